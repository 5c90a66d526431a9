//! Leaping by the method that a scene selects.

use glam::Vec3;

use crate::render::choices::Leaping;
use crate::render::march::Ray;
use crate::render::memory::MemoryPart;
use crate::render::skip::Skipper;
use crate::space::PreparedVolume;

use super::{BrickLeap, BrickWalls, EmptyRadius, Surroundings, VoxelLeap, VoxelWalls};

/// The data that leaping needs besides the flags.
pub enum Leaper {
    /// [`Leaping::None`].
    Nothing,
    /// [`Leaping::Flag`].
    Flag,
    /// [`Leaping::Brick`].
    Bricks(BrickWalls),
    /// [`Leaping::Voxel`].
    Voxels(VoxelWalls),
}

impl Leaper {
    /// Computes the data that `leaping` needs for `volume`.
    pub fn new(leaping: Leaping, volume: &PreparedVolume) -> Self {
        match leaping {
            Leaping::None => Self::Nothing,
            Leaping::Flag => Self::Flag,
            Leaping::Brick => Self::Bricks(BrickWalls::new(volume)),
            Leaping::Voxel => Self::Voxels(VoxelWalls::new(volume)),
        }
    }

    /// Returns its memory, bytes; `None` if it takes none.
    pub fn part(&self) -> Option<(MemoryPart, usize)> {
        match self {
            Self::Nothing | Self::Flag => None,
            Self::Bricks(walls) => Some((MemoryPart::BrickDistances, walls.bytes())),
            Self::Voxels(walls) => Some((MemoryPart::VoxelDistances, walls.bytes())),
        }
    }

    /// Returns the skipper for rays whose samples depend on voxels nearer than `REACH`. `flag` leaps by the storage's own flags.
    pub fn skipper<'a, F: Skipper, const REACH: u8>(
        &'a self,
        volume: &'a PreparedVolume,
        flag: F,
    ) -> ChosenLeap<'a, F, REACH> {
        match self {
            Self::Nothing => ChosenLeap::Nothing,
            Self::Flag => ChosenLeap::Flag(flag),
            // The bits cover 3×3×3 voxels, too few for regressions. Without bits, sampling is quicker than looking.
            Self::Bricks(walls) if REACH == 1 && volume.flags().has_bits() => {
                ChosenLeap::BricksAndBits(BrickLeap::new(volume, walls))
            }
            Self::Bricks(walls) => ChosenLeap::Bricks(BrickLeap::new(volume, walls)),
            Self::Voxels(walls) => ChosenLeap::Voxels(VoxelLeap::new(walls)),
        }
    }
}

/// Leaps by one of several skippers. See [`VoxelLeap`] for `REACH`.
pub enum ChosenLeap<'a, F, const REACH: u8> {
    /// Takes every sample.
    Nothing,
    /// Leaps by flags.
    Flag(F),
    /// Leaps by the distances of bricks.
    Bricks(BrickLeap<'a, false>),
    /// Leaps by the distances of bricks and by a bit for each voxel.
    BricksAndBits(BrickLeap<'a, true>),
    /// Leaps by the distances of voxels.
    Voxels(VoxelLeap<'a, REACH>),
}

/// The walk of a [`ChosenLeap`]'s skipper.
pub enum ChosenWalk<W> {
    /// None.
    Nothing,
    /// By flags.
    Flag(W),
    /// By bricks.
    Bricks(u32),
    /// By voxels.
    Voxels(f32),
}

impl<F: Skipper, const REACH: u8> Skipper for ChosenLeap<'_, F, REACH> {
    type Walk = ChosenWalk<F::Walk>;

    #[inline(always)]
    fn start(&self, ray: &Ray, n: u32) -> Self::Walk {
        match self {
            Self::Nothing => ChosenWalk::Nothing,
            Self::Flag(flag) => ChosenWalk::Flag(flag.start(ray, n)),
            Self::Bricks(bricks) => ChosenWalk::Bricks(bricks.start(ray, n)),
            Self::BricksAndBits(bricks) => ChosenWalk::Bricks(bricks.start(ray, n)),
            Self::Voxels(voxels) => ChosenWalk::Voxels(voxels.start(ray, n)),
        }
    }

    #[inline(always)]
    fn next(&self, walk: &mut Self::Walk, ray: &Ray, n: u32) -> u32 {
        match (self, walk) {
            (Self::Flag(flag), ChosenWalk::Flag(walk)) => flag.next(walk, ray, n),
            (Self::Bricks(bricks), ChosenWalk::Bricks(walk)) => bricks.next(walk, ray, n),
            (Self::BricksAndBits(bricks), ChosenWalk::Bricks(walk)) => bricks.next(walk, ray, n),
            (Self::Voxels(voxels), ChosenWalk::Voxels(walk)) => voxels.next(walk, ray, n),
            // Taking a sample is never wrong.
            _ => n,
        }
    }
}

/// Clearance known from a [`Leaper`]'s data, or otherwise from the storage's own flags.
pub enum ChosenRadius<'a, R> {
    /// Nothing is known.
    Nothing,
    /// The flags of the storage.
    Flags(R),
    /// The distances of bricks, and flags.
    Bricks(Surroundings<'a>, Option<R>),
    /// The distances of voxels.
    Voxels(&'a VoxelWalls),
}

impl Leaper {
    /// Returns the clearance that this method knows in `volume`, or otherwise that of `flags`.
    pub fn radius<'a, R>(&'a self, volume: &'a PreparedVolume, flags: Option<R>) -> ChosenRadius<'a, R> {
        match self {
            Self::Voxels(walls) => ChosenRadius::Voxels(walls),
            Self::Bricks(bricks) => ChosenRadius::Bricks(Surroundings { volume, bricks }, flags),
            Self::Nothing | Self::Flag => flags.map_or(ChosenRadius::Nothing, ChosenRadius::Flags),
        }
    }
}

impl<R: EmptyRadius> EmptyRadius for ChosenRadius<'_, R> {
    #[inline(always)]
    fn around(&self, q: Vec3) -> f32 {
        match self {
            Self::Nothing => 0.0,
            Self::Flags(flags) => flags.around(q),
            Self::Bricks(bricks, flags) => match (bricks.around(q), flags) {
                // Beside a wall the storage's own flags may know more.
                (little, Some(flags)) if little < 2.0 => little.max(flags.around(q)),
                (free, _) => free,
            },
            Self::Voxels(voxels) => voxels.around(q),
        }
    }
}
