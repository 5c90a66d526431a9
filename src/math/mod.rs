//! Small mathematical helpers shared by several modules.

pub(crate) mod cubic;
pub mod hash;
pub(crate) mod lattice;
pub(crate) mod normal;
pub(crate) mod reflection;
pub(crate) mod sphere;
