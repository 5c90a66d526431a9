//! The ileocecal valve, and its place.

use glam::{DMat3, DVec3};

use super::ground::{Ground, Spot};
use super::shape::Shape;
use super::solid::Plate;
use super::stream::stream;

/// The ileocecal valve: two lips on the colon's medial wall, and the slit between them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Valve {
    /// The place on the plain wall.
    pub spot: Spot,
    /// The lips, as one body of tissue.
    pub lips: Plate,
    /// The slit, if it is open.
    pub slit: Option<Plate>,
    /// Distance of the mouth from the plain wall, mm.
    pub height: f64,
}

/// Returns the valve of a colon: open for odd seeds.
pub(crate) fn valve(shape: &Shape, seed: u64) -> Option<Valve> {
    let spot = valve_spot(&Ground::new(shape))?;
    let frame = shape.axis.frame(spot.s);
    let small = shape.axis.length() < 1000.0;
    let share = if small { 0.85 } else { 1.0 };
    let wide = stream(seed, 97).within(3.2, if small { 4.2 } else { 5.6 });
    let across = (frame.tangent - spot.up * frame.tangent.dot(spot.up)).normalize();
    let axes = DMat3::from_cols(across.cross(spot.up), across, spot.up);
    let height = 6.0 * share;
    let lips = Plate { foot: spot.at, axes, size: DVec3::new(23.0, 11.0, 6.0) * share + DVec3::new(0.0, wide, 0.0) };
    // A plate begins 4 mm below its foot, and there the ileum is.
    let slit = Plate { foot: spot.at, axes, size: DVec3::new(10.0 * share + 1.0, wide, height + 2.0) };
    Some(Valve { spot, lips, slit: (seed % 2 == 1).then_some(slit), height })
}

/// Returns the place of the valve: on the medial side, about 50 mm from the cecal end (of an adult's cecum).
pub(crate) fn valve_spot(ground: &Ground<'_>) -> Option<Spot> {
    let axis = &ground.shape.axis;
    let end = axis.length();
    let from_end = if end > 1000.0 { 32.0 } else { 22.0 };
    // The place on the plain wall within 10 mm that is farthest from a fold.
    let place = |i: i32| {
        let s = end - from_end + f64::from(i);
        let spot = ground.spot(s, axis.frame(s).angle(DVec3::X))?;
        Some((ground.shape.to_folds(&ground.foot(spot.at, s)?), spot))
    };
    (-10..=10).filter_map(place).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, spot)| spot)
}
