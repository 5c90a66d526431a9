//! The indirect method (the paper's section 2): the wall as a triangle mesh, and pictures of the mesh.
//!
//! Marching cubes (Lorensen and Cline 1987) run over the same trilinear volume that the rays see, with air outside, so
//! the mesh is closed. The table of cases is derived, not typed in (`cases`). Faces with two possible interpretations
//! are decided by the value at the face's saddle (Nielson and Hamann 1991). Both cells that share the face compute the
//! same value, so the mesh has no cracks. [`Rasteriser`] draws it with a z-buffer and the ray caster's light.
//!
//! [`LumenMesh`] is the surface of the colon alone, for other programs: the same cubes over the voxels of its lumen only.

mod cases;
mod clip;
mod extract;
#[cfg(test)]
mod extract_tests;
mod islands;
mod lumen;
mod measure;
mod mesh;
mod raster;
#[cfg(test)]
mod raster_tests;
mod relax;
mod signs;
mod slider;
mod tile;
mod write;

pub use lumen::LumenMesh;
pub use measure::Measures;
pub use mesh::{Block, Mesh};
pub use raster::Rasteriser;
pub use write::MeshFormat;
#[doc(hidden)]
pub use write::{is_far, write_ply};
