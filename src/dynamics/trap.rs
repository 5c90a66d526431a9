//! The kind of place that a flight is caught in, recognised by its tentacles (paper, sections 3.1.1 and 3.2: *both
//! cases should be detected and operator intervention should be called for*).

use glam::DVec3;

use super::monitor::StallKind;

/// A kind of trap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trap {
    /// The lumen is closed ahead.
    BlindEnd,
    /// The lumen is open ahead, but the forces balance.
    LocalMinimum,
    /// The lumen goes on, but the body does not fit through.
    Narrow,
    /// Something thin across the view, with lumen on both sides of it.
    Bridge,
    /// Something on one side fills the view: a polyp or a fold.
    Obstacle,
    /// Two ways, or two forces, take turns.
    Dithering,
    /// The flight came back on its own trail and goes round.
    Circling,
    /// The flight turned back, and nothing that was felt explains it.
    TurnedBack,
    /// A guide without tentacles hangs in place.
    Stuck,
}

impl Trap {
    /// The text for the operator.
    pub fn text(self) -> &'static str {
        match self {
            Self::BlindEnd => "no way on: a blind end",
            Self::LocalMinimum => "confused: the forces balance in a local minimum, though the lumen is open ahead",
            Self::Narrow => "no way on: the lumen is narrower than the camera",
            Self::Bridge => "confused: a bridge across the view",
            Self::Obstacle => "confused: a polyp or fold fills the view",
            Self::Dithering => "confused: dithering between two ways",
            Self::Circling => "confused: circling over its own trail",
            Self::TurnedBack => "no way on: the guide turned back over its own trail",
            Self::Stuck => "no way on: the guide hangs in place",
        }
    }
}

/// What the tentacles feel at a place.
#[derive(Clone, Copy, Debug)]
pub struct TentacleReading<'a> {
    /// Unit directions of the tentacles.
    pub directions: &'a [DVec3],
    /// Lengths of the tentacles, mm.
    pub lengths: &'a [f64],
    /// Unit heading: where the body has been going; zero if it has not moved.
    pub heading: DVec3,
    /// The body's radius, mm.
    pub radius_mm: f64,
}

/// Directions within 75° of the heading lie ahead, cos.
const AHEAD: f64 = 0.26;
/// Directions between 60° and 120° of the heading are sideways, cos.
const SIDE: f64 = 0.5;
/// The lumen is closed where it reaches ahead by no more than this many times its half-width, or than that many where
/// nothing stands in the view.
const CLOSED: (f64, f64) = (1.6, 2.5);
/// What lies in the view is an obstacle where it is nearer than this share of what lies beyond it.
const NEAR: f64 = 0.5;
/// A tentacle of this share of the longest is another way.
const LONG: f64 = 0.6;
/// Longer than the gap that a body of its radius needs, mm: tentacles are apart and walls are rough.
const SLACK_MM: f64 = 0.5;

impl TentacleReading<'_> {
    fn ahead(&self) -> impl Iterator<Item = (DVec3, f64)> + Clone + '_ {
        self.all().filter(|(d, _)| self.heading.dot(*d) > AHEAD)
    }

    fn all(&self) -> impl Iterator<Item = (DVec3, f64)> + Clone + '_ {
        self.directions.iter().copied().zip(self.lengths.iter().copied())
    }

    /// The longest tentacle of those that `keep`: its direction and length; zero where there is none.
    pub fn longest(&self, keep: impl Fn(DVec3) -> bool) -> (DVec3, f64) {
        let longest = self.all().filter(|(d, _)| keep(*d)).max_by(|a, b| a.1.total_cmp(&b.1));
        longest.unwrap_or((DVec3::ZERO, 0.0))
    }

    /// The longest tentacle that leads ahead.
    pub fn opening(&self) -> (DVec3, f64) {
        self.longest(|d| self.heading.dot(d) > AHEAD)
    }

    /// Half of the lumen's width across the heading: the middle one of the tentacles to the sides, mm.
    pub fn half_width(&self) -> f64 {
        let mut sides: Vec<f64> =
            self.all().filter(|(d, _)| self.heading.dot(*d).abs() < SIDE).map(|(_, l)| l).collect();
        sides.sort_by(f64::total_cmp);
        sides.get(sides.len() / 2).copied().unwrap_or(0.0)
    }

    /// The kind of place, for a body that makes no progress.
    pub fn kind(&self) -> Trap {
        let (direction, length) = self.opening();
        // What stands straight ahead, and what is open beside it.
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

    /// Whether walls on two opposite sides of the ray along `way` leave no room for the body before `length`.
    fn is_narrow(&self, direction: DVec3, length: f64) -> bool {
        let hits = |(d, l): (DVec3, f64)| {
            let along = direction.dot(d) * l;
            let off = d * l - direction * along;
            // Only the first part of the way: further on the ray comes near the wall that it ends at.
            ((0.0..0.5 * length).contains(&along) && off.length() < self.radius_mm + SLACK_MM).then_some(off)
        };
        let near: Vec<DVec3> = self.all().filter_map(hits).collect();
        near.iter().enumerate().any(|(i, a)| near[..i].iter().any(|b| a.dot(*b) < -0.5 * a.length() * b.length()))
    }
}

/// The trap behind a trouble, given what was felt where it began.
pub fn recognise(stall: StallKind, reading: Option<Trap>) -> Trap {
    match (stall, reading) {
        // It wanders about before something.
        (StallKind::Dithering | StallKind::Circling, Some(t @ (Trap::BlindEnd | Trap::Narrow))) => t,
        (StallKind::Dithering, _) => Trap::Dithering,
        (StallKind::Circling, _) => Trap::Circling,
        (StallKind::Stuck, reading) => reading.unwrap_or(Trap::Stuck),
        // What was passed by is no reason to turn.
        (StallKind::TurnedBack, Some(t @ (Trap::BlindEnd | Trap::Narrow | Trap::Bridge | Trap::Obstacle))) => t,
        (StallKind::TurnedBack, _) => Trap::TurnedBack,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::tentacles::{circle, directions};

    /// Lengths of tentacles in a place that `inside` draws.
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
