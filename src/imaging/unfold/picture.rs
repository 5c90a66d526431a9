//! The picture of a map: the wall in the light of a lamp in the middle of the lumen.

use glam::Vec3;
use rayon::prelude::*;

use super::{Behind, Chart, Unfolding};
use crate::render::shaders::headlight::{AMBIENT, DIFFUSE};
use crate::render::transfer::Palette;

/// The colour that marks further layers, red, green and blue.
pub const BEHIND: [f32; 3] = [0.30, 0.45, 0.95];
/// Share of it in the pixel's colour.
const MARK: f32 = 0.3;

/// What a row of a map shows, as in the map.
pub(super) struct Row<'a> {
    /// Index of its first pixel.
    pub first: usize,
    pub points: &'a [[f32; 3]],
    pub normals: &'a [Vec3],
    pub behind: &'a [Behind],
}

/// Draws a map, red, green and blue for each pixel, row by row. The wall has the colours of a flight (see
/// [`shaders::headlight`](crate::render::shaders::headlight)); the lamp is in the middle of the lumen at the row's distance. Where
/// something lies behind what is shown, a little blue is added. Without wall a pixel is black.
pub fn picture(map: &Unfolding, iso: f64) -> Vec<[u8; 3]> {
    let columns = map.columns();
    let mut out = vec![[0; 3]; map.points.len()];
    out.par_chunks_mut(columns).enumerate().for_each(|(row, out)| {
        let first = row * columns;
        let behind = |pixel: usize| map.behind.partition_point(|b| (b.pixel as usize) < pixel);
        let wall = Row {
            first,
            points: &map.points[first..][..columns],
            normals: &map.normals[first..][..columns],
            behind: &map.behind[behind(first)..behind(first + columns)],
        };
        paint(&map.chart, map.mm(row), iso, &wall, out);
    });
    out
}

/// Draws a row at a distance along the line, mm. Where it has no wall, `out` stays as it is.
pub(super) fn paint(chart: &Chart, mm: f64, iso: f64, wall: &Row<'_>, out: &mut [[u8; 3]]) {
    let colour = Palette::default().colour(iso as f32);
    // Beyond the ends of the line it stays at these: at a tip it would touch the wall.
    let lit = mm.clamp(0.0, chart.length_mm());
    let Some(station) = chart.middle(lit).or_else(|| chart.middle(mm)) else { return };
    let lamp = station.frame.at;
    let mut behind = wall.behind.iter().map(|b| b.pixel as usize).peekable();
    for (n, out) in out.iter_mut().enumerate() {
        let mut is_marked = false;
        while behind.next_if_eq(&(wall.first + n)).is_some() {
            is_marked = true;
        }
        let (point, normal) = (Vec3::from_array(wall.points[n]), wall.normals[n]);
        if point.is_nan() {
            continue;
        }
        let ray = (point.as_dvec3() - lamp).as_vec3().normalize_or_zero();
        let mut shown = colour * (AMBIENT + DIFFUSE * normal.dot(ray).max(0.0));
        if is_marked {
            shown = shown.lerp(Vec3::from_array(BEHIND), MARK);
        }
        *out = (shown.clamp(Vec3::ZERO, Vec3::ONE) * 255.0).round().to_array().map(|c| c as u8);
    }
}
