//! A walk: one body with random properties, moved about in one place by random forces in random steps.

use glam::{DMat3, DVec3};

use super::judge::Judge;
use crate::dynamics::integrators::Integrator;
use crate::dynamics::rigid::{RigidBodyState, Turning, orientation};
use crate::dynamics::step::{Step, step_reporting};
use crate::dynamics::{Attitude, Body, Forces, Potential, PotentialForce};
use crate::fields::{Clearance, ClearanceFinder, Clearances, Distance, Sample};
use crate::math::hash;

/// Steps of a walk.
pub(crate) const STEPS: u64 = 50;
/// Uncertainty of the change in clearance along a path that begins too near to the wall, mm: the tolerance of clearances, and the
/// same amount for the points of the sampled wall.
const REPORTED_MM: f64 = 2.0 * crate::fields::clearance::TOLERANCE_MM;

/// Counts of events in walks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    /// Number of steps.
    pub steps: u64,
    /// Steps whose path came nearer to the wall than the radius, or went through it.
    pub perforations: u64,
    /// Steps after which the state was not finite.
    pub broken: u64,
    /// Steps that took more evaluations than the bound.
    pub hangs: u64,
    /// Steps in which the body was in the wall or too near to it.
    pub too_near: u64,
    /// Of these, those in which no way out was found.
    pub stuck: u64,
    /// Steps that a wall stopped.
    pub blocked: u64,
    /// Largest number of evaluations in one step.
    pub most_rates: u32,
    /// Smallest remaining distance to the wall beyond the radius, mm, in steps that began free.
    pub margin_mm: f64,
}

impl Tally {
    /// Creates a tally of no steps.
    pub fn none() -> Self {
        Self { margin_mm: f64::INFINITY, ..Self::default() }
    }

    /// Counts one step of `body` with its judgement.
    fn of(reported: &Step, body: &Body, judged: Result<f64, Fault>) -> Self {
        Self {
            steps: 1,
            perforations: u64::from(judged.is_err()),
            broken: u64::from(
                !reported.motion.is_finite() || (reported.motion.orientation.length() - 1.0).abs() > 1e-9,
            ),
            hangs: u64::from(reported.cost.rates > HANG),
            too_near: u64::from(reported.advance.clearance_mm < body.radius_mm),
            stuck: u64::from(reported.advance.stuck),
            blocked: u64::from(reported.advance.blocked.is_some()),
            most_rates: reported.cost.rates,
            margin_mm: judged.unwrap_or(f64::NEG_INFINITY),
        }
    }

    /// Returns the sum of both.
    pub fn and(self, o: Self) -> Self {
        Self {
            steps: self.steps + o.steps,
            perforations: self.perforations + o.perforations,
            broken: self.broken + o.broken,
            hangs: self.hangs + o.hangs,
            too_near: self.too_near + o.too_near,
            stuck: self.stuck + o.stuck,
            blocked: self.blocked + o.blocked,
            most_rates: self.most_rates.max(o.most_rates),
            margin_mm: self.margin_mm.min(o.margin_mm),
        }
    }
}

/// A step that perforated.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// Number of the walk. Together with the seed and `STEPS` it reproduces the walk.
    pub walk: u64,
    /// Number of the step in the walk.
    pub step: u64,
    /// Start of the step, world mm.
    pub from: DVec3,
    /// Radius of the body, mm.
    pub radius_mm: f64,
    /// Kind of perforation.
    pub what: Fault,
}

/// Kinds of perforation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Its path has a gap.
    Gap,
    /// Its centre went from gas into the wall.
    Crossed,
    /// It came nearer to the wall than its radius.
    Near,
    /// It was already too near, and came nearer.
    Nearer,
}

impl Fault {
    /// Returns the description for a report.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gap => "has a gap in its path",
            Self::Crossed => "went into the wall",
            Self::Near => "nearer than its radius",
            Self::Nearer => "too near, and came nearer",
        }
    }
}

/// Number of evaluations in one step above which it counts as a hang: four times what any method's own bounds allow.
pub(crate) const HANG: u32 = 100_000;

/// A place prepared for walks.
pub(crate) struct Ground {
    /// Its walls, as used by the step.
    pub walls: ClearanceFinder,
    /// Its walls, as used by the judge.
    pub judge: Judge,
    /// The lower corner of the box in which walks begin, world mm: a little larger than the volume.
    pub from: DVec3,
    /// The upper corner, world mm.
    pub to: DVec3,
}

/// `D_s` from the finder. Its gradient points away from the nearest wall; its Hessian is omitted.
struct Nearest<'a>(&'a ClearanceFinder);

impl Distance for Nearest<'_> {
    fn sample(&self, at: DVec3) -> Option<Sample> {
        let Clearance { mm, toward } = self.0.clearance(at);
        at.is_finite().then_some(Sample { mm, gradient: -toward, hessian: DMat3::ZERO })
    }
}

/// A force that changes linearly with the distance from a point, in either sense: `F = f + s (x − x₀)`.
struct Slanted {
    force: DVec3,
    slope: f64,
    origin: DVec3,
}

impl Forces for Slanted {
    fn force(&self, at: DVec3) -> DVec3 {
        self.force + (at - self.origin) * self.slope
    }

    fn slope(&self, _: DVec3) -> DMat3 {
        DMat3::IDENTITY * self.slope
    }
}

/// Sequence of random numbers of one walk. The walk's number determines where it begins in the stream of its seed.
struct Draw {
    seed: u64,
    count: u64,
}

impl Draw {
    fn new(seed: u64, walk: u64) -> Self {
        Self { seed, count: walk.wrapping_mul(1 << 20) }
    }

    /// Returns a number from 0 to 1.
    fn uniform(&mut self) -> f64 {
        self.count += 1;
        hash::uniform(self.seed, self.count)
    }

    /// Returns a point in the cube from −1 to 1.
    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.uniform(), self.uniform(), self.uniform()) * 2.0 - 1.0
    }

    /// Returns a coordinate of a [`Draw::vector`], from −1 to 1.
    fn signed(&mut self) -> f64 {
        self.vector().x
    }

    /// Returns a number from `10^low` to `10^high`, with each decade equally likely.
    fn decade(&mut self, low: f64, high: f64) -> f64 {
        decade(self.signed() * 0.5 + 0.5, low, high)
    }

    /// Returns a body of any size, mass, drag and shape, with its method.
    fn body(&mut self) -> Body {
        let (integrator, _) = Integrator::ALL[((self.uniform() * 8.0) as usize).min(7)];
        let radius_mm = [1.5, 1.5, 0.5, 0.1, 0.0][((self.uniform() * 5.0) as usize).min(4)];
        // From a needle to a disc.
        let thin = (self.uniform() * 1.6 - 0.8f64).clamp(-0.785, 0.785) + 0.785;
        Body {
            radius_mm,
            mass_g: decade(self.uniform(), -6.0, 6.0),
            drag_per_s: if self.uniform() < 0.2 { 0.0 } else { decade(self.uniform(), -3.0, 3.0) },
            cylinder_radius_mm: Some(radius_mm * thin.sin().abs() * 0.999),
            cylinder_length_mm: Some(2.0 * radius_mm * thin.cos().abs() * 0.999),
            integrator,
        }
    }

    /// Returns the start of a walk, world mm. Most walks start where the body fits, if one of a few attempts finds such a point.
    /// The others start anywhere, some of them on the wall.
    fn place(&mut self, ground: &Ground, radius_mm: f64) -> DVec3 {
        let middle = (ground.from + ground.to) * 0.5;
        let mut at = middle + self.vector() * (ground.to - ground.from) * 0.5;
        if self.signed() < 0.9 {
            for _ in 0..200 {
                if ground.walls.at(at).mm > radius_mm {
                    break;
                }
                at = middle + self.vector() * (ground.to - ground.from) * 0.5;
            }
        }
        if self.signed() < -0.9 {
            // At distance 0 exactly: the nearest point of the wall.
            let c = ground.walls.at(at);
            at += c.toward * (c.mm + crate::fields::clearance::TOLERANCE_MM);
        }
        at
    }

    /// Returns the initial state of a body at `at`: at rest, spinning.
    fn start(&mut self, body: &Body, at: DVec3) -> RigidBodyState {
        let mut m = RigidBodyState::at_rest(at, Attitude::new(self.vector(), self.vector()));
        m.orientation = orientation(m.attitude());
        m.angular = body.inertia().momentum(self.vector() * 1e4, m.orientation * DVec3::Z);
        m
    }

    /// Returns the load of one step.
    fn load(&mut self) -> Load {
        Load {
            dt: self.decade(-6.0, 1.0),
            push: self.vector() * self.decade(-3.0, 9.0),
            slope: self.signed().powi(3) * self.decade(-3.0, 9.0),
            wall_energy: self.decade(-9.0, 9.0),
            turning: if self.signed() > 0.0 {
                Turning::towards(self.vector(), 0.45, 1.8)
            } else {
                Turning { push: self.vector() * self.decade(-3.0, 9.0), ..Turning::FREE }
            },
        }
    }
}

/// Interpolates from `10^low` to `10^high` on a logarithmic scale by the share `u` (0 to 1).
fn decade(u: f64, low: f64, high: f64) -> f64 {
    10f64.powf(low + u * (high - low))
}

/// The load on a body in one step.
struct Load {
    /// The step, s.
    dt: f64,
    /// Force, g·mm/s².
    push: DVec3,
    /// Linear change of the force with the position, g/s². Used if no potential acts.
    slope: f64,
    /// Strength of the potential's wall, g·mm²/s².
    wall_energy: f64,
    turning: Turning,
}

/// Runs walk number `walk` of `seed`, with `steps` steps. Returns its method, its tally, and each step that perforated.
pub(crate) fn walk(ground: &Ground, seed: u64, walk: u64, steps: u64) -> (Integrator, Tally, Vec<Failure>) {
    let mut draw = Draw::new(seed, walk);
    let body = draw.body();
    debug_assert!(body.check().is_ok(), "{body:?}");
    let integrator = body.integrator;
    let at = draw.place(ground, body.radius_mm);
    let mut m = draw.start(&body, at);
    let nearest = Nearest(&ground.walls);
    // The finder is slow as a field, so only few walks have a potential, and only with methods that need few evaluations.
    let felt = draw.signed() < -0.8 && !matches!(integrator, Integrator::DormandPrince);
    let (mut tally, mut failures) = (Tally::none(), Vec::new());
    for step in 0..steps {
        let Load { dt, push, slope, wall_energy, turning } = draw.load();
        let potential = Potential { wall_energy, ..Potential::default() };
        let force: &dyn Forces = if felt {
            &PotentialForce { potential, wall: Some(&nearest), target: None, push }
        } else {
            &Slanted { force: push, slope, origin: m.position }
        };
        let mut pieces = Vec::new();
        let reported =
            step_reporting(integrator.stepper(), &body, &m, force, &turning, &ground.walls, dt, &mut |a, b| {
                pieces.push((a, b));
            });
        let judged = judge_step(ground, &body, &m, &pieces, &reported);
        if let Err(what) = judged {
            failures.push(Failure { walk, step, from: m.position, radius_mm: body.radius_mm, what });
        }
        tally = tally.and(Tally::of(&reported, &body, judged));
        m = reported.motion;
    }
    (integrator, tally, failures)
}

/// Same as [`judge`] for a step made in `pieces`, which must lead to its final position.
fn judge_step(
    ground: &Ground,
    body: &Body,
    before: &RigidBodyState,
    pieces: &[(DVec3, DVec3)],
    reported: &Step,
) -> Result<f64, Fault> {
    let begun = if reported.advance.clearance_mm < body.radius_mm { Begun::TooNear } else { Begun::Free };
    let judged = judge(ground, before, pieces, body.radius_mm, begun);
    let arrived = pieces.last().is_none_or(|p| p.1 == reported.motion.position);
    if arrived { judged } else { Err(Fault::Gap) }
}

/// State of a body at the beginning of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Begun {
    /// Where the body fits.
    Free,
    /// In the wall, or nearer to it than the radius of the body.
    TooNear,
}

/// Returns the distance that the path of a step left beyond the radius, mm (infinite for a step that began too near), or how it
/// perforated.
fn judge(
    ground: &Ground,
    before: &RigidBodyState,
    pieces: &[(DVec3, DVec3)],
    radius: f64,
    begun_at: Begun,
) -> Result<f64, Fault> {
    let mut margin = f64::INFINITY;
    let mut at = before.position;
    let begun = ground.judge.clearance(at, at, radius);
    for &(a, b) in pieces {
        if a != at {
            return Err(Fault::Gap);
        }
        if ground.judge.crosses(a, b) {
            return Err(Fault::Crossed);
        }
        at = b;
        if begun_at == Begun::TooNear {
            // The path may only raise the clearance; one out of the wall begins at 0. The sampled wall may seem further away from
            // the beginning than it is, so a suspected perforation is checked closely.
            let there = ground.judge.clearance(b, b, radius);
            if there < begun - REPORTED_MM && there < ground.judge.closely(before.position, radius) - REPORTED_MM {
                return Err(Fault::Nearer);
            }
        } else {
            let left = ground.judge.clearance(a, b, radius + 1.0) - radius;
            if left < -1e-9 {
                return Err(Fault::Near);
            }
            margin = margin.min(left);
        }
    }
    Ok(margin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::perforation::grounds;

    /// The judge must detect what a step without the clamp does.
    #[test]
    #[ignore = "slow: makes all volumes of the perforation report"]
    fn a_step_without_walls_is_caught() {
        let grounds = grounds(1, &crate::progress::Progress::new()).unwrap();
        let ground = &grounds[6].1;
        let at = DVec3::ZERO;
        let m = RigidBodyState::at_rest(at, Attitude::new(DVec3::Z, DVec3::Y));
        assert!(ground.walls.at(at).mm > 3.0, "in the tube");
        let judged = |pieces: &[(DVec3, DVec3)]| judge(ground, &m, pieces, 1.5, Begun::Free);
        assert!(judged(&[(at, at + DVec3::Y * 2.0)]).is_ok());
        assert_eq!(judged(&[(at, at + DVec3::Y * 7.0)]), Err(Fault::Near));
        assert_eq!(judged(&[(at, at + DVec3::Y * 30.0)]), Err(Fault::Crossed));
        assert_eq!(judged(&[(at + DVec3::X, at)]), Err(Fault::Gap));
        // From too near to the wall: moving nearer is a perforation, moving away is not.
        let m = RigidBodyState { position: at + DVec3::Y * 7.0, ..m };
        let left = |by: f64| judge(ground, &m, &[(m.position, m.position + DVec3::Y * by)], 1.5, Begun::TooNear);
        assert_eq!(left(0.3), Err(Fault::Nearer));
        assert!(left(-0.3).is_ok());
    }
}
