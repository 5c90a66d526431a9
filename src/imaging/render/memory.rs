//! The purposes of a renderer's memory.

/// A part of the memory that a renderer keeps beside the 16-bit voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
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
            Self::StoredGradients => "precomputed gradients",
            Self::VoxelDistances => "wall distance per voxel",
            Self::BrickDistances => "wall distance per brick",
            Self::FrameCache => "frame cache",
            Self::SampledRays => "rays of adaptive image-plane sampling",
            Self::SmallPicture => "image at a third of the size",
            Self::RefinementRays => "refinement: rays",
            Self::RefinementPictures => "refinement: images",
            Self::Mesh => "mesh",
            Self::Other(name) => name,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::MemoryPart::*;

    #[test]
    fn each_part_has_its_own_name() {
        let parts = [
            Flags,
            ByteVolume,
            Occupancy,
            GradientCache,
            StoredGradients,
            VoxelDistances,
            BrickDistances,
            FrameCache,
            SampledRays,
            SmallPicture,
            RefinementRays,
            RefinementPictures,
            Mesh,
            Other("own"),
        ];
        let names: std::collections::BTreeSet<_> = parts.iter().map(|p| p.name()).collect();
        assert_eq!(names.len(), parts.len());
        assert!(VoxelDistances.name().contains("voxel") && BrickDistances.name().contains("brick"));
        assert_eq!(Other("own").name(), "own");
    }
}
