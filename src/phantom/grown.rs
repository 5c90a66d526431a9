//! What the wall belongs to at a place.

use glam::DVec3;

use super::Phantom;
use super::growth::Which;
use super::shape::WINDOW;
use super::solid::Surface;
use super::tag::Beside;

/// A place that is this far inside the lumen is on something that lies in it, mm: a level of fluid, or stool.
const AFLOAT_MM: f64 = 0.9;

/// What the wall belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum WallKind {
    /// The wall itself, haustra and taeniae included.
    Wall,
    /// A fold.
    Fold,
    /// A polyp, by its number in the ground truth, from 0.
    Polyp(usize),
    /// A strand of residue across the lumen.
    Bridge,
    /// A structure that looks like a polyp but is not.
    Decoy,
    /// The level of fluid, or a film of tag.
    Fluid,
    /// Stool.
    Stool,
}

impl Phantom {
    /// Returns what the wall belongs to at a place on it (world, mm): of all bodies that are joined there, the one that reaches farthest
    /// into the lumen. `None` far from the colon.
    pub fn wall_kind(&self, world: DVec3) -> Option<WallKind> {
        let mut deepest = (f64::INFINITY, None);
        let mut runs = Vec::new();
        self.runs_near(world, 0.1, &mut runs);
        for run in &runs {
            self.shape.axis.feet(world, run.clone(), &self.reach, |foot| {
                let d = self.shape.distances(world, &foot).wall;
                if d < deepest.0 {
                    deepest = (d, Some(foot));
                }
            });
        }
        let (mm, foot) = (deepest.0, deepest.1?);
        if mm < -AFLOAT_MM {
            let (distances, s) = self.distances_among(world, &runs);
            let beside = self.tag.as_ref().map_or(Beside::Fluid, |tag| tag.beside(world, s, &distances));
            return Some(if beside == Beside::Stool { WallKind::Stool } else { WallKind::Fluid });
        }
        let mut kind = WallKind::Wall;
        let mut base = Surface { d: self.shape.bare(&foot), normal: DVec3::ZERO };
        let mut take = |own: f64, what: WallKind| {
            if own > base.d {
                (base.d, kind) = (own, what);
            }
        };
        take(self.shape.to_folds(&foot), WallKind::Fold);
        for bridge in self.shape.bridges.iter().filter(|a| (a.s - foot.s).abs() < WINDOW) {
            take(bridge.what.surface(world).d, WallKind::Bridge);
        }
        for decoy in self.shape.decoys_near(foot.s) {
            let grown = decoy.grow_on(base_of(self, &foot), world).d;
            take(if grown > self.shape.to_wall(&foot) + 0.05 { grown } else { f64::NEG_INFINITY }, WallKind::Decoy);
        }
        for (n, which) in self.in_order().into_iter().enumerate() {
            let own = match which {
                Which::Ball(i) => {
                    let polyp = &self.shape.polyps[i];
                    let near = (polyp.s - foot.s).abs() < WINDOW;
                    near.then(|| Surface::about(polyp.what.position, 0.5 * polyp.what.diameter_mm, world).d)
                }
                Which::Lesion(i) => {
                    let lesion = &self.shape.lesions[i];
                    let near = (lesion.s - foot.s).abs() < WINDOW;
                    near.then(|| lesion.what.surface(base_of(self, &foot), world).d)
                }
            };
            take(own.unwrap_or(f64::NEG_INFINITY), WallKind::Polyp(n));
        }
        Some(kind)
    }
}

/// Returns the surface of the wall with its folds.
fn base_of(phantom: &Phantom, foot: &super::FootPoint) -> Surface {
    Surface { d: phantom.shape.to_wall(foot), normal: foot.offset.normalize_or_zero() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PhantomSettings, Size};

    /// Rays from the axis meet every kind, and where they meet a polyp is by a polyp.
    #[test]
    fn places_of_the_wall_are_told_by_what_they_belong_to() {
        let phantom = Phantom::new(&PhantomSettings { size: Size::Small, seed: 3, ..PhantomSettings::embedded(3) });
        let truth = phantom.truth();
        for (n, polyp) in truth.polyps.iter().enumerate() {
            // Its head, towards the axis.
            let axis = truth
                .centerline
                .iter()
                .min_by(|a, b| a.distance(polyp.position).total_cmp(&b.distance(polyp.position)));
            let towards = (*axis.unwrap() - polyp.position).normalize();
            let place = polyp.position + towards * 0.5 * polyp.diameter_mm;
            assert_eq!(phantom.wall_kind(place), Some(WallKind::Polyp(n)), "{polyp:?}");
        }
        let (mut folds, mut walls) = (0, 0);
        for (n, at) in truth.centerline.iter().enumerate().step_by(7) {
            let direction = DVec3::new((n as f64).sin(), (n as f64 * 1.7).cos(), 0.4).normalize();
            let Some(mm) = (1..400).map(|k| f64::from(k) * 0.1).find(|mm| phantom.wall(*at + direction * *mm) >= 0.0)
            else {
                continue;
            };
            match phantom.wall_kind(*at + direction * mm) {
                Some(WallKind::Fold) => folds += 1,
                Some(WallKind::Wall) => walls += 1,
                _ => {}
            }
        }
        assert!(folds > 5 && walls > 40, "{folds} folds, {walls} walls");
        assert_eq!(phantom.wall_kind(DVec3::splat(1e4)), None);
    }
}
