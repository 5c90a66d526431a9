//! Small mathematical helpers shared by several modules.

pub mod cubic;
pub mod hash;
pub mod lattice;
pub mod reflection;
