//! A map drawn in bands: some rows at once, in any order.

use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use glam::Vec3;
use rayon::prelude::*;

use super::chart::Chart;
use super::raster::{BAND, Bands, Hit, NONE, Pixels};
use super::wall::Refiner;
use super::{Behind, Sheet, Unfolding, picture, pixels};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Volume;

/// Draws a map band by band. A band depends on the chart and on its own rows only, so that any order and any number of threads give the
/// same map.
pub struct Drawing<'a> {
    chart: Arc<Chart>,
    pixels: Pixels,
    triangles: Bands,
    refiner: Refiner<'a>,
    iso: f64,
}

/// Some rows of a map, drawn.
#[derive(Clone, Debug)]
pub struct Band {
    /// Its rows of the map.
    pub rows: Range<usize>,
    /// As in the map, of these rows.
    pub(super) points: Vec<[f32; 3]>,
    pub(super) normals: Vec<Vec3>,
    pub(super) behind: Vec<Behind>,
}

impl Band {
    /// Returns the wall's point that each pixel shows, world, mm, and the unit normal into the tissue there, row by row; NaN where there is
    /// none.
    pub fn wall(&self) -> impl Iterator<Item = (Vec3, Vec3)> {
        self.points.iter().map(|p| Vec3::from_array(*p)).zip(self.normals.iter().copied())
    }
}

impl<'a> Drawing<'a> {
    /// Prepares a map of a chart of the wall in `volume`; the wall of gas is at `iso` HU.
    ///
    /// # Errors
    /// Returns status 4 if the sheet has no row, or too many.
    pub fn new(chart: impl Into<Arc<Chart>>, volume: &'a Volume, iso: f64, sheet: &Sheet) -> Result<Self> {
        let chart = chart.into();
        let pixels = pixels(&chart, sheet)?;
        let triangles = Bands::new(&chart, &pixels);
        Ok(Self { chart, pixels, triangles, refiner: Refiner::new(volume, iso), iso })
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.pixels.columns
    }

    /// Number of bands.
    pub fn count(&self) -> usize {
        self.pixels.rows.div_ceil(BAND)
    }

    /// Returns the rows of a band.
    pub fn rows(&self, band: usize) -> Range<usize> {
        band * BAND..((band + 1) * BAND).min(self.pixels.rows)
    }

    /// Draws a band.
    pub fn band(&self, band: usize) -> Band {
        let (first, more) = self.triangles.draw(&self.chart, &self.pixels, band);
        let refined = |hit: &Hit| match hit.triangle {
            NONE => (Vec3::NAN, Vec3::NAN),
            _ => self.refiner.refined(&self.chart, hit),
        };
        let before = (band * BAND * self.pixels.columns) as u32;
        let behind = more.iter().map(|(n, hit)| Behind { pixel: before + n, point: refined(hit).0 }).collect();
        let (points, normals) = first.iter().map(refined).map(|(point, normal)| (point.to_array(), normal)).unzip();
        Band { rows: self.rows(band), points, normals, behind }
    }

    /// Draws all bands on the threads of the pool that calls it, and hands each to `ready` once it is drawn: those nearest to `from_mm` along
    /// the line first. That is asked anew for each band, and may change meanwhile.
    ///
    /// # Errors
    /// Returns status 4 if interrupted, and the errors of `ready`.
    pub fn outwards(
        &self,
        from_mm: impl Fn() -> f64 + Sync,
        progress: &Progress,
        ready: impl Fn(Band) -> Result<()> + Sync,
    ) -> Result<()> {
        progress.stage("laying the wall flat", self.count() as u64);
        let left = Mutex::new((0..self.count()).collect::<Vec<_>>());
        let next = || self.take_nearest(&mut left.lock().unwrap_or_else(PoisonError::into_inner), from_mm());
        (0..rayon::current_num_threads()).into_par_iter().try_for_each(|_| {
            while let Some(band) = next() {
                ready(self.band(band))?;
                progress.advance(1)?;
            }
            Ok(())
        })
    }

    /// Takes the band nearest to a distance along the line, mm, out of those that are left; the first one if that is no number.
    fn take_nearest(&self, left: &mut Vec<usize>, mm: f64) -> Option<usize> {
        let row = self.pixels.at.row(mm);
        let away = |band: usize| {
            let rows = self.rows(band);
            (rows.start as f64 - row).max(row - (rows.end - 1) as f64).max(0.0)
        };
        let nearest = (0..left.len()).min_by(|&a, &b| away(left[a]).total_cmp(&away(left[b])))?;
        Some(left.remove(nearest))
    }

    /// Returns the picture of a band: those rows of [`picture()`].
    pub fn picture(&self, band: &Band) -> Vec<[u8; 3]> {
        let columns = self.pixels.columns;
        let mut out = vec![[0; 3]; band.points.len()];
        let mut behind = &band.behind[..];
        for (n, row) in band.rows.clone().enumerate() {
            let own = n * columns..(n + 1) * columns;
            let count = behind.partition_point(|b| (b.pixel as usize) < (row + 1) * columns);
            let wall = picture::Row {
                first: row * columns,
                points: &band.points[own.clone()],
                normals: &band.normals[own.clone()],
                behind: &behind[..count],
            };
            picture::paint(&self.chart, self.pixels.mm(row), self.iso, &wall, &mut out[own]);
            behind = &behind[count..];
        }
        out
    }

    /// Returns the map without any wall.
    pub fn blank(&self) -> Unfolding {
        let count = self.pixels.rows * self.pixels.columns;
        let (chart, pixels) = (Arc::clone(&self.chart), self.pixels.clone());
        Unfolding {
            chart,
            pixels,
            points: vec![[f32::NAN; 3]; count],
            normals: vec![Vec3::NAN; count],
            behind: Vec::new(),
            bins: OnceLock::new(),
        }
    }

    /// Returns the map with the nearest points of a coarser map of the same chart, for as long as its bands are not drawn.
    pub fn preview(&self, coarse: &Unfolding) -> Unfolding {
        let mut map = self.blank();
        let (wide, high) = (coarse.columns(), coarse.rows());
        let columns = map.columns();
        let rows = map.points.par_chunks_mut(columns).zip(map.normals.par_chunks_mut(columns)).enumerate();
        rows.for_each(|(row, (points, normals))| {
            let from = (coarse.row(self.pixels.mm(row)).round().max(0.0) as usize).min(high - 1) * wide;
            for (column, (point, normal)) in points.iter_mut().zip(normals).enumerate() {
                let n = from + ((column as f64 + 0.5) * wide as f64 / columns as f64) as usize;
                (*point, *normal) = (coarse.points[n], coarse.normals[n]);
            }
        });
        map
    }

    /// Returns a picture of a coarser map of the same chart in the size of this one.
    pub fn enlarged(&self, coarse: &Unfolding, rgb: &[[u8; 3]]) -> Vec<[u8; 3]> {
        let columns = self.pixels.columns;
        let mut out = vec![[0; 3]; self.pixels.rows * columns];
        out.par_chunks_mut(columns).enumerate().for_each(|(row, out)| {
            let row = coarse.row(self.pixels.mm(row));
            for (column, out) in out.iter_mut().enumerate() {
                let column = (column as f64 + 0.5) * coarse.columns() as f64 / columns as f64 - 0.5;
                *out = coarse.colour(rgb, row, column).map(|c| (c + 0.5) as u8);
            }
        });
        out
    }
}
