//! What the operator changes about a flight: its guide, its end, its direction, the camera's place on the way.

use glam::DVec3;

use super::FlightApp;
use crate::app::plan::{self, Plan};
use crate::app::scene::Guide;
use crate::components::camera::{Heading, Pose};
use crate::components::flight::{Flight, State, Watch};
use crate::components::guide::{MineField, Planned};
use crate::components::input::{Act, Command, Inbox};
use crate::components::play::Playback;
use crate::error::{Error, Result};

impl FlightApp {
    /// Lets the operator act before the next step.
    ///
    /// # Errors
    /// When a command asks for something that there is not.
    pub fn act(&mut self, command: Command) -> Result<()> {
        let tick = self.clock().tick;
        self.follow(command.clone())?;
        // Only what was followed: a replay must not stop at what was refused.
        if let Some(acted) = &mut self.acted {
            acted.push(Act { tick, command });
        }
        Ok(())
    }

    fn follow(&mut self, command: Command) -> Result<()> {
        match command {
            Command::Guide(name) => {
                let guide = Guide::named(&name).ok_or_else(|| {
                    let names = Guide::ALL.map(|g| g.1).join(", ");
                    Error::usage("guide", format!("there is no {name:?}"), format!("choose one of {names}"))
                })?;
                self.refuse_while_playing("guide")?;
                let before = (self.scene.guide, self.scene.own_guide.take());
                self.scene.guide = Some(guide);
                self.change(|flight| (flight.scene.guide, flight.scene.own_guide) = before)?;
                self.resume();
            }
            Command::Reverse => {
                self.refuse_while_playing("reverse")?;
                let before = self.plan.clone();
                let plan = &mut self.plan;
                plan.begin = plan.goal;
                std::mem::swap(&mut plan.goal, &mut plan.other_end);
                std::mem::swap(&mut plan.within_mm, &mut plan.other_within_mm);
                std::mem::swap(&mut plan.falls_short, &mut plan.other_falls_short);
                self.change(|flight| flight.plan = before)?;
                self.trail.turn_round();
                if let Some(mut heading) = self.app.world.get_mut::<Heading>(self.camera) {
                    heading.0 = -heading.0;
                }
                self.resume();
            }
            Command::Segment(number) => {
                let plan = plan::through_segment(&self.space, &self.lumen, number, false, self.scene.body.radius_mm)?;
                self.set_out_on(plan)?;
            }
            Command::OtherEnd => {
                let number = self
                    .plan
                    .segment
                    .ok_or_else(|| Error::incomplete("other end", "not known of this gas", "turn round instead"))?;
                let reverse = !self.is_reversed();
                let radius = self.scene.body.radius_mm;
                let plan = plan::through_segment(&self.space, &self.lumen, number, reverse, radius)?;
                self.set_out_on(plan)?;
            }
            Command::Seek(share) => self.seek(share)?,
            other => {
                if let Some(mut inbox) = self.app.world.get_resource_mut::<Inbox>() {
                    inbox.0.push_back(other);
                }
            }
        }
        Ok(())
    }

    /// A log goes its own way.
    fn refuse_while_playing(&self, what: &str) -> Result<()> {
        if self.scene.play.is_some() {
            return Err(Error::usage(what, "the flight is a log that is played", "fly without --play"));
        }
        Ok(())
    }

    /// Builds the flight anew after a change; where that fails, for what it was before.
    fn change(&mut self, back: impl FnOnce(&mut Self)) -> Result<()> {
        self.rebuild().or_else(|e| {
            back(self);
            self.rebuild()?;
            Err(e)
        })
    }

    /// Sets out anew with another plan.
    fn set_out_on(&mut self, plan: Plan) -> Result<()> {
        self.note_flown();
        let before = std::mem::replace(&mut self.plan, plan);
        self.change(|flight| flight.plan = before)?;
        self.set_out();
        Ok(())
    }

    /// Takes the camera to a share (0 to 1) of the way: of the plan, of the log that is played, or without either of the
    /// way that was flown.
    fn seek(&mut self, share: f64) -> Result<()> {
        let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
        if let Some(mut play) = self.app.world.get_mut::<Playback>(self.camera) {
            play.seek(share);
            let now = play.now();
            let pose = Pose { position: now.position, attitude: now.attitude };
            self.app.world.entity_mut(self.camera).insert(pose);
            self.resume();
            return Ok(());
        }
        let (position, forward, up) = match self.fields.route() {
            Some(route) => {
                let s = route.length_mm() * share;
                (route.place(s), route.look(s, self.scene.path.look_ahead_mm), route.up(s))
            }
            None => {
                let at = self.trail.at(share).ok_or_else(|| {
                    Error::incomplete("way", "not flown until there, and not planned", "change the guide to path (G)")
                })?;
                (at.0, at.1.forward, at.1.up)
            }
        };
        if !self.place(position, forward, up) {
            return Err(Error::incomplete("way", "the camera does not fit there", "choose another place"));
        }
        if let Some(mut planned) = self.app.world.get_mut::<Planned>(self.camera) {
            // Nothing of how the body was moving is left.
            (planned.pilot, planned.velocity_before, planned.last) = (None, None, DVec3::ZERO);
        }
        self.trail.jump(share);
        if let Some(mut watch) = self.app.world.get_mut::<Watch>(self.camera) {
            watch.rescue.restart();
        }
        if let Some(mut mines) = self.app.world.get_mut::<MineField>(self.camera) {
            mines.mines.clear();
        }
        self.resume();
        Ok(())
    }

    fn resume(&mut self) {
        self.note_flown();
        if let Some(mut flight) = self.app.world.get_mut::<Flight>(self.camera) {
            flight.state = State::Flying;
            flight.reason.clear();
        }
    }

    pub(super) fn note_flown(&mut self) {
        if let Some(n) = self.plan.segment
            && self.flight().state == State::Arrived
            && !self.flown.contains(&n)
        {
            self.flown.push(n);
        }
    }

    /// Replays acts in the steps they were made in.
    pub fn replay(&mut self, acts: Vec<Act>) {
        self.coming = acts.into();
    }

    /// Whether acts are still to be replayed.
    pub fn is_replaying(&self) -> bool {
        !self.coming.is_empty()
    }

    /// Keeps every act from here on.
    pub fn record_acts(&mut self) {
        self.acted = Some(Vec::new());
    }

    /// The acts kept since [`FlightApp::record_acts`].
    pub fn acts(&self) -> &[Act] {
        self.acted.as_deref().unwrap_or(&[])
    }
}
