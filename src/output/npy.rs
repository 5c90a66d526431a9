//! NumPy's array files, format 1.0.

use std::io::{self, Write};
use std::path::Path;

use super::write_whole;
use crate::error::Result;

/// Writes what comes before the values of an array of float32 in C order.
///
/// # Errors
/// What the writer says.
pub fn write_npy_head(w: &mut dyn Write, shape: &[usize]) -> io::Result<()> {
    let shape: Vec<String> = shape.iter().map(usize::to_string).collect();
    let mut head = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}", shape.join(", "));
    // The format asks for a header that ends on a multiple of 64 bytes with a line break.
    while (10 + head.len() + 1) % 64 != 0 {
        head.push(' ');
    }
    head.push('\n');
    w.write_all(b"\x93NUMPY\x01\x00")?;
    w.write_all(&(head.len() as u16).to_le_bytes())?;
    w.write_all(head.as_bytes())
}

/// Writes values of an array of float32.
///
/// # Errors
/// What the writer says.
pub fn write_npy_values(w: &mut dyn Write, values: &[f32]) -> io::Result<()> {
    values.iter().try_for_each(|v| w.write_all(&v.to_le_bytes()))
}

/// Writes an array of float32 of two or more dimensions, in C order, whole or not at all.
///
/// # Errors
/// Status 5 when it cannot be written.
pub fn write_npy(path: &Path, values: &[f32], shape: &[usize]) -> Result<()> {
    write_whole(path, |w| {
        write_npy_head(w, shape)?;
        write_npy_values(w, values)
    })
}
