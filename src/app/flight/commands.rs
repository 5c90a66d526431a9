//! Operator commands on a flight: guide, end, direction, and the camera's position on the path; their record.

use std::collections::VecDeque;
use std::sync::Arc;

use super::FlightApp;
use crate::components::camera::{Heading, Pose};
use crate::components::flight::{Flight, Flown, State, TakenOver};
use crate::components::guide::Planned;
use crate::components::input::{Command, FlightCommand, Inbox, TimedCommand};
use crate::components::output::Picture;
use crate::components::play::Playback;
use crate::components::trail::Trail;
use crate::error::{Error, Result};
use crate::plan::{self, Plan, SegmentEnd};
use crate::render::{CameraModel, View};
use crate::scene::Steering;
use glam::DVec3;

impl FlightApp {
    /// Applies a command of the operator before the next step.
    ///
    /// # Errors
    /// Returns an error if the command requests something that does not exist.
    pub fn act(&mut self, command: impl Into<Command>) -> Result<()> {
        // A recording holds only finite numbers.
        let (tick, Some(command)) = (self.clock().tick, command.into().finite()) else { return Ok(()) };
        match &command {
            Command::Hand(command) => {
                if let Some(mut inbox) = self.app.world.get_resource_mut::<Inbox>() {
                    inbox.0.push_back(*command);
                }
            }
            Command::Flight(command) => {
                let progress = Arc::clone(&self.progress);
                progress.call(|| self.follow(command))?;
            }
        }
        // Only commands that succeeded: a replay must not stop at a refused one.
        self.commands.record(TimedCommand { tick, command });
        Ok(())
    }

    pub(super) fn follow(&mut self, command: &FlightCommand) -> Result<()> {
        // Another guide or path than the tour's.
        if matches!(
            command,
            FlightCommand::Guide(_) | FlightCommand::Reverse | FlightCommand::Segment(_) | FlightCommand::OtherEnd
        ) {
            self.end_review()?;
        }
        match command {
            FlightCommand::Guide(name) => {
                let guide = self.setup.scene.find(name)?.name;
                self.refuse_while_playing("guide")?;
                let before = std::mem::replace(&mut self.setup.scene.steering, Steering::Guide(guide));
                self.change(|flight| flight.setup.scene.steering = before)?;
                self.resume();
            }
            FlightCommand::Reverse => {
                self.refuse_while_playing("reverse")?;
                let before = self.setup.plan.clone();
                self.setup.plan.reverse();
                self.change(|flight| flight.setup.plan = before)?;
                if let Some(mut trail) = self.camera_mut::<Trail>() {
                    trail.turn_round();
                }
                if let Some(mut heading) = self.camera_mut::<Heading>() {
                    heading.0 = -heading.0;
                }
                self.resume();
            }
            FlightCommand::Segment(number) => {
                self.refuse_while_playing("segment")?;
                let plan = plan::through_segment(
                    &self.setup.volume,
                    &self.setup.lumen,
                    *number,
                    SegmentEnd::Cecal,
                    self.setup.scene.body.radius_mm,
                )?;
                self.set_out_on(plan)?;
            }
            FlightCommand::OtherEnd => {
                self.refuse_while_playing("other end")?;
                let number = self
                    .setup
                    .plan
                    .segment
                    .ok_or_else(|| Error::incomplete("other end", "not known in this gas", "turn round instead"))?;
                let other = if self.setup.is_reversed() { SegmentEnd::Cecal } else { SegmentEnd::Rectal };
                let radius = self.setup.scene.body.radius_mm;
                let plan = plan::through_segment(&self.setup.volume, &self.setup.lumen, number, other, radius)?;
                self.set_out_on(plan)?;
            }
            FlightCommand::Seek(share) => self.seek(*share)?,
            FlightCommand::Go { to, forward, up } => self.go([*to, *forward, *up].map(DVec3::from_array))?,
            FlightCommand::Review(stops) => {
                self.refuse_while_playing("review")?;
                self.review(stops)?;
            }
            FlightCommand::EndReview => self.end_review()?,
            &FlightCommand::ViewAngle(degrees) => {
                let usual = self.setup.scene.image.fov_degrees;
                if let Some(mut picture) = self.camera_mut::<Picture>() {
                    // The initial angle of the flight may lie outside the offered range.
                    let held = if degrees == usual { Some(usual) } else { picture.camera.clamp_fov(degrees) };
                    picture.fov_degrees = held.unwrap_or(picture.fov_degrees);
                }
            }
            FlightCommand::Camera { model, fov_degrees } => self.change_camera(model, *fov_degrees)?,
            // A newer version of the list may have other commands.
            _ => {
                return Err(Error::incomplete(
                    "command",
                    "not known here",
                    "use the same version of colvis and its members",
                ));
            }
        }
        Ok(())
    }

    /// Looks through a camera model of this crate, or through the flight's own. Fails with status 2 if there is none of that name, or if it
    /// has no pictures of this size.
    fn change_camera(&mut self, name: &str, degrees: f64) -> Result<()> {
        let own = Some(self.setup.scene.image.camera).filter(|c| c.name == name);
        let Some(model) = own.or_else(|| CameraModel::named(name)) else {
            let why = format!("there is no camera {name}");
            return Err(Error::usage("camera", why, "give perspective, fisheye or panorama"));
        };
        let Some(mut picture) = self.camera_mut::<Picture>() else { return Ok(()) };
        let fov_degrees = model.clamp_fov(degrees).unwrap_or(picture.fov_degrees);
        let (width, height) = (picture.frame.width(), picture.frame.height());
        View::with_model(DVec3::ZERO, DVec3::Y, DVec3::Z, model, fov_degrees, width, height)?;
        (picture.camera, picture.fov_degrees) = (model, fov_degrees);
        Ok(())
    }

    /// Refuses commands that a replayed log cannot follow.
    fn refuse_while_playing(&self, what: &str) -> Result<()> {
        if self.setup.scene.play().is_some() {
            return Err(Error::usage(what, "the flight replays a log", "fly without --play"));
        }
        Ok(())
    }

    /// Rebuilds the flight after a change. If that fails, `back` undoes the change and the flight is rebuilt for its former state.
    pub(super) fn change(&mut self, back: impl FnOnce(&mut Self)) -> Result<()> {
        self.build_scene().or_else(|e| {
            back(self);
            self.build_scene()?;
            Err(e)
        })
    }

    /// Builds the fields for the current scene, and rebuilds it. A cancellation that has ended an earlier call does not end this one.
    pub(super) fn build_scene(&mut self) -> Result<()> {
        let progress = Arc::clone(&self.progress);
        progress.call(|| self.setup.build_fields(&progress).and_then(|()| self.rebuild()))
    }

    /// Restarts the flight with another plan.
    fn set_out_on(&mut self, plan: Plan) -> Result<()> {
        self.note_flown();
        let before = std::mem::replace(&mut self.setup.plan, plan);
        self.change(|flight| flight.setup.plan = before)?;
        self.set_out();
        Ok(())
    }

    /// Moves the camera to a position with a forward and an up direction. A flight by plan continues from the nearest part of its
    /// path.
    fn go(&mut self, [to, forward, up]: [DVec3; 3]) -> Result<()> {
        self.refuse_while_playing("place")?;
        let looks = forward.is_finite() && up.is_finite() && forward.cross(up).length_squared() > 1e-12;
        if !to.is_finite() || !looks || !self.place(to, forward, up) {
            return Err(Error::incomplete("place", "the camera does not fit there", "choose another place"));
        }
        if let Some(mut planned) = self.camera_mut::<Planned>() {
            planned.jumps += 1;
            let (length, near) = (planned.route.length_mm(), planned.route.nearest(to));
            if let Some(s) = near.first().filter(|_| length > 0.0) {
                let share = s / length;
                self.jump(share);
            }
        } else if let Some(share) = self.survey().trail().map(|t| t.share_near(to)) {
            self.jump(share);
        }
        self.set_free();
        Ok(())
    }

    /// Moves the camera to a share (0 to 1) of the path: of the plan, of the log that is played, or, without either, of the path
    /// flown.
    fn seek(&mut self, share: f64) -> Result<()> {
        let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
        if let Some(mut play) = self.camera_mut::<Playback>() {
            play.seek(share);
            let now = play.now();
            let pose = Pose { position: now.position, attitude: now.attitude };
            self.app.camera().insert(pose);
            self.resume();
            return Ok(());
        }
        let (position, forward, up) = match self.camera::<Planned>() {
            Some(Planned { route, look_ahead_mm, .. }) => {
                let s = route.length_mm() * share;
                (route.place(s), route.look(s, *look_ahead_mm), route.up(s))
            }
            None => {
                let at = self.survey().trail().and_then(|t| t.at(share)).ok_or_else(|| {
                    Error::incomplete("path", "not flown yet, and no planned route", "change the guide to path (G)")
                })?;
                (at.0, at.1.forward, at.1.up)
            }
        };
        if !self.place(position, forward, up) {
            return Err(Error::incomplete("path", "the camera does not fit there", "choose another place"));
        }
        if let Some(mut planned) = self.camera_mut::<Planned>() {
            planned.jumps += 1;
        }
        self.jump(share);
        self.set_free();
        Ok(())
    }

    /// Resumes the flight from where the operator has put the camera.
    fn set_free(&mut self) {
        let entity = self.app.camera_id();
        self.app.world.trigger(TakenOver { entity });
        self.resume();
    }

    /// Records in the trail that the camera was moved to a share of the path.
    pub(super) fn jump(&mut self, share: f64) {
        if let Some(mut trail) = self.camera_mut::<Trail>() {
            trail.jump(share);
        }
    }

    fn resume(&mut self) {
        self.note_flown();
        if let Some(mut flight) = self.camera_mut::<Flight>() {
            flight.state = State::Flying;
            flight.reason.clear();
        }
    }

    pub(super) fn note_flown(&mut self) {
        let state = self.flight().state;
        if let Some(mut flown) = self.camera_mut::<Flown>() {
            flown.note(state);
        }
    }
}

/// The commands of a flight: those that took effect, and those that are left to replay.
#[derive(Default)]
pub struct CommandRecord {
    /// Commands left to replay, by step.
    coming: VecDeque<TimedCommand>,
    /// Commands that took effect, once they are recorded.
    done: Option<Vec<TimedCommand>>,
}

impl CommandRecord {
    /// Replays commands in the steps in which they were given.
    pub fn replay(&mut self, commands: Vec<TimedCommand>) {
        self.coming = commands.into();
    }

    /// True if commands are left to replay.
    pub fn is_replaying(&self) -> bool {
        !self.coming.is_empty()
    }

    /// Records every command from here on.
    pub fn start(&mut self) {
        self.done = Some(Vec::new());
    }

    /// Returns the commands recorded since [`CommandRecord::start`].
    pub fn recorded(&self) -> &[TimedCommand] {
        self.done.as_deref().unwrap_or(&[])
    }

    fn record(&mut self, command: TimedCommand) {
        if let Some(done) = &mut self.done {
            done.push(command);
        }
    }

    /// Removes and returns the next command to replay if it is due at this step.
    pub(super) fn next_due(&mut self, tick: u64) -> Option<Command> {
        self.coming.pop_front_if(|c| c.tick <= tick).map(|c| c.command)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::Scene;
    use crate::fields::lumen;
    use crate::progress::Progress;
    use crate::testing::Room;

    #[test]
    fn a_planned_flight_goes_on_from_the_part_of_its_path_that_is_nearest() {
        let volume = Room::new([20, 60, 20]).scan();
        let [start, goal] = [10.0, 50.0].map(|y| DVec3::new(10.0, y, 10.0));
        let lumen = lumen::gas_at(volume.voxels(), start, &Progress::new()).unwrap().unwrap();
        let plan = Plan::between(start, goal, 40.0);
        let mut flight = FlightApp::new(volume, Arc::new(lumen), plan, Scene::guided_by("path")).unwrap();
        // Three quarters of the way, a little beside it.
        let to = [12.0, 40.0, 10.0];
        flight.act(FlightCommand::Go { to, forward: [0.0, 1.0, 0.0], up: [0.0, 0.0, 1.0] }).unwrap();
        assert_eq!(flight.pose().position.to_array(), to);
        let (share, _) = flight.survey().progress();
        assert!((share - 0.75).abs() < 0.05, "{share}");
        assert_eq!(flight.flight().state, State::Flying);
    }

    /// A recording holds finite numbers alone, and does what was done.
    #[test]
    fn a_recording_holds_finite_numbers_alone_and_does_the_same() {
        use crate::components::input::HandCommand;

        let volume = Room::new([20, 60, 20]).scan();
        let [start, goal] = [10.0, 50.0].map(|y| DVec3::new(10.0, y, 10.0));
        let lumen = lumen::gas_at(volume.voxels(), start, &Progress::new()).unwrap().unwrap();
        let lumen = Arc::new(lumen);
        let fly = |scene: Scene| {
            let plan = Plan::between(start, goal, 40.0);
            FlightApp::new(volume.clone(), Arc::clone(&lumen), plan, scene).unwrap()
        };
        let scene = Scene { operator: true, ..Scene::guided_by("path") };
        let mut flight = fly(scene.clone());
        flight.commands.start();
        let bad = f64::NAN;
        let all: [Command; 8] = [
            HandCommand::Push([bad, f64::INFINITY, 0.5]).into(),
            HandCommand::Turn([0.2, bad, 0.0]).into(),
            HandCommand::Look([bad, 0.0]).into(),
            HandCommand::Roll(f64::INFINITY).into(),
            HandCommand::Speed(bad).into(),
            FlightCommand::Seek(bad).into(),
            FlightCommand::ViewAngle(f64::INFINITY).into(),
            FlightCommand::ViewAngle(bad).into(),
        ];
        for command in all {
            flight.act(command).unwrap();
            flight.step().unwrap();
        }
        let beyond = FlightCommand::Go { to: [bad; 3], forward: [0.0, 1.0, 0.0], up: [0.0, 0.0, 1.0] };
        assert!(flight.act(beyond).is_err());
        let recorded = flight.commands.recorded().to_vec();
        assert_eq!(recorded.len(), 4, "{recorded:?}");
        let text = serde_json::to_string(&recorded.iter().map(|c| &c.command).collect::<Vec<_>>()).unwrap();
        assert!(!text.contains("null"), "{text}");

        let mut again = fly(scene);
        again.commands.replay(recorded);
        for _ in 0..8 {
            again.step().unwrap();
        }
        assert_eq!(again.pose(), flight.pose());
    }
}
