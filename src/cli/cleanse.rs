//! `colvis cleanse`.

use glam::DVec3;
use serde::Serialize;
use serde_json::json;

use crate::app::Timings;
use crate::cli::args::{CleanseArgs, Global};
use crate::cli::files;
use crate::cli::messages::say;
use crate::cli::prepare;
use crate::cli::shared::Use;
use crate::error::Result;
use crate::fields::cleanse::{CleansedPool, Left};
use crate::output;
use crate::progress::Progress;
use crate::volume::io;

/// A pool in the stats. `level_mm` is a point of its level and the unit normal, upwards; world, mm LPS.
#[derive(Serialize)]
struct Pool {
    ml: f64,
    tag_hu: f64,
    level_mm: [DVec3; 2],
}

/// Tag that was not removed, in the stats.
#[derive(Serialize)]
struct NotTaken {
    ml: f64,
    why: &'static str,
}

/// Runs the command. Fails with status 3 if the input cannot be read, 4 if it is too flat to have an interior, has no gas of a
/// colon or if interrupted, 5 if an output cannot be written.
pub(crate) fn run(args: &CleanseArgs, global: &Global, progress: &Progress) -> Result<()> {
    files::check_folders(&args.out, args.stats.as_deref())?;
    io::check_ending(&args.out)?;
    let mut timings = Timings::default();
    // The command cleanses the scan itself; `--cleanse` must not do it first.
    let global = Global { cleanse: false, ..global.clone() };
    let from = args.from.map(|p| p.0);
    let input = prepare::load(&args.input, &global, Use::Change, &mut timings, progress)?;
    let lumen = input.lumen_from(from, &mut timings, progress)?;
    if lumen.segments.is_empty() {
        return Err(prepare::no_lumen(&input.volume, &lumen, "give --from and a point in the colon"));
    }
    let mut cleansed = input.cleansed(&lumen, from, &mut timings, progress)?;
    drop(lumen);
    let mut volume = input.into_volume();
    cleansed.changes.exchange(&mut volume);
    say(&cleansed.to_string());
    io::save(&args.out, &volume, progress)?;
    if let Some(note) = io::written_note(&args.out, volume.grid()) {
        say(&note);
    }
    if let Some(path) = &args.stats {
        let mut stats = prepare::stats_head(&timings);
        let pool = |p: &CleansedPool| Pool { ml: p.ml, tag_hu: p.tag_hu, level_mm: p.level };
        let left = |l: &Left| NotTaken { ml: l.ml, why: l.why };
        for (name, value) in [
            ("replaced_ml", json!(cleansed.replaced_ml)),
            ("blur_mm", json!(cleansed.blur_mm)),
            ("pools", json!(cleansed.pools.iter().map(pool).collect::<Vec<_>>())),
            ("residue_ml", json!(cleansed.residue_ml)),
            ("not_taken", json!(cleansed.left.iter().map(left).collect::<Vec<_>>())),
            ("changed_bytes", json!(cleansed.changes.bytes())),
        ] {
            stats.insert(name.to_owned(), value);
        }
        output::write_json(path, &stats)?;
    }
    Ok(())
}
