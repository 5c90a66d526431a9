//! The paper's volume of eight bits a voxel (section 2.2): seven bits for the value, and one that marks homogeneous surroundings.
//!
//! The 128 codes cover the values that matter: `lo` of the wall's ramp is code 32 and `hi` is code 74, so a code stands for (hi −
//! lo)/42 HU, 7.1 HU by default, from −1028 to −122 HU. Values outside this range get the nearest code. Within it, the error of a
//! value is at most half a code. No empty voxel gets a code that is not empty.
//!
//! The flag is stored in the voxel's own byte, as in the paper, and not in the [`flags`](crate::space::flags) of the 16-bit
//! volume. One read returns value and flag, which is what this preset is meant to measure.

pub(crate) mod sampler;
pub(crate) mod skip;

use rayon::prelude::*;

use crate::volume::{AIR_HU, Grid};

use super::TransferFunction;
use super::accelerations::Accelerations;
use super::begin::Begin;
use super::caster::ImageRequest;
use super::choices::{GradientSource, Leaping};
use super::gather::Voxels;
use super::leap::chosen::ChosenRadius;
use super::memory::MemoryPart;
use super::quality::{Quality, Settings};
use super::reuse::VoxelStorage;
use super::{Frame, View, Work};
use crate::space::PreparedVolume;

pub use sampler::{ByteNearest, ByteTrilinear};
#[doc(hidden)]
pub use skip::{ByteLeap, ByteSurroundings};

/// The greatest empty code: that of the ramp's `lo`.
pub(crate) const EMPTY: u8 = 32;
/// The least opaque code: that of the ramp's `hi`.
pub(crate) const OPAQUE: u8 = 74;
/// The bit that marks a voxel's surroundings as homogeneous.
const FLAG: u8 = 0x80;
/// The bits of the value.
const CODE: u8 = 0x7F;
/// Slices of a task.
const SLAB: usize = 16;

/// A volume of 7 + 1 bits a voxel: half of the 16-bit volume.
pub struct ByteVolume {
    grid: Grid,
    wall: TransferFunction,
    /// The flag is set if all voxels up to this many voxels away are of one class, empty or opaque.
    reach: usize,
    data: Vec<u8>,
    air: u8,
}

/// Returns the HU of one code step.
fn unit(wall: TransferFunction) -> f32 {
    (wall.hi() - wall.lo()) / f32::from(OPAQUE - EMPTY)
}

/// Returns the code of a value.
#[inline(always)]
fn code(hu: i16, wall: TransferFunction, per_hu: f32) -> u8 {
    // A cast to an integer saturates.
    (((f32::from(hu) - wall.lo()) * per_hu + (f32::from(EMPTY) + 0.5)) as u8).min(CODE)
}

/// Returns 1 for an empty code, 2 for an opaque one, 0 in between. Codes are of one class if the bitwise and of their
/// classes is not 0.
#[inline(always)]
fn class(code: u8) -> u8 {
    u8::from(code <= EMPTY) | u8::from(code >= OPAQUE) << 1
}

impl ByteVolume {
    /// Computes the codes and flags of `volume`, in parallel.
    ///
    /// Flags cover voxels up to `reach` away. How many must be homogeneous for a sample to be skipped depends on what
    /// the sample is made of: 1 for values, 2 for regressions.
    pub fn new(volume: &PreparedVolume, reach: usize) -> Self {
        let (volume, wall) = (volume.voxels(), volume.transfer());
        let per_hu = 1.0 / unit(wall);
        let data = volume.data().par_iter().with_min_len(1 << 16).map(|&v| code(v, wall, per_hu)).collect();
        let air = code(AIR_HU, wall, per_hu);
        let mut bytes = Self { grid: volume.grid().clone(), wall, reach, data, air };
        bytes.flag();
        bytes
    }

    /// Sets the flags.
    fn flag(&mut self) {
        let [nx, ny, nz] = self.grid.dims();
        let (plane, reach, air) = (nx * ny, self.reach, class(self.air));
        // Slab by slab, so that the classes of a whole volume are never in memory.
        let depth = SLAB * rayon::current_num_threads().max(1);
        for first in (0..nz).step_by(depth) {
            let count = depth.min(nz - first);
            let low = first.saturating_sub(reach);
            let high = (first + count + reach).min(nz);
            let mut planes = vec![0u8; (high - low) * plane];
            planes.par_chunks_mut(plane).enumerate().for_each_init(
                || vec![0u8; plane],
                |rows, (n, out)| {
                    let slice = &self.data[(low + n) * plane..(low + n + 1) * plane];
                    and_within_slice(slice, nx, reach, air, rows, out);
                },
            );
            self.data[first * plane..(first + count) * plane].par_chunks_mut(plane).enumerate().for_each(
                |(n, slice)| {
                    let k = first + n;
                    let outside = k < reach || k + reach >= nz;
                    let mut all = vec![if outside { air } else { 3 }; plane];
                    for z in k.saturating_sub(reach)..(k + reach + 1).min(nz) {
                        all.iter_mut().zip(&planes[(z - low) * plane..]).for_each(|(a, b)| *a &= b);
                    }
                    slice.iter_mut().zip(&all).for_each(|(v, &a)| *v |= if a != 0 { FLAG } else { 0 });
                },
            );
        }
    }

    /// Returns the bytes, with air outside.
    #[inline(always)]
    fn voxels(&self) -> Voxels<'_, u8> {
        Voxels { grid: &self.grid, data: &self.data, outside: self.air }
    }

    /// Returns the byte of a voxel counted from voxel −1; air outside.
    #[inline(always)]
    fn get(&self, v: [i32; 3]) -> u8 {
        self.voxels().get(v)
    }

    /// Returns the memory taken, bytes.
    pub fn bytes(&self) -> usize {
        self.data.len()
    }
}

/// Ands the classes of each voxel's neighbours up to `reach` away within its slice.
///
/// `air` is the class outside. The flags of the slice may already be set.
fn and_within_slice(slice: &[u8], nx: usize, reach: usize, air: u8, rows: &mut [u8], out: &mut [u8]) {
    let ny = slice.len() / nx;
    let mut classes = vec![air; nx + 2 * reach];
    for (row, and) in slice.chunks_exact(nx).zip(rows.chunks_exact_mut(nx)) {
        classes[reach..reach + nx].iter_mut().zip(row).for_each(|(c, &v)| *c = class(v & CODE));
        and.copy_from_slice(&classes[..nx]);
        for by in 1..=2 * reach {
            and.iter_mut().zip(&classes[by..]).for_each(|(a, c)| *a &= c);
        }
    }
    for (j, out) in out.chunks_exact_mut(nx).enumerate() {
        out.fill(if j < reach || j + reach >= ny { air } else { 3 });
        for row in rows.chunks_exact(nx).take((j + reach + 1).min(ny)).skip(j.saturating_sub(reach)) {
            out.iter_mut().zip(row).for_each(|(o, r)| *o &= r);
        }
    }
}

/// Renders pictures from the volume of 7 + 1 bits. The 16-bit voxels are used only for a picture's depth.
#[doc(hidden)]
pub struct ByteStorage {
    volume: PreparedVolume,
    bytes: ByteVolume,
    accelerations: Accelerations,
}

impl ByteStorage {
    /// Renders from `bytes`, which must be made from `volume`, with the given leaping and gradients.
    ///
    /// Some leaping methods need distances. These are computed from the 16-bit voxels: whatever is empty there is also empty here.
    #[doc(hidden)]
    pub fn new(volume: &PreparedVolume, bytes: ByteVolume, leap: Leaping, gradients: GradientSource) -> Self {
        let accelerations = Accelerations::new(volume, &ByteTrilinear::new(volume, &bytes), leap, gradients);
        Self { volume: volume.clone(), bytes, accelerations }
    }
}

impl VoxelStorage for ByteStorage {
    type Radius<'a> = ChosenRadius<'a, ByteSurroundings<'a>>;

    fn volume(&self) -> &PreparedVolume {
        &self.volume
    }

    fn empty_radius(&self) -> Self::Radius<'_> {
        self.accelerations.leaper.radius(&self.volume, Some(ByteSurroundings { bytes: &self.bytes }))
    }

    fn image<B: Begin>(
        &self,
        view: &View,
        settings: &Settings,
        begin: &B,
        kept: &mut [B::Kept],
        frame: &mut Frame,
    ) -> Work {
        let request = ImageRequest { volume: &self.volume, view, settings };
        let flags = (ByteLeap::new(&self.bytes), ByteLeap::new(&self.bytes));
        if settings.quality == Quality::Low {
            let low = ByteNearest::new(&self.volume, &self.bytes);
            self.accelerations.image(&request, low, flags, begin, kept, frame)
        } else {
            let high = ByteTrilinear::new(&self.volume, &self.bytes);
            self.accelerations.image(&request, high, flags, begin, kept, frame)
        }
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        let own = [(MemoryPart::Flags, self.volume.bytes()), (MemoryPart::ByteVolume, self.bytes.bytes())];
        own.into_iter().chain(self.accelerations.parts()).collect()
    }
}

#[cfg(test)]
mod tests;
