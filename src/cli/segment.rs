//! `colvis segment`.

use std::time::Instant;

use glam::DVec3;
use serde::Serialize;

use crate::cli::args::{Global, SegmentArgs};
use crate::error::{Error, Result};
use crate::fields::lumen::{self, Lumen, Remnant};
use crate::output;
use crate::progress::Progress;
use crate::volume::io::{self, LoadOptions};

/// What `--stats` holds. Places are world, mm LPS.
#[derive(Serialize)]
struct Stats {
    threads: usize,
    simd: &'static str,
    peak_rss_bytes: u64,
    prepare: Prepare,
    /// Gas and fluid together.
    lumen_ml: f64,
    fluid_ml: f64,
    ordered: bool,
    segments: Vec<Part>,
    bridges: Vec<Mark>,
    islands: Vec<Mark>,
}

#[derive(Serialize)]
struct Prepare {
    load_s: f64,
    lumen_s: f64,
    residue_s: f64,
}

#[derive(Serialize)]
struct Part {
    ml: f64,
    fluid_ml: f64,
    bounds_mm: [DVec3; 2],
    ends: [DVec3; 2],
    length_mm: f64,
    joined_to: Vec<usize>,
}

#[derive(Serialize)]
struct Mark {
    position: DVec3,
    ml: f64,
    length_mm: f64,
}

/// Runs the command.
///
/// # Errors
/// Status 3 when the input cannot be read, 4 when it is too flat to have an interior or the work is interrupted, 5 when
/// an output cannot be written.
pub fn run(args: &SegmentArgs, global: &Global, progress: &Progress) -> Result<()> {
    let begin = Instant::now();
    let options = LoadOptions {
        spacing: global.spacing.map(|s| s.0),
        hu: global.hu.map(|h| (h.0, h.1)),
        series: global.series,
        allow_gaps: global.allow_gaps,
    };
    let loaded = io::load(&args.input, &options, progress)?;
    for note in &loaded.notes {
        eprintln!("note: {note}");
    }
    let load_s = begin.elapsed().as_secs_f64();
    let volume = loaded.volume;
    if volume.grid().dims().contains(&1) {
        return Err(Error::incomplete(
            args.input.display().to_string(),
            format!("is flat (dims {:?}): it has no interior", volume.grid().dims()),
            "give a volume of several slices",
        ));
    }
    let begin = Instant::now();
    let lumen = lumen::find(&volume, progress)?;
    let lumen_s = begin.elapsed().as_secs_f64();
    // Bridges and islands are only told in the stats.
    let marked = match &args.stats {
        Some(path) => {
            let begin = Instant::now();
            let residue = lumen::residue(&volume, &lumen, progress)?;
            Some((path, residue, begin.elapsed().as_secs_f64()))
        }
        None => None,
    };
    let grid = volume.grid().clone();
    drop(volume);
    io::save_mask(&args.out, &grid, &lumen.mask(), progress)?;
    if let Some((path, residue, residue_s)) = marked {
        let marks = |found: &[Remnant]| {
            found.iter().map(|m| Mark { position: m.at, ml: m.ml, length_mm: m.length_mm }).collect()
        };
        let stats = Stats {
            threads: rayon::current_num_threads(),
            simd: "scalar",
            peak_rss_bytes: peak_rss_bytes(),
            prepare: Prepare { load_s, lumen_s, residue_s },
            lumen_ml: lumen.gas_ml() + lumen.fluid_ml(),
            fluid_ml: lumen.fluid_ml(),
            ordered: lumen.ordered,
            segments: parts(&lumen),
            bridges: marks(&residue.bridges),
            islands: marks(&residue.islands),
        };
        output::write_json(path, &stats)?;
    }
    Ok(())
}

fn parts(lumen: &Lumen) -> Vec<Part> {
    let part = |s: &lumen::Segment| Part {
        ml: s.ml,
        fluid_ml: s.fluid_ml,
        bounds_mm: s.bounds_mm,
        ends: s.ends,
        length_mm: s.length_mm,
        joined_to: s.joined_to.clone(),
    };
    lumen.segments.iter().map(part).collect()
}

/// The most memory the process has held, bytes; 0 where the system does not tell.
fn peak_rss_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    let kib = line.and_then(|l| l.split_whitespace().next()).and_then(|n| n.parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}
