//! The drawings shipped with the program, each with a known trap.
//!
//! `assets/plane/README.md` describes how they are made and what to expect of each.

use super::drawing::Drawing;
pub use super::files::{DRAWINGS, names};
use crate::error::Result;

/// Returns the drawing of that name, if it exists.
pub fn named(name: &str) -> Option<Result<Drawing>> {
    DRAWINGS.iter().find(|d| d.0 == name).map(|(name, png)| Drawing::decode(name, png))
}
