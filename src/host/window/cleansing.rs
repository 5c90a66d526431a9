//! The scan without tag beside the scan as it is: found while the flight goes on, and shown at a key.
//!
//! The flight keeps the walls that it set out with. Only a box around the colon is kept a second time.

use std::sync::Arc;
use std::time::Instant;

use bevy_ecs::prelude::Entity;
use colvis_scan::memory;
use serde::Serialize;

use super::background::{Background, BackgroundTask};
use crate::app::boxed::boxed;
use crate::app::{FlightApp, Setup};
use crate::components::output::Picture;
use crate::components::scan::Scan;
use crate::error::Result;
use crate::fields::cleanse::{self, Cleansed};
use crate::progress::Progress;
use crate::space::PreparedVolume;

/// Why there is only one scan, if there is no tag.
const NO_TAG: &str = "the colon contains no tagged fluid or stool";

/// What a window knows of the scan without tag.
pub(crate) struct Cleansing {
    stage: Stage,
    task: BackgroundTask<Found>,
    /// True if the scan is shown without tag as soon as that is known.
    is_wanted: bool,
    took: Option<Took>,
    /// What is known of the tag, without its values.
    known: Arc<Cleansed>,
}

/// What finding the scan without tag took, for the statistics.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[doc(hidden)]
pub struct Took {
    /// What was taken out.
    pub text: String,
    /// From the begin of the work until both scans were at hand, s.
    pub seconds: f64,
    /// Size in memory of the values that were changed, and of the box that is kept, bytes.
    pub changed_bytes: usize,
    pub box_bytes: usize,
}

enum Stage {
    /// The first picture comes first.
    Waiting,
    Working,
    /// Both scans are at hand: the one that is flown through, and this one.
    Both(Entity),
    /// There is only one, and why.
    One(&'static str),
}

/// What is known of a scan's tag.
pub(crate) enum Tag {
    /// There is none.
    Absent,
    /// It was taken out of the scan that is flown through. The changes hold the values that the scan had.
    Taken(Arc<Cleansed>),
    /// It is in the scan, and this is the part around the colon without it, and what else is known of it.
    Beside(PreparedVolume, Arc<Cleansed>),
    /// Nothing.
    Unknown,
}

/// The other scan, and what was taken out.
struct Found {
    other: Option<PreparedVolume>,
    cleansed: Arc<Cleansed>,
}

impl Cleansing {
    pub(crate) fn new(now: Instant) -> Self {
        Self {
            stage: Stage::Waiting,
            task: BackgroundTask::new(now),
            is_wanted: true,
            took: None,
            known: Arc::default(),
        }
    }

    /// Leaves the work out, for a reason that tells why there is one scan only.
    pub(crate) fn leave_out(&mut self, why: &'static str) {
        self.stage = Stage::One(why);
    }

    /// Starts the work unless it has been started.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start threads.
    pub(crate) fn begin(&mut self, flight: &FlightApp, background: &Background, now: Instant) -> Result<()> {
        if !matches!(self.stage, Stage::Waiting) {
            return Ok(());
        }
        let Setup { volume, lumen, scene, cleansed, plan, .. } = flight.setup();
        let none = match &plan.gas {
            // The box would not reach around the camera.
            Some(_) => Some("the flight starts outside the colon"),
            None => (scene.play().is_some() || lumen.segments.is_empty()).then_some("there is no colon to cleanse"),
        };
        if let Some(why) = none {
            self.stage = Stage::One(why);
            return Ok(());
        }
        self.stage = Stage::One("it failed");
        let (volume, lumen, known) = (volume.clone(), Arc::clone(lumen), cleansed.clone());
        let light = scene.image.settings.light;
        let work = move |progress: &Arc<Progress>| {
            let cleansed = match known {
                // Its changes hold the values that the scan had.
                Some(known) => known,
                None => Arc::new(cleanse::cleanse(volume.voxels(), &lumen, progress)?),
            };
            let other = (!cleansed.changes.is_empty()).then(|| {
                // What was needed to find the changes, before the box needs as much.
                memory::release();
                let part = boxed(volume.voxels(), &lumen, &cleansed.changes);
                let other = volume.with_voxels(Arc::new(part));
                light.prepare(&other);
                other
            });
            Ok(Found { other, cleansed })
        };
        self.task.go_over(Ok(background.start_apart("cleansing", work)?), now);
        self.stage = Stage::Working;
        Ok(())
    }

    /// Takes what was found, once it is there, and returns what to tell the operator, which may be nothing.
    ///
    /// # Errors
    /// Returns the error of the work, or status 1 if it panicked.
    pub(crate) fn take(&mut self, flight: &mut FlightApp, now: Instant) -> Result<Option<String>> {
        let Some(found) = self.task.take(now) else { return Ok(None) };
        self.stage = Stage::One("it failed");
        let (Found { other, cleansed }, seconds) = found?;
        let Some(other) = other else {
            self.stage = Stage::One(NO_TAG);
            return Ok(Some(String::new()));
        };
        self.known = Arc::new(cleansed.without_values());
        self.took = Some(Took {
            text: cleansed.to_string(),
            seconds,
            changed_bytes: cleansed.changes.bytes(),
            box_bytes: other.voxels().bytes() + other.bytes(),
        });
        if is_flown_without_tag(flight) {
            flight.keep_scanned(other.shared_voxels());
        }
        self.stage = Stage::Both(flight.app_mut().world.spawn(Scan(other)).id());
        self.show(flight);
        // A flight through the fluid has said so already.
        Ok(Some(if is_flown_without_tag(flight) { String::new() } else { cleansed.to_string() }))
    }

    /// True if the work has not been started.
    pub(crate) fn is_waiting(&self) -> bool {
        matches!(self.stage, Stage::Waiting)
    }

    /// True if the work has not ended.
    pub(crate) fn is_under_way(&self) -> bool {
        matches!(self.stage, Stage::Waiting | Stage::Working)
    }

    /// Returns what is known of the tag in the scan that is flown through.
    pub(crate) fn tag(&self, flight: &FlightApp) -> Tag {
        if let Some(cleansed) = &flight.setup().cleansed {
            return Tag::Taken(Arc::clone(cleansed));
        }
        match self.stage {
            Stage::One(NO_TAG) => Tag::Absent,
            Stage::Both(other) => flight
                .app()
                .world
                .get::<Scan>(other)
                .map_or(Tag::Unknown, |scan| Tag::Beside(scan.0.clone(), Arc::clone(&self.known))),
            _ => Tag::Unknown,
        }
    }

    /// Checks whether there is a choice. The error states why not.
    pub(crate) fn may_switch(&self) -> std::result::Result<(), &'static str> {
        match self.stage {
            Stage::Both(_) => Ok(()),
            Stage::Waiting | Stage::Working => Err("the scan is being cleansed"),
            Stage::One(why) => Err(why),
        }
    }

    /// Switches between both scans. Returns what is shown now.
    pub(crate) fn switch(&mut self, flight: &mut FlightApp) -> &'static str {
        self.is_wanted = !self.is_wanted;
        self.show(flight);
        self.text()
    }

    /// Returns what is shown; empty if there is no choice.
    pub(crate) fn shown(&self) -> &'static str {
        if matches!(self.stage, Stage::Both(_)) { self.text() } else { "" }
    }

    /// True if there is a choice and the scan is shown with its tag.
    pub(crate) fn is_shown_as_scanned(&self) -> bool {
        matches!(self.stage, Stage::Both(_)) && !self.is_wanted
    }

    fn text(&self) -> &'static str {
        if self.is_wanted { "cleansed" } else { "as scanned" }
    }

    /// Returns the entity of the scan that is shown, if it is not that which is flown through.
    pub(crate) fn other(&self, flight: &FlightApp) -> Option<Entity> {
        match self.stage {
            Stage::Both(other) => (self.is_wanted != is_flown_without_tag(flight)).then_some(other),
            _ => None,
        }
    }

    /// Returns the scan without tag, or the part of it around the colon, if it is known, and the scan as it is beside it.
    pub(crate) fn pair(&self, flight: &FlightApp) -> (PreparedVolume, Option<PreparedVolume>) {
        let flown = flight.setup().volume.clone();
        let other = match self.stage {
            Stage::Both(other) => flight.app().world.get::<Scan>(other).map(|scan| scan.0.clone()),
            _ => None,
        };
        match other {
            Some(other) if is_flown_without_tag(flight) => (flown, Some(other)),
            Some(other) => (other, Some(flown)),
            None => (flown, None),
        }
    }

    /// Returns what finding it took, once it is there.
    pub(crate) fn took(&self) -> Option<Took> {
        self.took.clone()
    }

    /// Shows the scan that is wanted in all views of the flight's scan.
    fn show(&self, flight: &mut FlightApp) {
        let Stage::Both(entity) = self.stage else { return };
        let other = self.other(flight);
        let world = &mut flight.app_mut().world;
        for mut picture in world.query::<&mut Picture>().iter_mut(world) {
            if picture.scan.is_none_or(|scan| scan == entity) {
                (picture.scan, picture.due) = (other, true);
            }
        }
    }
}

fn is_flown_without_tag(flight: &FlightApp) -> bool {
    flight.setup().cleansed.as_ref().is_some_and(|c| !c.changes.is_empty())
}

#[cfg(test)]
mod tests {
    use std::thread;
    use std::time::Duration;

    use glam::{DMat3, DVec3};

    use super::*;
    use crate::app::{FlightRequest, ImageSettings, OpenOptions, Scene};
    use crate::components::slices::{Orientation, SliceView};
    use crate::fields::cleanse::Changes;
    use crate::fields::lumen;
    use crate::host::window::contract::WindowView;
    use crate::host::window::controller::FlightController;
    use crate::host::window::controller::tests::{cockpit_of, perform, trace};
    use crate::phantom::PhantomSettings;
    use crate::render::{ImageSize, Settings};
    use crate::shared::shared;
    use crate::volume::{Grid, Volume};

    /// A flight through the phantom once both scans are at hand, or it is known that there is one.
    fn flown(guide: &'static str, fluid: bool) -> FlightController {
        let mut c = begun(guide, fluid);
        // Nothing moves while it waits.
        let now = Instant::now();
        assert_eq!(c.cleansing().may_switch(), Err("the scan is being cleansed"));
        c.advance(now).unwrap();
        assert!(c.cleansing().is_waiting(), "the first picture comes first");
        trace(&mut c, now);
        until_known(&mut c, now);
        c
    }

    fn until_known(c: &mut FlightController, now: Instant) {
        let begun = Instant::now();
        while c.cleansing().is_waiting() || matches!(c.cleansing().stage, Stage::Working) {
            assert!(begun.elapsed() < Duration::from_secs(60));
            c.advance(now).unwrap();
            thread::sleep(Duration::from_millis(1));
        }
    }

    /// A flight that has shown nothing yet.
    fn begun(guide: &'static str, fluid: bool) -> FlightController {
        let (_, volume) = shared(&PhantomSettings { fluid, ..PhantomSettings::embedded(1) });
        let mut scan = crate::app::Scan::of(volume, &OpenOptions::default()).unwrap();
        let settings = Settings { adaptive: false, ..Settings::default() };
        let image = ImageSettings { width: 96, height: 72, settings, ..ImageSettings::default() };
        let scene = Scene { picture: true, image, ..Scene::guided_by(guide) };
        cockpit_of(scan.flight(scene, &FlightRequest::default()).unwrap(), 0.0, Vec::new())
    }

    fn picture_of(c: &mut FlightController) -> Vec<[u8; 3]> {
        c.flight_mut().camera_mut::<Picture>().unwrap().due = true;
        trace(c, Instant::now());
        c.flight().camera::<Picture>().unwrap().frame.pixels().to_vec()
    }

    #[test]
    fn one_key_changes_between_the_scan_and_that_without_tag_in_pictures_and_slices() {
        let mut c = flown("tentacles", true);
        let now = Instant::now();
        let took = c.cleansing().took().unwrap();
        assert!(took.text.contains("of tagged fluid and stool") && took.changed_bytes > 0 && took.seconds > 0.0);
        let whole = &c.flight().setup().volume;
        assert!(took.box_bytes < whole.voxels().bytes() + whole.bytes());
        let before = whole.voxels().data().to_vec();
        let hud = c.hud(now);
        assert!(hud.figures.iter().any(|f| f == "cleansed"), "{:?}", hud.figures);
        assert!(hud.message.unwrap().contains("(X shows the scan as it is)"));
        // Where fluid is, slices show gas.
        let lumen = Arc::clone(&c.flight().setup().lumen);
        let grid = c.flight().setup().volume.voxels().grid().clone();
        let fluid = lumen.mask().iter().enumerate().filter(|m| *m.1 == 2).map(|m| m.0).collect::<Vec<_>>();
        let deep = fluid[fluid.len() / 2];
        let [nx, ny, _] = grid.dims();
        let place = grid.world(DVec3::from_array([deep % nx, deep / nx % ny, deep / nx / ny].map(|v| v as f64)));
        let slice = |c: &mut FlightController| {
            c.slice(crate::host::window::intent::SliceInput::Point(place), now);
            let due = c.prepare(ImageSize::new(96, 72), &[(Orientation::Axial, [80, 60])], now).unwrap();
            c.show(due).unwrap();
            let entity = c.slices().entity(Orientation::Axial).unwrap();
            let view = c.flight().app().world.get::<SliceView>(entity).unwrap();
            let [x, y] = view.shown().unwrap().pixel(place).0.map(|p| p as usize);
            view.hu_at([x, y]).unwrap()
        };
        assert!(slice(&mut c) < -800.0, "gas");
        let shown = c.flight().shown_scan().clone();
        let clean = picture_of(&mut c);
        perform(&mut c, "tag", now);
        assert!(slice(&mut c) > 100.0, "tag");
        assert!(std::ptr::eq(c.flight().shown_scan(), &c.flight().setup().volume));
        assert!(!std::ptr::eq(shown.voxels(), c.flight().setup().volume.voxels()));
        assert!(c.hud(now).figures.iter().any(|f| f.starts_with("as scanned")));
        picture_of(&mut c);
        perform(&mut c, "tag", now);
        assert!(slice(&mut c) < -800.0 && picture_of(&mut c) == clean);
        // The walls that the flight knows are those that it set out with.
        assert!(c.flight().setup().volume.voxels().data() == before);
    }

    #[test]
    fn a_flight_through_fluid_shows_what_it_flies_and_the_scan_at_the_key() {
        let mut c = flown("path", true);
        let now = Instant::now();
        assert!(c.flight().setup().cleansed.is_some() && c.cleansing().other(c.flight()).is_none());
        assert_eq!(c.cleansing().shown(), "cleansed");
        perform(&mut c, "tag", now);
        let grid = c.flight().setup().volume.voxels().grid();
        let raw = c.flight().shown_scan().voxels();
        let shift = grid.voxel(raw.grid().origin()).round().to_array().map(|v| v as usize);
        let cleansed = c.flight().setup().cleansed.clone().unwrap();
        let mut tag = 0;
        for (voxels, values) in cleansed.changes.runs() {
            for (n, hu) in voxels.zip(values) {
                let [nx, ny, _] = grid.dims();
                let at = [n % nx, n / nx % ny, n / nx / ny];
                let [i, j, k] = [0, 1, 2].map(|a| at[a] as i64 - shift[a] as i64);
                assert_eq!(raw.get(i, j, k), *hu, "every value that was changed is as it was");
                tag += usize::from(*hu > 200);
            }
        }
        assert!(tag > 100);
    }

    /// Without a picture of the flight, slices show the scan without tag all the same.
    #[test]
    fn slices_alone_are_cleansed_too() {
        let mut c = begun("tentacles", true);
        let now = Instant::now();
        c.advance(now).unwrap();
        let due = c.prepare(ImageSize::default(), &[(Orientation::Axial, [80, 60])], now).unwrap();
        c.show(due).unwrap();
        until_known(&mut c, now);
        assert_eq!(c.cleansing().may_switch(), Ok(()));
    }

    #[test]
    fn a_scan_without_tag_has_nothing_to_switch() {
        let mut c = flown("tentacles", false);
        assert_eq!(c.cleansing().may_switch(), Err("the colon contains no tagged fluid or stool"));
        assert!(c.cleansing().took().is_none() && c.cleansing().shown().is_empty());
        perform(&mut c, "tag", Instant::now());
        assert!(c.flight().camera::<Picture>().unwrap().scan.is_none());
    }

    #[test]
    fn the_box_holds_the_lumen_and_every_change() {
        let turn = DMat3::from_rotation_z(0.4);
        let grid = Grid::new([60, 50, 90], DVec3::new(1.0, 1.2, 0.8), DVec3::splat(-20.0), turn).unwrap();
        // A bubble of gas in tissue, and a change far from it.
        let value = |n: usize| {
            let v = DVec3::from_array([n % 60, n / 60 % 50, n / 3000].map(|c| c as f64));
            if v.distance(DVec3::new(30.0, 25.0, 30.0)) < 8.0 { -1000 } else { 40 }
        };
        let volume = Volume::new(grid.clone(), (0..grid.len()).map(value).collect());
        let inside = grid.world(DVec3::new(30.0, 25.0, 30.0));
        let lumen = lumen::gas_at(&volume, inside, &Progress::new()).unwrap().unwrap();
        let far = grid.index(59, 20, 70);
        let changes = Changes::of([(far, 7), (far + 1, 8)]);
        let part = boxed(&volume, &lumen, &changes);
        let shift = grid.voxel(part.grid().origin()).round().to_array().map(|c| c as usize);
        let get = |i: usize, j: usize, k: usize| {
            part.get(i as i64 - shift[0] as i64, j as i64 - shift[1] as i64, k as i64 - shift[2] as i64)
        };
        assert_eq!([get(59, 20, 70), get(0, 21, 70)], [7, 8]);
        let end = [0, 1, 2].map(|a| shift[a] + part.grid().dims()[a]);
        assert!(shift[2] <= 8 && end[2] == 86 && end[0] == 60 && shift[0] == 0, "{shift:?} {end:?}");
        assert!(part.data().len() < grid.len());
        for n in 0..grid.len() {
            let v = [n % 60, n / 60 % 50, n / 3000];
            if volume.data()[n] < 0 {
                assert_eq!(get(v[0], v[1], v[2]), -1000, "{v:?}");
            }
        }
    }
}
