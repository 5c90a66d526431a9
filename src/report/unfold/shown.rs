//! How often a map shows each part of the wall, found without anything that the map was made with.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Side of a cell, mm.
const CELL_MM: f32 = 2.0;
/// A part of the wall is shown if a pixel's point is within this of it, mm.
pub(super) const NEAR_MM: f32 = 1.0;
/// The same, mm, where pixels are far apart on the wall.
pub(super) const WIDE_MM: f32 = 2.0;
/// A pixel's point is on a face within this of it, mm.
const ON_MM: f32 = 2.0;
/// Pixels within so many rows and columns of each other are one place of the map.
const GAP: i64 = 3;
/// Every so many faces one is looked at.
const STRIDE: usize = 7;

/// A face of the wall.
#[derive(Clone, Copy, Debug)]
pub(super) struct Face {
    /// World, mm.
    pub(super) at: DVec3,
    /// Unit normal, world.
    pub(super) normal: DVec3,
    pub(super) mm2: f64,
}

/// A map of the wall: rows of points, world mm; NaN where there is none. The last column is beside the first.
pub(super) struct Map {
    pub(super) columns: usize,
    pub(super) points: Vec<[f32; 3]>,
}

/// Shares of the wall's area.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Shares {
    /// Without a pixel within [`NEAR_MM`] and [`WIDE_MM`].
    pub(super) absent: [f64; 2],
    /// In two places of the map or more.
    pub(super) twice: f64,
}

/// Points in cells.
struct Cells {
    origin: Vec3,
    dims: [usize; 3],
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Cells {
    fn new(points: &[Vec3]) -> Self {
        let known = || points.iter().filter(|p| p.is_finite());
        let low = known().copied().reduce(Vec3::min).unwrap_or_default() - CELL_MM;
        let high = known().copied().reduce(Vec3::max).unwrap_or_default() + CELL_MM;
        let dims = ((high - low) / CELL_MM).ceil().to_array().map(|n| (n as usize).clamp(1, 4096));
        let mut cells = Self { origin: low, dims, starts: Vec::new(), items: Vec::new() };
        let mut starts = vec![0u32; dims.iter().product::<usize>() + 1];
        let places: Vec<Option<usize>> = points.iter().map(|p| cells.cell(*p)).collect();
        places.iter().flatten().for_each(|c| starts[c + 1] += 1);
        (1..starts.len()).for_each(|n| starts[n] += starts[n - 1]);
        let mut next = starts.clone();
        cells.items = vec![0; starts[starts.len() - 1] as usize];
        for (n, cell) in places.iter().enumerate() {
            if let Some(c) = cell {
                cells.items[next[*c] as usize] = n as u32;
                next[*c] += 1;
            }
        }
        cells.starts = starts;
        cells
    }

    fn cell(&self, p: Vec3) -> Option<usize> {
        let at = ((p - self.origin) / CELL_MM).floor();
        let at = p.is_finite().then(|| at.to_array().map(|n| n as i64))?;
        let inside = at.iter().zip(self.dims).all(|(n, d)| (0..d as i64).contains(n));
        inside.then(|| at[0] as usize + self.dims[0] * (at[1] as usize + self.dims[1] * at[2] as usize))
    }

    /// Calls `each` for everything in the cells about a point.
    fn around(&self, p: Vec3, mut each: impl FnMut(usize)) {
        for corner in 0..27 {
            let by = Vec3::new((corner % 3) as f32 - 1.0, (corner / 3 % 3) as f32 - 1.0, (corner / 9) as f32 - 1.0);
            if let Some(c) = self.cell(p + by * CELL_MM) {
                self.items[self.starts[c] as usize..self.starts[c + 1] as usize].iter().for_each(|n| each(*n as usize));
            }
        }
    }
}

/// Returns shares of the wall by how often a map shows it. A pixel counts for a face only if the nearest face to it looks the same way: the
/// other side of a fold is another wall.
pub(super) fn shares(faces: &[Face], map: &Map) -> Shares {
    let face_at: Vec<Vec3> = faces.iter().map(|f| f.at.as_vec3()).collect();
    let by_face = Cells::new(&face_at);
    let points: Vec<Vec3> = map.points.iter().map(|p| Vec3::from_array(*p)).collect();
    let normals: Vec<Vec3> = points
        .par_iter()
        .map(|p| {
            let mut best = (ON_MM, Vec3::ZERO);
            by_face.around(*p, |n| {
                let away = face_at[n].distance(*p);
                if away < best.0 {
                    best = (away, faces[n].normal.as_vec3());
                }
            });
            best.1
        })
        .collect();
    let by_pixel = Cells::new(&points);
    let looked: Vec<[f64; 4]> = faces
        .par_iter()
        .step_by(STRIDE)
        .map(|face| {
            let (at, normal) = (face.at.as_vec3(), face.normal.as_vec3());
            let (mut near, mut is_wide) = (Vec::new(), false);
            by_pixel.around(at, |n| {
                let away = points[n].distance(at);
                if away < WIDE_MM && normals[n].dot(normal) > 0.3 {
                    is_wide = true;
                    if away < NEAR_MM {
                        near.push(n);
                    }
                }
            });
            let share = |is: bool| if is { face.mm2 } else { 0.0 };
            [face.mm2, share(near.is_empty()), share(!is_wide), share(places(&near, map.columns).len() > 1)]
        })
        .collect();
    let sum = |n: usize| looked.iter().map(|l| l[n]).sum::<f64>();
    let whole = sum(0).max(f64::MIN_POSITIVE);
    Shares { absent: [sum(1) / whole, sum(2) / whole], twice: sum(3) / whole }
}

/// Returns the places of a map that some of its pixels, by their index, are in: groups of those near each other.
pub(super) fn places(pixels: &[usize], columns: usize) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let columns = columns.max(1) as i64;
    let place = |n: usize| (n as i64 / columns, n as i64 % columns);
    for &pixel in pixels {
        let (row, column) = place(pixel);
        let is_near = |&other: &usize| {
            let (r, c) = place(other);
            let across = (c - column).abs();
            (r - row).abs() <= GAP && across.min(columns - across) <= GAP
        };
        let (mut joined, apart): (Vec<_>, Vec<_>) = groups.into_iter().partition(|g| g.iter().any(is_near));
        groups = apart;
        let mut group = joined.drain(..).flatten().collect::<Vec<_>>();
        group.push(pixel);
        groups.push(group);
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flat wall of 20 mm, and maps that show all, half and all of it twice.
    #[test]
    fn what_is_absent_or_shown_twice_is_counted() {
        let face = |n: usize| Face {
            at: DVec3::new((n % 80) as f64 * 0.25, (n / 80) as f64 * 0.25, 0.0),
            normal: DVec3::Z,
            mm2: 0.0625,
        };
        let faces: Vec<Face> = (0..6400).map(face).collect();
        let map = |rows: usize, place: &dyn Fn(usize) -> f32| Map {
            columns: 40,
            points: (0..rows * 40).map(|n| [(n % 40) as f32 * 0.5, place(n / 40), 0.1]).collect(),
        };
        let all = shares(&faces, &map(40, &|row| row as f32 * 0.5));
        assert_eq!((all.absent, all.twice), ([0.0; 2], 0.0));
        let half = shares(&faces, &map(20, &|row| row as f32 * 0.5));
        assert!((0.42..0.48).contains(&half.absent[0]) && half.absent[1] < half.absent[0], "{half:?}");
        let twice = shares(&faces, &map(80, &|row| (row % 40) as f32 * 0.5));
        assert!(twice.twice > 0.9 && twice.absent == [0.0; 2], "{twice:?}");
        // The other side of a thin wall does not show this one.
        let behind: Vec<Face> =
            faces.iter().map(|f| Face { at: f.at - DVec3::Z * 0.8, normal: -DVec3::Z, ..*f }).collect();
        let both = [faces, behind].concat();
        let one = shares(&both, &map(40, &|row| row as f32 * 0.5));
        assert!((0.49..0.51).contains(&one.absent[0]), "{one:?}");
    }

    #[test]
    fn pixels_beside_the_cut_are_one_place() {
        assert_eq!(places(&[0, 39, 41, 79], 40).len(), 1);
        assert_eq!(places(&[0, 20, 400], 40).len(), 3);
        assert!(places(&[], 0).is_empty());
    }
}
