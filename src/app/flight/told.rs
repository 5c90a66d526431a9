//! A flight whose lumen is updated because the reader changed kinds of gas.

use std::sync::Arc;

use glam::DVec3;

use super::{FlightApp, Setup};
use crate::components::flight::Flown;
use crate::components::input::FlightCommand;
use crate::error::Result;
use crate::fields::Lumen;
use crate::fields::lumen::{Segment, Told};
use crate::flight_fields::Fields;
use crate::plan::{self, Plan, SegmentEnd};

/// Distance from gas at which the camera belongs to it, mm.
const NEAR_MM: f64 = 5.0;

/// How a flight continues in another lumen.
#[derive(Clone, Debug)]
#[doc(hidden)]
pub enum Onward {
    /// What is flown is as it was.
    Same(Plan),
    /// It has changed: a plan through the segment where the camera is.
    Changed(Plan),
    /// It is no longer colon: a plan through the largest segment.
    Elsewhere(Plan),
    /// There is no segment.
    Nowhere,
}

impl Onward {
    /// Returns the plan, if there is one.
    #[doc(hidden)]
    pub fn plan(&self) -> Option<&Plan> {
        match self {
            Self::Same(plan) | Self::Changed(plan) | Self::Elsewhere(plan) => Some(plan),
            Self::Nowhere => None,
        }
    }
}

/// True if both are the same gas with the same ends.
fn is_same(a: &Segment, b: &Segment) -> bool {
    let swapped = [b.ends[1], b.ends[0]];
    a.ml == b.ml && a.bounds_mm == b.bounds_mm && (a.ends == b.ends || a.ends == swapped)
}

/// Plans how a flight continues in another lumen of its scan, with the camera at `position` (world, mm).
///
/// # Errors
/// Returns status 4 if the segment to fly is too narrow for the body.
#[doc(hidden)]
pub fn onward(setup: &Setup, lumen: &Lumen, position: DVec3) -> Result<Onward> {
    let Some(number) = setup.plan.segment else { return Ok(Onward::Same(setup.plan.clone())) };
    let flown = setup.lumen.segments.get(number);
    if let Some(n) = lumen.segments.iter().position(|s| flown.is_some_and(|f| is_same(s, f))) {
        return Ok(Onward::Same(Plan { segment: Some(n), ..setup.plan.clone() }));
    }
    let to = if setup.is_reversed() { SegmentEnd::Rectal } else { SegmentEnd::Cecal };
    let through = |n: usize| plan::through_segment(&setup.volume, lumen, n, to, setup.scene.body.radius_mm);
    if let Some((n, _)) = lumen.nearest_gas(position, NEAR_MM) {
        return through(n).map(Onward::Changed);
    }
    lumen.largest().map_or(Ok(Onward::Nowhere), |n| through(n).map(Onward::Elsewhere))
}

impl FlightApp {
    /// Flies in a lumen that was updated with the kinds in `told`. `fields` may hold what the guide needs there; what they lack is
    /// built. The camera stays where it is, unless its gas is no longer colon. Without any segment, the flight keeps the lumen that
    /// it has.
    ///
    /// # Errors
    /// Returns an error if no plan or field can be made. The flight then stays as it was.
    #[doc(hidden)]
    pub fn tell(&mut self, lumen: Arc<Lumen>, told: Vec<Told>, fields: Fields) -> Result<Onward> {
        let pose = self.pose();
        let onward = onward(&self.setup, &lumen, pose.position)?;
        let Some(plan) = onward.plan().cloned() else {
            self.setup.told = told;
            return Ok(onward);
        };
        self.note_flown();
        let done = self.camera::<Flown>().map_or_else(Vec::new, |f| f.done.clone());
        let setup = &mut self.setup;
        let before = (
            std::mem::replace(&mut setup.plan, plan),
            std::mem::replace(&mut setup.lumen, lumen),
            std::mem::replace(&mut setup.fields, fields),
        );
        let former = Arc::clone(&before.1);
        self.change(|flight| (flight.setup.plan, flight.setup.lumen, flight.setup.fields) = before)?;
        self.setup.told = told;
        // Segments have other numbers; those that were flown are flown in the new lumen if they are the same.
        let now = &self.setup.lumen.segments;
        let same = |n: &usize| former.segments.get(*n).and_then(|f| now.iter().position(|s| is_same(s, f)));
        let done = done.iter().filter_map(same).collect();
        if let Some(mut flown) = self.camera_mut::<Flown>() {
            flown.done = done;
        }
        if !matches!(onward, Onward::Same(_)) {
            self.set_out();
        }
        if matches!(onward, Onward::Changed(_)) {
            let (to, forward, up) = (pose.position, pose.attitude.forward, pose.attitude.up);
            let [to, forward, up] = [to, forward, up].map(|v| v.to_array());
            // If the camera does not fit there any more, it stays at the start of the segment.
            let _ = self.follow(&FlightCommand::Go { to, forward, up });
        }
        Ok(onward)
    }
}
