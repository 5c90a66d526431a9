//! Which triangle of the wall each pixel of the map shows.

use std::f32::consts::{PI, TAU};

use rayon::prelude::*;

use super::chart::Chart;
use super::rows::Rows;

/// Rows that one task draws.
pub(super) const BAND: usize = 32;
/// No triangle.
pub(super) const NONE: u32 = u32::MAX;
/// A wall this much farther from the middle than the one shown is another layer, mm.
pub(super) const LAYER_MM: f32 = 2.0;

/// The pixels of the map. Column c is at the angle (c + ½) · 360° / columns − 180°.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pixels {
    pub rows: usize,
    pub columns: usize,
    /// Where each row is along the line.
    pub at: Rows,
}

impl Pixels {
    /// Returns the distance along the line of a row, mm.
    pub(super) fn mm(&self, row: usize) -> f64 {
        self.at.mm(row as f64)
    }

    /// Returns the place of an angle and a distance, in pixels: (column, row); the middle of a pixel is whole.
    pub(super) fn place(&self, [angle, along]: [f32; 2]) -> [f32; 2] {
        let column = (angle + PI) / TAU * self.columns as f32 - 0.5;
        [column, self.at.row(along.into()) as f32]
    }
}

/// What a pixel shows: a triangle, and its corners' shares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hit {
    pub triangle: u32,
    pub shares: [f32; 3],
    /// Distance from the middle of the lumen, mm.
    pub far: f32,
}

impl Hit {
    const NOTHING: Self = Self { triangle: NONE, shares: [0.0; 3], far: f32::INFINITY };
}

/// The triangles that rows of the map may show, in order.
pub(super) struct Bands {
    begins: Vec<u32>,
    triangles: Vec<u32>,
}

impl Bands {
    /// Sorts the triangles of a chart by the bands of [`BAND`] rows that they touch.
    pub(super) fn new(chart: &Chart, pixels: &Pixels) -> Self {
        let count = pixels.rows.div_ceil(BAND);
        let touched = |t: usize| {
            let rows = chart.flat(t)?.map(|c| pixels.place(c)[1]);
            let (low, high) = (rows[0].min(rows[1]).min(rows[2]), rows[0].max(rows[1]).max(rows[2]));
            if high < 0.0 || low > (pixels.rows - 1) as f32 {
                return None;
            }
            let band = |row: f32| row.max(0.0) as usize / BAND;
            Some((band(low.ceil()) as u32, (band(high.floor()) as u32).min(count as u32 - 1)))
        };
        let touched: Vec<Option<(u32, u32)>> = (0..chart.triangles.len()).into_par_iter().map(touched).collect();
        let mut begins = vec![0u32; count + 1];
        for (low, high) in touched.iter().flatten() {
            for band in *low..=*high {
                begins[band as usize + 1] += 1;
            }
        }
        for n in 0..count {
            begins[n + 1] += begins[n];
        }
        let (mut next, mut triangles) = (begins.clone(), vec![0; begins[count] as usize]);
        for (t, (low, high)) in touched.iter().enumerate().filter_map(|(t, b)| Some((t, (*b)?))) {
            for band in low..=high {
                triangles[next[band as usize] as usize] = t as u32;
                next[band as usize] += 1;
            }
        }
        Self { begins, triangles }
    }

    /// Draws a band: for each pixel what is nearest to the middle of the lumen, and, ordered by pixel and from near to far, what lies
    /// behind that.
    pub(super) fn draw(&self, chart: &Chart, pixels: &Pixels, band: usize) -> (Vec<Hit>, Vec<(u32, Hit)>) {
        let rows = (band * BAND, ((band + 1) * BAND).min(pixels.rows));
        let count = (rows.1 - rows.0) * pixels.columns;
        let middles: Vec<[f32; 3]> = (rows.0..rows.1)
            .map(|row| {
                let middle = chart.middle(pixels.mm(row));
                middle.map_or([f32::NAN; 3], |s| (s.frame.at - chart.origin).as_vec3().to_array())
            })
            .collect();
        let own = &self.triangles[self.begins[band] as usize..self.begins[band + 1] as usize];
        let mut first = vec![Hit::NOTHING; count];
        let mut times = vec![0u8; count];
        let far = |t: u32, shares: [f32; 3], row: usize| {
            let middle = middles[row - rows.0];
            let corners = chart.triangles[t as usize].map(|v| chart.places[v as usize]);
            let at = corners[0] * shares[0] + corners[1] * shares[1] + corners[2] * shares[2];
            at.distance(middle.into())
        };
        for &t in own {
            each_pixel(chart, pixels, t, rows, |row, column, shares| {
                let n = (row - rows.0) * pixels.columns + column;
                let hit = Hit { triangle: t, shares, far: far(t, shares, row) };
                times[n] = times[n].saturating_add(1);
                if hit.far < first[n].far {
                    first[n] = hit;
                }
            });
        }
        let mut behind = Vec::new();
        for &t in own {
            each_pixel(chart, pixels, t, rows, |row, column, shares| {
                let n = (row - rows.0) * pixels.columns + column;
                if times[n] > 1 && first[n].triangle != t {
                    let hit = Hit { triangle: t, shares, far: far(t, shares, row) };
                    if hit.far > first[n].far + LAYER_MM {
                        behind.push((n as u32, hit));
                    }
                }
            });
        }
        behind.sort_by(|a: &(u32, Hit), b| (a.0.cmp(&b.0)).then(a.1.far.total_cmp(&b.1.far)));
        // Triangles that share a side, and small folds, are one layer.
        behind.dedup_by(|next, kept| next.0 == kept.0 && next.1.far < kept.1.far + LAYER_MM);
        (first, behind)
    }
}

/// Calls `visit(row, column, shares)` for the pixels within a triangle and on its rim.
fn each_pixel(
    chart: &Chart,
    pixels: &Pixels,
    triangle: u32,
    rows: (usize, usize),
    mut visit: impl FnMut(usize, usize, [f32; 3]),
) {
    const RIM: f32 = 1e-4;
    let Some(corners) = chart.flat(triangle as usize) else { return };
    let [a, b, c] = corners.map(|c| pixels.place(c));
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
    if area == 0.0 {
        return;
    }
    let low = |n: usize| a[n].min(b[n]).min(c[n]);
    let high = |n: usize| a[n].max(b[n]).max(c[n]);
    let range = |n: usize| ((low(n) - RIM).ceil() as i64, (high(n) + RIM).floor() as i64);
    let (columns, own) = (range(0), range(1));
    for row in own.0.max(rows.0 as i64)..=own.1.min(rows.1 as i64 - 1) {
        for column in columns.0..=columns.1 {
            let (x, y) = (column as f32, row as f32);
            let share = |p: [f32; 2], q: [f32; 2]| ((p[0] - x) * (q[1] - y) - (q[0] - x) * (p[1] - y)) / area;
            let shares = [share(b, c), share(c, a), share(a, b)];
            if shares.iter().all(|s| *s >= -RIM) {
                visit(row as usize, column.rem_euclid(pixels.columns as i64) as usize, shares);
            }
        }
    }
}
