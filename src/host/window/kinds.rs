//! The kinds of gas in a window: found when somebody asks for them, shown in colours in the slices, and changed by the reader.
//!
//! Nothing is computed or kept before somebody asks. A change finds the lumen anew while the flight goes on.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use super::background::{Background, BackgroundTask};
use super::job::Job;
use crate::app::Fields;
use crate::app::findings::MOST_KINDS;
use crate::app::flight::onward;
use crate::app::{FlightApp, Setup};
use crate::error::Result;
use crate::fields::cleanse;
use crate::fields::lumen::{self, GasBody, GasKind, KindMap, Lumen, Told};
use crate::progress::Progress;
use crate::render::slice::Tint;
use crate::volume::Volume;

/// Distance from a body at which a click is meant for it, mm.
const NEAR_MM: f64 = 3.0;
/// Opacities of a body, and of the one that is chosen.
const OPACITY: u8 = 140;
const CHOSEN: u8 = 220;

/// The kinds that the reader can give, with the ids of the actions for it, and none for what was judged.
pub(crate) const CHOICES: [(Option<GasKind>, &str, &str); 7] = [
    (Some(GasKind::Colon), "Colon", "kind-colon"),
    (Some(GasKind::SmallBowel), "Small bowel", "kind-small-bowel"),
    (Some(GasKind::Stomach), "Stomach", "kind-stomach"),
    (Some(GasKind::Lung), "Lung", "kind-lung"),
    (Some(GasKind::Trachea), "Trachea", "kind-trachea"),
    (Some(GasKind::Unknown), "Unknown", "kind-unknown"),
    (None, "Automatic", "kind-as-judged"),
];

/// The kinds of the legend, in its order, with their colours.
pub(crate) const LEGEND: [(GasKind, [u8; 3]); 6] = [
    (GasKind::Colon, [60, 220, 90]),
    (GasKind::Unknown, [250, 230, 60]),
    (GasKind::SmallBowel, [255, 140, 30]),
    (GasKind::Stomach, [190, 90, 255]),
    (GasKind::Lung, [70, 120, 255]),
    (GasKind::Trachea, [60, 225, 235]),
];

/// Returns the colour of a kind; `None` if it is not coloured.
pub(crate) fn colour(kind: GasKind) -> Option<[u8; 3]> {
    LEGEND.iter().find(|(k, _)| *k == kind).map(|(_, colour)| *colour)
}

/// Returns the name of a kind in a legend.
pub(crate) fn name(kind: GasKind) -> &'static str {
    if kind == GasKind::Unknown { "may be colon" } else { kind.name() }
}

/// What was found.
pub(crate) struct Found {
    map: Arc<KindMap>,
    /// The lumen that was found anew, and the fields that the flight needs in it.
    pub(crate) anew: Option<(Arc<Lumen>, Fields)>,
    /// The kinds that it was found with.
    pub(crate) told: Vec<Told>,
}

/// The kinds of gas in a window.
pub(crate) struct Kinds {
    is_shown: bool,
    task: BackgroundTask<Found>,
    map: Option<Arc<KindMap>>,
    tint: Option<Arc<Tint>>,
    /// The place of the body that was clicked on, world mm.
    chosen: Option<DVec3>,
    told: Vec<Told>,
}

impl Kinds {
    /// Creates the kinds of a flight, with what the reader said before.
    pub(crate) fn new(told: Vec<Told>, now: Instant) -> Self {
        Self { is_shown: false, task: BackgroundTask::new(now), map: None, tint: None, chosen: None, told }
    }

    /// Takes the kinds of a file, if they are others: the flight began with what was read before, and another window may have changed it
    /// since. The lumen is found with them once somebody asks for the kinds.
    pub(crate) fn adopt(&mut self, told: &[Told]) {
        if told != self.told {
            self.told = told.to_vec();
        }
    }

    /// Returns the kinds that the reader gave.
    pub(crate) fn told(&self) -> &[Told] {
        &self.told
    }

    /// True if they are shown in the slices.
    pub(crate) fn is_shown(&self) -> bool {
        self.is_shown
    }

    /// Shows or hides them. What is needed is found in the background.
    pub(crate) fn show(&mut self, shown: bool, flight: &FlightApp, background: &Background, now: Instant) {
        self.is_shown = shown;
        if shown && self.map.is_none() && !self.task.is_working() {
            self.begin(flight, background, now);
        }
    }

    /// Finds the kinds, and first the lumen if the reader has said something new.
    fn begin(&mut self, flight: &FlightApp, background: &Background, now: Instant) {
        self.task.go_over(begin(flight, &self.told, background), now);
    }

    /// Takes what was found once it is there.
    pub(crate) fn take(&mut self, now: Instant) -> Option<Found> {
        let (found, _) = self.task.take(now)?.ok()?;
        self.map = Some(Arc::clone(&found.map));
        self.colour();
        Some(found)
    }

    /// Returns when the progress has to be looked at.
    pub(crate) fn next(&self) -> Option<Instant> {
        self.task.next()
    }

    /// Returns what is being done, or why it failed; `None` if nothing is.
    pub(crate) fn state(&self) -> Option<std::result::Result<String, &str>> {
        let working = self.task.progress().map(|p| Ok(p.snapshot().0));
        working.or(self.task.failed().map(Err))
    }

    /// Returns the colours, if they are shown and known.
    pub(crate) fn tint(&self) -> Option<Arc<Tint>> {
        self.tint.clone().filter(|_| self.is_shown)
    }

    /// Makes the colours anew.
    fn colour(&mut self) {
        self.tint = self.map.clone().map(|map| {
            let chosen = self.chosen_body().map(|b| b.0);
            let colour = |(n, body): (usize, &GasBody)| {
                let [r, g, b] = colour(body.kind).unwrap_or_default();
                let opacity = if chosen == Some(n) { CHOSEN } else { OPACITY };
                [r, g, b, if body.kind == GasKind::Outside { 0 } else { opacity }]
            };
            let colours = map.bodies().iter().enumerate().map(colour).collect();
            Arc::new(Tint { map, colours })
        });
    }

    /// Returns the volume of each kind, ml, in the order of [`GasKind::ALL`]; `None` before they are known.
    pub(crate) fn volumes(&self) -> Option<[f64; 7]> {
        let mut ml = [0.0; 7];
        self.map.as_ref()?.bodies().iter().for_each(|b| ml[b.kind.number()] += b.ml);
        Some(ml)
    }

    /// Chooses the body at a place (world, mm) of its scan. Returns what to say of it; `None` if there is none.
    pub(crate) fn choose(&mut self, place: DVec3, scan: &Volume) -> Option<String> {
        let map = self.map.as_ref().filter(|_| self.is_shown)?;
        let found = map.nearest(place, NEAR_MM).filter(|(n, _)| map.bodies()[*n].kind != GasKind::Outside);
        // A lumen is found anew by its gas, not by its fluid.
        let is_gas = |at: DVec3| lumen::GAS_HU >= nearest_hu(scan, at);
        self.chosen = found.map(|(n, at)| if is_gas(at) { at } else { map.bodies()[n].place });
        self.colour();
        self.chosen_body().map(|(_, body)| line(&body))
    }

    /// Returns the number of the chosen body, and the body.
    pub(crate) fn chosen_body(&self) -> Option<(usize, GasBody)> {
        let (map, at) = (self.map.as_ref()?, self.chosen?);
        let n = map.body_at(at)?;
        Some((n, map.bodies()[n]))
    }

    /// Checks whether a body is chosen. The error states why not.
    pub(crate) fn may_tell(&self) -> std::result::Result<(), &'static str> {
        match (self.is_shown, self.chosen_body()) {
            (true, Some(_)) => Ok(()),
            (true, None) => Err("no body of gas is selected (click on one)"),
            (false, _) => Err("the kinds of gas are not shown"),
        }
    }

    /// Gives a kind to the chosen body, or takes back what was given. Returns false if nothing changes.
    pub(crate) fn tell(
        &mut self,
        kind: Option<GasKind>,
        at: &FlightApp,
        background: &Background,
        now: Instant,
    ) -> bool {
        let (Some(map), Some(place), Some((chosen, _))) = (self.map.clone(), self.chosen, self.chosen_body()) else {
            return false;
        };
        let mut told = self.told.clone();
        told.retain(|t| map.nearest(t.0, NEAR_MM).is_none_or(|(n, _)| n != chosen));
        told.extend(kind.map(|kind| (place, kind)));
        told.drain(..told.len().saturating_sub(MOST_KINDS));
        if told == self.told {
            return false;
        }
        self.restore(told, at, background, now);
        true
    }

    /// Restores the kinds that were given before.
    pub(crate) fn restore(&mut self, told: Vec<Told>, flight: &FlightApp, background: &Background, now: Instant) {
        self.told = told;
        self.begin(flight, background, now);
    }
}

/// Returns the value of the voxel at a place (world, mm).
fn nearest_hu(scan: &Volume, at: DVec3) -> i16 {
    let [i, j, k] = scan.grid().voxel(at).round().to_array().map(|v| v as i64);
    scan.get(i, j, k)
}

/// Describes a body in a line.
pub(crate) fn line(body: &GasBody) -> String {
    format!("{}, {:.0} ml: {}", name(body.kind), body.ml, body.why)
}

/// Begins the work.
///
/// # Errors
/// Returns status 1 if the system cannot start threads.
fn begin(flight: &FlightApp, told: &[Told], background: &Background) -> Result<Job<Found>> {
    let Setup { volume, lumen, scene, plan, cleansed, .. } = flight.setup();
    // What the flight needs to be planned anew, without its fields: those are of the former lumen.
    let setup = Setup {
        volume: volume.clone(),
        lumen: Arc::clone(lumen),
        plan: plan.clone(),
        scene: scene.clone(),
        fields: Fields::default(),
        cleansed: cleansed.clone(),
        told: told.to_vec(),
    };
    let (is_new, position) = (flight.setup().told != told, flight.pose().position);
    background.start_apart("kinds", move |progress| find(setup, is_new, position, progress))
}

/// Finds the kinds of gas, first the lumen if what was told is new, and the fields for the flight in it.
fn find(mut setup: Setup, is_new: bool, position: DVec3, progress: &Progress) -> Result<Found> {
    let volume = setup.volume.shared_voxels();
    let mut lumen = Arc::clone(&setup.lumen);
    if is_new {
        let mut found = lumen::find_told(&volume, &setup.told, progress)?;
        if let Some(cleansed) = &setup.cleansed {
            cleanse::keep_ends(&mut found, &setup.lumen);
            found.measure_as_scanned(cleansed, &setup.told, None);
        }
        lumen = Arc::new(found);
    }
    let map = lumen::not_colon(&volume, &lumen, progress)?.map(&lumen, &setup.told)?;
    let told = std::mem::take(&mut setup.told);
    let anew = if is_new {
        // A lumen that cannot be flown is reported when the flight is to go on in it.
        if let Some(plan) = onward(&setup, &lumen, position).ok().and_then(|o| o.plan().cloned()) {
            setup.plan = plan;
            setup.lumen = Arc::clone(&lumen);
            if setup.build_fields(progress).is_err() {
                progress.check()?;
                setup.fields = Fields::default();
            }
        }
        Some((lumen, setup.fields))
    } else {
        None
    };
    Ok(Found { map: Arc::new(map), anew, told })
}

#[cfg(test)]
mod tests;
