//! The lumen as cells: blocks of a few voxels, parted where a wall runs through them.

use std::ops::Range;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::fields::centerline::Shape;
use crate::fields::voxels::{VoxelSet, each_bit};
use crate::math::sets::Sets;
use crate::progress::Progress;
use crate::volume::Grid;

/// The greatest extent of a cell, mm, unless a voxel is larger: a fold is 2 to 3 mm thick.
pub const CELL_MM: f64 = 2.05;
/// The most voxels of a cell along an axis.
const MOST: usize = 4;

/// A connected piece of the lumen within a block of voxels.
#[derive(Clone, Copy, Debug)]
struct Cell {
    /// The block's voxels that belong to it, x fastest.
    mask: u64,
    /// The block.
    block: [u16; 3],
    /// Its centre, mm along the axes of the grid from voxel 0.
    centre: Vec3,
}

/// A neighbour of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// The other cell.
    pub to: u32,
    /// How well the two conduct: the area of the faces between them over the distance of their centres, mm.
    pub conductance: f32,
}

/// Neighbours of many cells, those of one after those of another.
#[derive(Clone, Debug, Default)]
pub(super) struct Links {
    /// The first neighbour of each, and their number.
    pub first: Vec<u32>,
    pub all: Vec<Link>,
}

impl Links {
    /// Returns the neighbours of a cell.
    #[inline]
    pub(super) fn of(&self, n: usize) -> &[Link] {
        &self.all[self.first[n] as usize..self.first[n + 1] as usize]
    }

    /// Collects those of `count` cells in blocks, in parallel. `of` appends the neighbours of one.
    pub(super) fn gather(count: usize, of: impl Fn(usize, &mut Vec<Link>) + Sync) -> Self {
        const BLOCK: usize = 4096;
        let blocks: Vec<(Vec<u32>, Vec<Link>)> = (0..count.div_ceil(BLOCK))
            .into_par_iter()
            .map(|block| {
                let own = block * BLOCK..((block + 1) * BLOCK).min(count);
                let (mut lengths, mut all) = (Vec::with_capacity(own.len()), Vec::with_capacity(6 * own.len()));
                for n in own {
                    let before = all.len();
                    of(n, &mut all);
                    lengths.push((all.len() - before) as u32);
                }
                (lengths, all)
            })
            .collect();
        let mut links = Self { first: Vec::with_capacity(count + 1), all: Vec::new() };
        links.all.reserve_exact(blocks.iter().map(|b| b.1.len()).sum());
        let mut sum = 0;
        links.first.push(0);
        for (lengths, all) in blocks {
            for n in lengths {
                sum += n;
                links.first.push(sum);
            }
            links.all.extend(all);
        }
        links
    }
}

/// The lumen as cells, with what connects them. A cell is a connected piece of the lumen within a block of at most 2 mm, and two cells
/// are neighbours if voxels of theirs share a face, so that neither a thin wall nor a thin fold is bridged.
#[derive(Clone, Debug)]
pub struct Domain {
    grid: Grid,
    shape: Shape,
    /// Blocks with a cell, and the first cell of each.
    blocks: VoxelSet,
    first: Vec<u32>,
    cells: Vec<Cell>,
    links: Links,
    /// The connected component of each.
    component: Vec<u32>,
    components: usize,
}

impl Domain {
    /// Divides a set of voxels of `grid` into cells of at most `cell_mm`, unless a voxel is larger.
    ///
    /// # Errors
    /// Returns status 4 if interrupted, status 3 if there are more cells than can be numbered.
    pub fn new(grid: &Grid, set: &VoxelSet, cell_mm: f64, progress: &Progress) -> Result<Self> {
        let side = grid.spacing().to_array().map(|mm| {
            let mut side = 1;
            while side < MOST && 2.0 * side as f64 * mm <= cell_mm {
                side *= 2;
            }
            side
        });
        let shape = Shape::with_sides(side);
        let dims: [usize; 3] = std::array::from_fn(|a| grid.dims()[a].div_ceil(side[a]));
        if dims.iter().any(|&n| n > usize::from(u16::MAX)) {
            return Err(Error::input("volume", "is too long to be unfolded", "crop or resample it"));
        }
        let spacing = grid.spacing();
        let layers: Vec<Vec<Cell>> = (0..dims[2])
            .into_par_iter()
            .map(|layer| {
                progress.check()?;
                Ok(cells_of(set, &shape, spacing, [dims[1], layer]))
            })
            .collect::<Result<_>>()?;
        let cells = layers.concat();
        let too_many = || Error::input("volume", "holds more lumen than can be numbered", "crop or resample it");
        u32::try_from(6 * cells.len()).map_err(|_| too_many())?;
        let runs = cells.iter().map(|c| {
            let [i, j, k] = c.block.map(usize::from);
            (j, k, i..i + 1)
        });
        let blocks = VoxelSet::from_runs(dims, runs).ok_or_else(too_many)?;
        let mut first = Vec::with_capacity(blocks.len() + 1);
        for (n, cell) in cells.iter().enumerate() {
            if n == 0 || cells[n - 1].block != cell.block {
                first.push(n as u32);
            }
        }
        first.push(cells.len() as u32);
        let mut domain = Self {
            grid: grid.clone(),
            shape,
            blocks,
            first,
            cells,
            links: Links::default(),
            component: Vec::new(),
            components: 0,
        };
        progress.check()?;
        domain.links = Links::gather(domain.cells.len(), |n, out| domain.link(n, out));
        progress.check()?;
        let mut sets = Sets::new(domain.cells.len());
        for n in 0..domain.cells.len() {
            for link in domain.links.of(n).iter().filter(|l| l.to > n as u32) {
                sets.join(n as u32, link.to);
            }
        }
        (domain.component, domain.components) = sets.numbered();
        Ok(domain)
    }

    /// Appends the neighbours of a cell.
    fn link(&self, n: usize, out: &mut Vec<Link>) {
        let (cell, spacing) = (self.cells[n], self.grid.spacing());
        for a in 0..3 {
            let area = (spacing[(a + 1) % 3] * spacing[(a + 2) % 3]) as f32;
            for is_next in [false, true] {
                let mut block = cell.block.map(i64::from);
                block[a] += if is_next { 1 } else { -1 };
                for m in self.in_block(block) {
                    let other = self.cells[m];
                    let (here, next) = if is_next { (cell, other) } else { (other, cell) };
                    let faces = self.shape.contact(a, here.mask, next.mask).count_ones();
                    if faces > 0 {
                        let distance = next.centre[a] - here.centre[a];
                        out.push(Link { to: m as u32, conductance: faces as f32 * area / distance });
                    }
                }
            }
        }
    }

    /// Returns the cells of a block.
    fn in_block(&self, block: [i64; 3]) -> Range<usize> {
        match self.blocks.number(block) {
            Some(n) => self.first[n] as usize..self.first[n + 1] as usize,
            None => 0..0,
        }
    }

    /// Returns the number of cells.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// True if there is no cell.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// Returns the cell that a voxel belongs to.
    pub fn cell(&self, voxel: [i64; 3]) -> Option<u32> {
        let side = self.shape.side.map(|s| s as i64);
        let block: [i64; 3] = std::array::from_fn(|a| voxel[a].div_euclid(side[a]));
        let [x, y, z] = std::array::from_fn(|a| voxel[a].rem_euclid(side[a]));
        let bit = x + side[0] * (y + side[1] * z);
        self.in_block(block).find(|&n| self.cells[n].mask >> bit & 1 == 1).map(|n| n as u32)
    }

    /// Returns the cell of the voxel nearest to a place (world, mm), if one is within `within_mm`, and the centre of that voxel, in the coordinates of [`Domain::local`].
    pub fn nearest(&self, world: DVec3, within_mm: f64) -> Option<(u32, DVec3)> {
        if !world.is_finite() {
            return None;
        }
        let (at, spacing) = (self.grid.voxel(world), self.grid.spacing());
        let middle = at.round().to_array().map(|x| x as i64);
        let of = |v: [i64; 3]| DVec3::from_array(v.map(|x| x as f64)) * spacing;
        if let Some(n) = self.cell(middle) {
            return Some((n, of(middle)));
        }
        let reach = spacing.to_array().map(|mm| (within_mm / mm).ceil() as i64);
        let mut best: Option<(f64, u32, DVec3)> = None;
        for (dz, dy, dx) in (-reach[2]..=reach[2])
            .flat_map(|z| (-reach[1]..=reach[1]).map(move |y| (z, y)))
            .flat_map(|(z, y)| (-reach[0]..=reach[0]).map(move |x| (z, y, x)))
        {
            let voxel = [middle[0].saturating_add(dx), middle[1].saturating_add(dy), middle[2].saturating_add(dz)];
            let square = (of(voxel) - at * spacing).length_squared();
            if square <= within_mm * within_mm && best.is_none_or(|b| square < b.0) {
                best = self.cell(voxel).map(|n| (square, n, of(voxel))).or(best);
            }
        }
        best.map(|b| (b.1, b.2))
    }

    /// Returns a place (world, mm) in mm along the axes of the grid, from voxel 0.
    pub fn local(&self, world: DVec3) -> DVec3 {
        self.grid.voxel(world) * self.grid.spacing()
    }

    /// Returns a place in the coordinates of [`Domain::local`] in the world, mm.
    pub fn world(&self, local: DVec3) -> DVec3 {
        self.grid.world(local / self.grid.spacing())
    }

    /// Returns the grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Returns the centre of a cell, in the coordinates of [`Domain::local`].
    #[inline]
    pub fn centre(&self, cell: u32) -> DVec3 {
        self.cells[cell as usize].centre.as_dvec3()
    }

    /// Returns the extent of a block, mm.
    pub fn cell_mm(&self) -> DVec3 {
        self.grid.spacing() * DVec3::from_array(self.shape.side.map(|s| s as f64))
    }

    /// Returns the volume of a cell, mm³.
    pub fn volume_mm3(&self, cell: u32) -> f64 {
        f64::from(self.cells[cell as usize].mask.count_ones()) * self.grid.voxel_ml() * 1000.0
    }

    /// Returns the neighbours of a cell.
    pub fn neighbours(&self, cell: u32) -> &[Link] {
        self.links.of(cell as usize)
    }

    /// Returns the connected component that a cell belongs to.
    pub fn component(&self, cell: u32) -> u32 {
        self.component[cell as usize]
    }

    /// Returns the number of connected components.
    pub fn components(&self) -> usize {
        self.components
    }

    /// Returns the block of each cell.
    pub(super) fn block(&self, cell: usize) -> [u16; 3] {
        self.cells[cell].block
    }

    /// Returns the links of all cells.
    pub(super) fn links(&self) -> &Links {
        &self.links
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        self.cells.len() * (size_of::<Cell>() + 2 * size_of::<u32>())
            + self.links.all.len() * size_of::<Link>()
            + self.blocks.bytes()
    }
}

/// Returns the cells of a layer of blocks, in the order of their blocks, x fastest.
fn cells_of(set: &VoxelSet, shape: &Shape, spacing: DVec3, [rows, layer]: [usize; 2]) -> Vec<Cell> {
    let [sx, sy, sz] = shape.side;
    let [_, ny, nz] = set.dims();
    let part = (1u64 << sx) - 1;
    let mut out = Vec::new();
    for row in 0..rows {
        let lines: Vec<(usize, &[u64])> = (0..sz)
            .flat_map(|z| (0..sy).map(move |y| (y, z)))
            .filter(|&(y, z)| row * sy + y < ny && layer * sz + z < nz)
            .map(|(y, z)| (sx * (y + sy * z), set.row(row * sy + y, layer * sz + z)))
            .collect();
        let words = lines.first().map_or(0, |l| l.1.len());
        for w in 0..words {
            // A block does not reach across words: its side is a power of two.
            let mut any = lines.iter().fold(0, |any, l| any | l.1[w]);
            while any != 0 {
                let x = any.trailing_zeros() as usize / sx * sx;
                any &= !(part << x);
                let mut rest = lines.iter().fold(0, |mask, l| mask | (l.1[w] >> x & part) << l.0);
                while rest != 0 {
                    let mask = shape.piece(rest, rest & rest.wrapping_neg());
                    rest &= !mask;
                    let block = [(64 * w + x) / sx, row, layer];
                    let mut sum = DVec3::ZERO;
                    each_bit(mask, |bit| sum += DVec3::from_array(shape.offset(bit).map(|o| o as f64)));
                    let corner = DVec3::from_array([64 * w + x, row * sy, layer * sz].map(|c| c as f64));
                    let centre = (corner + sum / f64::from(mask.count_ones())) * spacing;
                    out.push(Cell { mask, block: block.map(|b| b as u16), centre: centre.as_vec3() });
                }
            }
        }
    }
    out
}
