//! `colvis measure`.

use glam::DVec3;
use serde::Serialize;
use serde_json::json;

use crate::app::Timings;
use crate::cli::args::{Global, MeasureArgs};
use crate::cli::messages::print;
use crate::cli::prepare;
use crate::cli::shared::Use;
use crate::error::Result;
use crate::output;
use crate::polyps::{self, Form, Measurement, RESTORED_HU, Wall};
use crate::progress::Progress;

/// A measurement as written. Places are world, mm LPS.
#[derive(Serialize)]
struct Written {
    position: DVec3,
    diameter_mm: f64,
    ends: [DVec3; 2],
    height_mm: f64,
    volume_mm3: f64,
    shape: Form,
    /// Mean and standard deviation inside, HU.
    hu: [f64; 2],
    confidence: f64,
    #[serde(skip_serializing_if = "String::is_empty")]
    why: String,
}

impl From<&Measurement> for Written {
    fn from(m: &Measurement) -> Self {
        let l = &m.lesion;
        Self {
            position: l.position,
            diameter_mm: l.diameter_mm,
            ends: l.ends,
            height_mm: l.height_mm,
            volume_mm3: l.volume_mm3,
            shape: m.form,
            hu: [l.feature("hu_mean"), l.feature("hu_sd")],
            confidence: m.confidence,
            why: m.why.join("; "),
        }
    }
}

/// Runs the command. Fails with status 3 if the input cannot be read, 4 if it has no gas of a colon, if nothing bulges at the place
/// or if interrupted, 5 if an output cannot be written.
pub(crate) fn run(args: &MeasureArgs, global: &Global, progress: &Progress) -> Result<()> {
    let iso = prepare::transfer(global)?.iso();
    let outputs: Vec<_> = args.out.iter().chain(&args.stats).map(std::path::PathBuf::as_path).collect();
    output::check_folders(&outputs)?;
    let mut timings = Timings::default();
    // The command cleanses the scan itself; `--cleanse` must not do it first.
    let global = Global { cleanse: false, ..global.clone() };
    let mut input = prepare::load(&args.input, &global, Use::Change, &mut timings, progress)?;
    let (lumen, cleansed) = input.cleanse(args.from.map(|p| p.0), false, &mut timings, progress)?;
    let volume = input.into_volume();
    let restored = cleansed.map(|c| c.changes);
    let wall = timings.time("wall_s", || Wall::new(&volume, &lumen, iso, progress))?;
    let is_restored = |p: DVec3| {
        let grid = volume.grid();
        let [i, j, k] = grid.voxel(p).round().to_array().map(|x| x as i64);
        let dims = grid.dims().map(|n| n as i64);
        let inside = (0..dims[0]).contains(&i) && (0..dims[1]).contains(&j) && (0..dims[2]).contains(&k);
        let voxel = || grid.index(i as usize, j as usize, k as usize);
        let before = || restored.as_ref()?.get(voxel());
        inside && before().is_some_and(|hu| (i32::from(hu) - i32::from(volume.data()[voxel()])).abs() > RESTORED_HU)
    };
    let measured = timings.time("measure_s", || polyps::measure(&wall, &volume, args.at.0, is_restored))?;
    let written = Written::from(&measured);
    match &args.out {
        Some(path) => output::write_json(path, &written)?,
        None => print(|out| writeln!(out, "{:#}", json!(written)))?,
    }
    if let Some(path) = &args.stats {
        output::write_json(path, &prepare::stats_head(&timings))?;
    }
    Ok(())
}
