//! How well a map shows the wall.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::Unfolding;
use super::raster::LAYER_MM;

/// Sums are taken over this many triangles or pixels at once, in order.
const BLOCK: usize = 1 << 14;

/// Number of round trips.
const TRIPS: usize = 20_000;

/// How well a map shows the wall.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Measures {
    /// Area of the wall between the first and the last row, mm².
    pub wall_mm2: f64,
    /// Share of that which the map shows.
    pub shown: f64,
    /// Share that lies behind what is shown, in a further layer.
    pub behind: f64,
    /// Share that is in no layer.
    pub absent: f64,
    /// The largest length on the wall of a step of one pixel over the smallest, at 5, 50 and 95 % of the pixels.
    pub stretch: [f64; 3],
    /// The area of the wall in a pixel, mm², at 5, 50 and 95 % of the pixels.
    pub pixel_mm2: [f64; 3],
    /// The distance on the wall from each shown point to what the map shows where [`Unfolding::place`] finds it, mm, at 50, 95 and 99 %.
    pub round_trip_mm: [f64; 3],
}

impl Measures {
    /// Measures a map.
    pub fn of(map: &Unfolding) -> Self {
        let chart = &map.chart;
        let share = |t: usize| -> [f64; 3] {
            let area = chart.area(t);
            let Some(corners) = chart.flat(t) else { return [area, 0.0, 0.0] };
            let middle = std::array::from_fn(|n| corners.iter().map(|c| c[n]).sum::<f32>() / 3.0);
            let [column, row] = map.pixels.place(middle);
            let row = row.round();
            if row < 0.0 || row >= map.rows() as f32 {
                return [0.0; 3];
            }
            let (row, column) = (row as usize, (column.round() as i64).rem_euclid(map.columns() as i64) as usize);
            let wall = chart.triangles[t].iter().map(|&v| chart.world(v)).sum::<DVec3>() / 3.0;
            // A pixel may be larger than a triangle.
            let size = map.scale(row, column).map_or(0.0, |s| s[0]).min(3.0);
            let near = |p: DVec3| p.distance(wall) < f64::from(LAYER_MM) + size;
            if map.point(row, column).is_some_and(near) {
                [area, area, 0.0]
            } else if map.points_behind(row, column).any(near) {
                [area, 0.0, area]
            } else {
                [area, 0.0, 0.0]
            }
        };
        let add = |a: [f64; 3], b: [f64; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        let count = chart.triangles.len();
        let sums: Vec<[f64; 3]> = (0..count.div_ceil(BLOCK))
            .into_par_iter()
            .map(|b| (b * BLOCK..((b + 1) * BLOCK).min(count)).map(share).fold([0.0; 3], add))
            .collect();
        let [wall_mm2, shown, behind] = sums.into_iter().fold([0.0; 3], add);
        let of = |area: f64| if wall_mm2 > 0.0 { area / wall_mm2 } else { 0.0 };
        let scales: Vec<[f64; 2]> = (0..map.points.len())
            .into_par_iter()
            .filter_map(|n| map.scale(n / map.columns(), n % map.columns()))
            .collect();
        let most = f64::from(LAYER_MM);
        let one_layer: Vec<[f64; 2]> = scales.into_iter().filter(|s| s[0] < 3.0 * most && s[1] > 0.0).collect();
        let trip: Vec<f64> = (0..map.points.len())
            .into_par_iter()
            .step_by(map.points.len().div_ceil(TRIPS).max(1))
            .filter_map(|n| {
                let point = Vec3::from_array(map.points[n]).as_dvec3();
                let place = map.place(point).filter(|_| !point.is_nan())?;
                let row = (place.row.round() as usize).min(map.rows() - 1);
                let back = map.point(row, (place.column.round() as i64).rem_euclid(map.columns() as i64) as usize)?;
                Some(back.distance(point))
            })
            .collect();
        Self {
            wall_mm2,
            shown: of(shown),
            behind: of(behind),
            absent: of(wall_mm2 - shown - behind),
            stretch: shares(one_layer.iter().map(|s| s[0] / s[1]).collect(), [0.05, 0.5, 0.95]),
            pixel_mm2: shares(one_layer.iter().map(|s| s[0] * s[1]).collect(), [0.05, 0.5, 0.95]),
            round_trip_mm: shares(trip, [0.5, 0.95, 0.99]),
        }
    }
}

/// Returns the values below which the given shares of all lie.
fn shares<const N: usize>(mut values: Vec<f64>, at: [f64; N]) -> [f64; N] {
    values.sort_unstable_by(f64::total_cmp);
    at.map(|share| values.get((values.len().saturating_sub(1) as f64 * share) as usize).copied().unwrap_or(0.0))
}
