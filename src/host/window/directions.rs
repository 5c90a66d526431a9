//! Directions of the patient (left, front, head) in the view.

use glam::DVec3;

use crate::dynamics::Attitude;

/// An axis counts if the direction's component along it is at least this: less than 67.5° off.
const COUNTS: f64 = 0.382_683_432_365_089_8;

/// Returns the letters of a world direction (LPS): `L`eft and `R`ight, `P`osterior and `A`nterior, `S`uperior and `I`nferior of
/// the patient. The largest component comes first, as on radiological images.
pub(crate) fn letters(direction: DVec3) -> String {
    let mut parts: Vec<(f64, char)> = [(direction.x, 'L', 'R'), (direction.y, 'P', 'A'), (direction.z, 'S', 'I')]
        .into_iter()
        .map(|(c, plus, minus)| (c.abs(), if c > 0.0 { plus } else { minus }))
        .filter(|p| p.0 >= COUNTS * direction.length() && p.0 > 0.0)
        .collect();
    parts.sort_by(|a, b| b.0.total_cmp(&a.0));
    parts.into_iter().map(|p| p.1).collect()
}

/// The patient's directions at the edges of a view.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Directions {
    /// At the left edge.
    pub left: String,
    /// At the right edge.
    pub right: String,
    /// At the top.
    pub top: String,
    /// At the bottom.
    pub bottom: String,
    /// Ahead.
    pub ahead: String,
}

impl Directions {
    /// Returns the directions for a view from `attitude`, world.
    pub(crate) fn of(attitude: &Attitude) -> Self {
        let right = attitude.right();
        Self {
            left: letters(-right),
            right: letters(right),
            top: letters(attitude.up),
            bottom: letters(-attitude.up),
            ahead: letters(attitude.forward),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(forward: DVec3, up: DVec3) -> [String; 5] {
        let d = Directions::of(&Attitude::new(forward, up));
        [d.left, d.right, d.top, d.bottom, d.ahead]
    }

    #[test]
    fn views_a_radiologist_knows() {
        // From the feet, the patient's front on top: an axial slice. The patient's left is on the right.
        assert_eq!(of(DVec3::Z, DVec3::NEG_Y), ["R", "L", "A", "P", "S"]);
        // From the front, head on top: a coronal slice.
        assert_eq!(of(DVec3::Y, DVec3::Z), ["R", "L", "S", "I", "P"]);
        // From the patient's left, head on top: a sagittal slice. The front is on the left.
        assert_eq!(of(DVec3::NEG_X, DVec3::Z), ["A", "P", "S", "I", "R"]);
        // Down from the head, the front on top: mirrored compared with the first.
        assert_eq!(of(DVec3::NEG_Z, DVec3::NEG_Y), ["L", "R", "A", "P", "I"]);
    }

    #[test]
    fn oblique_directions_name_what_counts_most_first() {
        assert_eq!(letters(DVec3::new(1.0, -0.9, 0.1)), "LA");
        assert_eq!(letters(DVec3::new(-0.5, 0.0, -1.0)), "IR");
        assert_eq!(letters(DVec3::new(0.3, 0.0, 1.0)), "S");
        assert_eq!(letters(DVec3::new(3.0, 2.9, 2.8)), "LPS");
        assert_eq!(letters(DVec3::ZERO), "");
    }
}
