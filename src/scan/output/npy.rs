//! NumPy array files, format 1.0.

use std::io::{self, Write};
use std::path::Path;

use super::write_whole;
use crate::error::Result;

/// Values that are written at once.
const VALUES: usize = 1 << 14;

/// Writes the header of a float32 array in C order.
///
/// # Errors
/// Returns the writer's error.
pub fn write_npy_head(w: &mut dyn Write, shape: &[usize]) -> io::Result<()> {
    let shape: Vec<String> = shape.iter().map(usize::to_string).collect();
    let mut head = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}", shape.join(", "));
    // The header must end at a multiple of 64 bytes with a line break.
    while (10 + head.len() + 1) % 64 != 0 {
        head.push(' ');
    }
    head.push('\n');
    w.write_all(b"\x93NUMPY\x01\x00")?;
    w.write_all(&(head.len() as u16).to_le_bytes())?;
    w.write_all(head.as_bytes())
}

/// Writes the values of a float32 array.
///
/// # Errors
/// Returns the writer's error.
pub fn write_npy_values(w: &mut dyn Write, values: &[f32]) -> io::Result<()> {
    // Many at once: a call for each takes longer than the disk.
    let mut bytes = Vec::with_capacity(size_of::<f32>() * VALUES.min(values.len()));
    values.chunks(VALUES).try_for_each(|values| {
        bytes.clear();
        bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        w.write_all(&bytes)
    })
}

/// Writes a float32 array of two or more dimensions, in C order, atomically.
///
/// # Errors
/// Returns status 5 if the file cannot be written.
pub fn write_npy(path: &Path, values: &[f32], shape: &[usize]) -> Result<()> {
    write_whole(path, |w| {
        write_npy_head(w, shape)?;
        write_npy_values(w, values)
    })
}
