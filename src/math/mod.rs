//! Small mathematics that several concepts share.

pub mod hash;
