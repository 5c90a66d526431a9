//! Opens a scan, finds its colon, and prepares a flight for a scene.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use crate::components::play::Playback;
use crate::error::{Error, Result};
use crate::fields::cleanse::{self, Cleansed};
use crate::fields::lumen::Told;
use crate::fields::{Lumen, lumen};
use crate::flight_fields::Fields;
use crate::found::Found;
use crate::phantom::{Phantom, PhantomSettings};
use crate::plan::{self, FlightRequest, Plan};
use crate::progress::Progress;
use crate::render::Preset;
use crate::space::{PreparedVolume, TransferFunction};
use crate::timings::Timings;
use crate::volume::Volume;
use crate::volume::io::{self, LoadOptions};
use crate::{FlightApp, Scene, Setup};

/// A scan to fly through. Its colon is segmented on first use.
///
/// ```
/// # use colvis_app as colvis;
/// use colvis::app::{Scan, Scene, FlightRequest};
/// use colvis::components::flight::State;
///
/// # fn main() -> colvis::error::Result<()> {
/// let mut scan = Scan::phantom(1)?; // or Scan::open("scan.nii.gz")?
/// let scene = Scene { log: true, ..Scene::guided_by("tentacles") };
/// let mut flight = scan.flight(scene, &FlightRequest::default())?; // through the largest segment, rectum to cecum
/// assert_eq!(flight.fly(2.0)?, State::Flying);
/// let picture = flight.look(320, 240)?;
/// println!("{} after {:.0} mm", flight.pose().position, flight.flight().length_mm);
/// # assert!(flight.take_log().len() == 240 && picture.pixels().iter().any(|p| p[0] > 30));
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Scan {
    volume: PreparedVolume,
    lumen: Option<Arc<Lumen>>,
    /// Kinds that the reader gave to gas.
    told: Vec<Told>,
    /// The lumen before kinds were given to the gas of a cleansed scan: it knows the ends.
    former: Option<Arc<Lumen>>,
    without_tag: Option<WithoutTag>,
    /// What was cleansed in this scan itself.
    cleansed: Option<Arc<Cleansed>>,
    /// What is known of the scan as read.
    found: Arc<Found>,
    /// True if the measure along the colon is computed before the scan is cleansed.
    measures_along: bool,
    timings: Timings,
    notes: Vec<String>,
    progress: Arc<Progress>,
}

/// The scan without pools of tagged fluid, for guides that need that. It is derived once and kept for further flights. The scan
/// itself stays unchanged.
#[derive(Clone, Debug)]
struct WithoutTag {
    volume: PreparedVolume,
    lumen: Arc<Lumen>,
    cleansed: Arc<Cleansed>,
    /// Notes to the user for each flight through it.
    notes: Vec<String>,
}

/// Options for opening a scan.
#[derive(Clone, Debug, Default)]
pub struct OpenOptions {
    /// How the file is read.
    pub load: LoadOptions,
    /// Which values of it are wall.
    pub transfer: TransferFunction,
    /// The renderer that the volume is prepared for.
    pub preset: Preset,
    /// Cleanses it, as [`Scan::cleanse`] does.
    pub cleanse: bool,
    /// Computes the measure along the colon ([`Lumen::along`](crate::fields::Lumen::along)) before the scan is cleansed, if it is. Set it
    /// if the measure will be needed: once the scan is cleansed, the measure takes a second copy of the volume with the values as scanned.
    pub measure_along: bool,
    /// Receives the progress, and can interrupt the work.
    pub progress: Arc<Progress>,
    /// What is known of the scan as read.
    #[doc(hidden)]
    pub found: Arc<Found>,
}

impl Scan {
    /// Opens a scan with the default options: NIfTI, MetaImage, NRRD, a DICOM file or folder.
    ///
    /// # Errors
    /// Returns status 3 if it cannot be read or used.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_with(path, &OpenOptions::default())
    }

    /// Opens a scan with the given options.
    ///
    /// # Errors
    /// Returns status 2 for invalid options, 3 if the scan cannot be read or used, 4 if interrupted.
    pub fn open_with(path: impl AsRef<Path>, options: &OpenOptions) -> Result<Self> {
        let mut timings = Timings::default();
        let loaded = timings.time("load_s", || io::load(path.as_ref(), &options.load, &options.progress))?;
        Self::read(Arc::new(loaded.volume), loaded.notes, options, timings)
    }

    /// Creates a scan that was read elsewhere, with the notes and the times of that.
    #[doc(hidden)]
    pub fn read(volume: Arc<Volume>, notes: Vec<String>, options: &OpenOptions, timings: Timings) -> Result<Self> {
        let mut scan = Self::made(volume, options, timings)?;
        scan.notes.splice(0..0, notes);
        Ok(scan)
    }

    /// Creates the embedded phantom: a small synthetic colon, a different one for each seed.
    ///
    /// # Errors
    /// Returns an error only for an internal error of the program.
    pub fn phantom(seed: u64) -> Result<Self> {
        Self::phantom_with(seed, &OpenOptions::default())
    }

    /// Creates the embedded phantom with the given options.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn phantom_with(seed: u64, options: &OpenOptions) -> Result<Self> {
        let phantom = Phantom::new(&PhantomSettings::embedded(seed));
        let mut timings = Timings::default();
        let volume = timings.time("load_s", || phantom.voxelise(&phantom.grid(), &options.progress))?;
        Self::made(Arc::new(volume), options, timings)
    }

    /// Creates a scan from a volume in memory.
    ///
    /// # Errors
    /// Returns status 4 if it is to be cleansed and has one slice, or if interrupted.
    pub fn of(volume: Volume, options: &OpenOptions) -> Result<Self> {
        Self::made(Arc::new(volume), options, Timings::default())
    }

    /// Creates a scan from a prepared volume.
    pub fn prepared(volume: PreparedVolume, progress: Arc<Progress>) -> Self {
        Self::ready(volume, Timings::default(), progress)
    }

    fn ready(volume: PreparedVolume, timings: Timings, progress: Arc<Progress>) -> Self {
        Self {
            volume,
            lumen: None,
            told: Vec::new(),
            former: None,
            without_tag: None,
            cleansed: None,
            found: Arc::default(),
            measures_along: false,
            timings,
            notes: Vec::new(),
            progress,
        }
    }

    fn made(volume: Arc<Volume>, options: &OpenOptions, mut timings: Timings) -> Result<Self> {
        let begun = Instant::now();
        let volume = options.preset.preparation.prepare(volume, options.transfer);
        timings.add("flags_s", begun.elapsed().as_secs_f64());
        let mut scan = Self::ready(volume, timings, Arc::clone(&options.progress));
        (scan.measures_along, scan.found) = (options.measure_along, Arc::clone(&options.found));
        if options.cleanse {
            let taken = scan.cleanse()?;
            scan.notes.push(taken.to_string());
        }
        Ok(scan)
    }

    /// Returns the prepared volume.
    pub fn volume(&self) -> &PreparedVolume {
        &self.volume
    }

    /// Returns the time taken so far by each part of the preparation.
    pub fn timings(&self) -> &Timings {
        &self.timings
    }

    /// Takes the notes to the user since the last call.
    pub fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    /// Gives kinds to the gas at some places (world, mm), in place of those given before. The lumen, and everything derived from
    /// it, is found again. If two places lie in the same gas, the later kind counts. A cleansed scan stays cleansed.
    pub fn tell(&mut self, told: Vec<Told>) {
        if told == self.told {
            return;
        }
        let lumen = self.lumen.take();
        if self.cleansed.is_some() && self.former.is_none() {
            self.former = lumen;
        }
        (self.told, self.without_tag) = (told, None);
        // What is known is without kinds.
        self.found = Arc::default();
    }

    /// Returns the kinds that were given to gas.
    pub fn told(&self) -> &[Told] {
        &self.told
    }

    /// Returns the colon's lumen, which the first call segments.
    ///
    /// # Errors
    /// Returns status 4 for a volume of one voxel or one slice, or if interrupted.
    pub fn lumen(&mut self) -> Result<Arc<Lumen>> {
        let progress = Arc::clone(&self.progress);
        progress.call(|| self.find_lumen())
    }

    fn find_lumen(&mut self) -> Result<Arc<Lumen>> {
        if let Some(lumen) = &self.lumen {
            return Ok(Arc::clone(lumen));
        }
        check_thick(self.volume.voxels())?;
        let find = || lumen::find_told(self.volume.voxels(), &self.told, &self.progress);
        let mut found = self.timings.time("lumen_s", || self.found.lumen(find))?;
        self.notes.extend(found.lying.and_then(|l| l.conflict()));
        if let Some(former) = &self.former {
            cleanse::keep_ends(Arc::make_mut(&mut found), former);
        }
        if let Some(cleansed) = &self.cleansed {
            Arc::make_mut(&mut found).measure_as_scanned(cleansed, &self.told, None);
        }
        self.close_septa(&found);
        Ok(Arc::clone(self.lumen.insert(found)))
    }

    /// Makes the septa of a lumen tissue, so that neither a camera nor a ray passes through them.
    fn close_septa(&mut self, lumen: &Lumen) {
        if lumen.septa().is_empty() {
            return;
        }
        self.notes.extend(lumen.septa_note());
        let begun = Instant::now();
        self.volume.change(|volume| lumen.close_septa(volume));
        self.timings.add("septa_flags_s", begun.elapsed().as_secs_f64());
    }

    /// True if tagged fluid or stool was taken out of this scan.
    pub fn is_cleansed(&self) -> bool {
        self.cleansed.as_ref().is_some_and(|c| !c.changes.is_empty())
    }

    /// Replaces tagged fluid and stool of this scan by gas, in place if nothing shares its voxels. A scan without tagged fluid
    /// stays unchanged. Returns what was cleansed; its changes hold the values that the scan had.
    ///
    /// # Errors
    /// Returns status 4 for a volume of one voxel or one slice, or if interrupted; the scan is then unchanged.
    pub fn cleanse(&mut self) -> Result<Arc<Cleansed>> {
        let progress = Arc::clone(&self.progress);
        let known = Arc::clone(&self.found);
        progress.call(|| self.cleanse_with(cleanse::cleanse, &known))
    }

    /// `known` is what `method` has found before.
    fn cleanse_with(
        &mut self,
        method: fn(&Volume, &Lumen, &Progress) -> Result<Cleansed>,
        known: &Found,
    ) -> Result<Arc<Cleansed>> {
        if let Some(cleansed) = &self.cleansed {
            return Ok(Arc::clone(cleansed));
        }
        let found = self.lumen()?;
        let volume = self.volume.clone();
        let find = || method(volume.voxels(), &found, &self.progress);
        let cleansed = self.timings.time("cleanse_s", || known.cleansed(find))?;
        drop(volume);
        let mut cleansed = Arc::unwrap_or_clone(cleansed);
        if cleansed.changes.is_empty() {
            return Ok(Arc::clone(self.cleansed.insert(Arc::new(cleansed))));
        }
        if self.measures_along {
            let measured = self.timings.time("along_s", || found.along(self.volume.voxels(), &self.progress));
            // Another failure is that of whoever asks for the measure.
            if measured.is_err() {
                self.progress.check()?;
            }
        }
        self.change(&mut cleansed);
        let mut lumen = match self.lumen_without_tag(&found, known) {
            Ok(lumen) => lumen,
            Err(e) => {
                self.change(&mut cleansed);
                return Err(e);
            }
        };
        self.close_septa(&lumen);
        let cleansed = Arc::new(cleansed);
        lumen.measure_as_scanned(&cleansed, &self.told, Some(found));
        (self.lumen, self.without_tag) = (Some(Arc::new(lumen)), None);
        Ok(Arc::clone(self.cleansed.insert(cleansed)))
    }

    /// Exchanges the values of what was cleansed, and prepares the volume again.
    fn change(&mut self, cleansed: &mut Cleansed) {
        let begun = Instant::now();
        self.volume.change(|volume| cleansed.changes.exchange(volume));
        self.timings.add("cleansed_flags_s", begun.elapsed().as_secs_f64());
    }

    fn lumen_without_tag(&mut self, before: &Lumen, known: &Found) -> Result<Lumen> {
        let find = || lumen::find_told(self.volume.voxels(), &self.told, &self.progress);
        let found = self.timings.time("cleansed_lumen_s", || known.cleansed_lumen(find))?;
        let mut lumen = Arc::unwrap_or_clone(found);
        cleanse::keep_ends(&mut lumen, before);
        Ok(lumen)
    }

    /// Returns the volume and lumen for a flight whose guide flies through tagged fluid: the cleansed ones.
    fn without_tag(&mut self) -> Result<Flown> {
        let found = self.lumen()?;
        if self.cleansed.is_some() {
            return Ok((self.volume.clone(), found, self.cleansed.clone()));
        }
        if self.without_tag.is_none() {
            let mut other = Self::ready(self.volume.clone(), Timings::default(), Arc::clone(&self.progress));
            other.lumen = Some(Arc::clone(&found));
            other.told.clone_from(&self.told);
            other.measures_along = self.measures_along;
            let cleansed = other.cleanse_with(cleanse::to_fly, &Found::default())?;
            let lumen = other.lumen()?;
            other.timings.parts().iter().for_each(|&(name, seconds)| self.timings.add(name, seconds));
            let notes = through_fluid(&cleansed, &found, &lumen);
            self.without_tag = Some(WithoutTag { volume: other.volume, lumen, cleansed, notes });
        }
        let Some(made) = &self.without_tag else { return Ok((self.volume.clone(), found, None)) };
        self.notes.extend(made.notes.iter().cloned());
        Ok((made.volume.clone(), Arc::clone(&made.lumen), Some(Arc::clone(&made.cleansed))))
    }

    /// Cleanses the scan in place for a scene whose guide flies through fluid: the scan as scanned is no longer needed.
    ///
    /// # Errors
    /// As [`Scan::cleanse`].
    #[doc(hidden)]
    pub fn cleanse_for(&mut self, scene: &Scene) -> Result<()> {
        if self.cleansed.is_some() || scene.play().is_some() || !scene.needs().fluid_as_gas {
            return Ok(());
        }
        let before = self.lumen()?;
        let cleansed = self.cleanse_with(cleanse::to_fly, &Found::default())?;
        let now = self.lumen()?;
        self.notes.extend(through_fluid(&cleansed, &before, &now));
        Ok(())
    }

    /// Plans start and goal of a flight, for a body of `radius_mm`.
    ///
    /// # Errors
    /// Returns status 4 if there is no colon to fly, a point is outside the lumen, or the lumen is too narrow.
    pub fn plan(&mut self, request: &FlightRequest, radius_mm: f64) -> Result<Plan> {
        let progress = Arc::clone(&self.progress);
        progress.call(|| {
            let lumen = self.lumen()?;
            let volume = self.volume.clone();
            self.plan_in(&volume, &lumen, request, radius_mm)
        })
    }

    fn plan_in(
        &mut self,
        volume: &PreparedVolume,
        lumen: &Lumen,
        request: &FlightRequest,
        radius_mm: f64,
    ) -> Result<Plan> {
        self.timings.time("plan_s", || plan::plan(volume, lumen, request, radius_mm, &self.progress))
    }

    /// Creates a flight at its start, with everything that the scene needs. The scan itself stays unchanged, so one flight never
    /// affects the next.
    ///
    /// # Errors
    /// Returns status 2 for an invalid scene, 3 for a log of another scan, 4 if there is no colon or no path between the points,
    /// or if interrupted.
    pub fn flight(&mut self, scene: Scene, request: &FlightRequest) -> Result<FlightApp> {
        let progress = Arc::clone(&self.progress);
        progress.call(|| self.prepare_flight(scene, request))
    }

    fn prepare_flight(&mut self, scene: Scene, request: &FlightRequest) -> Result<FlightApp> {
        let ((volume, lumen, cleansed), plan) = match scene.play() {
            Some(play) => {
                check_log(play, &self.volume)?;
                let lumen = Lumen::none(self.volume.voxels().grid());
                ((self.volume.clone(), Arc::new(lumen), self.cleansed.clone()), plan::as_logged(play))
            }
            None => {
                let flown = match scene.needs().fluid_as_gas {
                    true => self.without_tag()?,
                    false => {
                        // The lumen first: it may close septa in the volume.
                        let lumen = self.lumen()?;
                        (self.volume.clone(), lumen, self.cleansed.clone())
                    }
                };
                let plan = self.plan_in(&flown.0, &flown.1, request, scene.body.radius_mm)?;
                (flown, plan)
            }
        };
        self.notes.extend(plan.notes.iter().cloned());
        let fields = Fields::default();
        let told = self.told.clone();
        self.fly(Setup { volume, lumen, plan, scene, fields, cleansed, told })
    }

    /// Reports the progress of what follows elsewhere.
    #[doc(hidden)]
    pub fn report_to(&mut self, progress: &Arc<Progress>) {
        self.progress = Arc::clone(progress);
    }

    /// Creates a flight of a scan that cannot be flown, to look at its slices: the camera rests in the middle of the scan, and nothing
    /// moves it.
    ///
    /// # Errors
    /// Returns status 2 for an invalid scene, 4 if interrupted.
    #[doc(hidden)]
    pub fn at_rest(&mut self, scene: Scene) -> Result<FlightApp> {
        let grid = self.volume.voxels().grid();
        // A single slice has no lumen, and a scan without a colon one without segments.
        let lumen = self.lumen.clone().unwrap_or_else(|| Arc::new(Lumen::none(grid)));
        let middle = grid.world((DVec3::from_array(grid.dims().map(|n| n as f64)) - 1.0) * 0.5);
        let scene = Scene { steering: crate::Steering::Nobody, mines: None, watch: None, coverage: false, ..scene };
        let (volume, fields) = (self.volume.clone(), Fields::default());
        let (plan, cleansed, told) = (Plan::between(middle, middle, 1.0), self.cleansed.clone(), self.told.clone());
        self.fly(Setup { volume, lumen, plan, scene, fields, cleansed, told })
    }

    /// Creates a flight from its parts, with the fields that it needs.
    fn fly(&mut self, mut setup: Setup) -> Result<FlightApp> {
        setup.scene.check()?;
        setup.build_fields(&self.progress)?;
        self.notes.extend(setup.fields.take_notes());
        setup.fields.take_times().into_iter().for_each(|(name, seconds)| self.timings.add(name, seconds));
        let progress = Arc::clone(&self.progress);
        let create = || FlightApp::with_fields(setup, progress);
        let mut flight = self.timings.time("scene_s", create)?;
        self.notes.extend(flight.take_notes());
        Ok(flight)
    }
}

/// What is flown: the volume, its lumen, and what was cleansed in it.
type Flown = (PreparedVolume, Arc<Lumen>, Option<Arc<Cleansed>>);

/// Notes on a flight through what was cleansed.
fn through_fluid(cleansed: &Cleansed, before: &Lumen, now: &Lumen) -> Vec<String> {
    if cleansed.changes.is_empty() {
        return Vec::new();
    }
    let mut notes = vec![format!("the guide flies through tagged fluid, and films and stool are wall: {cleansed}")];
    let [before, now] = [before, now].map(|l| l.segments.len());
    if now < before {
        notes.push(format!("{before} segments become {now}"));
    }
    notes
}

/// Checks that the volume has more than one slice.
///
/// # Errors
/// Returns status 4 for a volume of one voxel or one slice.
#[doc(hidden)]
pub fn check_thick(volume: &Volume) -> Result<()> {
    let dims = volume.grid().dims();
    if dims.iter().any(|&d| d < 2) {
        let why = format!("has {}×{}×{} voxels: a single slice has no lumen", dims[0], dims[1], dims[2]);
        return Err(Error::incomplete("volume", why, "give the whole scan; info and render accept this one"));
    }
    Ok(())
}

/// Checks that a log was recorded in this scan, as far as that can be determined. It can be played in no other.
fn check_log(play: &Playback, volume: &PreparedVolume) -> Result<()> {
    let grid = volume.voxels().grid();
    let last = DVec3::from_array(grid.dims().map(|n| n as f64 - 1.0));
    let outside = |p: DVec3| {
        let v = grid.voxel(p);
        !(v.cmpge(DVec3::splat(-0.5)).all() && v.cmple(last + 0.5).all())
    };
    match play.lines().iter().find(|l| outside(DVec3::from_array(l.position))) {
        None => Ok(()),
        Some(l) => {
            let at = plan::triple(DVec3::from_array(l.position));
            Err(Error::input("log", format!("{at} lies outside this scan"), "give the scan that it was flown in"))
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::components::input::FlightCommand;
    use crate::fields::Along;
    use crate::shared::shared;
    use crate::volume::Grid;

    fn small() -> Scan {
        Scan::of(shared(&PhantomSettings::embedded(1)).1, &OpenOptions::default()).unwrap()
    }

    #[test]
    fn what_is_told_counts_in_every_lumen_of_the_scan() {
        let mut scan = small();
        let before = scan.lumen().unwrap();
        let told = vec![(before.segments[0].ends[0], lumen::GasKind::Stomach)];
        scan.tell(told.clone());
        let now = scan.lumen().unwrap();
        assert!(now.gas_ml() < before.gas_ml() - 1.0 && scan.told() == told);
        // Also in the cleansed scan, and taken back.
        scan.cleanse().unwrap();
        assert!(scan.lumen().unwrap().gas_ml() < before.gas_ml() - 1.0);
        scan.tell(Vec::new());
        assert!((scan.lumen().unwrap().gas_ml() - before.gas_ml()).abs() < 1.0);
    }

    /// In a cleansed scan the line of the lumen is another, but the measure is that of the scan as scanned.
    #[test]
    #[ignore = "slow: measures along a phantom with and without its tag"]
    fn the_measure_along_the_colon_is_that_of_the_scan_as_it_was() {
        let progress = Progress::new();
        let settings = PhantomSettings { fluid: true, ..PhantomSettings::embedded(1) };
        let open = || Scan::of(shared(&settings).1, &OpenOptions::default()).unwrap();
        let along = |scan: &mut Scan| {
            let lumen = scan.lumen().unwrap();
            (lumen.along(scan.volume().voxels(), &progress).unwrap(), lumen)
        };
        let mut scan = open();
        let (before, first) = along(&mut scan);
        let told = vec![(first.segments[0].ends[0], lumen::GasKind::Stomach)];
        scan.tell(told.clone());
        let (told_before, _) = along(&mut scan);
        assert_ne!(told_before.length_mm(), before.length_mm());
        // Nothing asked for it before the scan was cleansed.
        let mut scan = open();
        assert!(!scan.cleanse().unwrap().changes.is_empty());
        let (now, lumen) = along(&mut scan);
        let other = Along::new(scan.volume().voxels(), &lumen, &progress).unwrap();
        assert_ne!(other.length_mm(), before.length_mm(), "the test needs a line that differs");
        assert_eq!(now.length_mm(), before.length_mm());
        for segment in &first.segments {
            segment.way.iter().for_each(|&p| assert_eq!(now.of(p).map(|a| a.mm), before.of(p).map(|a| a.mm), "{p}"));
        }
        // Kinds that are given afterwards change it as they do in the scan with its tag.
        scan.tell(told);
        assert_eq!(along(&mut scan).0.length_mm(), told_before.length_mm());
    }

    #[test]
    fn the_measure_along_the_colon_may_come_before_the_cleansing() {
        let progress = Progress::new();
        let settings = PhantomSettings { fluid: true, ..PhantomSettings::embedded(1) };
        let along = |measure_along: bool| {
            let options = OpenOptions { cleanse: true, measure_along, ..OpenOptions::default() };
            let mut scan = Scan::of(shared(&settings).1, &options).unwrap();
            let is_measured = scan.timings().parts().iter().any(|p| p.0 == "along_s");
            assert_eq!(is_measured, measure_along);
            let lumen = scan.lumen().unwrap();
            let along = lumen.along(scan.volume().voxels(), &progress).unwrap();
            let places: Vec<_> = lumen.segments.iter().flat_map(|s| s.way.clone()).collect();
            (along.length_mm(), places.iter().map(|&p| along.of(p)).collect::<Vec<_>>())
        };
        assert_eq!(along(true), along(false));
    }

    #[test]
    fn a_cancelled_call_leaves_the_scan_and_its_flights_usable() {
        let mut scan = small();
        let progress = Arc::clone(&scan.progress);
        let request = FlightRequest::default();
        progress.cancel();
        assert!(scan.lumen().is_err());
        assert!(!scan.lumen().unwrap().segments.is_empty());
        progress.cancel();
        assert!(scan.cleanse().is_err());
        scan.cleanse().unwrap();
        progress.cancel();
        assert!(scan.flight(Scene::guided_by("path"), &request).is_err());
        let mut flight = scan.flight(Scene::guided_by("path"), &request).unwrap();
        // A command that was cancelled leaves the flight as it was, and can be given again.
        progress.cancel();
        let potential = || FlightCommand::Guide("potential".to_owned());
        assert!(flight.act(potential()).is_err());
        assert_eq!(flight.setup().scene.guide_name(), "path");
        flight.fly(0.1).unwrap();
        flight.act(potential()).unwrap();
        flight.fly(0.1).unwrap();
        progress.cancel();
        assert!(flight.survey().along().is_err() && flight.survey().along().is_ok());
    }

    #[test]
    fn a_scan_of_a_single_slice_is_refused() {
        let volume = |dims: [usize; 3]| {
            let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
            Volume::new(grid, vec![0; dims.iter().product()])
        };
        check_thick(&volume([2, 2, 2])).unwrap();
        for dims in [[1, 1, 1], [9, 7, 1], [9, 1, 7], [1, 9, 7]] {
            let e = check_thick(&volume(dims)).unwrap_err();
            let [x, y, z] = dims;
            assert!(e.kind as u8 == 4 && e.why.contains(&format!("{x}×{y}×{z} voxels")), "{e}");
        }
    }
}
