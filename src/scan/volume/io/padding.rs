//! Detection of the scanner's padding outside its round field of view, if the file does not declare it.

use rayon::prelude::*;

use crate::volume::{AIR_HU, Volume};

/// HU at or below which a value is neither tissue nor gas nor noise: scanners pad with −2000, −2048, −3024 and the like.
const NO_TISSUE_HU: i16 = -1500;

/// Replaces padding by air.
///
/// Padding is a single value of at most −1500 HU. It fills at least three quarters of the corners of all slices (a
/// round field of view leaves the corners empty), in slices that also contain something else.
pub(crate) fn to_air(volume: Volume, notes: &mut Vec<String>) -> Volume {
    let [nx, ny, nz] = volume.grid.dims();
    if nx < 8 || ny < 8 {
        return volume;
    }
    let slice = nx * ny;
    let corners = [0, nx - 1, slice - nx, slice - 1];
    let mut seen: Vec<i16> = (0..nz).flat_map(|k| corners.map(|c| volume.data[k * slice + c])).collect();
    seen.sort_unstable();
    let value = seen[seen.len() / 2];
    let same = seen.iter().filter(|v| **v == value).count();
    if value > NO_TISSUE_HU || 4 * same < 3 * seen.len() || volume.data.iter().all(|v| *v <= NO_TISSUE_HU) {
        return volume;
    }
    let Volume { grid, mut data, header_position, .. } = volume;
    data.par_iter_mut().filter(|v| **v == value).for_each(|v| *v = AIR_HU);
    notes.push(format!("{value} HU in the corners of the slices is padding and became air"));
    Volume::new(grid, data).with_header_position(header_position)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Grid;
    use glam::{DMat3, DVec3};

    fn disc(outside: i16) -> Volume {
        let grid = Grid::new([16, 16, 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let inside = |i: usize| (i % 16).abs_diff(8).pow(2) + (i / 16 % 16).abs_diff(8).pow(2) < 50;
        let data = (0..grid.len()).map(|i| if inside(i) { 40 } else { outside }).collect();
        Volume::new(grid, data)
    }

    #[test]
    fn padding_becomes_air_and_noise_does_not() {
        let mut notes = Vec::new();
        let padded = to_air(disc(-3024), &mut notes);
        assert_eq!(padded.data().iter().min(), Some(&AIR_HU));
        assert_eq!(notes.len(), 1);
        assert_eq!(to_air(disc(-1200), &mut notes).data().iter().min(), Some(&-1200));
        assert_eq!(notes.len(), 1);
    }

    #[test]
    fn an_empty_volume_stays_as_it_is() {
        let grid = Grid::new([8, 8, 1], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let v = to_air(Volume::new(grid, vec![-2000; 64]), &mut Vec::new());
        assert_eq!(v.data()[0], -2000);
    }
}
