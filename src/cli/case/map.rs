//! The colon from outside, each segment in its colour, and the findings on it.

use std::f64::consts::TAU;

use super::segments::COLOURS;
use crate::app::findings::Findings;
use crate::cli::outside::{self, Hit, Outside, PAPER};
use crate::error::Result;
use crate::fields::{Along, Lumen};
use crate::progress::Progress;

/// Width and height of the picture, pixels.
pub(super) const SIZE: [usize; 2] = [640, 640];
/// Side of the voxels of the solid, mm.
const VOXEL_MM: f64 = 2.0;
/// Colour of what belongs to no segment.
const OTHER: [u8; 3] = [190; 3];

/// The picture of a colon.
pub(super) struct Map {
    /// Its pixels, row by row.
    pub(super) rgb: Vec<[u8; 3]>,
    /// Where each finding is, pixels, with its id.
    pub(super) findings: Vec<(String, [f64; 2])>,
}

/// Draws a colon, with each segment in its colour; `None` without a lumen.
pub(super) fn of(lumen: &Lumen, along: &Along, findings: &Findings, progress: &Progress) -> Result<Option<Map>> {
    let Some(Outside { view, hits }) = outside::look(lumen, SIZE, VOXEL_MM, progress)? else { return Ok(None) };
    let parts = along.parts();
    let colour = |hit: &Hit| {
        let part = along.of(hit.place).and_then(|a| parts.iter().position(|p| Some(p.name) == a.part));
        hit.lit(part.map_or(OTHER, |n| COLOURS[n % COLOURS.len()]))
    };
    let rgb = hits.iter().map(|hit| hit.as_ref().map_or(PAPER, colour)).collect();
    let findings = findings.findings.iter().filter_map(|f| Some((f.id.clone(), view.project(f.place)?))).collect();
    Ok(Some(Map { rgb, findings }))
}

/// Returns where a label beside a finding is written so that two do not cover each other: on a circle around it, in turn.
pub(super) fn beside([x, y]: [f64; 2], n: usize) -> [f64; 2] {
    let (sin, cos) = (TAU * (n as f64 * 0.381_966 + 0.1)).sin_cos();
    [x + 22.0 * cos, y + 22.0 * sin]
}
