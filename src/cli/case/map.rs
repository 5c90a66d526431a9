//! The colon from outside, drawn by the renderer of flights: its lumen is made solid, and looked at from the front.

use std::f64::consts::TAU;
use std::sync::Arc;

use glam::DVec3;

use super::segments::COLOURS;
use crate::app::findings::Findings;
use crate::error::Result;
use crate::fields::{Along, Lumen};
use crate::progress::Progress;
use crate::render::{Frame, Preset, Quality, Reuse, Settings, View, renderer};
use crate::space::TransferFunction;

/// Width and height of the picture, pixels.
pub(super) const SIZE: [usize; 2] = [640, 640];
/// Side of the voxels of the solid, mm.
const VOXEL_MM: f64 = 2.0;
/// Values of the solid and of what surrounds it, HU: like tissue in gas.
const SOLID_HU: i16 = 200;
const AROUND_HU: i16 = -1000;
/// The camera is so far from the colon that lines of sight are nearly parallel, mm.
const AWAY_MM: f64 = 4000.0;
/// Share of the picture's height that the colon takes.
const FILLS: f64 = 0.92;
/// Colour beside the colon.
const PAPER: [u8; 3] = [255; 3];

/// The picture of a colon.
pub(super) struct Map {
    /// Its pixels, row by row.
    pub(super) rgb: Vec<[u8; 3]>,
    /// Where each finding is, pixels, with its id.
    pub(super) findings: Vec<(String, [f64; 2])>,
}

/// Draws a colon, with each segment in its colour; `None` without a lumen.
pub(super) fn of(lumen: &Lumen, along: &Along, findings: &Findings, progress: &Progress) -> Result<Option<Map>> {
    let Some(solid) = lumen.solid(VOXEL_MM, [AROUND_HU, SOLID_HU])? else { return Ok(None) };
    progress.check()?;
    let grid = solid.grid();
    let size = grid.spacing() * DVec3::from_array(grid.dims().map(|n| n as f64));
    let middle = grid.world(DVec3::from_array(grid.dims().map(|n| 0.5 * (n as f64 - 1.0))));
    let height = size.z.max(size.x * SIZE[1] as f64 / SIZE[0] as f64) / FILLS;
    let fov = (2.0 * (0.5 * height / AWAY_MM).atan()).to_degrees();
    // From the front: the patient's right is on the left.
    let view = View::new(middle - DVec3::Y * AWAY_MM, DVec3::Y, DVec3::Z, fov, SIZE[0], SIZE[1])?;
    let preset = Preset::default();
    let prepared = preset.preparation.prepare(Arc::new(solid), TransferFunction::default());
    let mut frame = Frame::with_depth(SIZE[0], SIZE[1]);
    renderer(&prepared, Settings::new(Quality::High), preset, Reuse::Never).render(&view, &mut frame);
    let depth = frame.depth().unwrap_or_default();
    let mut rgb = vec![PAPER; SIZE[0] * SIZE[1]];
    let parts = along.parts();
    // The renderer's light falls off with the distance, which is nearly the same everywhere: its brightest pixel is white.
    let grey = |p: [u8; 3]| p.map(f64::from).iter().sum::<f64>() / 3.0;
    let hits = || frame.pixels().iter().zip(depth).filter(|(_, mm)| mm.is_finite());
    let most = hits().map(|(p, _)| grey(*p)).fold(1.0, f64::max);
    for (n, (pixel, mm)) in frame.pixels().iter().zip(depth).enumerate() {
        if !mm.is_finite() {
            continue;
        }
        let at = [n % SIZE[0], n / SIZE[0]].map(|x| x as f64 + 0.5);
        let Some(ray) = view.ray_at(at[0], at[1]) else { continue };
        let place = ray.origin + ray.direction * f64::from(*mm);
        let part = along.of(place).and_then(|a| parts.iter().position(|p| Some(p.name) == a.part));
        let colour = part.map_or([190; 3], |n| COLOURS[n % COLOURS.len()]);
        let light = (grey(*pixel) / most).clamp(0.0, 1.0);
        rgb[n] = colour.map(|c| (f64::from(c) * (0.35 + 0.65 * light)).round() as u8);
    }
    let findings = findings.findings.iter().filter_map(|f| Some((f.id.clone(), view.project(f.place)?))).collect();
    Ok(Some(Map { rgb, findings }))
}

/// Returns where a label beside a finding is written so that two do not cover each other: on a circle around it, in turn.
pub(super) fn beside([x, y]: [f64; 2], n: usize) -> [f64; 2] {
    let (sin, cos) = (TAU * (n as f64 * 0.381_966 + 0.1)).sin_cos();
    [x + 22.0 * cos, y + 22.0 * sin]
}
