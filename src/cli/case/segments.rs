//! The segments of the colon as labels.

use std::path::Path;

use glam::DVec3;
use rayon::prelude::*;

use crate::error::Result;
use crate::fields::{Along, Lumen};
use crate::output::AtomicFile;
use crate::progress::Progress;
use crate::volume::Grid;
use crate::volume::io::{self, SegmentLabel};

/// So many voxels along x share a label: they are nearer to each other than a segment is long.
const TOGETHER: usize = 8;
/// The segments' colours, from the rectum.
pub(super) const COLOURS: [[u8; 3]; 8] = [
    [214, 96, 77],
    [244, 165, 130],
    [253, 219, 160],
    [230, 245, 152],
    [146, 197, 222],
    [67, 147, 195],
    [118, 113, 179],
    [175, 141, 195],
];

/// The labels of a scan's voxels.
pub(super) struct Segments {
    grid: Grid,
    labels: Vec<u8>,
    names: Vec<SegmentLabel>,
}

/// Labels the lumen with its segments, from 1 at the rectum. What belongs to none has the last label.
pub(super) fn of(lumen: &Lumen, along: &Along) -> Result<Segments> {
    let grid = lumen.grid().clone();
    let mut labels = lumen.mask();
    let parts = along.parts();
    let [nx, ny, _] = grid.dims();
    labels.par_chunks_mut(nx).enumerate().for_each(|(row, labels)| {
        for (n, voxels) in labels.chunks_mut(TOGETHER).enumerate() {
            let Some(first) = voxels.iter().position(|v| *v != 0) else { continue };
            let voxel = [n * TOGETHER + first, row % ny, row / ny];
            let at = grid.world(DVec3::from_array(voxel.map(|x| x as f64)));
            let part = along.of(at).and_then(|a| parts.iter().position(|p| Some(p.name) == a.part));
            // Gas that no line leads through is nearest to none, and comes last.
            let label = part.unwrap_or(parts.len()) as u8 + 1;
            voxels.iter_mut().filter(|v| **v != 0).for_each(|v| *v = label);
        }
    });
    let colour = |n: usize| COLOURS[n % COLOURS.len()];
    let named = |n: usize, name: &str| SegmentLabel { value: n as u8 + 1, name: name.to_owned(), colour: colour(n) };
    let mut names: Vec<SegmentLabel> = parts.iter().enumerate().map(|(n, p)| named(n, p.name)).collect();
    let rest = if parts.is_empty() { "colon" } else { "colon, segment unknown" };
    if labels.par_iter().any(|l| usize::from(*l) == parts.len() + 1) {
        names.push(named(parts.len(), rest));
    }
    Ok(Segments { grid, labels, names })
}

impl Segments {
    /// Returns the grid of the labels.
    #[cfg(feature = "dicom")]
    pub(super) fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Returns the label of each voxel, 0 outside the lumen.
    #[cfg(feature = "dicom")]
    pub(super) fn labels(&self) -> &[u8] {
        &self.labels
    }

    /// Returns what the labels stand for.
    #[cfg(feature = "dicom")]
    pub(super) fn names(&self) -> &[SegmentLabel] {
        &self.names
    }

    /// Writes them as a segmentation into a file that is left to finish. Fails with status 4 if cancelled, 5 if it cannot be written.
    pub(super) fn write(&self, path: &Path, progress: &Progress) -> Result<AtomicFile> {
        io::save_segments(path, &self.grid, &self.labels, &self.names, progress)
    }
}
