//! Blood vessels under the mucosa: trees that grow over a tile of the plane, which repeats.

use std::collections::VecDeque;
use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DVec2, Vec2, Vec3};

use super::lanes::{LANES, Lanes};
use super::noise::{MOST, Noise, split_32};
use crate::math::hash::Stream;

/// Side of the tile, texels.
const SIDE: usize = 512;
/// A texel, mm. The tile is 51 mm wide.
const TEXEL_MM: f64 = 0.1;
/// Trunks along a side of the tile: one for every 10 mm.
const TRUNKS: usize = 5;
/// Step of growth, mm.
const STEP_MM: f64 = 0.1;
/// Vessels that are thinner are not seen, mm.
const THINNEST_MM: f64 = 0.05;

/// How much blood lies under each texel, 0 to 255, and how the colour varies there, 0 to 255.
#[derive(Debug)]
pub(super) struct Vessels(Box<[[[u8; 2]; SIDE]; SIDE]>);

/// The growing end of a vessel.
struct Tip {
    at: DVec2,
    /// Direction, radians, and how it bends, radians/mm.
    heading: f64,
    bend: f64,
    /// Radius, mm, and the length over which it goes to nothing, mm.
    radius: f64,
    length: f64,
    parent: u16,
}

impl Vessels {
    /// Grows the trees of a seed.
    pub(super) fn new(seed: u64) -> Self {
        let mut random = Stream::new(seed, 0x7E55E1);
        let width = SIDE as f64 * TEXEL_MM / TRUNKS as f64;
        let mut tips = VecDeque::new();
        for n in 0..TRUNKS * TRUNKS {
            let cell = DVec2::new((n % TRUNKS) as f64, (n / TRUNKS) as f64);
            let jitter = DVec2::new(random.within(0.1, 0.9), random.within(0.1, 0.9));
            let (heading, radius) = (random.within(0.0, TAU), random.within(0.12, 0.28));
            tips.push_back(Tip {
                at: (cell + jitter) * width,
                heading,
                bend: 0.0,
                radius,
                length: 110.0 * radius,
                parent: 0,
            });
        }
        let (mut tile, mut owners, mut own) = (Box::new([[0; SIDE]; SIDE]), vec![0u16; SIDE * SIDE], 0);
        while let Some(tip) = tips.pop_front() {
            own = u16::saturating_add(own, 1);
            grow(tip, own, (tile.as_flattened_mut(), &mut owners), &mut tips, &mut random);
        }
        let noise = Noise::new(random.within(0.0, 1e15) as u64);
        let mut pairs = Box::new([[[0; 2]; SIDE]; SIDE]);
        for (n, pair) in pairs.as_flattened_mut().iter_mut().enumerate() {
            // The noise repeats after 32 units: those across the tile, or four times as many, leave no seam.
            let at = Vec3::new((n % SIDE) as f32, (n / SIDE) as f32, 0.0) * (32.0 / SIDE as f32);
            let varied = 0.7 * noise.at(at).x + 0.3 * noise.at(at * 4.0).y;
            *pair = [tile.as_flattened()[n], (127.5 + 127.5 * varied) as u8];
        }
        Self(pairs)
    }

    /// Adds how much blood lies under sixteen points of the plane (mm), and how the colour varies there, 0 to 1, times the points' shares.
    #[inline(always)]
    pub(super) fn add(&self, place: &[Lanes; 2], share: &Lanes, to: &mut [Lanes; 2]) {
        let (mut texels, mut within) = ([[0; LANES]; 2], [[0.0; LANES]; 2]);
        for ((place, texels), within) in place.iter().zip(&mut texels).zip(&mut within) {
            for k in 0..LANES {
                let at = (place[k] * (1.0 / TEXEL_MM as f32)).clamp(-MOST, MOST);
                (texels[k], within[k]) = split_32(at, SIDE as u32);
            }
        }
        for k in (0..LANES).filter(|k| share[*k] > 0.0) {
            let [i, j] = [texels[0][k], texels[1][k]].map(|n| n as usize & (SIDE - 1));
            let (right, down) = ((i + 1) & (SIDE - 1), (j + 1) & (SIDE - 1));
            let row = |row: &[[u8; 2]; SIDE]| {
                let [a, b] = [row[i], row[right]].map(|[a, b]| Vec2::new(f32::from(a), f32::from(b)));
                a + (b - a) * within[0][k]
            };
            let (a, b) = (row(&self.0[j]), row(&self.0[down]));
            let near = (a + (b - a) * within[1][k]) * (share[k] * (1.0 / 255.0));
            (to[0][k], to[1][k]) = (to[0][k] + near.x, to[1][k] + near.y);
        }
    }
}

/// Grows a vessel until it is too thin or meets another, and adds its branches to `tips`.
fn grow(
    mut tip: Tip,
    own: u16,
    (tile, owners): (&mut [u8], &mut [u16]),
    tips: &mut VecDeque<Tip>,
    random: &mut Stream,
) {
    let first = tip.radius;
    let (mut grown, mut side, mut next) = (0.0, if random.within(0.0, 1.0) < 0.5 { 1.0 } else { -1.0 }, 0.0);
    // A trunk comes up from below: it begins as thin as it ends.
    let is_trunk = tip.parent == 0;
    let risen = |grown: f64| if is_trunk { (0.45 + 0.25 * grown).min(1.0) } else { 1.0 };
    tip.radius = first * risen(0.0);
    while tip.radius > THINNEST_MM {
        // Vessels wind, the thinner the more, and turn back to where they were going.
        let winding = 0.13 / first.sqrt();
        tip.bend += random.within(-winding, winding) - 0.12 * tip.bend;
        tip.heading += tip.bend * STEP_MM;
        let ahead = DVec2::from_angle(tip.heading);
        let met = owners[texel(tip.at + ahead * (tip.radius + 0.25))];
        if met != 0 && met != own && (met != tip.parent || grown > 1.5) {
            // A few join the vessel that they meet.
            if random.within(0.0, 1.0) < 0.6 {
                return;
            }
            for n in 0..6 {
                stamp(tip.at + ahead * (0.1 * f64::from(n)), tip.radius, own, (tile, owners));
            }
            return;
        }
        stamp(tip.at, tip.radius, own, (tile, owners));
        tip.at += ahead * STEP_MM;
        grown += STEP_MM;
        tip.radius = first * risen(grown) * (1.0 - 0.85 * grown / tip.length);
        if grown > next {
            if grown > 0.5 {
                let turn = random.within(0.25, 0.75) * FRAC_PI_2 * side;
                let radius = tip.radius * random.within(0.45, 0.85);
                let length = (tip.length - grown).max(4.0) * random.within(0.5, 0.95);
                let heading = tip.heading + turn;
                tips.push_back(Tip { at: tip.at, heading, bend: 0.0, radius, length, parent: own });
                // What is left of the vessel turns away from its branch.
                tip.heading -= 0.3 * turn;
            }
            next = grown + random.within(0.8, 3.2) * (0.4 + 3.5 * first);
            side *= if random.within(0.0, 1.0) < 0.75 { -1.0 } else { 1.0 };
        }
    }
}

/// Returns the texel at a place, mm.
fn texel(place: DVec2) -> usize {
    let [x, y] = (place / TEXEL_MM).to_array().map(|x| (x.floor() as i64).rem_euclid(SIDE as i64) as usize);
    x + SIDE * y
}

/// Draws a disc of a vessel whose edge is soft: the tissue above it scatters light.
fn stamp(at: DVec2, radius: f64, own: u16, (tile, owners): (&mut [u8], &mut [u16])) {
    let reach = radius + 0.12;
    let strength = 255.0 * (0.25 + 2.4 * radius).min(1.0);
    let texels = (reach / TEXEL_MM).ceil() as i64;
    for y in -texels..=texels {
        for x in -texels..=texels {
            let place = ((at / TEXEL_MM).floor() + DVec2::new(x as f64, y as f64) + 0.5) * TEXEL_MM;
            let share = 1.0 - place.distance(at) / reach;
            if share <= 0.0 {
                continue;
            }
            let n = texel(place);
            let blood = (strength * (1.8 * share).min(1.0)) as u8;
            tile[n] = tile[n].max(blood);
            if share * reach > 0.1 {
                owners[n] = own;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vessels_are_thin_and_everywhere_and_the_tile_has_no_seam() {
        let vessels = Vessels::new(5);
        let texels = vessels.0.as_flattened();
        let covered = texels.iter().filter(|v| v[0] > 40).count() as f64 / texels.len() as f64;
        assert!((0.05..0.4).contains(&covered), "{covered}");
        // No square of 13 mm is without a vessel.
        for block in 0..16 {
            let (x, y) = (block % 4 * 128, block / 4 * 128);
            assert!(vessels.0[y..y + 128].iter().any(|row| row[x..x + 128].iter().any(|v| v[0] > 80)), "{block}");
        }
        let width = (SIDE as f64 * TEXEL_MM) as f32;
        let at = |place: Vec2| {
            let mut near = [[0.0; LANES]; 2];
            vessels.add(&[[place.x; LANES], [place.y; LANES]], &[1.0; LANES], &mut near);
            Vec2::new(near[0][3], near[1][3])
        };
        for n in 0..500 {
            let p = Vec2::new(n as f32 * 0.37 - 90.0, 51.0 - n as f32 * 0.21);
            assert!((at(p) - at(p + Vec2::new(width, -width))).abs().max_element() < 0.02);
        }
        assert!(at(Vec2::splat(1e30)).is_finite() && at(Vec2::splat(f32::MIN)).is_finite());
    }
}
