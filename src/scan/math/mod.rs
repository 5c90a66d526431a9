//! Small mathematical helpers shared by several modules.

#[doc(hidden)]
pub mod cubic;
pub mod hash;
#[doc(hidden)]
pub mod lattice;
#[doc(hidden)]
pub mod normal;
#[doc(hidden)]
pub mod ranked;
#[doc(hidden)]
pub mod reflection;
#[doc(hidden)]
pub mod sets;
#[doc(hidden)]
pub mod smooth;
#[doc(hidden)]
pub mod sphere;
