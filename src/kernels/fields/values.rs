//! The values of a volume, or those that it had before some were changed: what measures a scan as scanned needs no copy of it.

use std::borrow::Cow;

use super::cleanse::Changes;
use crate::volume::{Grid, Volume};

/// The values of a volume, HU.
#[derive(Clone, Debug)]
pub(in crate::fields) struct Values<'a> {
    volume: &'a Volume,
    before: Option<Before<'a>>,
}

/// Other values for some voxels, found by their rows.
#[derive(Clone, Debug)]
struct Before<'a> {
    changes: &'a Changes,
    /// For each row of voxels along x, and for the end: the number of runs that begin before it.
    begun: Vec<usize>,
}

impl<'a> Values<'a> {
    /// Takes the values that a volume has.
    pub(in crate::fields) fn of(volume: &'a Volume) -> Self {
        Self { volume, before: None }
    }

    /// Takes the values of `changes` where there are some.
    pub(in crate::fields) fn before(volume: &'a Volume, changes: &'a Changes) -> Self {
        let [nx, ny, nz] = volume.grid().dims();
        let mut begun = vec![0; ny * nz + 1];
        for (voxels, _) in changes.runs() {
            // A run counts for all rows after the one that it begins in.
            begun[voxels.start / nx + 1] += 1;
        }
        for n in 1..begun.len() {
            begun[n] += begun[n - 1];
        }
        Self { volume, before: Some(Before { changes, begun }) }
    }

    /// Returns the volume's grid.
    pub(in crate::fields) fn grid(&self) -> &'a Grid {
        self.volume.grid()
    }

    /// Returns the value of a voxel (linear index).
    #[inline]
    pub(in crate::fields) fn at(&self, voxel: usize) -> i16 {
        self.changed(voxel).unwrap_or_else(|| self.volume.data()[voxel])
    }

    #[inline]
    fn changed(&self, voxel: usize) -> Option<i16> {
        let Before { changes, begun } = self.before.as_ref()?;
        let row = voxel / self.grid().dims()[0];
        // The last run of an earlier row may go on in this one.
        changes.get_among(begun[row].saturating_sub(1)..begun[row + 1], voxel)
    }

    /// Returns the values of `len` voxels in a row from the voxel `from` (linear index) on.
    pub(in crate::fields) fn row(&self, from: usize, len: usize) -> Cow<'a, [i16]> {
        let values = &self.volume.data()[from..from + len];
        match &self.before {
            None => Cow::Borrowed(values),
            Some(_) => values.iter().enumerate().map(|(n, hu)| self.changed(from + n).unwrap_or(*hu)).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::math::hash;

    proptest! {
        /// Runs within rows, over several rows, and side by side.
        #[test]
        fn they_are_those_of_the_volume_with_all_changes(nx in 1usize..9, ny in 1usize..6, nz in 1usize..5, share in 0.0f64..1.0, seed: u64) {
            let grid = Grid::new([nx, ny, nz], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
            let volume = Volume::new(grid.clone(), (0..grid.len()).map(|n| n as i16).collect());
            let changed = (0..grid.len()).filter(|n| hash::uniform(seed, *n as u64 / 3) < share).map(|n| (n, -(n as i16) - 1));
            let changes = Changes::of(changed);
            let (whole, plain) = (changes.applied(&volume), Values::of(&volume));
            let values = Values::before(&volume, &changes);
            for n in 0..grid.len() {
                prop_assert_eq!(values.at(n), whole.data()[n]);
                prop_assert_eq!(plain.at(n), volume.data()[n]);
            }
            for row in 0..ny * nz {
                prop_assert_eq!(&*values.row(row * nx, nx), &whole.data()[row * nx..][..nx]);
                prop_assert_eq!(&*plain.row(row * nx, nx), &volume.data()[row * nx..][..nx]);
            }
        }
    }
}
