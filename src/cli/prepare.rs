//! Options that several commands share, and the head of their stats.

use glam::DVec3;
use serde_json::{Map, Value, json};
use std::path::Path;
use std::sync::Arc;

use crate::app::found::Found;
use crate::app::scan::check_thick;
use crate::app::{OpenOptions, Scan, Timings, colon};
use crate::cli::Program;
use crate::cli::args::{Global, ImageSize, QualityName};
use crate::cli::messages::say;
use crate::cli::shared::Use;
use crate::error::{Error, Kind, Result};
use crate::fields::cleanse::{self, Cleansed};
use crate::fields::{Lumen, lumen};
use crate::memory::resident_bytes;
use crate::phantom::{Phantom, PhantomSettings};
use crate::progress::Progress;
use crate::render::packets::simd_level;
use crate::render::{CameraModel, Preset, Quality, Settings};
use crate::space::TransferFunction;
use crate::volume::io::{self, LoadOptions};
use crate::volume::{Volume, hounsfield};

/// Refuses invalid global options, even if the command ignores them; `scene` is a flight's scene file. Fails with status 2.
pub(crate) fn check(program: &Program, global: &Global, scene: Option<&Path>) -> Result<()> {
    transfer(global)?;
    checked_options(global)?;
    let named = camera(program, global, CameraModel::default())?;
    if scene.is_some() && global.camera.is_none() {
        // The scene may name a camera with limits of its own.
        return Ok(());
    }
    fov(global, named).map(|_| ())
}

/// Options for reading an input.
pub(crate) fn load_options(global: &Global) -> LoadOptions {
    LoadOptions {
        spacing: global.spacing.map(|s| s.0),
        hu: global.hu.map(|p| (p.0, p.1)),
        series: global.series_number(),
        allow_gaps: global.allow_gaps,
    }
}

/// The same, checked. Fails with status 2 if they are invalid.
fn checked_options(global: &Global) -> Result<LoadOptions> {
    if let Some(h) = global.hu.filter(|h| h.0 >= h.1) {
        return Err(Error::usage("--hu", format!("{} HU is not below {} HU", h.0, h.1), "give black,white"));
    }
    if let Some(h) = global.hu.filter(|h| h.0.abs().max(h.1.abs()) > 32767.0) {
        return Err(Error::usage("--hu", format!("{},{} is not within ±32767 HU", h.0, h.1), "give black,white"));
    }
    if let Some(s) = global.spacing.map(|s| s.0).filter(|s| s.min_element() < 1e-6 || s.max_element() > 1e6) {
        return Err(Error::usage("--spacing", format!("{s} mm is out of range"), "give three sizes in mm"));
    }
    Ok(load_options(global))
}

/// The opacity ramp of `--wall`. Fails with status 2 if it is invalid.
pub(crate) fn transfer(global: &Global) -> Result<TransferFunction> {
    let Some(p) = global.wall else { return Ok(TransferFunction::default()) };
    if p.0.abs().max(p.1.abs()) > 32767.0 {
        let hint = "give LO,HI in HU with LO below HI, such as -800,-500";
        return Err(Error::usage("--wall", format!("{},{} is not within ±32767 HU", p.0, p.1), hint));
    }
    TransferFunction::new(p.0 as f32, p.1 as f32)
}

/// The view angle of `--fov`, degrees, checked against the camera's limits. Fails with status 2 if it exceeds them.
pub(crate) fn fov(global: &Global, camera: CameraModel) -> Result<f64> {
    let fov = global.fov.unwrap_or(90.0);
    camera.camera(fov, 1.0).map_err(|e| match e.kind {
        Kind::Usage => Error::usage("--fov", e.why, "give an angle such as 90"),
        _ => e,
    })?;
    Ok(fov)
}

/// The size of a camera's images if none is given: 1024 pixels high, and as wide as the camera has them. Fails if a plug-in does.
pub(crate) fn usual_size(camera: CameraModel) -> Result<ImageSize> {
    let aspect = camera.camera(90.0, 1.0).ok().and_then(|c| c.aspect()).unwrap_or(1.0);
    Ok(ImageSize { width: (1024.0 * aspect).round() as usize, height: 1024 })
}

/// The renderer's settings for a quality on the command line.
pub(crate) fn quality(name: Option<QualityName>) -> Settings {
    match name.unwrap_or(QualityName::High) {
        QualityName::High => Settings::new(Quality::High),
        QualityName::Low => Settings::new(Quality::Low),
        QualityName::Reference => Settings::new(Quality::Reference),
        QualityName::Adaptive => Settings { adaptive: true, ..Settings::new(Quality::High) },
    }
}

/// The renderer of `--preset`, or else of the scene. Fails with status 2 for an unknown name.
pub(crate) fn preset(program: &Program, named: Option<&str>, scene: Preset) -> Result<Preset> {
    named.map_or(Ok(scene), |name| program.catalog.find_preset(name))
}

/// The camera of `--camera`, or else of the scene. Fails with status 2 for an unknown name.
pub(crate) fn camera(program: &Program, global: &Global, scene: CameraModel) -> Result<CameraModel> {
    global.camera.as_deref().map_or(Ok(scene), |name| program.catalog.find_camera(name))
}

/// Opens the input, or the embedded phantom if there is none, ready to render, and prints notes about it. Fails with status 2 for
/// invalid options, 3 if it cannot be read, 4 if interrupted.
pub(crate) fn open(input: Option<&Path>, global: &Global, preset: Preset, progress: &Arc<Progress>) -> Result<Scan> {
    open_by(input, global, &options(global, preset, progress)?, Use::Change)
}

/// Like [`open`], for a flight: `measure_along` if it needs the measure along the colon as scanned; `purpose` tells whether it is in the
/// scan as read.
pub(crate) fn open_to_fly(
    input: Option<&Path>,
    global: &Global,
    preset: Preset,
    measure_along: bool,
    purpose: Use,
    progress: &Arc<Progress>,
) -> Result<Scan> {
    let purpose = if global.cleanse { Use::Change } else { purpose };
    open_by(input, global, &OpenOptions { measure_along, ..options(global, preset, progress)? }, purpose)
}

fn open_by(input: Option<&Path>, global: &Global, options: &OpenOptions, purpose: Use) -> Result<Scan> {
    let mut scan = opened(input, global, options, purpose)?;
    scan.take_notes().iter().for_each(|note| say(note));
    Ok(scan)
}

/// Like [`open`], and leaves the notes to the caller.
#[cfg(feature = "window")]
pub(crate) fn open_unsaid(
    input: Option<&Path>,
    global: &Global,
    preset: Preset,
    progress: &Arc<Progress>,
) -> Result<Scan> {
    opened(input, global, &options(global, preset, progress)?, Use::Change)
}

fn options(global: &Global, preset: Preset, progress: &Arc<Progress>) -> Result<OpenOptions> {
    Ok(OpenOptions {
        load: checked_options(global)?,
        transfer: transfer(global)?,
        preset,
        cleanse: global.cleanse,
        measure_along: false,
        progress: Arc::clone(progress),
        found: Arc::default(),
    })
}

fn opened(input: Option<&Path>, global: &Global, options: &OpenOptions, purpose: Use) -> Result<Scan> {
    let Some(path) = input else {
        report_unread(global);
        return Scan::phantom_with(global.seed.unwrap_or(1), options);
    };
    let mut timings = Timings::default();
    let read = || timings.time("load_s", || io::load(path, &options.load, &options.progress));
    let (volume, notes, found) = global.shared.read(path, &options.load, purpose, read)?;
    Scan::read(volume, notes, &OpenOptions { found, ..options.clone() }, timings)
}

/// A scan that a command has read.
pub(crate) struct Input {
    pub volume: Arc<Volume>,
    /// What is known of it as it is.
    found: Arc<Found>,
}

impl Input {
    /// Returns its voxels.
    pub(crate) fn into_volume(self) -> Volume {
        Arc::unwrap_or_clone(self.volume)
    }

    /// Returns the colon. Fails with status 4 for a volume of one voxel or one slice, or if interrupted.
    pub(crate) fn lumen(&self, timings: &mut Timings, progress: &Progress) -> Result<Arc<Lumen>> {
        check_thick(&self.volume)?;
        let find = || lumen::find(&self.volume, progress);
        let found = timings.time("lumen_s", || self.found.lumen(find))?;
        if let Some(conflict) = found.lying.and_then(|l| l.conflict()) {
            say(&conflict);
        }
        if let Some(note) = found.septa_note() {
            say(&note);
        }
        Ok(found)
    }

    /// Returns the colon; with a point (world, mm) the gas there, whatever it looks like. Fails as [`Input::lumen`] does, and with
    /// status 4 if there is no gas at the point.
    pub(crate) fn lumen_from(
        &self,
        from: Option<DVec3>,
        timings: &mut Timings,
        progress: &Progress,
    ) -> Result<Arc<Lumen>> {
        let Some(p) = from else { return self.lumen(timings, progress) };
        check_thick(&self.volume)?;
        let found = timings.time("lumen_s", || lumen::gas_at(&self.volume, p, progress))?;
        found.map(Arc::new).ok_or_else(|| {
            let odd = hounsfield::oddity(&self.volume).map_or_else(String::new, |odd| format!(": {odd}"));
            let why = format!("{:.1},{:.1},{:.1} has no gas inside the patient within 5 mm{odd}", p.x, p.y, p.z);
            Error::incomplete("--from", why, "give a point in the colon")
        })
    }

    /// Returns what cleansing removes from the scan, whose colon is `lumen`, which it has from [`Input::lumen_from`] with the same
    /// point. Fails with status 4 if interrupted.
    pub(crate) fn cleansed(
        &self,
        lumen: &Lumen,
        from: Option<DVec3>,
        timings: &mut Timings,
        progress: &Progress,
    ) -> Result<Cleansed> {
        let find = || cleanse::cleanse(&self.volume, lumen, progress);
        timings.time("cleanse_s", || self.known(from).cleansed(find)).map(Arc::unwrap_or_clone)
    }

    /// Cleanses the scan and prints what was removed. Returns the colon in it (with a point (world, mm), the gas there) and what was
    /// removed, with the values that the scan had. `with_along` measures along the scan as scanned, as `centerline` does. Fails as
    /// [`Input::lumen_from`] does, and with status 4 if there is no colon.
    pub(crate) fn cleanse(
        &mut self,
        from: Option<DVec3>,
        with_along: bool,
        timings: &mut Timings,
        progress: &Progress,
    ) -> Result<(Lumen, Option<Cleansed>)> {
        let found = self.lumen_from(from, timings, progress)?;
        if found.segments.is_empty() {
            return Err(no_lumen(&self.volume, &found, "give --from and a point in the colon"));
        }
        let before = Arc::clone(&found);
        let again = |volume: &Volume| match from {
            // Gas stays gas, so a requested point still has some.
            Some(p) => lumen::gas_at(volume, p, progress).map(|l| l.unwrap_or_else(|| Lumen::clone(&before))),
            None => lumen::find(volume, progress),
        };
        let taken = |cleansed: &Cleansed| say(&cleansed.to_string());
        let known = self.known(from);
        // What is known is of the scan as read.
        self.found = Arc::default();
        let volume = Arc::make_mut(&mut self.volume);
        colon::without_tag(volume, (found, &known), with_along, again, taken, timings, progress)
    }

    /// What is known of the scan if its colon is that of the rules, and not of a point.
    fn known(&self, from: Option<DVec3>) -> Arc<Found> {
        from.map_or_else(|| Arc::clone(&self.found), |_| Arc::default())
    }
}

/// Reads the input without preparing it, cleanses it if requested, and prints notes about it. Fails as [`open`] does, and with
/// status 4 if it is to be cleansed and has one slice.
pub(crate) fn load(
    input: &Path,
    global: &Global,
    purpose: Use,
    timings: &mut Timings,
    progress: &Progress,
) -> Result<Input> {
    let options = checked_options(global)?;
    let purpose = if global.cleanse { Use::Change } else { purpose };
    let read = || timings.time("load_s", || io::load(input, &options, progress));
    let (volume, notes, found) = global.shared.read(input, &options, purpose, read)?;
    notes.iter().for_each(|note| say(note));
    let mut input = Input { volume, found };
    if global.cleanse {
        let found = input.lumen(timings, progress)?;
        let mut cleansed = input.cleansed(&found, None, timings, progress)?;
        drop(found);
        say(&cleansed.to_string());
        cleansed.changes.exchange(Arc::make_mut(&mut input.volume));
        input.found = Arc::default();
    }
    Ok(input)
}

/// Like [`load`], for a mask, which is never cleansed. Fails as [`open`] does, and with status 3 if it is not a mask.
pub(crate) fn load_mask(input: &Path, global: &Global, timings: &mut Timings, progress: &Progress) -> Result<Volume> {
    if global.cleanse {
        say("--cleanse is ignored: a mask has no HU");
    }
    let options = checked_options(global)?;
    let loaded = timings.time("load_s", || io::load_mask(input, &options, progress))?;
    loaded.notes.iter().for_each(|note| say(note));
    Ok(loaded.volume)
}

/// Like [`load`]; without an input it makes the embedded phantom.
pub(crate) fn load_or_phantom(input: Option<&Path>, global: &Global, progress: &Progress) -> Result<Volume> {
    input.map_or_else(
        || {
            report_unread(global);
            let phantom = Phantom::new(&PhantomSettings::embedded(global.seed.unwrap_or(1)));
            phantom.voxelise(&phantom.grid(), progress)
        },
        |path| load(path, global, Use::Change, &mut Timings::default(), progress).map(Input::into_volume),
    )
}

/// The failure of a command that found no colon in a scan. Values that are not HU come first: what was found in them means nothing.
pub(crate) fn no_lumen(volume: &Volume, lumen: &Lumen, hint: &str) -> Error {
    if let Some(odd) = hounsfield::oddity(volume) {
        return Error::incomplete("volume", format!("no gas of a colon was found in it: {odd}"), odd.hint());
    }
    let found = lumen.found().map_or_else(String::new, |f| format!(": {f}"));
    Error::incomplete("volume", format!("no gas of a colon was found in it{found}"), hint)
}

/// Returns the file of a command that takes either a scan or the mask of a lumen, and true if it is the mask. Fails with status 2
/// unless exactly one is given.
pub(crate) fn scan_or_mask<'a>(
    command: &str,
    scan: Option<&'a Path>,
    mask: Option<&'a Path>,
) -> Result<(&'a Path, bool)> {
    match (scan, mask) {
        (Some(_), Some(mask)) => {
            let why = "is given together with an input";
            Err(Error::usage(format!("--mask {}", mask.display()), why, "give one of the two"))
        }
        (Some(path), None) => Ok((path, false)),
        (None, Some(path)) => Ok((path, true)),
        (None, None) => Err(Error::usage(command, "has no input", "give a scan, or --mask and a mask")),
    }
}

/// Prints which options have no effect on the embedded phantom, which is made and not read.
fn report_unread(global: &Global) {
    for (name, given) in [
        ("--spacing", global.spacing.is_some()),
        ("--hu", global.hu.is_some()),
        ("--series", global.series.is_some()),
        ("--allow-gaps", global.allow_gaps),
    ] {
        if given {
            say(&format!("{name} is ignored: there is no input"));
        }
    }
}

/// The head of every stats file.
pub(crate) fn stats_head(timings: &Timings) -> Map<String, Value> {
    let mut m = Map::new();
    m.insert("threads".to_owned(), json!(rayon::current_num_threads()));
    m.insert("simd".to_owned(), json!(simd_level()));
    m.insert("peak_rss_bytes".to_owned(), json!(resident_bytes("VmHWM").unwrap_or(0)));
    // What was done twice counts twice.
    let total = |name: &str| timings.parts().iter().filter(|p| p.0 == name).map(|p| p.1).sum::<f64>();
    let parts = timings.parts().iter().map(|&(n, _)| (n.to_owned(), json!(total(n))));
    m.insert("prepare".to_owned(), Value::Object(parts.collect::<Map<_, _>>()));
    let peaks = timings.peaks().iter().map(|&(n, bytes)| (n.trim_end_matches("_s").to_owned(), json!(bytes)));
    m.insert("peak_by_stage_bytes".to_owned(), Value::Object(peaks.collect::<Map<_, _>>()));
    m
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::values::Pair;

    #[test]
    fn greys_are_of_values_that_a_scan_can_hold() {
        let checked = |lo, hi| checked_options(&Global { hu: Some(Pair(lo, hi)), ..Global::default() });
        assert_eq!(checked(-1000.0, 3000.0).unwrap().hu, Some((-1000.0, 3000.0)));
        assert!(checked(-32767.0, 32767.0).is_ok());
        for (lo, hi) in [(-32768.0, 0.0), (0.0, 1e9), (-1e300, 1e300), (5.0, 5.0), (5.0, -5.0)] {
            assert!(checked(lo, hi).is_err_and(|e| e.to_string().starts_with("--hu")), "{lo},{hi}");
        }
    }
}
