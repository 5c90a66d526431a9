//! Placement of lesions: drawn from the seed, within the space that a flight leaves.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3};

use super::ground::{Ground, Spot, Taken};
use super::lesions::{Lesion, PolypShape, PolypSite};
use super::pools::Pool;
use super::shape::{Attached, Fold, Shape};
use super::solid::{Ellipsoid, Rod};
use super::stream::stream;
use crate::math::hash;
use crate::math::hash::Stream;

/// Length of colon for each lesion, mm.
const EVERY_MM: f64 = 75.0;
/// Lesions keep this distance from the axis, mm.
const FROM_AXIS_MM: f64 = 5.0;
/// Largest lesion on a fold, mm.
const ON_FOLD_MM: f64 = 10.0;
/// Number of places tried for a lesion.
const TRIES: usize = 300;

/// The requested properties of a lesion.
#[derive(Clone, Copy, Debug)]
struct Wish {
    shape: PolypShape,
    site: PolypSite,
    diameter_mm: f64,
    /// Wholly under fluid.
    under: bool,
}

/// Places lesions in `shape`, away from what is `taken`, and adds them to it. `pools` hold fluid along `down`.
pub(crate) fn place(shape: &Shape, pools: &[Pool], down: DVec3, taken: &mut Taken, seed: u64) -> Vec<Attached<Lesion>> {
    let ground = Ground::new(shape);
    let mut lesions = Vec::new();
    for (i, wish) in wishes(shape.axis.length(), !pools.is_empty(), seed).into_iter().enumerate() {
        let draw = stream(seed, 1000 + i as u64);
        let mut place = Place { ground: &ground, pools, down, draw };
        if let Some(lesion) = place.find(wish, taken) {
            taken.take(lesion.what.balls());
            lesions.push(lesion);
        }
    }
    lesions.sort_by(|a, b| a.s.total_cmp(&b.s));
    lesions
}

/// Returns the requested lesions of a colon of `length` mm, largest first.
fn wishes(length: f64, has_pools: bool, seed: u64) -> Vec<Wish> {
    use PolypShape::{Flat, Sessile, Stalked};
    use PolypSite::{Between, Fold, Wall};
    let count = (length / EVERY_MM).round().max(1.0) as usize;
    let mut draw = stream(seed, 61);
    // Shares from 0 to 1, evenly spread and in an order of their own for each property.
    let mut spread = |stream: u64| {
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by_key(|&i| hash::bits(hash::bits(seed, 0x1E51 + stream), i as u64));
        order.into_iter().map(|i| (i as f64 + draw.within(0.0, 1.0)) / count as f64).collect::<Vec<_>>()
    };
    let log = |lo: f64, hi: f64, t: f64| lo * (hi / lo).powf(t);
    let size = |u: f64| match u {
        u if u < 0.3 => log(3.0, 5.9, u / 0.3),
        u if u < 0.7 => log(6.0, 9.9, (u - 0.3) / 0.4),
        u => log(10.0, 20.0, (u - 0.7) / 0.3),
    };
    let shapes = spread(0).into_iter().map(|u| [Sessile, Stalked, Flat][usize::from(u > 0.45) + usize::from(u > 0.75)]);
    let sites = spread(1).into_iter().map(|u| [Wall, Fold, Between][usize::from(u > 0.4) + usize::from(u > 0.7)]);
    let mut all: Vec<Wish> = (shapes.zip(sites).zip(spread(2)))
        .map(|((shape, site), u)| Wish { shape, site, diameter_mm: size(u), under: false })
        .collect();
    // What is too small for its shape changes sizes with a sessile one, and what is too large for a fold changes places.
    let least = smallest;
    for i in 0..count {
        if all[i].diameter_mm < least(all[i].shape) {
            let other = (0..count).find(|&j| all[j].shape == Sessile && all[j].diameter_mm >= least(all[i].shape));
            match other {
                Some(j) => (all[i].diameter_mm, all[j].diameter_mm) = (all[j].diameter_mm, all[i].diameter_mm),
                None => all[i].diameter_mm = least(all[i].shape),
            }
        }
    }
    for i in 0..count {
        let fits = |w: &Wish| w.diameter_mm <= ON_FOLD_MM;
        let other = (0..count).find(|&j| all[j].site != Fold && fits(&all[j]));
        if let Some(j) = other.filter(|_| all[i].site == Fold && !fits(&all[i])) {
            (all[i].site, all[j].site) = (all[j].site, Fold);
        }
    }
    if has_pools {
        all.iter_mut().filter(|w| w.shape != Flat).step_by(4).for_each(|w| w.under = true);
    }
    all.sort_by(|a, b| b.diameter_mm.total_cmp(&a.diameter_mm));
    all
}

/// The search for a place.
struct Place<'a> {
    ground: &'a Ground<'a>,
    pools: &'a [Pool],
    down: DVec3,
    draw: Stream,
}

impl Place<'_> {
    /// Finds a place that fits a wish, or else one without fluid, a smaller lesion, or one on the plain wall.
    fn find(&mut self, wish: Wish, taken: &Taken) -> Option<Attached<Lesion>> {
        let dry = Wish { under: false, ..wish };
        let smaller = |w: Wish, share: f64| Wish { diameter_mm: (w.diameter_mm * share).max(smallest(w.shape)), ..w };
        let elsewhere = |site| Wish { site, ..dry };
        let steps =
            [wish, smaller(wish, 0.75), dry, smaller(dry, 0.85), elsewhere(PolypSite::Wall), smaller(dry, 0.65)];
        let last = [0.8, 0.65, 0.5, 0.4, 0.3].map(|share| smaller(elsewhere(PolypSite::Wall), share));
        steps.into_iter().chain(last).find_map(|wish| (0..TRIES).find_map(|_| self.attempt(wish, taken)))
    }

    /// Tries one place.
    fn attempt(&mut self, wish: Wish, taken: &Taken) -> Option<Attached<Lesion>> {
        let end = self.ground.shape.axis.length();
        // Under fluid, a place is beneath the axis.
        let (from, to) = if wish.under {
            let pool = &self.pools[(self.draw.within(0.0, self.pools.len() as f64) as usize).min(self.pools.len() - 1)];
            (pool.from.max(15.0), pool.to.min(end - 15.0))
        } else {
            (15.0, end - 15.0)
        };
        let s = self.draw.within(from.min(to), to);
        let turn = self.draw.within(-1.0, 1.0);
        let side = if self.draw.within(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
        let form = Form::drawn(&mut self.draw);
        let axis = &self.ground.shape.axis;
        let beneath = |s: f64| axis.frame(s).angle(self.down) + 0.7 * turn;
        if wish.site == PolypSite::Wall {
            let phi = if wish.under { beneath(s) } else { PI * turn };
            let spot = self.ground.spot(s, phi)?;
            return self.grown(wish, &form, spot, taken);
        }
        let near = |f: &&Fold| !f.sheet && f.depth > 5.0 && f.s >= s - 15.0;
        let fold = self.ground.shape.folds.iter().find(near)?;
        let phi = if wish.under { beneath(fold.s) } else { fold.phi + 0.6 * fold.half_width * turn };
        let height = fold.height(phi);
        if height < 0.5 * fold.depth {
            return None;
        }
        if wish.site == PolypSite::Fold {
            let spot = self.on_fold(fold, phi, side, wish)?;
            return self.grown(wish, &form, spot, taken);
        }
        // Farther and farther from the fold, until the gap is as wide as requested.
        let gap = form.gap;
        (0..80)
            .find_map(|i| {
                let spot =
                    self.ground.spot(fold.line(phi) + side * (0.5 * fold.thickness + 0.25 * f64::from(i)), phi)?;
                let lesion = self.lesion(wish, &form, &spot)?;
                (self.to_folds(&lesion, spot.s) <= -gap).then_some(spot)
            })
            .and_then(|spot| self.grown(wish, &form, spot, taken))
    }

    /// Returns a place on a fold at angle `phi`: on its edge if there is room, else on its flank on one `side`.
    fn on_fold(&self, fold: &Fold, phi: f64, side: f64, wish: Wish) -> Option<Spot> {
        let (height, line) = (fold.height(phi), fold.line(phi));
        let room = fold.radius - height - FROM_AXIS_MM;
        let needed = match wish.shape {
            PolypShape::Sessile => 0.75 * wish.diameter_mm,
            PolypShape::Stalked => wish.diameter_mm + 3.0,
            PolypShape::Flat => f64::INFINITY,
        };
        let axis = &self.ground.shape.axis;
        let spot = if needed <= room {
            self.ground.spot(line, phi)
        } else {
            let from = axis.frame((line + side * 9.0).clamp(0.0, axis.length()));
            let start = from.at + from.direction(phi) * (fold.radius - 0.5 * height);
            self.ground.cast(start, from.tangent * -side, line)
        }?;
        let on_it = self.ground.shape.to_folds(&self.ground.foot(spot.at, spot.s)?) > -0.3;
        on_it.then_some(spot)
    }

    /// Returns the lesion that grows at `spot`, if it has room and is as requested.
    fn grown(&self, wish: Wish, form: &Form, spot: Spot, taken: &Taken) -> Option<Attached<Lesion>> {
        let lesion = self.lesion(wish, form, &spot)?;
        let fits = taken.has_room_for(&lesion.balls())
            && self.leaves_a_way(&lesion, &spot)
            && self.is_as_wished(&lesion, &spot, wish)
            && (wish.shape == PolypShape::Flat || wish.under == self.is_under(&lesion, &spot));
        fits.then_some(Attached { s: spot.s, what: lesion })
    }

    /// Returns a lesion at `spot`.
    fn lesion(&self, wish: Wish, form: &Form, spot: &Spot) -> Option<Lesion> {
        let radius = 0.5 * wish.diameter_mm;
        let (side, other) = spot.up.any_orthonormal_pair();
        let x = side * form.spin.cos() + other * form.spin.sin();
        let axes = |up: DVec3| {
            let x = (x - up * x.dot(up)).normalize();
            DMat3::from_cols(x, up.cross(x), up)
        };
        let Wish { shape, site, .. } = wish;
        let root = spot.at;
        let (head, stem) = match shape {
            PolypShape::Flat => {
                let radii = DVec3::new(radius, radius / form.longer, form.height);
                (Ellipsoid { centre: root, axes: axes(spot.up), radii }, None)
            }
            PolypShape::Sessile => {
                let radii = DVec3::new(1.0, form.ratios[0], form.ratios[1]) * radius;
                // On a fold's flank, it must not come out on the other side.
                let lift = if site == PolypSite::Fold { form.lift.max(0.4) } else { form.lift };
                let centre = root + spot.up * (lift * radii.z);
                let core = if site == PolypSite::Fold {
                    Rod { from: centre, to: root, radius: 0.4 * radii.min_element() }
                } else {
                    Rod { from: centre, to: root - spot.up, radius: 0.7 * radii.min_element() }
                };
                (Ellipsoid { centre, axes: axes(spot.up), radii }, Some(core))
            }
            PolypShape::Stalked => {
                let along = spot.up * form.tilt.cos() + x * form.tilt.sin();
                let radii = DVec3::new(1.0, form.ratios[0].max(0.88), form.ratios[1].max(0.88)) * radius;
                let clear = |t: f64| {
                    let centre = root + along * t;
                    let d = if site == PolypSite::Between {
                        self.plain(centre, spot.s)
                    } else {
                        self.to_wall(centre, spot.s)
                    };
                    d.is_some_and(|d| -d - radius >= form.clear)
                };
                let first = radius + form.clear;
                let t = (0..40).map(|i| first + 0.2 * f64::from(i)).find(|t| clear(*t))?;
                let stem =
                    Rod { from: root - along * 2.0, to: root + along * t, radius: (form.stem * radius).max(1.25) };
                (Ellipsoid { centre: stem.to, axes: axes(along), radii }, Some(stem))
            }
        };
        Some(Lesion { shape, site, head, stem, root })
    }

    fn to_wall(&self, p: DVec3, s: f64) -> Option<f64> {
        self.ground.foot(p, s).map(|foot| self.ground.shape.to_wall(&foot))
    }

    fn plain(&self, p: DVec3, s: f64) -> Option<f64> {
        self.ground.foot(p, s).map(|foot| self.ground.shape.distances(p, &foot).plain)
    }

    /// Returns the signed distance of a lesion's head to the nearest fold's face, mm: 0 or more if they meet in the lumen.
    fn to_folds(&self, lesion: &Lesion, s: f64) -> f64 {
        let mut most = f64::NEG_INFINITY;
        for p in lesion.head.points(60) {
            if let Some(foot) = self.ground.foot(p, s).filter(|f| self.ground.shape.distances(p, f).plain < 0.3) {
                most = most.max(self.ground.shape.to_folds(&foot));
            }
        }
        most
    }

    /// Returns true if a flight gets past a lesion, and what should be in the lumen is.
    fn leaves_a_way(&self, lesion: &Lesion, spot: &Spot) -> bool {
        let own = |p: DVec3| match lesion.stem {
            Some(stem) => lesion.head.surface(p).or(stem.surface(p)),
            None => lesion.head.surface(p),
        };
        if self.ground.clear_of_axis(spot.s, own) < FROM_AXIS_MM {
            return false;
        }
        let Ellipsoid { centre, axes, radii } = lesion.head;
        let d = |p: DVec3| self.to_wall(p, spot.s).unwrap_or(1.0);
        match lesion.shape {
            // The base may be bent, but not so much that the plaque goes around an edge.
            PolypShape::Flat => (0..8).all(|i| {
                let (sin, cos) = (TAU * f64::from(i) / 8.0).sin_cos();
                d(centre + axes * (DVec3::new(cos, sin, 0.0) * radii)).abs() < 0.35 * radii.x
            }),
            PolypShape::Sessile => {
                lesion.head.points(40).filter(|p| (*p - centre).dot(spot.up) > 0.4 * radii.z).all(|p| d(p) < -0.3)
            }
            PolypShape::Stalked => {
                lesion.head.points(40).all(|p| d(p) < if lesion.site == PolypSite::Between { -0.2 } else { -2.5 })
            }
        }
    }

    fn is_as_wished(&self, lesion: &Lesion, spot: &Spot, wish: Wish) -> bool {
        match wish.site {
            PolypSite::Wall => {
                self.to_folds(lesion, spot.s) < -3.0
                    && self.ground.foot(spot.at, spot.s).is_some_and(|f| self.ground.shape.to_folds(&f) < -3.0)
            }
            PolypSite::Fold => true,
            PolypSite::Between => (-2.0..0.0).contains(&self.to_folds(lesion, spot.s)),
        }
    }

    /// Returns true if all of a lesion that is in the lumen is under fluid.
    fn is_under(&self, lesion: &Lesion, spot: &Spot) -> bool {
        let level = self.pools.iter().find(|p| (p.from..=p.to).contains(&spot.s)).map(|p| p.level + 0.5);
        level.is_some_and(|level| {
            let in_lumen = lesion.head.points(40).filter(|p| (*p - spot.at).dot(spot.up) > -0.5);
            in_lumen.map(|p| p.dot(self.down)).all(|depth| depth > level)
        })
    }
}

/// What varies between lesions of one shape and size.
struct Form {
    /// Lengths of a head's second and third axes, relative to the first.
    ratios: [f64; 2],
    /// Distance of a sessile one's centre from the surface, in radii.
    lift: f64,
    /// Angle about the normal.
    spin: f64,
    /// Inclination of a stalk.
    tilt: f64,
    /// Distance between a stalked head and the wall, mm.
    clear: f64,
    /// Diameter of a stalk, relative to the head's.
    stem: f64,
    /// Height of a flat one, mm, and its length relative to its width.
    height: f64,
    longer: f64,
    /// Gap between a lesion and a fold beside it, mm.
    gap: f64,
}

impl Form {
    fn drawn(draw: &mut Stream) -> Self {
        let ball = draw.within(0.0, 1.0) < 0.4;
        let ratios = [draw.within(0.8, 1.0), draw.within(0.8, 1.0)];
        Self {
            ratios: if ball { [1.0, 1.0] } else { ratios },
            lift: draw.within(0.2, 0.5),
            spin: draw.within(0.0, TAU),
            tilt: draw.within(0.0, 50f64).to_radians(),
            clear: draw.within(3.0, 5.5),
            stem: draw.within(0.3, 0.5),
            height: draw.within(1.3, 2.9),
            longer: draw.within(1.0, 1.4),
            gap: draw.within(0.2, 1.5),
        }
    }
}

fn smallest(shape: PolypShape) -> f64 {
    match shape {
        PolypShape::Sessile => 3.0,
        PolypShape::Stalked => 5.0,
        PolypShape::Flat => 6.0,
    }
}
