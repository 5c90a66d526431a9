//! Landmarks of the patient: skin, midline, spine, pelvis and the lungs' lower end, from cells of about 5 mm.

use glam::DVec3;
use rayon::prelude::*;

use crate::fields::lumen::TISSUE_HU;
use crate::fields::lumen::frame::Frame;
use crate::math::sets::Sets;
use crate::volume::{PatientPosition, Volume};

/// Minimum side of a cell, mm.
const CELL_MM: f64 = 5.0;
/// Brighter than this is bone or tag, HU.
const BONE_HU: i16 = 160;
/// Lung is between these, HU.
const LUNG_HU: [i16; 2] = [-940, -500];
/// Half the width of an adult's abdomen, mm: bodies are compared with it.
const ADULT_HALF_WIDTH_MM: f64 = 160.0;
/// Limits of a body's size compared with an adult's.
const SCALE: [f64; 2] = [0.35, 1.3];
/// Share of a slice's body that is lung, down to the lungs' lower end: blurred walls of skin and bowel look like lung, too.
const LUNG_SHARE: f64 = 0.1;
/// Share of a slice's body that is lung, from which on the slice is through the chest.
const CHEST_SHARE: f64 = 0.25;
/// Minimum area of the table in a slice, mm².
const TABLE_MM2: f64 = 500.0;
/// A scan of which this share passes through the chest shows the chest …
const CHEST: f64 = 0.2;
/// … and one that reaches this far below the lungs shows the abdomen, too, mm, in an adult.
const ABDOMEN_MM: f64 = 220.0;
/// Minimum area of bone on each side of a slice through the pelvis, mm², in an adult.
const PELVIS_MM2: f64 = 350.0;

/// Landmarks of the patient, world, mm LPS. What is not in the scan is `None`.
#[derive(Clone, Debug, PartialEq)]
pub struct Landmarks {
    /// x of the midline.
    pub midline: f64,
    /// Half the body's width.
    pub half_width: f64,
    /// y of the body's front and of its back.
    pub depth: [f64; 2],
    /// z of the body's lowest and of its highest slice.
    pub span: [f64; 2],
    /// y of the front of the spine.
    pub spine: Option<f64>,
    /// z of the lungs' lower ends.
    pub diaphragm: Option<f64>,
    /// z of the highest slice through the pelvic bones.
    pub pelvis: Option<f64>,
    /// Share of the slices that pass through the chest.
    pub chest: f64,
    /// The position that the table shows.
    pub table: Option<PatientPosition>,
    /// z of the slices and the share of lung in each, upwards.
    lung: Vec<(f64, f64)>,
}

/// What a cell holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cell {
    Gas,
    Lung,
    Tissue,
    Bone,
}

/// One slice of cells.
struct Slice {
    z: f64,
    /// Minimum and maximum of x and y of the body.
    x: [f64; 2],
    y: [f64; 2],
    /// Bone: x, y.
    bone: Vec<[f64; 2]>,
    /// Lung, within the body's limits.
    lung: Vec<[f64; 2]>,
    body: usize,
    /// What is neither air nor body: x, y.
    loose: Vec<[f64; 2]>,
}

impl Landmarks {
    /// Finds the landmarks of a scan; `None` where there is no body.
    pub(in crate::fields) fn of(volume: &Volume, frame: Frame) -> Option<Self> {
        let grid = volume.grid();
        let (dims, spacing) = (grid.dims(), grid.spacing());
        // At least about 16 cells along each axis, so that a small volume is measured too.
        let step: [usize; 3] =
            std::array::from_fn(|a| ((CELL_MM / spacing[a]).round() as usize).clamp(1, (dims[a] / 16).max(1)));
        let count: [usize; 3] = std::array::from_fn(|a| dims[a].div_ceil(step[a]));
        let cells: Vec<Cell> = (0..count[2])
            .into_par_iter()
            .flat_map_iter(|k| {
                (0..count[1]).flat_map(move |j| {
                    (0..count[0]).map(move |i| cell(volume.data()[grid.index(i * step[0], j * step[1], k * step[2])]))
                })
            })
            .collect();
        let body = largest(&cells, count);
        let index = |c: [usize; 3]| c[0] + count[0] * (c[1] + count[1] * c[2]);
        let mut slices: Vec<Slice> = (0..count[frame.superior.axis])
            .into_par_iter()
            .map(|level| {
                let mut s = Slice {
                    z: 0.0,
                    x: [f64::INFINITY, f64::NEG_INFINITY],
                    y: [f64::INFINITY, f64::NEG_INFINITY],
                    bone: Vec::new(),
                    lung: Vec::new(),
                    body: 0,
                    loose: Vec::new(),
                };
                let (a, b) = (frame.left.axis, frame.posterior.axis);
                for v in 0..count[b] {
                    for u in 0..count[a] {
                        let mut c = [0; 3];
                        (c[frame.superior.axis], c[a], c[b]) = (level, u, v);
                        let n = index(c);
                        let p = grid.world(DVec3::from_array(std::array::from_fn(|a| (c[a] * step[a]) as f64)));
                        if cells[n] == Cell::Lung {
                            s.lung.push([p.x, p.y]);
                        }
                        // Skin in a part of a cell is not the table's shell.
                        let is_apart = || {
                            [a, b].into_iter().all(|axis| {
                                let (mut less, mut more) = (c, c);
                                less[axis] = c[axis].saturating_sub(1);
                                more[axis] = (c[axis] + 1).min(count[axis] - 1);
                                !body[index(less)] && !body[index(more)]
                            })
                        };
                        if !body[n] && (cells[n] != Cell::Gas || is_apart() && is_shell(volume, c, step, b)) {
                            s.loose.push([p.x, p.y]);
                        }
                        if body[n] {
                            s.body += 1;
                            s.z += p.z;
                            s.x = [s.x[0].min(p.x), s.x[1].max(p.x)];
                            s.y = [s.y[0].min(p.y), s.y[1].max(p.y)];
                            if cells[n] == Cell::Bone {
                                s.bone.push([p.x, p.y]);
                            }
                        }
                    }
                }
                s.z /= s.body.max(1) as f64;
                // The foam of a table is as dark as lung.
                let [x, y] = [s.x, s.y];
                s.lung.retain(|p| x[0] < p[0] && p[0] < x[1] && y[0] < p[1] && p[1] < y[1]);
                s
            })
            .collect();
        slices.retain(|s| s.body > 0);
        slices.sort_by(|a, b| a.z.total_cmp(&b.z));
        let area_mm2 = (step[frame.left.axis] * step[frame.posterior.axis]) as f64
            * spacing[frame.left.axis]
            * spacing[frame.posterior.axis];
        Self::measured(&slices, area_mm2)
    }

    fn measured(slices: &[Slice], area_mm2: f64) -> Option<Self> {
        let (first, last) = (slices.first()?, slices.last()?);
        let median = |value: &dyn Fn(&Slice) -> f64| {
            let mut all: Vec<f64> = slices.iter().map(value).collect();
            all.sort_by(f64::total_cmp);
            all[all.len() / 2]
        };
        let middle = median(&|s| 0.5 * (s.x[0] + s.x[1]));
        let half_width = median(&|s| 0.5 * (s.x[1] - s.x[0])).max(1.0);
        let depth = [median(&|s| s.y[0]), median(&|s| s.y[1])];
        let scale = scale(half_width);
        // The spine: bone near the middle, in the rear half.
        let rear = 0.5 * (depth[0] + depth[1]);
        let spine: Vec<(f64, f64)> = slices
            .iter()
            .filter_map(|s| {
                let near = s.bone.iter().filter(|b| (b[0] - middle).abs() < 0.3 * half_width && b[1] > rear);
                let (mut x, mut y): (Vec<f64>, Vec<f64>) = near.map(|b| (b[0], b[1])).unzip();
                if (x.len() as f64) * area_mm2 < 300.0 * scale * scale {
                    return None;
                }
                Some((ranked(&mut x, 0.5), ranked(&mut y, 0.1)))
            })
            .collect();
        let found = 4 * spine.len() >= slices.len();
        let (mut x, mut y): (Vec<f64>, Vec<f64>) = spine.into_iter().unzip();
        let lung: Vec<(f64, f64)> =
            slices.iter().map(|s| (s.z, s.lung.len() as f64 / (s.lung.len() + s.body) as f64)).collect();
        let table = table(slices, middle, half_width, depth, area_mm2);
        let is_chest = |l: &&(f64, f64)| l.1 >= CHEST_SHARE;
        // The longest stretch of slices with lung; arms and bowel make shorter ones.
        let stretches = lung.chunk_by(|a, b| (a.1 >= LUNG_SHARE) == (b.1 >= LUNG_SHARE));
        let lungs = stretches.filter(|s| s[0].1 >= LUNG_SHARE);
        let lungs = lungs.reduce(|a, b| if b.len() >= a.len() { b } else { a });
        let lowest_lung = lungs.map(|s| s[0].0);
        let is_pelvis = |s: &Slice| {
            let side = |sign: f64| {
                let far = |b: &&[f64; 2]| {
                    sign * (b[0] - middle) > 0.3 * half_width && b[1] > depth[0] + 0.3 * (depth[1] - depth[0])
                };
                s.bone.iter().filter(far).count() as f64 * area_mm2
            };
            side(1.0).min(side(-1.0)) >= PELVIS_MM2 * scale * scale
        };
        let below = |s: &&Slice| lowest_lung.is_none_or(|z| s.z < z);
        let pelvic: Vec<&Slice> = slices.iter().filter(below).filter(|s| is_pelvis(s)).collect();
        Some(Self {
            midline: if found { 0.5 * (ranked(&mut x, 0.5) + middle) } else { middle },
            half_width,
            depth,
            span: [first.z, last.z],
            spine: found.then(|| ranked(&mut y, 0.5)),
            diaphragm: lowest_lung,
            pelvis: pelvic.last().filter(|_| pelvic.len() >= 4).map(|s| s.z),
            table,
            chest: lung.iter().filter(is_chest).count() as f64 / lung.len() as f64,
            lung,
        })
    }

    /// True if the scan shows the chest and little below it: a colon's gas is cut off.
    pub fn is_chest(&self) -> bool {
        let below = self.diaphragm.map_or(f64::INFINITY, |z| z - self.span[0]);
        self.chest >= CHEST && below < ABDOMEN_MM * self.scale()
    }

    /// Returns the patient's size compared with an adult's.
    pub fn scale(&self) -> f64 {
        scale(self.half_width)
    }

    /// Returns how far to the patient's left a place (world, mm) is, as a share of half the body's width; negative to the right.
    pub fn aside(&self, p: DVec3) -> f64 {
        (p.x - self.midline) / self.half_width
    }

    /// Returns how far back a place (world, mm) is: 0 at the belly, 1 at the back.
    pub fn back(&self, p: DVec3) -> f64 {
        (p.y - self.depth[0]) / (self.depth[1] - self.depth[0]).max(1.0)
    }

    /// Returns how high a place (world, mm) is: 0 in the lowest slice of the body, 1 in the highest.
    pub fn height(&self, p: DVec3) -> f64 {
        (p.z - self.span[0]) / (self.span[1] - self.span[0]).max(1.0)
    }

    /// Returns the largest share of lung in a slice from `low` to `high` (z, mm).
    pub fn lung_between(&self, low: f64, high: f64) -> f64 {
        let within = self.lung.iter().filter(|l| (low..=high).contains(&l.0));
        within.map(|l| l.1).fold(0.0, f64::max)
    }
}

/// Returns the position that the table shows: most of what lies around the body lies on one side of it.
fn table(slices: &[Slice], middle: f64, half_width: f64, depth: [f64; 2], area_mm2: f64) -> Option<PatientPosition> {
    use PatientPosition::{Left, Prone, Right, Supine};
    let mut sides = [(0usize, Supine), (0, Prone), (0, Left), (0, Right)];
    for p in slices.iter().flat_map(|s| &s.loose) {
        let beyond = [p[1] - depth[1], depth[0] - p[1], p[0] - middle - half_width, middle - half_width - p[0]];
        // The corners of a table lie behind the body as well as beside it.
        let far = (0..4).fold(0, |best, n| if beyond[n] > beyond[best] { n } else { best });
        sides[far].0 += usize::from(beyond[far] > 0.0);
    }
    sides.sort_by_key(|s| std::cmp::Reverse(s.0));
    let ample = sides[0].0 as f64 * area_mm2 >= TABLE_MM2 * slices.len() as f64;
    (ample && sides[0].0 >= 2 * sides[1].0).then_some(sides[0].1)
}

/// Returns the value below which `share` of the values lie.
fn ranked(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get((share * (values.len().saturating_sub(1)) as f64).round() as usize).copied().unwrap_or(0.0)
}

fn scale(half_width: f64) -> f64 {
    (half_width / ADULT_HALF_WIDTH_MM).clamp(SCALE[0], SCALE[1])
}

fn cell(hu: i16) -> Cell {
    match hu {
        _ if hu > BONE_HU => Cell::Bone,
        _ if hu > TISSUE_HU => Cell::Tissue,
        _ if (LUNG_HU[0]..=LUNG_HU[1]).contains(&hu) => Cell::Lung,
        _ => Cell::Gas,
    }
}

/// True if tissue is found along an axis of a cell: the shell of a table is thinner than a cell, and one voxel of it may miss it.
fn is_shell(volume: &Volume, cell: [usize; 3], step: [usize; 3], axis: usize) -> bool {
    let mut at: [usize; 3] = std::array::from_fn(|a| cell[a] * step[a]);
    let end = (at[axis] + step[axis]).min(volume.grid().dims()[axis]);
    (at[axis]..end).any(|n| {
        at[axis] = n;
        volume.data()[volume.grid().index(at[0], at[1], at[2])] > TISSUE_HU
    })
}

/// Marks the cells of the largest piece of tissue and bone that touch face to face: not the table's.
fn largest(cells: &[Cell], [nx, ny, nz]: [usize; 3]) -> Vec<bool> {
    let is_body = |n: usize| matches!(cells[n], Cell::Tissue | Cell::Bone);
    let mut sets = Sets::new(cells.len());
    for n in (0..cells.len()).filter(|&n| is_body(n)) {
        let (i, j) = (n % nx, n / nx % ny);
        for (inside, m) in
            [(i > 0, n.wrapping_sub(1)), (j > 0, n.wrapping_sub(nx)), (n >= nx * ny, n.wrapping_sub(nx * ny))]
        {
            if inside && is_body(m) {
                sets.join(n as u32, m as u32);
            }
        }
    }
    debug_assert_eq!(cells.len(), nx * ny * nz);
    let (of, count) = sets.numbered();
    let mut sizes = vec![0u32; count];
    (0..cells.len()).filter(|&n| is_body(n)).for_each(|n| sizes[of[n] as usize] += 1);
    let most = (0..count).fold(0, |best, c| if sizes[c] > sizes[best] { c } else { best });
    (0..cells.len()).map(|n| is_body(n) && of[n] as usize == most).collect()
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::checks::cases;
    use crate::volume::Grid;

    /// The shell of a table of 2 mm, 1.5 mm voxels: it is found whatever the order and the directions of the index axes.
    #[test]
    fn a_thin_table_is_found_in_every_order_of_the_axes() {
        let size = [180.0, 135.0, 60.0];
        for shift in [0.0, 1.5, 3.0].into_iter().take(cases(3, 1)) {
            let hu = |p: DVec3| {
                let is_body = (p.x - 90.0).hypot(p.y - 60.0) < 55.0;
                let is_table = (122.0 + shift..124.0 + shift).contains(&p.y) && (15.0..165.0).contains(&p.x);
                if is_body || is_table { 40 } else { -1000 }
            };
            for order in [[0, 1, 2], [1, 0, 2], [2, 1, 0], [0, 2, 1], [1, 2, 0], [2, 0, 1]] {
                for flips in (0..8).step_by(cases(1, 3)) {
                    let axis = |n: usize| {
                        let mut axis = DVec3::ZERO;
                        axis[order[n]] = if flips >> n & 1 == 1 { -1.0 } else { 1.0 };
                        axis
                    };
                    let direction = DMat3::from_cols(axis(0), axis(1), axis(2));
                    let dims: [usize; 3] = std::array::from_fn(|n| (size[order[n]] / 1.5) as usize);
                    let mut origin = DVec3::ZERO;
                    for n in (0..3).filter(|n| flips >> n & 1 == 1) {
                        origin[order[n]] = 1.5 * (dims[n] - 1) as f64;
                    }
                    let grid = Grid::new(dims, DVec3::splat(1.5), origin, direction).unwrap();
                    let [nx, ny, _] = dims;
                    let place = |n: usize| {
                        grid.world(DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / (nx * ny)) as f64))
                    };
                    let data = (0..grid.len()).map(|n| hu(place(n))).collect();
                    let volume = Volume::new(grid.clone(), data);
                    let found = Landmarks::of(&volume, Frame::of(&grid)).unwrap();
                    assert_eq!(found.table, Some(PatientPosition::Supine), "{shift} mm, {order:?}, {flips:03b}");
                }
            }
        }
    }
}
