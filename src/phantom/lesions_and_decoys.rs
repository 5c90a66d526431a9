//! Placement of lesions and decoys, away from each other.

use super::ground::Taken;
use super::pools::Pool;
use super::shape::Shape;
use super::tag::Tag;
use super::touching::Touching;
use super::{PhantomSettings, decoy_placing, placing};

/// Adds lesions and decoys to a colon with these polyps, tag and pools, away from each other.
pub(crate) fn place(shape: &mut Shape, settings: &PhantomSettings, tag: Option<&Tag>, pools: &[Pool]) {
    let (seed, down) = (settings.seed, settings.position.down());
    let mut taken = Taken::default();
    taken.take(shape.polyps.iter().map(|a| (a.what.position, 0.5 * a.what.diameter_mm)));
    taken.take(decoy_placing::reserved(shape, seed));
    for c in &shape.collapsed {
        let places = (0..=20).map(|i| c.from - c.taper + (c.to - c.from + 2.0 * c.taper) * f64::from(i) / 20.0);
        let balls = places.map(|s| (shape.axis.frame(s).at, shape.largest_radius(s) - 8.0)).collect::<Vec<_>>();
        taken.take(balls);
    }
    taken.take(shape.touching.iter().map(Touching::ball));
    if let Some(tag) = tag {
        taken.take(tag.lumps().map(|lump| (lump.position, 0.5 * lump.diameter_mm)));
    }
    if settings.lesions {
        let pools = tag.map_or_else(|| pools.to_vec(), Tag::pools);
        shape.lesions = placing::place(shape, &pools, down, &mut taken, seed);
    }
    if settings.decoys {
        decoy_placing::place(shape, down, &mut taken, seed);
    }
}
