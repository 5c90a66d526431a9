//! Places of one colon in the other.

use glam::DVec3;

use super::{Matching, Paired};
use crate::fields::Lumen;
use crate::fields::frames::{Frame, STEP_MM};

/// A wall is sought as far as this from the line, mm.
const FAR_MM: f64 = 60.0;
/// Step of that search, mm.
const RAY_MM: f64 = 0.25;
/// Limits of the ratio of two radii by which a place moves nearer to the line or away from it.
const RATIO: [f64; 2] = [0.3, 2.0];

/// One of the two colons.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The first, `A`.
    A,
    /// The second, `B`.
    B,
}

impl Side {
    /// Returns the other one.
    pub fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }
}

/// A place of the other colon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Distance along the other colon, mm.
    pub along_mm: f64,
    /// The place is within this of it along the colon, with a probability of 90 %, mm.
    pub uncertainty_mm: f64,
    /// How sure the direction from the line is: 0 (any) to 1.
    pub sure: f64,
    /// True if either colon is collapsed there.
    pub is_gap: bool,
    /// Frame of the other line.
    frame: Frame,
    /// Angle about it, radians.
    angle: f64,
}

impl Match {
    /// Returns the point of the other line, world mm.
    pub fn on_line(&self) -> DVec3 {
        self.frame.at
    }

    /// Returns the unit direction from the line towards the wall, world.
    pub fn towards(&self) -> DVec3 {
        self.frame.direction(self.angle)
    }

    /// Returns the place of the wall of `lumen`, the other colon's, world mm: where a line from its centerline leaves it.
    pub fn on_wall(&self, lumen: &Lumen) -> DVec3 {
        wall(lumen, self.on_line(), self.towards())
    }
}

/// Returns where a line from a point leaves a lumen, world mm.
fn wall(lumen: &Lumen, from: DVec3, towards: DVec3) -> DVec3 {
    let is_inside = |p: DVec3| lumen.segment_at(p).is_some() || lumen.is_fluid(p);
    let mut reach = 0.0;
    while reach < FAR_MM && is_inside(from + towards * (reach + RAY_MM)) {
        reach += RAY_MM;
    }
    from + towards * (reach + 0.5 * RAY_MM)
}

/// A camera, or any body with a direction, of one colon as it is in the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Posed {
    /// Position, world mm.
    pub position: DVec3,
    /// Unit view direction.
    pub forward: DVec3,
    /// Unit up direction.
    pub up: DVec3,
}

impl Matching {
    /// Returns what in the other colon belongs to a place of one (world, mm) that is `along_mm` along its line. `None` if that is no
    /// number or no line.
    pub fn place(&self, from: Side, place: DVec3, along_mm: f64) -> Option<Match> {
        let (own_mm, other_mm, pair) = self.rows_of(from, along_mm)?;
        let frame = self.walls[from as usize].frame(own_mm)?;
        let turn = self.turn(from, &pair);
        self.at(from, own_mm, other_mm, &pair, frame.angle(place - frame.at) + turn)
    }

    /// Returns points of the other colon's wall (world, mm) over the stretch where the place lies with a probability of 90 %, from the
    /// rectum, at most `step_mm` apart along its line.
    pub fn stretch(&self, to: Side, found: &Match, lumen: &Lumen, step_mm: f64) -> Vec<DVec3> {
        let walls = &self.walls[to as usize];
        let middle = self.rectal_mm(to, found.along_mm);
        let length = self.lengths_mm[to as usize];
        let reach = found.uncertainty_mm.clamp(0.0, length);
        let [low, high] = [middle - reach, middle + reach].map(|mm| mm.clamp(0.0, length));
        let count = ((high - low) / step_mm.max(0.1)).ceil().max(1.0) as usize;
        let point = |n: usize| {
            let frame = walls.frame(low + (high - low) * n as f64 / count as f64)?;
            Some(wall(lumen, frame.at, frame.direction(found.angle)))
        };
        (0..=count).filter_map(point).collect()
    }

    /// Returns a camera of one colon, `along_mm` along its line, as it stands in the other: as far along, turned with the wall, and as
    /// near to the wall in proportion.
    pub fn camera(&self, from: Side, camera: Posed, along_mm: f64) -> Option<(Posed, Match)> {
        let (own_mm, other_mm, pair) = self.rows_of(from, along_mm)?;
        let (own, other) = (&self.walls[from as usize], &self.walls[from.other() as usize]);
        let (frame, there) = (own.frame(own_mm)?, other.frame(other_mm)?);
        let turn = self.turn(from, &pair);
        let turned = |d: DVec3| {
            let (c, (sin, cos)) = (frame.components(d), turn.sin_cos());
            there.of_components(DVec3::new(c.x * cos - c.y * sin, c.x * sin + c.y * cos, c.z))
        };
        let away = camera.position - frame.at;
        let angle = frame.angle(away);
        let ratio = other.radius_at(other_mm, angle + turn) / own.radius_at(own_mm, angle).max(1e-3);
        let position = there.at + turned(away) * ratio.clamp(RATIO[0], RATIO[1]);
        let found = self.at(from, own_mm, other_mm, &pair, angle + turn)?;
        Some((Posed { position, forward: turned(camera.forward), up: turned(camera.up) }, found))
    }

    /// Returns distances from both rectums that belong together, of one that is `along_mm` along its line, and the pair.
    fn rows_of(&self, from: Side, along_mm: f64) -> Option<(f64, f64, Paired)> {
        let own_mm = self.rectal_mm(from, Some(along_mm).filter(|mm| mm.is_finite())?);
        if from == Side::A {
            let pair = self.paired_at(own_mm);
            return Some((own_mm, self.in_second(pair.row), pair));
        }
        let row = own_mm / STEP_MM;
        let at = self.paired.partition_point(|p| p.row < row);
        // Rows of `A` that have the same median count alike.
        let same = self.paired.partition_point(|p| p.row <= row).max(at + 1);
        let (low, high) = (at.saturating_sub(1), same.min(self.paired.len()).checked_sub(1)?);
        let (before, after) = (self.paired.get(low)?, self.paired.get(high)?);
        let share =
            if after.row > before.row { ((row - before.row) / (after.row - before.row)).clamp(0.0, 1.0) } else { 0.5 };
        let a_mm = (low as f64 + share * (high - low) as f64) * STEP_MM;
        Some((own_mm, a_mm, self.paired_at(a_mm)))
    }

    /// Returns the turn from one colon to the other, radians.
    fn turn(&self, from: Side, pair: &Paired) -> f64 {
        if from == Side::A { pair.turn } else { -pair.turn }
    }

    /// Returns a distance from the rectum of one along its line, and the reverse.
    fn rectal_mm(&self, side: Side, mm: f64) -> f64 {
        if side == Side::B { self.own(mm) } else { mm }
    }

    fn at(&self, from: Side, own_mm: f64, other_mm: f64, pair: &Paired, angle: f64) -> Option<Match> {
        let to = from.other();
        let within = |side: Side, mm: f64| {
            let along_mm = self.rectal_mm(side, mm);
            self.gaps[side as usize].iter().any(|[a, b]| (*a..=*b).contains(&along_mm))
        };
        Some(Match {
            along_mm: self.rectal_mm(to, other_mm),
            uncertainty_mm: pair.uncertain * STEP_MM,
            sure: pair.sure,
            is_gap: within(from, own_mm) || within(to, other_mm),
            frame: self.walls[to as usize].frame(other_mm)?,
            angle,
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::fields::matching::image::WallImage;
    use crate::volume::Grid;

    /// Two straight tubes: the second twice as long and as wide, turned by a right angle, and along x instead of z.
    fn tubes(is_reversed: bool) -> Matching {
        let wall = |rows: usize, tangent: DVec3, normal: DVec3, radius: f32| WallImage {
            frames: (0..rows).map(|n| Frame { at: tangent * (n as f64 * STEP_MM), tangent, normal }).collect(),
            radius_mm: vec![radius; rows * 32],
            is_open: vec![true; rows],
        };
        let walls = [wall(51, DVec3::Z, DVec3::X, 10.0), wall(101, DVec3::X, DVec3::Y, 20.0)];
        let pair =
            |n: usize| Paired { row: 2.0 * n as f64, uncertain: 3.0, turn: std::f64::consts::FRAC_PI_2, sure: 0.9 };
        let paired = (0..51).map(pair).collect();
        Matching { walls, paired, lengths_mm: [100.0, 200.0], gaps: [vec![[20.0, 30.0]], Vec::new()], is_reversed }
    }

    #[test]
    fn a_place_is_found_in_the_other_and_back() {
        for is_reversed in [false, true] {
            let matching = tubes(is_reversed);
            for (x, y, z) in [(5.0, 0.0, 50.0), (0.0, -3.0, 7.3), (-2.0, 2.0, 99.0), (1.0, 1.0, 0.0)] {
                let camera = Posed { position: DVec3::new(x, y, z), forward: DVec3::Z, up: DVec3::X };
                let (there, found) = matching.camera(Side::A, camera, z).unwrap();
                let along_mm = if is_reversed { 200.0 - 2.0 * z } else { 2.0 * z };
                assert!((found.along_mm - along_mm).abs() < 1e-9 && found.uncertainty_mm == 6.0, "{found:?}");
                // Angle 0 is x in the first and y in the second; a right angle further is z, which is x × y.
                assert!((there.position - DVec3::new(2.0 * z, -2.0 * y, 2.0 * x)).length() < 1e-9, "{there:?}");
                assert!((there.forward - DVec3::X).length() < 1e-12 && (there.up - DVec3::Z).length() < 1e-12);
                let (back, own) = matching.camera(Side::B, there, found.along_mm).unwrap();
                assert!((back.position - camera.position).length() < 1e-6 && (own.along_mm - z).abs() < 1e-6);
                assert!((back.forward - camera.forward).length() < 1e-9 && (back.up - camera.up).length() < 1e-9);
                assert_eq!(found.is_gap, (20.0..=30.0).contains(&z));
            }
        }
        assert!(tubes(false).place(Side::A, DVec3::X, 25.0).unwrap().is_gap);
    }

    #[test]
    fn a_stretch_is_as_long_as_the_uncertainty() {
        let matching = tubes(false);
        let grid = Grid::new([4; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let none = Lumen::none(&grid);
        let found = matching.place(Side::A, DVec3::new(1.0, 0.0, 50.0), 50.0).unwrap();
        assert!((found.towards() - DVec3::Z).length() < 1e-12 && (found.on_line() - DVec3::X * 100.0).length() < 1e-9);
        let points = matching.stretch(Side::B, &found, &none, 4.0);
        assert!((points[0].x - 94.0).abs() < 1e-9 && (points[points.len() - 1].x - 106.0).abs() < 1e-9, "{points:?}");
        assert!(matching.place(Side::A, DVec3::ZERO, f64::NAN).is_none());
        for mm in [-50.0, 1e9] {
            let at_end = matching.place(Side::B, DVec3::ZERO, mm).unwrap();
            assert!(matching.stretch(Side::A, &at_end, &none, 1.0).iter().all(|p| p.is_finite()));
        }
    }
}
