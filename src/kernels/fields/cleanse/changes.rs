//! Values that differ from those of a scan, as runs of voxels.

use std::ops::Range;

use crate::volume::Volume;

/// Other values for some voxels of a volume. It takes the memory of these values and of their runs, never that of the volume.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Changes {
    /// First voxel of each run (linear index) and the position of its first value; ascending and separate.
    runs: Vec<(usize, usize)>,
    /// HU.
    values: Vec<i16>,
}

impl Changes {
    /// Gathers changes given as (linear index, HU) in ascending order; of several for one voxel the first counts.
    pub(super) fn from_sorted(changed: impl Iterator<Item = (usize, i16)>) -> Self {
        let mut out = Self::default();
        let mut next = None;
        for (n, hu) in changed {
            match next {
                Some(next) if n < next => continue,
                Some(next) if n == next => {}
                _ => out.runs.push((n, out.values.len())),
            }
            out.values.push(hu);
            next = Some(n + 1);
        }
        out.runs.shrink_to_fit();
        out.values.shrink_to_fit();
        out
    }

    /// Changes given as (linear index, HU) in ascending order, for tests.
    #[doc(hidden)]
    pub fn of(changed: impl IntoIterator<Item = (usize, i16)>) -> Self {
        Self::from_sorted(changed.into_iter())
    }

    /// Joins changes of separate voxels.
    pub(super) fn joined(parts: &[Self]) -> Self {
        let mut runs: Vec<(Range<usize>, &[i16])> = parts.iter().flat_map(Self::runs).collect();
        runs.sort_unstable_by_key(|r| r.0.start);
        let total = runs.iter().map(|r| r.1.len()).sum();
        let mut out = Self { runs: Vec::new(), values: Vec::with_capacity(total) };
        runs.into_iter().for_each(|(voxels, values)| out.push(voxels.start, values));
        out.runs.shrink_to_fit();
        out
    }

    /// Returns these changes and those of `other` where there are none of these.
    pub(super) fn over(&self, other: &Self) -> Self {
        let mut own = self.runs().peekable();
        let mut out = Self { runs: Vec::new(), values: Vec::with_capacity(self.len() + other.len()) };
        for (below, values) in other.runs() {
            let mut from = below.start;
            while let Some((voxels, _)) = own.peek().filter(|(voxels, _)| voxels.start < below.end) {
                let (start, end) = (voxels.start.clamp(from, below.end), voxels.end);
                out.push(from, &values[from - below.start..start - below.start]);
                if end > below.end {
                    // It may lie over further runs.
                    from = below.end;
                    break;
                }
                if let Some((voxels, values)) = own.next() {
                    out.push(voxels.start, values);
                    from = from.max(voxels.end);
                }
            }
            out.push(from, &values[from - below.start..]);
        }
        own.for_each(|(voxels, values)| out.push(voxels.start, values));
        out.runs.shrink_to_fit();
        out.values.shrink_to_fit();
        out
    }

    /// Appends values from `first` on, which is beyond all others.
    fn push(&mut self, first: usize, values: &[i16]) {
        if values.is_empty() {
            return;
        }
        let end = self.runs.last().map(|&(start, at)| start + self.values.len() - at);
        if end != Some(first) {
            self.runs.push((first, self.values.len()));
        }
        self.values.extend_from_slice(values);
    }

    /// Returns each voxel (linear index) with its value, HU.
    pub(super) fn each(&self) -> impl Iterator<Item = (usize, i16)> + '_ {
        self.runs().flat_map(|(voxels, values)| voxels.zip(values.iter().copied()))
    }

    /// Returns the value of a voxel (linear index), HU, if there is one.
    pub fn get(&self, voxel: usize) -> Option<i16> {
        self.get_among(0..self.runs.len(), voxel)
    }

    /// Like [`Changes::get`]; the run that holds the voxel, if there is one, is among those given by number.
    #[inline]
    pub(in crate::fields) fn get_among(&self, runs: Range<usize>, voxel: usize) -> Option<i16> {
        let run = (runs.start + self.runs[runs].partition_point(|r| r.0 <= voxel)).checked_sub(1)?;
        let (first, at) = self.runs[run];
        let end = self.runs.get(run + 1).map_or(self.values.len(), |next| next.1);
        self.values[at..end].get(voxel - first).copied()
    }

    /// Returns the number of voxels.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// True if nothing differs.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Returns each run of voxels (linear indices) with its values, HU.
    pub fn runs(&self) -> impl Iterator<Item = (Range<usize>, &[i16])> + '_ {
        let ends = self.runs.iter().skip(1).map(|r| r.1).chain([self.values.len()]);
        self.runs.iter().zip(ends).map(|(&(first, at), end)| (first..first + end - at, &self.values[at..end]))
    }

    /// Replaces each value, given its voxel (linear index) and itself.
    pub(super) fn adjust(&mut self, value: impl Fn(usize, i16) -> i16) {
        for (voxels, values) in self.runs_mut() {
            values.iter_mut().zip(voxels).for_each(|(hu, n)| *hu = value(n, *hu));
        }
    }

    /// Sets the values of ranges of voxels, ascending, each within one run.
    pub(super) fn set(&mut self, ranges: &[Range<usize>], hu: i16) {
        let mut ranges = ranges.iter().peekable();
        for (voxels, values) in self.runs_mut() {
            while let Some(range) = ranges.next_if(|r| r.start < voxels.end) {
                values[range.start - voxels.start..range.end - voxels.start].fill(hu);
            }
        }
    }

    /// Returns each run of voxels with its values, to be changed.
    fn runs_mut(&mut self) -> impl Iterator<Item = (Range<usize>, &mut [i16])> + '_ {
        let mut rest = self.values.as_mut_slice();
        let total = rest.len();
        let ends: Vec<usize> = self.runs.iter().skip(1).map(|r| r.1).chain([total]).collect();
        self.runs.iter().zip(ends).map(move |(&(first, at), end)| {
            let (own, after) = std::mem::take(&mut rest).split_at_mut(end - at);
            rest = after;
            (first..first + own.len(), own)
        })
    }

    /// Returns the volume with these values in place of its own.
    ///
    /// # Panics
    /// Panics if a voxel is not in the volume.
    pub fn applied(&self, volume: &Volume) -> Volume {
        let mut data = volume.data().to_vec();
        for (voxels, values) in self.runs() {
            data[voxels].copy_from_slice(values);
        }
        Volume::new(volume.grid().clone(), data)
    }

    /// Returns a box of the volume with these values in place of its own: the voxels from `low` to `high`, both within. Its grid is part
    /// of the volume's.
    ///
    /// # Panics
    /// Panics if the box reaches beyond the volume.
    pub fn applied_to_box(&self, volume: &Volume, low: [usize; 3], high: [usize; 3]) -> Volume {
        let grid = volume.grid();
        let [nx, ny, _] = grid.dims();
        let dims = [0, 1, 2].map(|a| high[a] + 1 - low[a]);
        let mut data = Vec::with_capacity(dims.iter().product());
        for k in low[2]..=high[2] {
            for j in low[1]..=high[1] {
                let row = grid.index(0, j, k);
                data.extend_from_slice(&volume.data()[row + low[0]..=row + high[0]]);
            }
        }
        for (voxels, values) in self.runs() {
            // A run may continue in the next row.
            let mut from = voxels.start;
            while from < voxels.end {
                let (row, i) = (from / nx, from % nx);
                let end = voxels.end.min((row + 1) * nx);
                let (j, k) = (row % ny, row / ny);
                let within = (low[1]..=high[1]).contains(&j) && (low[2]..=high[2]).contains(&k);
                let (first, last) = (i.max(low[0]), (end - row * nx).min(high[0] + 1));
                if within && first < last {
                    let to = first - low[0] + dims[0] * (j - low[1] + dims[1] * (k - low[2]));
                    let at = row * nx + first - voxels.start;
                    data[to..to + last - first].copy_from_slice(&values[at..at + last - first]);
                }
                from = end;
            }
        }
        Volume::new(grid.part(low, dims), data)
    }

    /// Exchanges these values and those of the volume, in place. Doing it twice restores both.
    ///
    /// # Panics
    /// Panics if a voxel is not in the volume.
    pub fn exchange(&mut self, volume: &mut Volume) {
        let data = volume.data_mut();
        for (voxels, values) in self.runs_mut() {
            data[voxels].swap_with_slice(values);
        }
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.runs.as_slice()) + size_of_val(self.values.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use glam::{DMat3, DVec3};

    use super::*;
    use crate::math::hash;
    use crate::volume::Grid;

    #[test]
    fn changes_are_applied_and_exchanged_and_exchanged_back() {
        let grid = Grid::new([4, 2, 2], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let mut volume = Volume::new(grid, (0..16).collect());
        let before = volume.clone();
        let mut changes =
            Changes::from_sorted([(1, 100), (2, 200), (2, 999), (7, 300), (8, 400), (15, 500)].into_iter());
        let runs: Vec<_> = changes.runs().map(|(r, v)| (r, v.to_vec())).collect();
        assert_eq!(runs, [(1..3, vec![100, 200]), (7..9, vec![300, 400]), (15..16, vec![500])]);
        assert_eq!((changes.len(), changes.is_empty()), (5, false));
        let expected = [0, 100, 200, 3, 4, 5, 6, 300, 400, 9, 10, 11, 12, 13, 14, 500];
        assert_eq!(changes.applied(&volume).data(), expected);
        assert_eq!(volume, before);
        changes.exchange(&mut volume);
        assert_eq!(volume.data(), expected);
        assert_eq!(changes.applied(&volume).data(), before.data());
        changes.exchange(&mut volume);
        assert_eq!(volume, before);
        assert!(Changes::default().is_empty() && Changes::default().applied(&volume) == volume);
        assert_eq!(changes.bytes(), 3 * 16 + 5 * 2);
    }

    #[test]
    fn changes_are_joined_and_laid_over_others() {
        let of = |list: &[(usize, i16)]| Changes::from_sorted(list.iter().copied());
        let parts = [of(&[(8, 1), (9, 2)]), of(&[(2, 3), (20, 4)]), Changes::default(), of(&[(3, 5), (10, 6)])];
        let joined = Changes::joined(&parts);
        assert_eq!(joined, of(&[(2, 3), (3, 5), (8, 1), (9, 2), (10, 6), (20, 4)]));
        assert_eq!(joined.runs().count(), 3);
        let over = of(&[(1, 70), (3, 71), (21, 72)]).over(&joined);
        assert_eq!(over, of(&[(1, 70), (2, 3), (3, 71), (8, 1), (9, 2), (10, 6), (20, 4), (21, 72)]));
        assert_eq!(over.runs().count(), 3);
        assert_eq!(Changes::default().over(&joined), joined);
        assert_eq!(joined.over(&Changes::default()), joined);
    }

    #[test]
    fn changes_over_others_are_those_of_each_voxel() {
        for seed in 0..200 {
            let of = |part: u64| -> Vec<(usize, i16)> {
                let is_in = |n: usize| hash::bits(seed, (n as u64 / (1 + seed % 5)) * 2 + part).is_multiple_of(3);
                (0..60).filter(|&n| is_in(n)).map(|n| (n, (100 * part) as i16 + n as i16)).collect()
            };
            let (own, below) = (of(0), of(1));
            let expected: BTreeMap<usize, i16> = below.iter().chain(&own).copied().collect();
            let [own, below] = [own, below].map(|list| Changes::from_sorted(list.into_iter()));
            assert_eq!(own.over(&below), Changes::from_sorted(expected.into_iter()), "{seed}");
            let mut doubled = own.clone();
            doubled.adjust(|n, hu| hu + n as i16);
            assert!(doubled.each().eq(own.each().map(|(n, hu)| (n, hu + n as i16))));
        }
    }

    #[test]
    fn a_box_of_a_volume_is_changed_as_the_whole_is() {
        let turn = DMat3::from_rotation_z(0.3);
        let grid = Grid::new([7, 5, 4], DVec3::new(0.7, 0.8, 1.1), DVec3::new(3.0, -2.0, 9.0), turn).unwrap();
        let volume = Volume::new(grid.clone(), (0..140).collect());
        let changes = Changes::from_sorted((20..100).filter(|n| n % 9 != 0).map(|n| (n, 1000 + n as i16)));
        let (low, high) = ([1, 0, 1], [5, 3, 3]);
        let (part, whole) = (changes.applied_to_box(&volume, low, high), changes.applied(&volume));
        assert_eq!(part.grid().dims(), [5, 4, 3]);
        for n in 0..part.data().len() {
            let at = [n % 5, n / 5 % 4, n / 20];
            let [i, j, k] = [0, 1, 2].map(|a| at[a] + low[a]);
            assert_eq!(part.data()[n], whole.data()[grid.index(i, j, k)]);
            let [here, there] = [(part.grid(), at), (&grid, [i, j, k])]
                .map(|(grid, v)| grid.world(DVec3::from_array(v.map(|c| c as f64))));
            assert!(here.distance(there) < 1e-9);
        }
        let all = changes.applied_to_box(&volume, [0; 3], [6, 4, 3]);
        assert_eq!(all.data(), whole.data());
    }
}
