//! Small mathematics that several concepts share.

pub mod cubic;
pub mod hash;
pub mod lattice;
pub mod reflection;
