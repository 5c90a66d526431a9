//! Textures: smooth noise, and the vessels of the lung.

use glam::DVec3;

use super::profile::mix;
use crate::math::hash;

/// Lung vessels: bright branching ridges on a dark background, with a standard deviation of about 70 HU.
pub(crate) fn lung_texture(seed: u64, p: DVec3, side: u64) -> f64 {
    let seed = hash::bits(seed, 0x1046 + side);
    let ridge = 1.0 - (2.0 * lattice(seed, p / 9.0) - 1.0).abs() * 3.0;
    let fine = lattice(seed ^ 1, p / 3.1) - 0.5;
    220.0 * ridge.max(0.0).powi(2) + 150.0 * fine - 40.0
}

/// Returns C2 value noise in [0, 1) on the unit lattice.
pub(crate) fn lattice(seed: u64, p: DVec3) -> f64 {
    let cell = p.floor();
    let t = p - cell;
    let w = t * t * t * (t * (t * 6.0 - DVec3::splat(15.0)) + DVec3::splat(10.0));
    let corner = |dx: i64, dy: i64, dz: i64| {
        let index = |c: f64, d: i64| ((c as i64 + d) as u64) & 0xF_FFFF;
        hash::uniform(seed, index(cell.x, dx) | index(cell.y, dy) << 20 | index(cell.z, dz) << 40)
    };
    let edge = |dy, dz| mix(corner(0, dy, dz), corner(1, dy, dz), w.x);
    mix(mix(edge(0, 0), edge(1, 0), w.y), mix(edge(0, 1), edge(1, 1), w.y), w.z)
}
