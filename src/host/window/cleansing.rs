//! The scan without tag beside the scan as it is: found while the flight goes on, and shown at a key.
//!
//! The flight keeps the walls that it set out with. Beside a flight through the scan as it is, a box around the colon without tag is kept. A
//! flight through the scan without tag knows what was taken out: the box as scanned is made of that when it is asked for, and kept while it is
//! shown.

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
use crate::fields::Lumen;
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
    /// True if what came out without work was not told yet.
    is_news: bool,
}

/// What finding the scan without tag took, for the statistics.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[doc(hidden)]
pub struct Took {
    /// What was taken out.
    pub text: String,
    /// From the begin of the work until both scans were at hand, s; 0 until there was any work.
    pub seconds: f64,
    /// Size in memory of the values that were changed, and of the box, if there was one, bytes.
    pub changed_bytes: usize,
    pub box_bytes: usize,
}

enum Stage {
    /// The first picture comes first.
    Waiting,
    Working,
    /// The flight goes through the scan as it is, and this is the part around the colon without tag.
    Beside(Entity),
    /// The flight goes through the scan without tag, and this is the part around the colon as scanned, while it is shown.
    Taken(Option<Entity>),
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
            is_news: false,
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
        if let Some(known) = cleansed {
            self.is_news = true;
            if known.changes.is_empty() {
                self.stage = Stage::One(NO_TAG);
                return Ok(());
            }
            self.took = Some(Took {
                text: known.to_string(),
                seconds: 0.0,
                changed_bytes: known.changes.bytes(),
                box_bytes: 0,
            });
            self.stage = Stage::Taken(None);
            return Ok(());
        }
        self.stage = Stage::One("it failed");
        let (volume, lumen, light) = (volume.clone(), Arc::clone(lumen), scene.image.settings.light);
        let work = move |progress: &Arc<Progress>| {
            let cleansed = Arc::new(cleanse::cleanse(volume.voxels(), &lumen, progress)?);
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
        if std::mem::take(&mut self.is_news) {
            // A flight through the fluid has said so already.
            return Ok(Some(String::new()));
        }
        let Some(found) = self.task.take(now) else { return Ok(None) };
        if let Stage::Taken(_) = self.stage {
            return self.take_as_scanned(flight, found).map(|()| Some(String::new()));
        }
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
        self.stage = Stage::Beside(flight.app_mut().world.spawn(Scan(other)).id());
        self.show(flight);
        Ok(Some(cleansed.to_string()))
    }

    /// Takes the scan as it is, unless it is no longer asked for.
    fn take_as_scanned(&mut self, flight: &mut FlightApp, found: Result<(Found, f64)>) -> Result<()> {
        let is_wanted = std::mem::replace(&mut self.is_wanted, true);
        let (Found { other, .. }, seconds) = found?;
        self.is_wanted = is_wanted;
        let Some(other) = other.filter(|_| !is_wanted) else { return Ok(()) };
        if let Some(took) = &mut self.took {
            (took.seconds, took.box_bytes) = (seconds, other.voxels().bytes() + other.bytes());
        }
        flight.keep_scanned(other.shared_voxels());
        self.stage = Stage::Taken(Some(flight.app_mut().world.spawn(Scan(other)).id()));
        self.show(flight);
        Ok(())
    }

    /// Begins to make the scan as it is of that without tag.
    fn restore(&mut self, flight: &FlightApp, background: &Background, now: Instant) -> Result<()> {
        let Setup { volume, lumen, scene, cleansed: Some(cleansed), .. } = flight.setup() else { return Ok(()) };
        let (volume, light, kept) = (volume.clone(), scene.image.settings.light, flight.kept_scanned());
        let (lumen, cleansed) = (Arc::clone(lumen), Arc::clone(cleansed));
        let work = move |_: &Arc<Progress>| {
            let part = kept.unwrap_or_else(|| Arc::new(boxed(volume.voxels(), &lumen, &cleansed.changes)));
            let other = volume.with_voxels(part);
            light.prepare(&other);
            Ok(Found { other: Some(other), cleansed })
        };
        self.task.go_over(Ok(background.start_apart("as scanned", work)?), now);
        Ok(())
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
            Stage::Beside(other) => {
                scan_of(flight, other).map_or(Tag::Unknown, |scan| Tag::Beside(scan, Arc::clone(&self.known)))
            }
            _ => Tag::Unknown,
        }
    }

    /// Checks whether there is a choice. The error states why not.
    pub(crate) fn may_switch(&self) -> std::result::Result<(), &'static str> {
        match self.stage {
            Stage::Beside(_) | Stage::Taken(_) => Ok(()),
            Stage::Waiting | Stage::Working => Err("the scan is being cleansed"),
            Stage::One(why) => Err(why),
        }
    }

    /// Switches between both scans. Returns what is shown now, or in a moment.
    ///
    /// # Errors
    /// Returns status 1 if the system cannot start threads; nothing changes then.
    pub(crate) fn switch(
        &mut self,
        flight: &mut FlightApp,
        background: &Background,
        now: Instant,
    ) -> Result<&'static str> {
        if self.is_wanted && matches!(self.stage, Stage::Taken(None)) && !self.task.is_working() {
            self.restore(flight, background, now)?;
        }
        self.is_wanted = !self.is_wanted;
        self.show(flight);
        if let (Stage::Taken(Some(as_scanned)), true) = (&self.stage, self.is_wanted) {
            flight.app_mut().world.despawn(*as_scanned);
            flight.forget_scanned();
            self.stage = Stage::Taken(None);
        }
        Ok(if self.is_wanted == self.is_clean() { self.text() } else { "as scanned ..." })
    }

    /// Returns what is shown; empty if there is no choice.
    pub(crate) fn shown(&self) -> &'static str {
        if self.may_switch().is_ok() { self.text() } else { "" }
    }

    /// True if there is a choice and the scan is shown with its tag.
    pub(crate) fn is_shown_as_scanned(&self) -> bool {
        self.may_switch().is_ok() && !self.is_clean()
    }

    /// True if the scan is shown without tag, if there is a choice.
    fn is_clean(&self) -> bool {
        self.is_wanted || matches!(self.stage, Stage::Taken(None))
    }

    fn text(&self) -> &'static str {
        if self.is_clean() { "cleansed" } else { "as scanned" }
    }

    /// Returns the entity of the scan that is shown, if it is not that which is flown through.
    pub(crate) fn other(&self) -> Option<Entity> {
        match self.stage {
            Stage::Beside(clean) => self.is_wanted.then_some(clean),
            Stage::Taken(as_scanned) => as_scanned.filter(|_| !self.is_wanted),
            _ => None,
        }
    }

    /// Returns the scan without tag, or the part of it around the colon, if it is known, and the scan as it is beside it.
    pub(crate) fn pair(&self, flight: &FlightApp) -> (PreparedVolume, AsScanned) {
        let Setup { volume, lumen, cleansed, .. } = flight.setup();
        let flown = volume.clone();
        match (&self.stage, cleansed) {
            (Stage::Beside(other), _) => match scan_of(flight, *other) {
                Some(clean) => (clean, AsScanned::Here(flown)),
                None => (flown, AsScanned::Same),
            },
            (Stage::Taken(Some(other)), _) if let Some(scan) = scan_of(flight, *other) => {
                (flown, AsScanned::Here(scan))
            }
            (Stage::Taken(_), Some(cleansed)) => (flown, AsScanned::Of(Arc::clone(lumen), Arc::clone(cleansed))),
            _ => (flown, AsScanned::Same),
        }
    }

    /// Returns what finding it took, once it is there.
    pub(crate) fn took(&self) -> Option<Took> {
        self.took.clone()
    }

    /// Shows the scan that is wanted in all views of the flight's scan.
    fn show(&self, flight: &mut FlightApp) {
        let (Stage::Beside(entity) | Stage::Taken(Some(entity))) = self.stage else { return };
        let other = self.other();
        let world = &mut flight.app_mut().world;
        for mut picture in world.query::<&mut Picture>().iter_mut(world) {
            if picture.scan.is_none_or(|scan| scan == entity) {
                (picture.scan, picture.due) = (other, true);
            }
        }
    }
}

fn scan_of(flight: &FlightApp, entity: Entity) -> Option<PreparedVolume> {
    flight.app().world.get::<Scan>(entity).map(|scan| scan.0.clone())
}

/// A scan as it is, beside that without tag.
pub(crate) enum AsScanned {
    /// They are the same.
    Same,
    Here(PreparedVolume),
    /// The part around the colon can be made of what was taken out.
    Of(Arc<Lumen>, Arc<Cleansed>),
}

impl AsScanned {
    /// Returns it, given the scan without tag; `None` if they are the same.
    pub(crate) fn beside(self, clean: &PreparedVolume) -> Option<PreparedVolume> {
        match self {
            Self::Same => None,
            Self::Here(scan) => Some(scan),
            Self::Of(lumen, cleansed) => {
                Some(clean.with_voxels(Arc::new(boxed(clean.voxels(), &lumen, &cleansed.changes))))
            }
        }
    }
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
        assert!(c.flight().setup().cleansed.is_some() && c.cleansing().other().is_none());
        assert_eq!(c.cleansing().shown(), "cleansed");
        assert_eq!(c.cleansing().took().unwrap().box_bytes, 0, "not made before it is asked for");
        perform(&mut c, "tag", now);
        assert_eq!(c.hud(now).message.as_deref(), Some("as scanned ..."));
        let until_shown = |c: &mut FlightController| {
            let begun = Instant::now();
            while c.cleansing().other().is_none() {
                assert!(begun.elapsed() < Duration::from_secs(60) && c.cleansing().shown() == "cleansed");
                c.advance(now).unwrap();
                thread::sleep(Duration::from_millis(1));
            }
        };
        until_shown(&mut c);
        assert_eq!(c.cleansing().shown(), "as scanned");
        assert_eq!(c.hud(now).message.as_deref(), Some("as scanned"));
        assert!(c.cleansing().took().unwrap().box_bytes > 0);
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
        // It goes when it is no longer shown, and comes again.
        let is_flown = |c: &FlightController| std::ptr::eq(c.flight().shown_scan(), &c.flight().setup().volume);
        assert!(!is_flown(&c));
        perform(&mut c, "tag", now);
        assert!(c.cleansing().other().is_none() && c.flight().kept_scanned().is_none());
        assert!(is_flown(&c));
        perform(&mut c, "tag", now);
        // Asked for and no longer wanted before it is there.
        perform(&mut c, "tag", now);
        let begun = Instant::now();
        while c.cleansing().task.is_working() {
            assert!(begun.elapsed() < Duration::from_secs(60));
            c.advance(now).unwrap();
            thread::sleep(Duration::from_millis(1));
        }
        assert!(c.cleansing().other().is_none() && c.flight().kept_scanned().is_none());
        perform(&mut c, "tag", now);
        until_shown(&mut c);
        assert!(!is_flown(&c));
        // Nothing looks at what has gone.
        picture_of(&mut c);
        perform(&mut c, "tag", now);
        picture_of(&mut c);
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
