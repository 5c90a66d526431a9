//! What several commands do first: read the scan, make it ready for rays, find the colon; with how long each took.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use serde_json::{Map, Value, json};

use crate::cli::args::{Global, PresetName, QualityName};
use crate::error::{Error, Result};
use crate::fields::{Lumen, drain, lumen};
use crate::memory::resident_bytes;
use crate::phantom::{self, Phantom};
use crate::progress::Progress;
use crate::render::fast::simd_level;
use crate::render::{PreparedVolume, Preset, Quality, Settings, TransferFunction};
use crate::volume::Volume;
use crate::volume::io::{self, LoadOptions};

/// Wall clock of the parts of a preparation, disjoint, in the order they were done.
#[derive(Clone, Debug, Default)]
pub struct Timings(Vec<(&'static str, f64)>);

impl Timings {
    /// Does a part and keeps how long it took, under `name` (ends in `_s`).
    ///
    /// # Errors
    /// What the part fails with.
    pub fn time<T>(&mut self, name: &'static str, part: impl FnOnce() -> Result<T>) -> Result<T> {
        let begun = Instant::now();
        let result = part();
        self.0.push((name, begun.elapsed().as_secs_f64()));
        result
    }

    /// Keeps how long a part took that was done elsewhere, under `name`.
    pub fn add(&mut self, name: &'static str, seconds: f64) {
        self.0.push((name, seconds.max(0.0)));
    }

    /// As the stats have it.
    pub fn json(&self) -> Value {
        Value::Object(self.0.iter().map(|&(n, s)| (n.to_owned(), json!(s))).collect::<Map<_, _>>())
    }
}

/// The options of reading an input.
pub fn load_options(global: &Global) -> LoadOptions {
    LoadOptions {
        spacing: global.spacing.map(|s| s.0),
        hu: global.hu.map(|p| (p.0, p.1)),
        series: global.series,
        allow_gaps: global.allow_gaps,
    }
}

/// The ramp that `--wall` asks for.
///
/// # Errors
/// Status 2 when it is none.
pub fn wall(global: &Global) -> Result<TransferFunction> {
    global.wall.map_or(Ok(TransferFunction::default()), |p| TransferFunction::new(p.0 as f32, p.1 as f32))
}

/// The view angle that `--fov` asks for, degrees.
///
/// # Errors
/// Status 2 when it is not between 0 and 180.
pub fn fov(global: &Global) -> Result<f64> {
    let fov = global.fov.unwrap_or(90.0);
    if fov > 0.0 && fov < 180.0 {
        Ok(fov)
    } else {
        Err(Error::usage("--fov", format!("{fov} degrees is not between 0 and 180"), "give an angle such as 90"))
    }
}

/// The renderer's settings that a quality on the command line stands for.
pub fn quality(name: Option<QualityName>) -> Settings {
    match name.unwrap_or(QualityName::High) {
        QualityName::High => Settings::new(Quality::High),
        QualityName::Low => Settings::new(Quality::Low),
        QualityName::Reference => Settings::new(Quality::Reference),
        QualityName::Adaptive => Settings { adaptive: true, ..Settings::new(Quality::High) },
    }
}

/// The renderer that `--preset` asks for, or else the scene.
pub fn preset(name: Option<PresetName>, scene: Preset) -> Preset {
    match name {
        Some(PresetName::Default) => Preset::Default,
        Some(PresetName::Colvis) => Preset::Colvis,
        Some(PresetName::Lean) => Preset::Lean,
        None => scene,
    }
}

/// Reads the input, or makes the embedded phantom where there is none; says what there is to say about it.
///
/// # Errors
/// Status 3 when it cannot be read, 4 when interrupted.
pub fn load(input: Option<&Path>, global: &Global, progress: &Progress) -> Result<Volume> {
    let Some(path) = input else {
        let seed = global.seed.unwrap_or(1);
        let phantom = Phantom::new(&phantom::Settings { size: phantom::Size::Small, seed, ..Default::default() });
        return phantom.voxelise(&phantom.grid(), progress);
    };
    if let Some(h) = global.hu.filter(|h| h.0 >= h.1) {
        return Err(Error::usage("--hu", format!("{} HU is not below {} HU", h.0, h.1), "give black,white"));
    }
    if let Some(s) = global.spacing.map(|s| s.0).filter(|s| s.min_element() <= 0.0) {
        return Err(Error::usage("--spacing", format!("{s} mm is not above 0"), "give three sizes in mm"));
    }
    let loaded = io::load(path, &load_options(global), progress)?;
    let own = loaded.volume.grid().spacing();
    if global.spacing.is_some_and(|s| s.0 != own) {
        say(&format!("--spacing is not used: the scan has its own, {own} mm"));
    }
    if global.hu.is_some() && path.is_file() {
        say("--hu is not used: the scan holds HU");
    }
    for note in &loaded.notes {
        say(note);
    }
    Ok(loaded.volume)
}

/// A scan that rays can be cast in.
///
/// # Errors
/// As [`load`]; status 2 for a wall that is none.
pub fn space(
    input: Option<&Path>,
    global: &Global,
    preset: Preset,
    timings: &mut Timings,
    progress: &Progress,
) -> Result<PreparedVolume> {
    let wall = wall(global)?;
    let volume = Arc::new(timings.time("load_s", || load(input, global, progress))?);
    let make = if preset == Preset::Lean { PreparedVolume::lean } else { PreparedVolume::new };
    timings.time("flags_s", || Ok(make(volume, wall)))
}

/// The colon in a scan that can be flown through.
///
/// # Errors
/// Status 4 for a volume of one voxel or one slice, or when interrupted.
pub fn lumen(volume: &Volume, timings: &mut Timings, progress: &Progress) -> Result<Lumen> {
    check_thick(volume)?;
    timings.time("lumen_s", || lumen::find(volume, progress))
}

/// The colon, and the scan that it is flown in. Where `joins`, segments of gas that tagged fluid joins are flown as one: the
/// fluid between them is taken as free, in a copy of the scan.
///
/// # Errors
/// As [`lumen`].
pub fn colon(
    space: PreparedVolume,
    joins: bool,
    timings: &mut Timings,
    progress: &Progress,
) -> Result<(PreparedVolume, Lumen)> {
    let found = lumen(space.volume(), timings, progress)?;
    let main = found.main_segment().map(|n| &found.segments[n]);
    if !joins || main.is_none_or(|s| s.joined_to.is_empty()) {
        return Ok((space, found));
    }
    let lean = !space.flags().has_bits();
    let wall = space.wall();
    let count = found.segments.len();
    let drained = timings.time("drain_s", || {
        let volume = Arc::new(drain::drained(space.volume(), &found));
        drop(space);
        Ok(if lean { PreparedVolume::lean(volume, wall) } else { PreparedVolume::new(volume, wall) })
    })?;
    let mut again = timings.time("joined_lumen_s", || lumen::find(drained.volume(), progress))?;
    drain::keep_ends(&mut again, &found);
    if again.segments.len() < count {
        say(&format!(
            "tagged fluid joins segments of gas: it is taken as free and shown as gas ({count} segments become {})",
            again.segments.len()
        ));
    }
    Ok((drained, again))
}

/// # Errors
/// Status 4 for a volume of one voxel or one slice.
pub fn check_thick(volume: &Volume) -> Result<()> {
    let dims = volume.grid().dims();
    if dims.iter().any(|&d| d < 2) {
        let why = format!("has {}×{}×{} voxels: no lumen can be found in one slice", dims[0], dims[1], dims[2]);
        return Err(Error::incomplete("volume", why, "give the whole scan; info and render take this one"));
    }
    Ok(())
}

/// Prints a note for the user.
pub fn say(note: &str) {
    eprintln!("note: {}", note.replace(char::is_control, " "));
}

/// The head of every stats file.
pub fn stats_head(timings: &Timings) -> Map<String, Value> {
    let mut m = Map::new();
    m.insert("threads".to_owned(), json!(rayon::current_num_threads()));
    m.insert("simd".to_owned(), json!(simd_level()));
    m.insert("peak_rss_bytes".to_owned(), json!(resident_bytes("VmHWM").unwrap_or(0)));
    m.insert("prepare".to_owned(), timings.json());
    m
}
