//! The purposes of a renderer's memory.

/// A part of the memory that a renderer keeps beside the 16-bit voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MemoryPart {
    /// The homogeneous-region flags and bricks of the prepared volume (`flags`).
    Flags,
    /// The paper's volume of 7 + 1 bits a voxel.
    ByteVolume,
    /// Which cells may be visible, and how far bricks are from the next such cell.
    Occupancy,
    /// Gradients cached from one frame to the next.
    GradientCache,
    /// Gradients computed ahead of time.
    StoredGradients,
    /// The distance to the wall for each voxel.
    VoxelDistances,
    /// The distance to the wall for each brick.
    BrickDistances,
    /// The space that the last picture proved empty.
    FrameCache,
    /// The rays of adaptive image-plane sampling.
    SampledRays,
    /// A picture at a fraction of the resolution, to be stretched.
    SmallPicture,
    /// Rays of a picture that is refined at rest.
    RefinementRays,
    /// Pictures that are refined at rest.
    RefinementPictures,
    /// The triangles of the wall.
    Mesh,
    /// Anything else, named by a custom renderer.
    Other(&'static str),
}

impl MemoryPart {
    /// Returns the readable name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Flags => "homogeneous-region flags",
            Self::ByteVolume => "volume (7 + 1 bit)",
            Self::Occupancy => "cells that may be seen, and distances of bricks",
            Self::GradientCache => "gradient cache",
            Self::StoredGradients => "gradients ahead of time",
            Self::VoxelDistances => "wall distance per voxel",
            Self::BrickDistances => "wall distance per brick",
            Self::FrameCache => "frame cache",
            Self::SampledRays => "rays of adaptive image-plane sampling",
            Self::SmallPicture => "picture of a third of the size",
            Self::RefinementRays => "refinement: rays",
            Self::RefinementPictures => "refinement: pictures",
            Self::Mesh => "mesh",
            Self::Other(name) => name,
        }
    }
}
