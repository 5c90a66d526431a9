//! From slices to a regular stack: sorting, duplicates, gaps, tilted gantry.

use std::path::Path;

use glam::{DMat3, DVec3};

use super::slice::Slice;
use super::{copies, even};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::Grid;
use crate::volume::io::frame;

/// Maximum sideways offset of slices from the line through the first and the last, mm.
const SIDEWAYS: f64 = 0.5;
/// Maximum deviation of a slice from its position in a regular stack: a fraction of the spacing, and the effect of
/// rounding written positions to a tenth of a millimetre.
const UNEVEN: (f64, f64) = (0.1, 0.06);

/// Missing slices between two that exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Gap {
    /// Index of the last slice before the gap, among the existing ones, from 0.
    pub after: usize,
    /// Number of missing slices.
    pub missing: usize,
}

/// Sorted slices and the regular grid that they are on or can be resampled to.
#[derive(Debug)]
pub(crate) struct Stack {
    /// Slices from first to last along the normal.
    pub slices: Vec<Slice>,
    /// The grid, including missing slices.
    pub grid: Grid,
    /// Position of each slice on the grid's third axis; whole numbers unless spacing is uneven.
    pub slots: Vec<f64>,
    /// Missing slices.
    pub gaps: Vec<Gap>,
    /// Smallest and largest distance between neighbours if spacing is uneven, mm.
    pub uneven: Option<(f64, f64)>,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// Sorts slices of one pass and finds their grid. Fails with status 3 if slices disagree in size, orientation or spacing, have no
/// position, or lie as those of several passes; status 4 if cancelled.
pub(crate) fn stack(input: &Path, mut slices: Vec<Slice>, progress: &Progress) -> Result<Stack> {
    let mut notes = Vec::new();
    agree(&slices)?;
    let first = slices[0].clone();
    let spacing = in_plane(input, &first, &mut notes)?;
    if slices.len() == 1 {
        return single(first, spacing, notes);
    }
    let axes = first.axes.ok_or_else(|| untold(&first, "ImageOrientationPatient"))?;
    let normal = axes[0].cross(axes[1]);
    for s in &slices {
        if s.position.is_none() {
            return Err(untold(s, "ImagePositionPatient"));
        }
    }
    let place = |s: &Slice| s.position.unwrap_or_default();
    slices.sort_by(|a, b| {
        let along = |s: &Slice| place(s).dot(normal);
        along(a).total_cmp(&along(b)).then_with(|| a.file.path.cmp(&b.file.path)).then(a.frame.cmp(&b.frame))
    });
    let slices = copies::left_out(input, slices, normal, &mut notes, progress)?;
    if slices.len() == 1 {
        return single(slices.into_iter().next().unwrap_or(first), spacing, notes);
    }
    let along: Vec<f64> = slices.iter().map(|s| place(s).dot(normal)).collect();
    let layout = layout(input, &along);
    let regular = layout.as_ref().is_ok_and(|l| l.gaps.is_empty() && l.uneven.is_none());
    if !regular && even::several(&along) && !is_numbered(&slices) {
        let why = "its slices are spaced like those of two or more passes, and no header separates the passes";
        return Err(Error::file(input, why, "export each pass as its own series"));
    }
    let layout = layout?;
    let last_slot = layout.slots.last().copied().unwrap_or(1.0).round().max(1.0);
    let (from, to) = (place(&slices[0]), place(&slices[slices.len() - 1]));
    let step = (to - from) / last_slot;
    for (s, slot) in slices.iter().zip(&layout.slots) {
        // Along the step, uneven spacing is allowed here; no offset is allowed beside it.
        let off = place(s) - (from + step * *slot);
        let beside = off - off.dot(normal) / step.dot(normal) * step;
        if beside.length() > SIDEWAYS {
            return Err(Error::file(
                &s.file.path,
                format!("lies {:.2} mm off the line of the other slices", beside.length()),
                "export the series again",
            ));
        }
    }
    let direction = DMat3::from_cols(axes[0], axes[1], step);
    let dims = [first.file.cols.into(), first.file.rows.into(), last_slot as usize + 1];
    let steps = DVec3::new(spacing[0], spacing[1], step.length());
    let grid = frame::grid(input, dims, steps, from, direction)?;
    let tilt = step.normalize().dot(normal).clamp(-1.0, 1.0).acos().to_degrees();
    if tilt > 0.1 {
        notes.push(format!("the gantry is tilted by {tilt:.1} degrees; the grid is oblique"));
    }
    Ok(Stack { slices, grid, slots: layout.slots, gaps: layout.gaps, uneven: layout.uneven, notes })
}

fn untold(s: &Slice, name: &str) -> Error {
    Error::file(&s.file.path, format!("has no {name}"), "export it with its geometry")
}

fn in_plane(input: &Path, s: &Slice, notes: &mut Vec<String>) -> Result<[f64; 2]> {
    match s.spacing {
        Some(spacing) => Ok(spacing),
        // A non-CT (`info` accepts any modality) may be a projection without a spacing in the patient.
        None if s.modality != "CT" => {
            notes.push("has no PixelSpacing: 1 mm is assumed".to_owned());
            Ok([1.0; 2])
        }
        None => Err(Error::file(input, "has no PixelSpacing", "export it with its geometry")),
    }
}

/// Rejects slices that cannot belong to one volume.
fn agree(slices: &[Slice]) -> Result<()> {
    for b in slices {
        if let Some(Difference { what, first, own }) = difference(&slices[0], b) {
            return Err(Error::file(
                &b.file.path,
                format!("its {what} is {own}, but the series' first slice has {first}"),
                "remove the slices of other scans from the series",
            ));
        }
    }
    Ok(())
}

/// A property in which two slices differ.
pub(crate) struct Difference {
    what: &'static str,
    first: String,
    own: String,
}

/// True if the numbers of slices in spatial order rise or fall throughout: then one pass holds them all, however they lie.
fn is_numbered(slices: &[Slice]) -> bool {
    let numbers: Option<Vec<f64>> = slices.iter().map(|s| s.marks.instance).collect();
    numbers.is_some_and(|n| n.windows(2).all(|w| w[0] < w[1]) || n.windows(2).all(|w| w[0] > w[1]))
}

/// Returns what keeps slice `b` out of the volume of slice `a`, whatever their positions.
pub(crate) fn difference(a: &Slice, b: &Slice) -> Option<Difference> {
    if (a.file.rows, a.file.cols) != (b.file.rows, b.file.cols) {
        let size = |s: &Slice| format!("{}×{}", s.file.cols, s.file.rows);
        return Some(Difference { what: "size", first: size(a), own: size(b) });
    }
    let turned = match (a.axes, b.axes) {
        (Some(p), Some(q)) => (p[0] - q[0]).length() > 1e-3 || (p[1] - q[1]).length() > 1e-3,
        (p, q) => p.is_some() != q.is_some(),
    };
    if turned {
        let text = |s: &Slice| s.axes.map_or("not given".to_owned(), |[x, y]| format!("{x} {y}"));
        return Some(Difference { what: "orientation", first: text(a), own: text(b) });
    }
    let stretched = match (a.spacing, b.spacing) {
        (Some(p), Some(q)) => p.iter().zip(q).any(|(p, q)| (p - q).abs() > 1e-3 * p),
        (p, q) => p.is_some() != q.is_some(),
    };
    let text = |s: &Slice| format!("{:?} mm", s.spacing);
    stretched.then(|| Difference { what: "spacing", first: text(a), own: text(b) })
}

fn single(slice: Slice, spacing: [f64; 2], mut notes: Vec<String>) -> Result<Stack> {
    let axes = slice.axes.unwrap_or_else(|| {
        notes.push("has no orientation: rows are assumed to run to the left, columns to posterior".to_owned());
        [DVec3::X, DVec3::Y]
    });
    let depth = slice.depth.unwrap_or_else(|| {
        notes.push("has no slice thickness: 1 mm is assumed".to_owned());
        1.0
    });
    let direction = DMat3::from_cols(axes[0], axes[1], axes[0].cross(axes[1]));
    let dims = [slice.file.cols.into(), slice.file.rows.into(), 1];
    let steps = DVec3::new(spacing[0], spacing[1], depth);
    let grid = frame::grid(&slice.file.path, dims, steps, slice.position.unwrap_or_default(), direction)?;
    Ok(Stack { slices: vec![slice], grid, slots: vec![0.0], gaps: Vec::new(), uneven: None, notes })
}

struct Layout {
    slots: Vec<f64>,
    gaps: Vec<Gap>,
    uneven: Option<(f64, f64)>,
}

/// Finds positions on a regular grid for slices at `along` (mm, ascending).
fn layout(input: &Path, along: &[f64]) -> Result<Layout> {
    let distances: Vec<f64> = along.windows(2).map(|w| w[1] - w[0]).collect();
    let mut sorted = distances.clone();
    sorted.sort_by(f64::total_cmp);
    // The lower median gives the usual distance even if nearly half the neighbours have a gap between them.
    let usual = sorted[(sorted.len() - 1) / 2];
    let steps: Vec<f64> = distances.iter().map(|d| (d / usual).round().max(1.0)).collect();
    let total: f64 = steps.iter().sum();
    if !total.is_finite() || total > 4.0 * along.len() as f64 + 16.0 {
        return Err(Error::file(
            input,
            format!("its {} slices cover the space of {total} (usual distance {usual} mm)", along.len()),
            "export the whole series",
        ));
    }
    let mut slots = vec![0.0];
    for s in &steps {
        slots.push(slots[slots.len() - 1] + s);
    }
    let gaps = steps
        .iter()
        .enumerate()
        .filter(|(_, s)| **s > 1.0)
        .map(|(after, s)| Gap { after, missing: *s as usize - 1 })
        .collect();
    let spacing = (along[along.len() - 1] - along[0]) / total;
    let room = |shares: f64| UNEVEN.0 * spacing + (shares * UNEVEN.1).min(0.4 * spacing);
    // Each slice must be near its position, and each distance near its nominal value (two roundings may add up there).
    let placed = along.iter().zip(&slots).all(|(t, slot)| (t - along[0] - slot * spacing).abs() <= room(1.0));
    let spaced = distances.iter().zip(&steps).all(|(d, s)| (d - s * spacing).abs() <= room(2.0));
    let regular = placed && spaced;
    if regular {
        return Ok(Layout { slots, gaps, uneven: None });
    }
    let length = along[along.len() - 1] - along[0];
    let count = (length / usual).round().max(1.0);
    let slots = along.iter().map(|t| (t - along[0]) / length * count).collect();
    Ok(Layout { slots, gaps, uneven: Some((sorted[0], sorted[sorted.len() - 1])) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lay(along: &[f64]) -> Layout {
        layout(Path::new("x"), along).unwrap()
    }

    #[test]
    fn rounded_positions_are_regular() {
        // 0.625 mm written with one decimal.
        let along: Vec<f64> = (0..200).map(|k| (f64::from(k) * 6.25).round() / 10.0).collect();
        let l = lay(&along);
        assert!(l.uneven.is_none() && l.gaps.is_empty());
        assert_eq!(l.slots[199], 199.0);
    }

    #[test]
    fn gaps_are_found_where_they_are() {
        let along: Vec<f64> =
            (0..30).filter(|k| ![7, 20, 21].contains(k)).map(|k| -40.0 + 2.5 * f64::from(k)).collect();
        let l = lay(&along);
        assert_eq!(l.gaps, [Gap { after: 6, missing: 1 }, Gap { after: 18, missing: 2 }]);
        assert!(l.uneven.is_none());
        assert_eq!(l.slots[26], 29.0);
    }

    #[test]
    fn uneven_spacing_is_found() {
        let l = lay(&[0.0, 1.0, 2.0, 3.3, 4.3, 5.3]);
        assert!(l.uneven.is_some());
        // Six slices, usually 2 mm apart, over 10.6 mm: five steps of 2.12 mm.
        let l = lay(&[10.0, 12.0, 14.0, 16.6, 18.6, 20.6]);
        let expected = [0.0, 2.0, 4.0, 6.6, 8.6, 10.6].map(|t| t / 2.12);
        assert!(l.slots.iter().zip(expected).all(|(slot, e)| (slot - e).abs() < 1e-9), "{:?}", l.slots);
        assert!(l.uneven.is_some_and(|(least, most)| (least - 2.0).abs() < 1e-9 && (most - 2.6).abs() < 1e-9));
        assert!(layout(Path::new("x"), &[0.0, 1.0, 2.0, 1e6]).is_err());
    }
}
