//! Checks shared by several settings.

use crate::error::{Error, Result};

/// Checks that the setting `name` is positive. Fails with status 2 (invalid arguments) if the value is not a finite number above 0.
pub(crate) fn positive(name: &str, value: f64) -> Result<()> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { refuse(name, value, "above 0") }
}

/// Checks that the setting `name` is not negative. Fails with status 2 (invalid arguments) if the value is not a finite number of
/// at least 0.
pub(crate) fn not_negative(name: &str, value: f64) -> Result<()> {
    if value.is_finite() && value >= 0.0 { Ok(()) } else { refuse(name, value, "of at least 0") }
}

fn refuse(name: &str, value: f64, wanted: &str) -> Result<()> {
    Err(Error::usage(name, format!("is {value}"), format!("give a finite number {wanted}")))
}
