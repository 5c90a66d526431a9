//! The kind of trap that a flight is caught in, recognised from its tentacles (paper, sections 3.1.1 and 3.2: *both cases
//! should be detected and operator intervention should be called for*).

use glam::DVec3;

use super::monitor::StallKind;

/// A kind of trap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Trap {
    /// The lumen is closed ahead.
    BlindEnd,
    /// The lumen is open ahead, but the forces balance.
    LocalMinimum,
    /// The lumen continues, but the body does not fit through.
    Narrow,
    /// Something thin blocks the view, with lumen on both sides of it.
    Bridge,
    /// Something on one side fills the view: a polyp or a fold.
    Obstacle,
    /// Two directions, or two forces, take turns.
    Dithering,
    /// The flight came back to its own trail and goes in circles.
    Circling,
    /// The flight turned back, and no tentacle reading explains it.
    TurnedBack,
    /// A guide without tentacles hangs in place.
    Stuck,
}

impl Trap {
    /// Returns the text for the operator.
    pub fn text(self) -> &'static str {
        match self {
            Self::BlindEnd => "blocked: a blind end",
            Self::LocalMinimum => "confused: the forces balance in a local minimum, though the lumen is open ahead",
            Self::Narrow => "blocked: the lumen is narrower than the camera",
            Self::Bridge => "confused: a bridge across the view",
            Self::Obstacle => "confused: a polyp or fold fills the view",
            Self::Dithering => "confused: dithering between two directions",
            Self::Circling => "confused: circling over its own trail",
            Self::TurnedBack => "blocked: the guide turned back over its own trail",
            Self::Stuck => "blocked: the guide makes no progress",
        }
    }
}

/// The readings of the tentacles at a position.
#[derive(Clone, Copy, Debug)]
pub struct TentacleReading<'a> {
    /// Unit directions of the tentacles.
    pub directions: &'a [DVec3],
    /// Lengths of the tentacles, mm.
    pub lengths: &'a [f64],
    /// Unit heading: the direction in which the body has been moving; zero if it has not moved.
    pub heading: DVec3,
    /// The body's radius, mm.
    pub radius_mm: f64,
}

/// Cosine of the angle to the heading within which directions count as ahead: 75°.
const AHEAD: f64 = 0.26;
/// Absolute cosine below which directions count as sideways: 60° to 120° from the heading.
const SIDE: f64 = 0.5;
/// The lumen is closed if it reaches ahead by no more than the first multiple of its half-width, or no more than the
/// second if nothing blocks the view.
const CLOSED: (f64, f64) = (1.6, 2.5);
/// Whatever blocks the view is an obstacle if it is nearer than this share of the distance beyond it.
const NEAR: f64 = 0.5;
/// A tentacle of at least this share of the longest counts as another direction.
const LONG: f64 = 0.6;
/// Slack on the gap that a body of its radius needs, mm: tentacles are spaced apart and walls are rough.
const SLACK_MM: f64 = 0.5;

impl TentacleReading<'_> {
    fn ahead(&self) -> impl Iterator<Item = (DVec3, f64)> + Clone + '_ {
        self.all().filter(|(d, _)| self.heading.dot(*d) > AHEAD)
    }

    fn all(&self) -> impl Iterator<Item = (DVec3, f64)> + Clone + '_ {
        self.directions.iter().copied().zip(self.lengths.iter().copied())
    }

    /// Returns the direction and length (mm) of the longest tentacle for which `keep` is true; zero if there is none.
    pub fn longest(&self, keep: impl Fn(DVec3) -> bool) -> (DVec3, f64) {
        let longest = self.all().filter(|(d, _)| keep(*d)).max_by(|a, b| a.1.total_cmp(&b.1));
        longest.unwrap_or((DVec3::ZERO, 0.0))
    }

    /// Returns the longest tentacle that points ahead.
    pub fn opening(&self) -> (DVec3, f64) {
        self.longest(|d| self.heading.dot(d) > AHEAD)
    }

    /// Returns half the width of the lumen across the heading, mm: the median of the sideways tentacles.
    pub fn half_width(&self) -> f64 {
        let mut sides: Vec<f64> =
            self.all().filter(|(d, _)| self.heading.dot(*d).abs() < SIDE).map(|(_, l)| l).collect();
        sides.sort_by(f64::total_cmp);
        sides.get(sides.len() / 2).copied().unwrap_or(0.0)
    }

    /// Classifies the place, for a body that makes no progress.
    pub fn kind(&self) -> Trap {
        let (direction, length) = self.opening();
        // The obstacle straight ahead, and the opening beside it.
        let front = self.all().max_by(|a, b| self.heading.dot(a.0).total_cmp(&self.heading.dot(b.0)));
        let front = front.map_or(0.0, |f| f.1);
        let is_hidden = front < NEAR * length;
        let wide = length / self.half_width();
        if length <= 2.0 * self.radius_mm || wide <= CLOSED.0 || (wide <= CLOSED.1 && !is_hidden) || wide.is_nan() {
            return Trap::BlindEnd;
        }
        // Beside a bridge the longest tentacle may graze it while another has room.
        let ways = self.ahead().filter(|(_, l)| *l >= LONG * length);
        if ways.clone().all(|(d, l)| self.is_narrow(d, l)) {
            return Trap::Narrow;
        }
        if !is_hidden {
            return Trap::LocalMinimum;
        }
        let way_aside = (direction - self.heading * self.heading.dot(direction)).normalize_or_zero();
        let other_side = self.ahead().any(|(d, l)| l >= LONG * length && d.dot(way_aside) < -0.2);
        if other_side { Trap::Bridge } else { Trap::Obstacle }
    }

    /// Returns true if walls on two opposite sides of the ray along `direction` leave no room for the body within `length` mm.
    fn is_narrow(&self, direction: DVec3, length: f64) -> bool {
        let hits = |(d, l): (DVec3, f64)| {
            let along = direction.dot(d) * l;
            let off = d * l - direction * along;
            // Only the first part of the path: further on, the ray comes near the wall that it ends at.
            ((0.0..0.5 * length).contains(&along) && off.length() < self.radius_mm + SLACK_MM).then_some(off)
        };
        let near: Vec<DVec3> = self.all().filter_map(hits).collect();
        near.iter().enumerate().any(|(i, a)| near[..i].iter().any(|b| a.dot(*b) < -0.5 * a.length() * b.length()))
    }
}

/// Returns the trap behind a stall, given the reading where it began.
pub fn recognise(stall: StallKind, reading: Option<Trap>) -> Trap {
    match (stall, reading) {
        // It wanders in front of something.
        (StallKind::Dithering | StallKind::Circling, Some(t @ (Trap::BlindEnd | Trap::Narrow))) => t,
        (StallKind::Dithering, _) => Trap::Dithering,
        (StallKind::Circling, _) => Trap::Circling,
        (StallKind::Stuck, reading) => reading.unwrap_or(Trap::Stuck),
        // A local minimum that the flight has already left is no reason to turn.
        (StallKind::TurnedBack, Some(t @ (Trap::BlindEnd | Trap::Narrow | Trap::Bridge | Trap::Obstacle))) => t,
        (StallKind::TurnedBack, _) => Trap::TurnedBack,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::tentacles::{circle, directions};

    /// Lengths of the tentacles in the place drawn by `inside`.
    fn lengths(directions: &[DVec3], inside: impl Fn(DVec3) -> bool) -> Vec<f64> {
        directions
            .iter()
            .map(|d| (1..1500).map(|n| f64::from(n) * 0.1).find(|l| !inside(*d * *l)).unwrap_or(150.0))
            .collect()
    }

    #[test]
    fn places_are_told_apart() {
        let tube = |p: DVec3| p.y.abs() < 10.0 && p.z.abs() < 10.0;
        let drawn: [(&dyn Fn(DVec3) -> bool, Trap); 5] = [
            (&|p| tube(p) && p.x < 8.0, Trap::BlindEnd),
            (&tube, Trap::LocalMinimum),
            (&|p| tube(p) && (p.x < 4.0 || p.x > 6.0 || p.y.abs().max(p.z.abs()) < 1.2), Trap::Narrow),
            (&|p| tube(p) && !((5.0..6.5).contains(&p.x) && p.y.abs() < 3.0), Trap::Bridge),
            (&|p| tube(p) && (p - DVec3::new(12.0, 10.0, 0.0)).length() >= 12.0, Trap::Obstacle),
        ];
        for (inside, want) in drawn {
            for all in [circle(128), directions(1024)] {
                let l = lengths(&all, inside);
                let reading = TentacleReading { directions: &all, lengths: &l, heading: DVec3::X, radius_mm: 1.5 };
                assert_eq!(reading.kind(), want, "{} directions", all.len());
            }
        }
    }

    #[test]
    fn nothing_felt_and_nonsense_still_have_a_name() {
        let none = TentacleReading { directions: &[], lengths: &[], heading: DVec3::ZERO, radius_mm: 1.5 };
        assert_eq!(none.kind(), Trap::BlindEnd);
        let d = directions(3);
        for l in [[0.0; 3], [f64::NAN; 3], [f64::INFINITY; 3]] {
            let _ = TentacleReading { directions: &d, lengths: &l, heading: DVec3::X, radius_mm: 0.0 }.kind();
        }
        assert_eq!(recognise(StallKind::Stuck, None), Trap::Stuck);
        assert_eq!(recognise(StallKind::TurnedBack, Some(Trap::LocalMinimum)), Trap::TurnedBack);
    }
}
