//! A flight through a drawing.
//!
//! It has a separate step function, not the scheduled systems of three-dimensional flights, because it has no operator, no view to
//! turn and no plug-ins. Both share the functions of [`crate::dynamics`] for sensing, steering, moving and recovery.

use glam::DVec3;

use super::drawing::Drawing;
use super::plan::{self, Plan, pair};
use super::walls::Walls;
pub use crate::components::flight::State;
use crate::dynamics::heading::follow_velocity;
use crate::dynamics::mines::{MineSettings, Mines};
use crate::dynamics::monitor::MonitorSettings;
use crate::dynamics::rescue::{Rescue, RescueAction};
use crate::dynamics::tentacles::{Drive, TentacleSettings, approach, circle, steer};
use crate::dynamics::trap::{TentacleReading, Trap};
use crate::dynamics::{Attitude, Body, RigidBodyState, STEP_HZ, Turning, step};
use crate::error::{Error, Result};
use crate::fields::Clearances;

/// Simulation steps per second.
pub const HZ: u32 = STEP_HZ;
/// Distance within which walls are searched for, mm.
const LIMIT_MM: f64 = 40.0;
/// Maximum viewing distance when choosing the first heading, mm.
const VIEW_MM: f64 = 300.0;

/// The settings of a flight in two dimensions.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaneSettings {
    /// The camera's body.
    pub body: Body,
    /// Tentacles, spread over a circle.
    pub tentacles: TentacleSettings,
    /// Mines; `None` for a flight without them.
    pub mines: Option<MineSettings>,
    /// Detection of stalls. If `None`, the flight looks for no other direction and does not call the operator.
    pub watch: Option<MonitorSettings>,
    /// Simulated time after which the flight ends, s.
    pub seconds: f64,
}

impl Default for PlaneSettings {
    fn default() -> Self {
        Self {
            body: Body::default(),
            tentacles: TentacleSettings { count: 64, ..TentacleSettings::default() },
            mines: Some(MineSettings::default()),
            watch: Some(MonitorSettings::default()),
            seconds: 120.0,
        }
    }
}

/// A call for the operator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Call {
    /// The kind of trap.
    pub trap: Trap,
    /// Position of the trap, mm.
    pub place: DVec3,
}

/// A flight under way.
#[derive(Clone, Debug)]
pub struct Flight {
    walls: Walls,
    plan: Plan,
    settings: PlaneSettings,
    directions: Vec<DVec3>,
    lengths: Vec<f64>,
    mines: Mines,
    rescue: Rescue,
    motion: RigidBodyState,
    heading: DVec3,
    places: Vec<DVec3>,
    state: State,
    call: Option<Call>,
    length_mm: f64,
}

impl Flight {
    /// Creates a flight at its start.
    ///
    /// # Errors
    /// Returns status 4 if the body does not fit at the start, and status 2 if a setting is out of range.
    pub fn new(drawing: Drawing, settings: PlaneSettings) -> Result<Self> {
        settings.body.check()?;
        settings.tentacles.check()?;
        settings.mines.map_or(Ok(()), |m| m.check())?;
        settings.watch.map_or(Ok(()), |w| w.check())?;
        let walls = Walls::new(drawing, LIMIT_MM);
        let plan = plan::plan(&walls, settings.body.radius_mm)?;
        let directions = circle(settings.tentacles.count.max(3));
        let mut flight = Self {
            lengths: vec![0.0; directions.len()],
            directions,
            walls,
            plan,
            settings,
            mines: Mines::default(),
            rescue: Rescue::default(),
            motion: RigidBodyState::at_rest(DVec3::ZERO, Attitude::new(DVec3::X, DVec3::Z)),
            heading: DVec3::ZERO,
            places: Vec::new(),
            state: State::Flying,
            call: None,
            length_mm: 0.0,
        };
        flight.set_out(flight.plan.start);
        Ok(flight)
    }

    /// Restarts near another position (mm).
    ///
    /// # Errors
    /// Returns status 4 if there is no room for the body.
    pub fn start_at(&mut self, at: DVec3) -> Result<()> {
        let at = plan::start_at(&self.walls, at, self.settings.body.radius_mm)?;
        self.set_out(at);
        Ok(())
    }

    /// Restarts from the last start.
    pub fn restart(&mut self) {
        self.set_out(self.plan.start);
    }

    fn set_out(&mut self, at: DVec3) {
        self.plan.start = at;
        self.places = vec![at];
        self.mines.clear();
        self.rescue = Rescue::default();
        self.motion = RigidBodyState::at_rest(at, Attitude::new(DVec3::X, DVec3::Z));
        self.state = State::Flying;
        self.call = None;
        self.length_mm = 0.0;
        self.feel(at);
        // Towards a goal in direct view, otherwise along the longest free direction (on a tie, the first).
        let mut best = (f64::NEG_INFINITY, DVec3::X);
        for d in circle(512) {
            let free = self.walls.crossing(at, d, VIEW_MM).unwrap_or(VIEW_MM);
            if free > best.0 {
                best = (free, d);
            }
        }
        self.heading = self.sees(self.plan.goal, at).unwrap_or(best.1);
    }

    /// Returns the unit direction to `goal` if it is in direct view.
    fn sees(&self, goal: DVec3, at: DVec3) -> Option<DVec3> {
        let direction = (goal - at).try_normalize()?;
        self.walls.crossing(at, direction, goal.distance(at)).is_none().then_some(direction)
    }

    fn feel(&mut self, at: DVec3) {
        let reach = self.settings.tentacles.reach_mm;
        for (length, &d) in self.lengths.iter_mut().zip(&self.directions) {
            *length = self.walls.crossing(at, d, reach).unwrap_or(reach);
        }
    }

    /// Advances the simulation by one step. Does nothing once the flight is over.
    pub fn step(&mut self) {
        if self.state != State::Flying {
            return;
        }
        let dt = 1.0 / f64::from(HZ);
        let at = self.position();
        let PlaneSettings { body, tentacles, mines, watch, seconds } = self.settings.clone();
        self.feel(at);
        let laid = mines.as_ref().map(|m| (&self.mines, m));
        let tentacles = self.rescue.temper(&tentacles);
        let feelers = (&self.directions[..], &self.lengths[..]);
        let s = steer(feelers, at, self.heading, laid, self.rescue.forbidden(), &tentacles, body.drag_per_s);
        let (mut thrust, mut limit) = (s.thrust, s.limit);
        if let Some((to, _)) = approach(at, self.plan.goal, &tentacles, body.drag_per_s)
            && self.sees(self.plan.goal, at).is_some()
        {
            (thrust, limit) = (to, to.length());
        }
        let mut push = DVec3::ZERO;
        if let Some(m) = &mines {
            self.mines.lay(at, self.heading, tentacles.drive == Drive::Mines, m);
            push = self.mines.push(at, m);
        }
        let force = ((thrust + push).clamp_length_max(limit) + s.wall) * body.mass_g;
        let moved = step(body.integrator.stepper(), &body, &self.motion, &force, &Turning::FREE, &self.walls, dt);
        self.motion = moved.motion;
        let now = self.motion.position;
        self.heading = follow_velocity(self.heading, self.motion.momentum / body.mass_g, dt);
        self.length_mm += now.distance(at);
        self.places.push(now);
        self.watch(now, dt, watch.as_ref());
        if self.state == State::Flying && self.seconds() >= seconds {
            self.state = State::Ended;
        }
    }

    fn watch(&mut self, at: DVec3, dt: f64, settings: Option<&MonitorSettings>) {
        if at.distance(self.plan.goal) <= self.plan.within_mm {
            self.state = State::Arrived;
            return;
        }
        let Some(settings) = settings else { return };
        let felt = TentacleReading {
            directions: &self.directions,
            lengths: &self.lengths,
            heading: self.heading,
            radius_mm: self.settings.body.radius_mm,
        };
        match self.rescue.follow(at, dt, Some(&felt), None, settings) {
            RescueAction::GoOn => {}
            RescueAction::SetOff { heading, clear_mines } => {
                self.heading = heading.unwrap_or(self.heading);
                if let Some(m) = &self.settings.mines {
                    let alone = self.settings.tentacles.drive == Drive::Mines;
                    self.mines.set_off(at, heading, clear_mines, alone, m);
                }
            }
            RescueAction::Call { trap, place } => {
                self.state = State::Operator;
                self.call = Some(Call { trap, place });
            }
        }
    }

    /// Returns the camera's position, mm.
    pub fn position(&self) -> DVec3 {
        self.places.last().copied().unwrap_or(self.plan.start)
    }

    /// Returns the positions of all steps, mm.
    pub fn places(&self) -> &[DVec3] {
        &self.places
    }

    /// Returns the unit heading.
    pub fn heading(&self) -> DVec3 {
        self.heading
    }

    /// Returns the tentacles: unit directions, and lengths in mm.
    pub fn tentacles(&self) -> (&[DVec3], &[f64]) {
        (&self.directions, &self.lengths)
    }

    /// Returns the mines.
    pub fn mines(&self) -> &Mines {
        &self.mines
    }

    /// Returns the state of recovery from traps.
    pub fn rescue(&self) -> &Rescue {
        &self.rescue
    }

    /// Returns the settings.
    pub fn settings(&self) -> &PlaneSettings {
        &self.settings
    }

    /// Returns the plan: start and goal.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Returns the walls.
    pub fn walls(&self) -> &Walls {
        &self.walls
    }

    /// Returns the flight's state.
    pub fn state(&self) -> State {
        self.state
    }

    /// Returns the call for the operator, if there is one.
    pub fn call(&self) -> Option<Call> {
        self.call
    }

    /// Returns the distance flown, mm.
    pub fn length_mm(&self) -> f64 {
        self.length_mm
    }

    /// Returns the simulated time, s.
    pub fn seconds(&self) -> f64 {
        (self.places.len() - 1) as f64 / f64::from(HZ)
    }

    /// Returns the clearance at the camera's position, mm.
    pub fn clearance_mm(&self) -> f64 {
        self.walls.clearance(self.position()).mm
    }

    /// Returns the outcome of the flight.
    ///
    /// # Errors
    /// Returns status 4 if the operator is called, with the place and the reason.
    pub fn outcome(&self) -> Result<()> {
        self.call.map_or(Ok(()), |c| {
            let what = format!("flight at {}", pair(c.place));
            Err(Error::incomplete(what, c.trap.text(), "open it in the window and start it elsewhere with a click"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::ImageSize;

    /// A corridor of 96 × 12 mm, with its goal at the right end.
    fn corridor() -> Drawing {
        let (w, h) = (200, 32);
        let lumen = (0..w * h).map(|n| (4..196).contains(&(n % w)) && (4..28).contains(&(n / w))).collect();
        let mut drawing = Drawing::new("d", ImageSize::new(w, h), lumen).unwrap();
        drawing.start = Some(DVec3::new(10.0, 7.0, 0.0));
        drawing.goal = Some(DVec3::new(94.0, 8.0, 0.0));
        drawing
    }

    #[test]
    fn a_restarted_flight_repeats_the_first_one() {
        let mut flight = Flight::new(corridor(), PlaneSettings::default()).unwrap();
        let fly = |flight: &mut Flight| {
            assert_eq!((flight.mines().len(), flight.length_mm(), flight.seconds()), (0, 0.0, 0.0));
            for _ in 0..2000 {
                if flight.mines().len() < 2 {
                    flight.step();
                }
            }
            assert_eq!(flight.mines().len(), 2, "{:?}", flight.state());
            flight.places().to_vec()
        };
        let first = fly(&mut flight);
        flight.restart();
        assert_eq!(fly(&mut flight), first, "nothing of the first flight is left");
        flight.start_at(first[0]).unwrap();
        assert_eq!(fly(&mut flight), first, "as if a click had put it there");
    }
}
