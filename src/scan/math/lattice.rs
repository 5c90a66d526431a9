//! Lattice points, ordered by distance.

use glam::{DVec3, IVec3};

/// Returns the offsets of a lattice of `step` (mm) within `reach_mm`, shortest first, along `axes` only.
///
/// Ties are ordered by z, then y, then x, lowest first, so the result is deterministic.
pub fn nearest_first(reach_mm: f64, step: f64, axes: IVec3) -> Vec<DVec3> {
    let n = axes * (reach_mm / step) as i32;
    let mut offsets: Vec<DVec3> = (-n.z..=n.z)
        .flat_map(|z| (-n.y..=n.y).flat_map(move |y| (-n.x..=n.x).map(move |x| IVec3::new(x, y, z))))
        .map(|o| o.as_dvec3() * step)
        .filter(|o| o.length() <= reach_mm)
        .collect();
    // The sort is stable: ties stay in lattice order.
    offsets.sort_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    offsets
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_there_are_and_in_order() {
        let solid = nearest_first(5.0, 0.5, IVec3::ONE);
        let flat = nearest_first(5.0, 0.5, IVec3::new(1, 1, 0));
        assert!(solid[0] == DVec3::ZERO && flat[0] == DVec3::ZERO);
        assert!(solid.windows(2).all(|w| w[0].length() <= w[1].length()));
        assert!((solid.len() as f64 / 4188.8 - 1.0).abs() < 0.02, "{}: the ball's volume", solid.len());
        assert!((flat.len() as f64 / 314.2 - 1.0).abs() < 0.02 && flat.iter().all(|o| o.z == 0.0), "{}", flat.len());
        assert_eq!(solid[1], DVec3::Z * -0.5);
    }
}
