//! A study as it comes from an archive: several scans of two patients, and much that is no scan.

use std::path::Path;

use super::dicom::Slice;
use super::series::write_series;

/// What no output may contain: names, identifiers and dates of birth.
pub(crate) const SECRETS: [&str; 7] = ["doe", "jane", "secret7", "roe", "richard", "hidden9", "19500102"];

/// Returns `n` axial slices of the series with this number.
fn scan(number: i32, n: usize, patient_position: &'static str, description: &'static str) -> Vec<Slice> {
    let one = |k| Slice {
        series: format!("2.{number}"),
        series_number: number,
        patient_position,
        description,
        study: "9.1",
        frame_of_reference: "8.1",
        ..Slice::at(2.5 * k as f64)
    };
    (0..n).map(one).collect()
}

fn coronal(slice: Slice, k: usize) -> Slice {
    let orientation = [1.0, 0.0, 0.0, 0.0, 0.0, -1.0];
    Slice { orientation, position: Some([-10.0, 3.0 * k as f64, 40.0]), ..slice }
}

/// Series 2 of the study: supine, of 12 slices.
pub(crate) fn supine() -> Vec<Slice> {
    scan(2, 12, "HFS", "Colon supine; Jane Doe\u{7}")
}

/// Series 1 of the study: two localizers.
pub(crate) fn localizer() -> Vec<Slice> {
    let mut scout = scan(1, 2, "HFS", "Topogram");
    scout[1] = coronal(scout[1].clone(), 1);
    scout.into_iter().map(|s| Slice { image_type: "ORIGINAL\\PRIMARY\\LOCALIZER", ..s }).collect()
}

/// Series 5 of the study: a picture of a screen, in colours.
pub(crate) fn capture() -> Vec<Slice> {
    let sop_class = "1.2.840.10008.5.1.4.1.1.7";
    let one = |s| Slice { sop_class, samples: 3, photometric: "RGB", pixels: vec![0; 72], ..s };
    scan(5, 1, "HFS", "Screen").into_iter().map(one).collect()
}

/// Series 7 of the study: a dose report, without pixels.
pub(crate) fn report() -> Vec<Slice> {
    let one = |s| Slice { modality: "SR", image: false, sop_class: "1.2.840.10008.5.1.4.1.1.88.67", ..s };
    scan(7, 1, "HFS", "Dose report").into_iter().map(one).collect()
}

/// Writes all series of a study into folders, with files that are no slices: 1 localizer, 2 supine, 3 prone, 4 coronal
/// reformat, 5 capture, 6 another patient, 7 report.
pub(crate) fn write_study(folder: &Path) {
    let reformat = scan(4, 10, "HFS", "Coronal").into_iter().enumerate();
    let reformat = reformat.map(|(k, s)| Slice { image_type: "DERIVED\\SECONDARY\\MPR", ..coronal(s, k) }).collect();
    let patient = ["Roe^Richard", "HIDDEN9"];
    let other = scan(6, 14, "HFS", "Abdomen").into_iter();
    let other = other.map(|s| Slice { patient, study: "9.2", frame_of_reference: "8.2", ..s }).collect();
    let all = [localizer(), supine(), scan(3, 11, "HFP", "Colon prone"), reformat, capture(), other, report()];
    for (k, slices) in all.iter().enumerate() {
        let below = folder.join("IMAGES").join(format!("S{}", 9 - k));
        std::fs::create_dir_all(&below).unwrap();
        write_series(&below, slices);
    }
    write_rest(folder);
}

/// Writes files that are no slices: text, a hidden file, and the index of a medium.
pub(crate) fn write_rest(folder: &Path) {
    std::fs::write(folder.join("README.txt"), "Doe^Jane").unwrap();
    std::fs::write(folder.join(".hidden"), [0; 200]).unwrap();
    let mut index = vec![0; 128];
    index.extend(b"DICM\x02\0\x02\0UI\x14\x001.2.840.10008.1.3.10");
    index.extend(b"\x02\0\x10\0UI\x14\x001.2.840.10008.1.2.1\0\x04\0\x30\x11CS\x04\0DISC");
    std::fs::write(folder.join("DICOMDIR"), index).unwrap();
}
