//! `colvis segment`.

use std::path::PathBuf;

use glam::DVec3;
use serde::Serialize;
use serde_json::json;

use crate::app::Timings;
use crate::cli::args::{Global, LabelName, SegmentArgs};
use crate::cli::messages::say;
use crate::cli::shared::Use;
use crate::cli::{outside, prepare};
use crate::error::Result;
use crate::fields::lumen::{self, GasKind, Lumen, Other, Remnant};
use crate::fields::wall;
use crate::output;
use crate::progress::Progress;
use crate::volume::io;

/// Mask value of what is certainly not colon.
const OTHER: u8 = 3;
/// Mask value of the colon's wall.
const WALL: u8 = 4;

/// Maximum number of bridges and of islands in the stats.
const MOST_MARKS: usize = 100;

/// A segment in the stats. Places are world, mm LPS.
#[derive(Serialize)]
struct Part {
    ml: f64,
    fluid_ml: f64,
    bounds_mm: [DVec3; 2],
    ends: [DVec3; 2],
    length_mm: f64,
    joined_to: Vec<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    kind: Option<GasKind>,
    #[serde(skip_serializing_if = "Option::is_none")]
    why: Option<&'static str>,
}

/// Gas outside the colon, in the stats.
#[derive(Serialize)]
struct NotColon {
    ml: f64,
    kind: GasKind,
    why: &'static str,
    bounds_mm: [DVec3; 2],
}

/// A bridge or an island in the stats.
#[derive(Serialize)]
struct Mark {
    position: DVec3,
    ml: f64,
    length_mm: f64,
}

/// Runs the command. Fails with status 3 if the input cannot be read, 4 if it is too flat to have an interior, has no gas of a
/// colon (mask, stats and picture are written) or if interrupted, 5 if an output cannot be written.
pub(crate) fn run(args: &SegmentArgs, global: &Global, progress: &Progress) -> Result<()> {
    let outputs = std::iter::once(&args.out).chain(&args.stats).chain(&args.picture);
    output::check_folders(&outputs.map(PathBuf::as_path).collect::<Vec<_>>())?;
    io::check_ending(&args.out)?;
    args.picture.as_deref().map_or(Ok(()), outside::check_ending)?;
    let mut timings = Timings::default();
    let input = prepare::load(&args.input, global, Use::Look, &mut timings, progress)?;
    let lumen = input.lumen_from(args.from.map(|p| p.0), &mut timings, progress)?;
    let volume = input.volume;
    // Only the stats report bridges and islands.
    let residue = match &args.stats {
        Some(_) => Some(timings.time("residue_s", || lumen::residue(&volume, &lumen, progress))?),
        None => None,
    };
    let wanted = |label| args.labels.contains(&label);
    let wall = match wanted(LabelName::Wall) {
        true => Some(timings.time("wall_s", || wall::around(&volume, &lumen, progress))?),
        false => None,
    };
    let others = match wanted(LabelName::Other) {
        true => Some(timings.time("other_s", || lumen::not_colon(&volume, &lumen, progress))?),
        false => None,
    };
    let grid = volume.grid().clone();
    // Mask, stats and picture are written even then.
    let refusal =
        lumen.segments.is_empty().then(|| prepare::no_lumen(&volume, &lumen, "give --from and a point in the colon"));
    drop(volume);
    let mut mask = lumen.mask();
    for &voxel in wall.iter().flat_map(|w| &w.voxels) {
        mask[voxel] = WALL;
    }
    if let Some(others) = &others {
        others.mark(&mut mask, OTHER);
    }
    io::save_mask(&args.out, &grid, &mask, progress)?;
    if let Some(note) = io::written_note(&args.out, &grid) {
        say(&note);
    }
    if let Some(path) = &args.picture {
        timings.time("picture_s", || outside::small(&lumen, progress)?.write_png(path))?;
    }
    if let (Some(path), Some(residue)) = (&args.stats, residue) {
        let mut stats = prepare::stats_head(&timings);
        for (name, value) in [
            ("lumen_ml", json!(lumen.gas_ml() + lumen.fluid_ml())),
            ("fluid_ml", json!(lumen.fluid_ml())),
            ("ordered", json!(lumen.ordered)),
            ("segments", json!(parts(&lumen))),
            ("bridges", json!(marks(&residue.bridges))),
            ("bridges_count", json!(residue.bridges.len())),
            ("islands", json!(marks(&residue.islands))),
            ("islands_count", json!(residue.islands.len())),
        ] {
            stats.insert(name.to_owned(), value);
        }
        if let Some(wall) = &wall {
            stats.insert("wall_ml".to_owned(), json!(wall.ml));
            stats.insert("wall_thickness".to_owned(), json!(wall.thickness));
            stats.insert("wall_told".to_owned(), json!(wall.reported));
        }
        let pieces = others.as_ref().map_or(&lumen.others, |o| &o.pieces);
        stats.insert("not_colon".to_owned(), json!(not_colon(pieces)));
        stats.insert("names".to_owned(), json!(lumen.names().parts));
        if let Some(lying) = lumen.lying {
            stats.insert("position".to_owned(), json!(lying));
        }
        output::write_json(path, &stats)?;
    }
    refusal.map_or(Ok(()), Err)
}

/// The largest pieces.
fn not_colon(pieces: &[Other]) -> Vec<NotColon> {
    let part = |o: &Other| NotColon { ml: o.ml, kind: o.kind, why: o.why, bounds_mm: o.bounds_mm };
    pieces.iter().take(MOST_MARKS).map(part).collect()
}

fn marks(found: &[Remnant]) -> Vec<Mark> {
    found.iter().take(MOST_MARKS).map(|m| Mark { position: m.at, ml: m.ml, length_mm: m.length_mm }).collect()
}

fn parts(lumen: &Lumen) -> Vec<Part> {
    let part = |s: &lumen::Segment| Part {
        ml: s.ml,
        fluid_ml: s.fluid_ml,
        bounds_mm: s.bounds_mm,
        ends: s.ends,
        length_mm: s.length_mm,
        joined_to: s.joined_to.clone(),
        kind: s.judged.map(|j| j.kind),
        why: s.judged.map(|j| j.why),
    };
    lumen.segments.iter().map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hundred_largest_are_listed() {
        let found = |n: usize| -> Vec<Remnant> {
            (0..n).map(|k| Remnant { at: DVec3::ZERO, ml: (n - k) as f64, length_mm: 1.0 }).collect()
        };
        assert_eq!(marks(&found(7)).len(), 7);
        let many = marks(&found(250));
        assert_eq!((many.len(), many[0].ml, many[99].ml), (100, 250.0, 151.0));
    }
}
