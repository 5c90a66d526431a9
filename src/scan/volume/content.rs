//! The identity of a scan: a hash of what it contains, which is the same whatever file the scan was read from.

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::{Grid, Volume};

/// Names the method, so that another one gives other hashes.
const METHOD: &[u8] = b"colvis content 1\n";
/// Spacing (mm) and directions are compared in steps of this: headers in single precision differ by less.
const STEP: f64 = 1e-4;
/// Steps begin at this share of one. Usual spacings are short decimals or have few binary digits, and none of them lies near a
/// boundary then.
const OFFSET: f64 = 1.0 / 3.0;
/// By so much more of it an axis must lie along a direction of the patient to be preferred to an earlier choice.
const PREFERRED: f64 = 1e-6;

/// The axes of a grid in the order of the patient's: along each, the index axis, and whether it runs the other way.
type Axes = [(usize, bool); 3];

/// Returns `sha256:` and the hash of dimensions, spacing, direction and values of a scan, in hexadecimal digits.
///
/// The values are taken in the order of the patient's axes (left, posterior, superior), so the same scan has the same hash whether a
/// file stores it slice by slice from the head or from the feet. Its place in the room is not part of it. It is a hash over one hash
/// for each slice, which are computed in parallel.
pub fn content_hash(volume: &Volume) -> String {
    let (grid, data) = (volume.grid(), volume.data());
    let axes = axes(grid.direction());
    let dims = axes.map(|(a, _)| grid.dims()[a]);
    // By so much the index of a voxel grows along each axis of the patient.
    let [nx, ny, _] = grid.dims();
    let stride = axes.map(|(a, _)| [1, nx, nx * ny][a]);
    let at = |axis: usize, n: usize| if axes[axis].1 { dims[axis] - 1 - n } else { n } * stride[axis];
    let slice = |k: usize| {
        let mut hash = Sha256::new();
        let mut row = vec![[0; 2]; dims[0]];
        for j in 0..dims[1] {
            let first = at(2, k) + at(1, j);
            if stride[0] == 1 && !axes[0].1 {
                row.iter_mut().zip(&data[first..]).for_each(|(bytes, v)| *bytes = v.to_le_bytes());
            } else {
                row.iter_mut().enumerate().for_each(|(i, bytes)| *bytes = data[first + at(0, i)].to_le_bytes());
            }
            hash.update(row.as_flattened());
        }
        hash.finalize()
    };
    let slices: Vec<_> = (0..dims[2]).into_par_iter().map(slice).collect();
    let mut hash = Sha256::new();
    hash.update(METHOD);
    for n in dims.map(|d| d as i64).into_iter().chain(geometry(grid, &axes)) {
        hash.update(n.to_le_bytes());
    }
    slices.iter().for_each(|digest| hash.update(digest));
    let digits: String = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    format!("sha256:{digits}")
}

/// Returns the centre (world, mm) of the voxel whose value is hashed first: the same one however a file stores the scan. Two files of one
/// scan whose places in the room differ by a shift have the same hash, and that shift between these.
pub fn content_origin(grid: &Grid) -> DVec3 {
    let mut voxel = DVec3::ZERO;
    for (axis, is_turned) in axes(grid.direction()) {
        if is_turned {
            voxel[axis] = grid.dims()[axis] as f64 - 1.0;
        }
    }
    grid.world(voxel)
}

/// Returns the grid's axes in the order of the patient's.
fn axes(direction: DMat3) -> Axes {
    let along = |index: usize, world: usize| direction.col(index)[world];
    let share = |order: [usize; 3]| (0..3).map(|world| along(order[world], world).abs()).sum::<f64>();
    let mut best = [0, 1, 2];
    for order in [[0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
        if share(order) > share(best) + PREFERRED {
            best = order;
        }
    }
    std::array::from_fn(|world| (best[world], along(best[world], world) < 0.0))
}

/// Returns spacing and direction of the axes, in steps.
fn geometry(grid: &Grid, axes: &Axes) -> impl Iterator<Item = i64> {
    let direction = axes.map(|(a, turned)| grid.direction().col(a) * if turned { -1.0 } else { 1.0 });
    let spacing = DVec3::from_array(axes.map(|(a, _)| grid.spacing()[a]));
    let all = [spacing, direction[0], direction[1], direction[2]];
    all.into_iter().flat_map(|v| v.to_array()).map(|x| (x / STEP + OFFSET).floor() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIMS: [usize; 3] = [5, 4, 3];

    fn scan(spacing: DVec3, direction: DMat3) -> Volume {
        let grid = Grid::new(DIMS, spacing, DVec3::new(-12.0, 7.0, 100.0), direction).unwrap();
        Volume::new(grid, (0..60).map(|n| (n * n % 71 - 1000) as i16).collect())
    }

    /// Stores the same scan with other index axes.
    fn stored(volume: &Volume, order: [usize; 3], turned: [bool; 3]) -> Volume {
        let g = volume.grid();
        let dims = order.map(|a| g.dims()[a]);
        let back = |voxel: [usize; 3]| {
            let mut old = [0; 3];
            for (new, a) in order.into_iter().enumerate() {
                old[a] = if turned[new] { dims[new] - 1 - voxel[new] } else { voxel[new] };
            }
            old
        };
        let mut data = Vec::new();
        for k in 0..dims[2] {
            for j in 0..dims[1] {
                for i in 0..dims[0] {
                    let [x, y, z] = back([i, j, k]);
                    data.push(volume.data()[g.index(x, y, z)]);
                }
            }
        }
        let origin = g.world(DVec3::from_array(back([0; 3]).map(|n| n as f64)));
        let column = |new: usize| g.direction().col(order[new]) * if turned[new] { -1.0 } else { 1.0 };
        let direction = DMat3::from_cols(column(0), column(1), column(2));
        let spacing = DVec3::from_array(order.map(|a| g.spacing()[a]));
        Volume::new(Grid::new(dims, spacing, origin, direction).unwrap(), data)
    }

    #[test]
    fn the_same_scan_has_the_same_hash_however_it_is_stored() {
        // A gantry's tilt and a plain one; usual spacings.
        let tilt = DMat3::from_rotation_x(0.2);
        for (direction, spacing) in [(DMat3::IDENTITY, [0.703_125, 0.703_125, 1.0]), (tilt, [0.78125, 0.78125, 1.25])] {
            let volume = scan(spacing.into(), direction);
            let hash = content_hash(&volume);
            assert!(hash.len() == 71 && hash.starts_with("sha256:"), "{hash}");
            // Both ways round, and slices along another axis; handedness changes, as in files of slices from the feet.
            for order in [[0, 1, 2], [0, 2, 1], [2, 1, 0]] {
                for n in 0..8 {
                    let again = stored(&volume, order, [n & 1 == 1, n & 2 == 2, n & 4 == 4]);
                    assert_eq!(content_hash(&again), hash, "{order:?} {n}");
                    let origin = content_origin(again.grid());
                    assert!(origin.abs_diff_eq(content_origin(volume.grid()), 1e-9), "{order:?} {n}: {origin}");
                }
            }
            // A header in single precision.
            let single = |v: DVec3| v.as_vec3().as_dvec3();
            let columns = [0, 1, 2].map(|c| single(direction.col(c)));
            let direction = DMat3::from_cols(columns[0], columns[1], columns[2]);
            assert_eq!(content_hash(&scan(single(spacing.into()) * (1.0 + 1e-7), direction)), hash);
        }
    }

    #[test]
    fn another_scan_has_another_hash() {
        let volume = scan(DVec3::new(0.7, 0.7, 1.0), DMat3::IDENTITY);
        let hash = content_hash(&volume);
        let mut hashes = vec![
            content_hash(&scan(DVec3::new(0.7, 0.7, 1.001), DMat3::IDENTITY)),
            content_hash(&scan(DVec3::new(0.7, 0.7, 1.0), DMat3::from_rotation_z(0.01))),
            hash,
        ];
        for voxel in [0, 31, 59] {
            let mut changed = volume.clone();
            changed.data_mut()[voxel] += 1;
            hashes.push(content_hash(&changed));
        }
        // The same numbers, in slices of another shape.
        let grid = Grid::new([4, 5, 3], volume.grid().spacing(), volume.grid().origin(), DMat3::IDENTITY).unwrap();
        hashes.push(content_hash(&Volume::new(grid, volume.data().to_vec())));
        let count = hashes.len();
        hashes.sort();
        hashes.dedup();
        assert_eq!(hashes.len(), count);
    }
}
