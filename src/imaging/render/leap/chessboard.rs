//! The chessboard distance transform: for each cell of a grid, the number of king's moves to the nearest marked cell.
//! Exact up to 255, in place and in linear time.
//!
//! It works slice by slice. A move between slices may be along any diagonal, so a cell's distance is 1 more than the
//! least of the 3×3 cells beside it in the slice before. Sweeps upwards and downwards give the distance to all marked
//! cells that are farther away along the axis than within the slice. The same method by rows, and then by cells, does
//! the rest (Rosenfeld and Pfaltz 1968, separated so that the cells of a slice and the slices are each independent).

use rayon::prelude::*;

/// Initial value of an unmarked cell.
pub(crate) const FAR: u8 = u8::MAX;

/// The surroundings of the grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outside {
    /// Marked cells.
    Marked,
    /// Nothing.
    Unmarked,
}

/// Replaces each cell by its chessboard distance to the nearest cell that is 0, or to the `outside` if that is marked.
///
/// Cells must be 0 or [`FAR`], x fastest.
pub(crate) fn chessboard(cells: &mut [u8], dims: [usize; 3], outside: Outside) {
    let [nx, ny, nz] = dims;
    let plane = nx * ny;
    if outside == Outside::Marked {
        for slice in [0, nz - 1] {
            cells[slice * plane..(slice + 1) * plane].iter_mut().for_each(|c| *c = (*c).min(1));
        }
    }
    for k in 1..nz {
        let (before, after) = cells.split_at_mut(k * plane);
        lower_slice(&mut after[..plane], &before[(k - 1) * plane..], nx);
    }
    for k in (1..nz).rev() {
        let (before, after) = cells.split_at_mut(k * plane);
        lower_slice(&mut before[(k - 1) * plane..], &after[..plane], nx);
    }
    cells.par_chunks_mut(plane).for_each(|slice| {
        if outside == Outside::Marked {
            slice[..nx].iter_mut().for_each(|c| *c = (*c).min(1));
            slice[plane - nx..].iter_mut().for_each(|c| *c = (*c).min(1));
        }
        for j in 1..ny {
            let (before, after) = slice.split_at_mut(j * nx);
            lower_row(&mut after[..nx], &before[(j - 1) * nx..]);
        }
        for j in (1..ny).rev() {
            let (before, after) = slice.split_at_mut(j * nx);
            lower_row(&mut before[(j - 1) * nx..], &after[..nx]);
        }
        for row in slice.chunks_exact_mut(nx) {
            let beside = if outside == Outside::Marked { 0 } else { FAR };
            let along = |last: &mut u8, c: &mut u8| {
                *c = (*c).min(last.saturating_add(1));
                *last = *c;
            };
            row.iter_mut().fold(beside, |mut last, c| {
                along(&mut last, c);
                last
            });
            row.iter_mut().rev().fold(beside, |mut last, c| {
                along(&mut last, c);
                last
            });
        }
    });
}

/// Lowers the cells of a slice to one more than the least of the 3×3 cells beside them in the slice `from`.
fn lower_slice(slice: &mut [u8], from: &[u8], nx: usize) {
    let ny = slice.len() / nx;
    // A few rows a task: a single row is too little work.
    slice.par_chunks_mut(nx * 64).enumerate().for_each_init(
        || vec![0; nx],
        |least, (n, rows)| {
            for (m, row) in rows.chunks_exact_mut(nx).enumerate() {
                let j = n * 64 + m;
                let at = |j: usize| &from[j * nx..(j + 1) * nx];
                least.copy_from_slice(at(j));
                for other in [j.wrapping_sub(1), j + 1].into_iter().filter(|&o| o < ny) {
                    least.iter_mut().zip(at(other)).for_each(|(l, o)| *l = (*l).min(*o));
                }
                lower_row(row, least);
            }
        },
    );
}

/// Lowers the cells of a row to one more than the least of the three cells beside them in the row `from`.
#[inline]
fn lower_row(row: &mut [u8], from: &[u8]) {
    let n = row.len();
    let from = &from[..n];
    for (c, f) in row.iter_mut().zip(from) {
        *c = (*c).min(f.saturating_add(1));
    }
    for (c, f) in row[1..].iter_mut().zip(from) {
        *c = (*c).min(f.saturating_add(1));
    }
    for (c, f) in row.iter_mut().zip(&from[1..]) {
        *c = (*c).min(f.saturating_add(1));
    }
}
