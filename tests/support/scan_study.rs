//! A scan as the DICOM study of a patient.

use std::path::Path;

use colvis::volume::Volume;
use glam::DVec3;

use super::dicom::Slice;

/// UID of the study.
pub(crate) const STUDY: &str = "1.2.826.0.1.99.1";

/// Writes a scan as a DICOM study. `turned` reverses the scan's first and second axis, as for a prone patient or feet first.
pub(crate) fn write_scan(volume: &Volume, turned: [bool; 2], position: &'static str, folder: &Path) {
    std::fs::create_dir(folder).unwrap();
    let grid = volume.grid();
    let ([nx, ny, nz], spacing) = (grid.dims(), grid.spacing());
    let at = |n: usize, count: usize, turned: bool| if turned { count - 1 - n } else { n };
    let sign = |turned: bool| if turned { -1.0 } else { 1.0 };
    let (x, y) = (grid.direction().x_axis * sign(turned[0]), grid.direction().y_axis * sign(turned[1]));
    for k in 0..nz {
        let first = [at(0, nx, turned[0]), at(0, ny, turned[1]), k].map(|n| n as f64);
        let pixel = |n: usize| {
            let hu = volume.data()[grid.index(at(n % nx, nx, turned[0]), at(n / nx, ny, turned[1]), k)];
            (hu + 1024).cast_unsigned()
        };
        let slice = Slice {
            patient: ["Featherstone^Marjoribanks", "SECRET7"],
            study: STUDY,
            series: "1.2.826.0.1.99.2".to_owned(),
            frame_of_reference: "1.2.826.0.1.99.3",
            patient_position: position,
            rows: ny as u16,
            cols: nx as u16,
            position: Some(grid.world(DVec3::from_array(first)).to_array()),
            orientation: [x, y].map(|v| v.to_array()).as_flattened().try_into().unwrap(),
            spacing: format!("{}\\{}", spacing.y, spacing.x),
            pixels: (0..nx * ny).map(pixel).collect(),
            ..Slice::at(0.0)
        };
        std::fs::write(folder.join(format!("{k:04}.dcm")), slice.bytes()).unwrap();
    }
}
