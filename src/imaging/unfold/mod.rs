//! The colon cut open and laid flat.
//!
//! Rows are level sets of a harmonic function on the lumen ([`fields::harmonic`](crate::fields::harmonic)), so that no two rows cross
//! and no polyp shows twice in a bend. The wall is a mesh, each vertex of which has a distance along the colon and an angle about it
//! ([`Chart`]). Each point of the wall thus lies at one place of the map. Where several lie at one place (behind an overhanging fold,
//! below the head of a polyp), the map shows the one nearest to the middle of the lumen and keeps the others as further layers.
//!
//! Beyond the two ends of its line a colon has no direction: there a source of the function, spread evenly, gives each recess of the
//! rectum and of the cecum levels of its own. Narrow pockets and catheters have none, and take that of the place that they open into.
//!
//! The rectum is on top and the cut runs along the back: angle 0, towards the patient's front at the beginning of the line, is in
//! the middle. The wall is seen from inside: with the rectum above and looking at the wall, what is on the right is on the right.
//! Angles are about frames that do not turn about the line (those of [`matching`](crate::fields::matching)), and a row is `step_mm` of
//! the line long, or less where a deep sac opens: all of its wall lies within little of the line. How long and wide a pixel is on the wall varies: [`Unfolding::scale`].

mod axis;
mod bins;
mod chart;
mod drawing;
mod measure;
mod picture;
mod raster;
mod rows;
#[cfg(test)]
mod tests;
mod wall;

use std::sync::{Arc, OnceLock};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

pub use chart::Chart;
pub use drawing::{Band, Drawing};
pub use measure::Measures;
pub use picture::{BEHIND, picture};

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::Volume;
use bins::Bins;
use raster::Pixels;
use rows::Rows;

/// Distance between rows along the line unless another is asked for, mm.
pub const STEP_MM: f64 = 0.4;
/// The fewest columns.
const LEAST_COLUMNS: usize = 32;
/// The most rows: 40 m of colon.
const MOST_ROWS: usize = 100_000;
/// A place farther than this from the wall is nowhere on the map, mm.
const NEAR_MM: f64 = 5.0;

/// The size of a map, and the part of the colon that it shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheet {
    /// Number of columns, each an equal part of the angle about the line. `None`: so many that pixels are square on the wall on average.
    pub columns: Option<usize>,
    /// Distance between rows along the line, mm. They are closer where much wall belongs to little of the line.
    pub step_mm: f64,
    /// The first distance along the line that is shown, mm; everything from there on if `None`.
    pub from_mm: Option<f64>,
    /// The last distance along the line that is shown, mm.
    pub to_mm: Option<f64>,
}

impl Default for Sheet {
    fn default() -> Self {
        Self { columns: None, step_mm: STEP_MM, from_mm: None, to_mm: None }
    }
}

/// A point of the wall behind one that is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Behind {
    /// Index of the pixel, row by row.
    pub pixel: u32,
    /// The point, world, mm.
    pub point: Vec3,
}

/// A place on the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Row, from 0; the middle of a row is whole.
    pub row: f64,
    /// Column, from 0; the middle of a column is whole.
    pub column: f64,
    /// 0 if the map shows it there, 1 if it is the first behind what is shown, and so on.
    pub layer: usize,
}

/// The map of an unfolded colon.
#[derive(Clone, Debug)]
pub struct Unfolding {
    chart: Arc<Chart>,
    pixels: Pixels,
    /// The wall's point of each pixel, row by row, world, mm; NaN where there is none.
    points: Vec<[f32; 3]>,
    /// Its normal into the tissue, world.
    normals: Vec<Vec3>,
    /// Ordered by pixel, then from near to far.
    behind: Vec<Behind>,
    bins: OnceLock<Bins>,
}

impl Unfolding {
    /// Draws the map of a chart of the wall in `volume`; the wall of gas is at `iso` HU. The result is the same for every number of
    /// threads.
    ///
    /// # Errors
    /// Returns status 4 if the sheet has no row, or too many, or if interrupted.
    pub fn new(
        chart: impl Into<Arc<Chart>>,
        volume: &Volume,
        iso: f64,
        sheet: &Sheet,
        progress: &Progress,
    ) -> Result<Self> {
        let drawing = Drawing::new(chart, volume, iso, sheet)?;
        progress.stage("laying the wall flat", drawing.count() as u64);
        let draw = |band: usize| {
            let drawn = drawing.band(band);
            progress.advance(1)?;
            Ok(drawn)
        };
        let bands: Vec<Band> = (0..drawing.count()).into_par_iter().map(draw).collect::<Result<_>>()?;
        let mut map = drawing.blank();
        for band in bands {
            map.put(&band);
        }
        Ok(map)
    }

    /// Replaces the rows of a band of the same map.
    pub fn put(&mut self, band: &Band) {
        let pixels = band.rows.start * self.columns()..band.rows.end * self.columns();
        self.points[pixels.clone()].copy_from_slice(&band.points);
        self.normals[pixels.clone()].copy_from_slice(&band.normals);
        let [first, last] = [pixels.start, pixels.end].map(|n| self.behind.partition_point(|b| (b.pixel as usize) < n));
        self.behind.splice(first..last, band.behind.iter().copied());
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.pixels.rows
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.pixels.columns
    }

    /// Returns the distance of a row along the line, mm: below 0 before its beginning.
    pub fn mm(&self, row: usize) -> f64 {
        self.pixels.mm(row)
    }

    /// Returns the distance of a place between rows along the line, mm; the middle of a row is whole.
    pub fn mm_at(&self, row: f64) -> f64 {
        self.pixels.at.mm(row)
    }

    /// Returns the row at a distance along the line, mm; the middle of a row is whole. It may be beyond the first or the last one.
    pub fn row(&self, mm: f64) -> f64 {
        self.pixels.at.row(mm)
    }

    /// Returns the angle of a column about the line, degrees: −180 to 180, 0 towards the patient's front at the line's beginning.
    pub fn degrees(&self, column: usize) -> f64 {
        (column as f64 + 0.5) * 360.0 / self.pixels.columns as f64 - 180.0
    }

    /// Returns the chart that was drawn.
    pub fn chart(&self) -> &Chart {
        &self.chart
    }

    /// Returns the wall's point of each pixel, row by row, world, mm; NaN where there is none.
    pub fn points(&self) -> &[[f32; 3]] {
        &self.points
    }

    /// Returns the points behind those that are shown, ordered by pixel, then from near to far.
    pub fn behind(&self) -> &[Behind] {
        &self.behind
    }

    /// Returns the wall's point that a pixel shows, world, mm; `None` where there is none.
    pub fn point(&self, row: usize, column: usize) -> Option<DVec3> {
        let inside = row < self.rows() && column < self.columns();
        let point = Vec3::from_array(*inside.then(|| &self.points[row * self.columns() + column])?);
        (!point.is_nan()).then(|| point.as_dvec3())
    }

    /// Returns the unit normal into the tissue at the point that a pixel shows, world; `None` where there is none.
    pub fn normal(&self, row: usize, column: usize) -> Option<DVec3> {
        self.point(row, column).map(|_| self.normals[row * self.columns() + column].as_dvec3())
    }

    /// Returns the point in the middle of the lumen of a row, world, mm; `None` in a gap.
    pub fn middle(&self, row: usize) -> Option<DVec3> {
        let mm = self.mm(row);
        let station = self.chart.middle(mm.clamp(0.0, self.chart.length_mm())).or_else(|| self.chart.middle(mm));
        station.map(|s| s.frame.at)
    }

    /// Returns the wall's points behind the one that a pixel shows, world, mm, from near to far.
    pub fn points_behind(&self, row: usize, column: usize) -> impl Iterator<Item = DVec3> {
        let pixel = row * self.columns() + column;
        let first = self.behind.partition_point(|b| (b.pixel as usize) < pixel);
        self.behind[first..].iter().take_while(move |b| b.pixel as usize == pixel).map(|b| b.point.as_dvec3())
    }

    /// Returns where the map has the wall nearest to a place (world, mm); `None` if that is farther than 5 mm away, or beyond the rows.
    /// The first call sorts the wall's triangles.
    pub fn place(&self, world: DVec3) -> Option<Place> {
        let bins = self.bins.get_or_init(|| Bins::new(&self.chart));
        let (triangle, shares, wall) = bins.nearest(&self.chart, world, NEAR_MM)?;
        let corners = self.chart.flat(triangle)?;
        let at: [f32; 2] = std::array::from_fn(|n| (0..3).map(|c| corners[c][n] * shares[c]).sum());
        let [column, row] = self.pixels.place(at);
        let (columns, last) = (self.columns() as f32, (self.rows() - 1) as f32);
        if !(-0.5..=last + 0.5).contains(&row) {
            return None;
        }
        // The cut is within a pixel.
        let column = (column + 0.5).rem_euclid(columns) - 0.5;
        let (own_row, own_column) =
            (row.round().clamp(0.0, last) as usize, column.round().rem_euclid(columns) as usize);
        let shown = self.point(own_row, own_column).into_iter();
        let layers = shown.chain(self.points_behind(own_row, own_column));
        let far = |(_, p): &(usize, DVec3)| p.distance_squared(wall);
        let layer = layers.enumerate().min_by(|a, b| far(a).total_cmp(&far(b))).map_or(0, |l| l.0);
        Some(Place { row: row.into(), column: column.into(), layer })
    }

    /// Returns the colour at a place of a picture of this map, between pixels: the middle of a row and of a column is whole. Beyond the first
    /// and the last row it is theirs.
    #[inline]
    pub fn colour(&self, rgb: &[[u8; 3]], row: f64, column: f64) -> [f32; 3] {
        let (wide, high) = (self.columns(), self.rows());
        let (r0, c0) = (row.floor(), column.floor());
        let at = |r: f64, c: f64| {
            let r = (r.max(0.0) as usize).min(high - 1);
            rgb[r * wide + (c as i64).rem_euclid(wide as i64) as usize].map(f32::from)
        };
        let (u, v) = ((column - c0) as f32, (row - r0) as f32);
        let mix = |a: [f32; 3], b: [f32; 3], t: f32| std::array::from_fn(|n| a[n] + (b[n] - a[n]) * t);
        mix(mix(at(r0, c0), at(r0, c0 + 1.0), u), mix(at(r0 + 1.0, c0), at(r0 + 1.0, c0 + 1.0), u), v)
    }

    /// Returns how much of the wall lies between a pixel and the next ones: the largest and the smallest length in mm that a step of
    /// one pixel covers (the singular values of the map's derivative); `None` beside a place without wall, or beside another layer.
    pub fn scale(&self, row: usize, column: usize) -> Option<[f64; 2]> {
        let at = self.point(row, column)?;
        let right = self.point(row, (column + 1) % self.columns())? - at;
        let down = self.point(row + 1, column)? - at;
        let (a, b, c) = (right.length_squared(), right.dot(down), down.length_squared());
        let (middle, half) = (0.5 * (a + c), (0.25 * (a - c) * (a - c) + b * b).sqrt());
        Some([(middle + half).sqrt(), (middle - half).max(0.0).sqrt()])
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        self.chart.bytes() + 2 * self.points.len() * size_of::<Vec3>() + self.behind.len() * size_of::<Behind>()
    }
}

/// Returns the pixels of a sheet of a chart. Fails with status 4 if there is no row, or if there are too many.
fn pixels(chart: &Chart, sheet: &Sheet) -> Result<Pixels> {
    let [first, last] = chart.extent_mm();
    let (from, to) = (sheet.from_mm.unwrap_or(first), sheet.to_mm.unwrap_or(last));
    let step_mm = sheet.step_mm.clamp(0.05, 100.0);
    // The wall's mean girth, with its folds: on a wall without any, a pixel is narrower than a row is high.
    let girth_mm = chart.girth_mm();
    let girth = || (girth_mm / step_mm / 8.0).ceil() as usize * 8;
    let columns = sheet.columns.unwrap_or_else(girth).clamp(LEAST_COLUMNS, 1 << 12);
    let rows = ((to - from) / step_mm).floor() + 1.0;
    if !(1.0..=MOST_ROWS as f64).contains(&rows) {
        let why = format!("from {from:.0} to {to:.0} mm along the colon there are no rows that could be drawn");
        return Err(Error::incomplete("unfold", why, "give --from and --to farther apart"));
    }
    let at = Rows::new(chart, [from, to], step_mm, girth_mm);
    Ok(Pixels { rows: at.count(to), columns, at })
}
