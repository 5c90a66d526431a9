//! DICOM: real files, and artificial series for everything that can vary or be wrong.

use crate::support::dicom::{self, Slice};
use crate::support::reading::load;
use crate::support::scans::data;
use crate::support::series::write_series;
use colvis::progress::Progress;
use colvis::volume::io::{self, LoadOptions, Loaded};
use glam::DVec3;

impl Slice {
    /// Returns the HU of the slice.
    pub(crate) fn hu(&self) -> Vec<i16> {
        self.pixels.iter().map(|p| *p as i16 - 1024).collect()
    }
}

fn read(slices: &[Slice], options: &LoadOptions) -> colvis::error::Result<Loaded> {
    let dir = tempfile::tempdir().unwrap();
    write_series(dir.path(), slices);
    io::load(dir.path(), options, &Progress::new())
}

fn info(slices: &[Slice]) -> serde_json::Value {
    let dir = tempfile::tempdir().unwrap();
    write_series(dir.path(), slices);
    io::info(dir.path(), &LoadOptions { allow_gaps: true, ..LoadOptions::default() }, &Progress::new()).unwrap()
}

fn plain(slices: &[Slice]) -> Loaded {
    read(slices, &LoadOptions::default()).unwrap()
}

fn refusal(slices: &[Slice]) -> String {
    let e = read(slices, &LoadOptions::default()).unwrap_err();
    assert_eq!(e.kind as i32, 3, "{e}");
    e.to_string()
}

/// Returns slices at 0, 2.5, 5, … in shuffled order.
fn stack(n: usize) -> Vec<Slice> {
    (0..n).map(|k| Slice::at(2.5 * ((k * 7) % n) as f64)).collect()
}

#[test]
fn a_real_series_loads() {
    let Some(path) = data("dicom/series_j2k") else { return };
    let v = load(&path).unwrap().volume;
    assert_eq!(v.grid().dims(), [512, 512, 20]);
    assert!((v.grid().spacing() - DVec3::new(0.9765625, 0.9765625, 2.0)).length() < 1e-9);
    assert!((v.grid().origin() - DVec3::new(-249.51171875, -437.51171875, -804.5)).length() < 1e-9);
}

#[test]
fn three_forms_of_the_same_image_agree() {
    for image in ["CT1", "CT2"] {
        let mut forms = Vec::new();
        for form in ["UNC", "RLE", "J2KR"] {
            let Some(path) = data(&format!("dicom/codecs/{image}_{form}")) else { return };
            forms.push(load(&path).unwrap().volume);
        }
        assert!(forms[0].data().iter().any(|v| *v > 100), "{image} shows something");
        assert!(forms[0] == forms[1] && forms[0] == forms[2], "{image}");
    }
}

#[test]
fn a_truncated_image_is_refused() {
    let Some(path) = data("dicom/MR_truncated.dcm") else { return };
    let e = io::info(&path, &LoadOptions::default(), &Progress::new()).unwrap_err();
    assert_eq!(e.kind as i32, 3);
    assert!(e.why.contains("ends early"), "{e}");
}

#[test]
fn slices_are_sorted_and_placed() {
    let loaded = plain(&stack(12));
    assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
    let g = loaded.volume.grid();
    assert_eq!((g.dims(), g.spacing()), ([6, 4, 12], DVec3::new(0.5, 0.75, 2.5)));
    assert_eq!(g.world(DVec3::new(1.0, 1.0, 2.0)), DVec3::new(-9.5, -19.25, 5.0));
    for k in 0..12 {
        let hu = Slice::at(2.5 * k as f64).hu();
        assert_eq!(&loaded.volume.data()[24 * k..][..24], hu);
    }
}

#[test]
fn every_lying_of_the_patient_lands_in_the_patients_frame() {
    // The plane's axes as scanners write them: the image is seen from the feet, with the table below.
    for (name, orientation) in [
        ("HFS", [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]),
        ("HFP", [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0]),
        ("FFS", [-1.0, 0.0, 0.0, 0.0, 1.0, 0.0]),
        ("FFP", [1.0, 0.0, 0.0, 0.0, -1.0, 0.0]),
        ("HFDR", [0.0, 1.0, 0.0, -1.0, 0.0, 0.0]),
    ] {
        // A mark at column 5, row 1 of the slice at z = 5, wherever that ends up.
        let x = DVec3::from_slice(&orientation[..3]);
        let y = DVec3::from_slice(&orientation[3..]);
        let place = DVec3::new(-10.0, -20.0, 5.0) + x * 0.5 * 5.0 + y * 0.75;
        let slices: Vec<Slice> = stack(12)
            .into_iter()
            .map(|s| {
                let mut s = Slice { orientation, patient_position: name, ..s };
                if s.position.unwrap()[2] == 5.0 {
                    s.pixels[6 + 5] = 4000;
                }
                s
            })
            .collect();
        let v = plain(&slices).volume;
        let at = v.grid().voxel(place).round();
        assert_eq!(v.get(at.x as i64, at.y as i64, at.z as i64), 4000 - 1024, "{name}");
        assert!((v.grid().world(at) - place).length() < 1e-9, "{name}");
        assert!(v.grid().direction().determinant() > 0.0, "{name}");
    }
}

#[test]
fn every_transfer_syntax_gives_the_same_values() {
    let reference = plain(&stack(11)).volume;
    for syntax in [dicom::IMPLICIT, dicom::BIG, dicom::DEFLATED, dicom::RLE, dicom::JPEG_LOSSLESS, dicom::JPEG_LS] {
        let slices: Vec<Slice> = stack(11).into_iter().map(|s| Slice { syntax, ..s }).collect();
        assert!(plain(&slices).volume == reference, "{syntax}");
    }
    let unknown: Vec<Slice> = stack(3).into_iter().map(|s| Slice { syntax: "1.2.840.10008.1.2.4.102", ..s }).collect();
    assert!(refusal(&unknown).contains("1.2.840.10008.1.2.4.102 (MPEG-4) is not supported"));
}

#[test]
fn frames_of_an_enhanced_image_are_slices() {
    let reference = plain(&stack(12)).volume;
    let enhanced = plain(&[Slice::enhanced()]).volume;
    assert_eq!((enhanced.data(), enhanced.grid()), (reference.data(), reference.grid()));
    let deflated = plain(&[Slice { syntax: dicom::DEFLATED, ..Slice::enhanced() }]).volume;
    assert_eq!(deflated.data(), reference.data());
    let mut fewer = Slice::enhanced();
    fewer.places.pop();
    assert!(refusal(&[fewer]).contains("no position for each"));
}

#[test]
fn bits_slope_and_padding() {
    // Twelve bits in the middle of sixteen, unsigned, with an overlay bit above and noise below.
    let shifted = Slice {
        stored: 12,
        high: 13,
        signed: false,
        pixels: (0..24).map(|i| 0x8001 | (i << 2)).collect(),
        ..Slice::at(0.0)
    };
    assert_eq!(plain(&[shifted]).volume.data()[23], 23 - 1024);
    // Twelve bits, signed: the sign is the twelfth bit.
    let negative = Slice { stored: 12, high: 11, pixels: vec![0x0FFF; 24], intercept: "0", ..Slice::at(0.0) };
    assert_eq!(plain(&[negative]).volume.data()[0], -1);
    // Each slice has a different slope.
    let mut slices = stack(11);
    slices[3].slope = "0.5";
    let expected = to_hu(f64::from(slices[3].pixels[0]) * 0.5 - 1024.0);
    let k = (slices[3].position.unwrap()[2] / 2.5) as usize;
    assert_eq!(plain(&slices).volume.data()[24 * k], expected);
    // Padding by value, and by a range in either order.
    let mut padded = Slice { padding: Some(-2000i16 as u16), ..Slice::at(0.0) };
    padded.pixels[5] = -2000i16 as u16;
    assert_eq!(plain(&[padded.clone()]).volume.data()[5], -1024);
    padded.padding_limit = Some(-1990i16 as u16);
    padded.pixels[6] = -1995i16 as u16;
    assert_eq!(plain(&[padded]).volume.data()[5..7], [-1024, -1024]);
    // Eight bits. Inverted display does not change the values.
    let eight = Slice { allocated: 8, stored: 8, high: 7, signed: false, photometric: "MONOCHROME1", ..Slice::at(0.0) };
    let eight = Slice { pixels: (100..124).collect(), ..eight };
    let loaded = plain(&[eight]);
    assert_eq!(loaded.volume.data()[23], 123 - 1024);
    assert_eq!(loaded.notes.len(), 1);
}

fn to_hu(x: f64) -> i16 {
    (x + 0.5f64.copysign(x)) as i16
}

#[test]
fn missing_slices_are_found_named_and_filled_only_when_allowed() {
    let mut slices: Vec<Slice> = (0..20).map(|k| Slice::at(2.0 * f64::from(k))).collect();
    slices.remove(12);
    slices.remove(11);
    slices.remove(5);
    let why = refusal(&slices);
    assert!(why.contains("1 after slice 4, 2 after slice 9") && why.contains("--allow-gaps"), "{why}");
    let loaded = read(&slices, &LoadOptions { allow_gaps: true, ..LoadOptions::default() }).unwrap();
    assert_eq!(loaded.volume.grid().dims(), [6, 4, 20]);
    assert_eq!(loaded.notes.len(), 1, "{:?}", loaded.notes);
    // The values are linear in z, so interpolation restores the missing ones.
    for k in 0..20 {
        assert_eq!(loaded.volume.data()[24 * k], (1000 + 48 * k as i16) - 1024);
    }
    let gaps = serde_json::json!([{"after_slice": 4, "missing": 1}, {"after_slice": 9, "missing": 2}]);
    assert_eq!(info(&slices)["slice_gaps"], gaps);
}

#[test]
fn uneven_slices_are_refused_or_resampled() {
    let z = [0.0, 2.0, 4.0, 6.0, 8.0, 10.7, 12.7, 14.7, 16.7, 18.7];
    let slices: Vec<Slice> = z.iter().map(|z| Slice::at(*z)).collect();
    assert!(refusal(&slices).contains("apart"));
    let loaded = read(&slices, &LoadOptions { allow_gaps: true, ..LoadOptions::default() }).unwrap();
    let g = loaded.volume.grid();
    assert!((g.world(DVec3::new(0.0, 0.0, (g.dims()[2] - 1) as f64)).z - 18.7).abs() < 1e-9);
}

#[test]
fn duplicates() {
    let mut slices = stack(12);
    slices.push(slices[4].clone());
    let loaded = plain(&slices);
    assert_eq!(loaded.volume.grid().dims()[2], 12);
    assert!(loaded.notes[0].contains("duplicates"), "{:?}", loaded.notes);
    slices[12].pixels[0] += 1;
    let why = refusal(&slices);
    assert!(why.contains("4.dcm") && why.contains("12.dcm") && why.contains("has the same position as"), "{why}");
}

#[test]
fn slices_that_disagree_are_refused() {
    let mut s = stack(12);
    s[5] = Slice { cols: 4, rows: 6, ..s[5].clone() };
    assert!(refusal(&s).contains("its size is 4×6"));
    let mut s = stack(12);
    s[5].orientation = [0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    assert!(refusal(&s).contains("orientation"));
    let mut s = stack(12);
    s[5].spacing = "0.7\\0.5".to_owned();
    assert!(refusal(&s).contains("its spacing"));
    let mut s = stack(12);
    s[5].position = s[5].position.map(|[x, y, z]| [x + 3.0, y, z]);
    assert!(refusal(&s).contains("off the line"));
}

#[test]
fn a_tilted_gantry_gives_an_oblique_grid() {
    let tilt = 15f64.to_radians();
    let slices: Vec<Slice> = (0..12)
        .map(|k| {
            let s = Slice::at(f64::from(k));
            let orientation = [1.0, 0.0, 0.0, 0.0, tilt.cos(), -tilt.sin()];
            Slice { orientation, position: Some([-10.0, -20.0, 2.5 * f64::from(k)]), ..s }
        })
        .collect();
    let loaded = plain(&slices);
    assert!(loaded.notes[0].contains("tilted by 15.0"), "{:?}", loaded.notes);
    let p = loaded.volume.grid().world(DVec3::new(0.0, 0.0, 4.0));
    assert!((p - DVec3::new(-10.0, -20.0, 10.0)).length() < 1e-9);
}

fn other_series(n: usize, uid: &str, number: i32, modality: &'static str) -> Vec<Slice> {
    let rename = |s: Slice| Slice { series: uid.to_owned(), series_number: number, modality, ..s };
    stack(n).into_iter().map(rename).collect()
}

#[test]
fn series_are_told_apart_and_chosen() {
    let scout = Slice { image_type: "ORIGINAL\\PRIMARY\\LOCALIZER", cols: 4, rows: 6, ..Slice::at(99.0) };
    let one = [other_series(12, "1.9", 3, "CT"), other_series(30, "1.8", 1, "MR"), vec![scout]].concat();
    let loaded = plain(&one);
    assert_eq!(loaded.volume.grid().dims()[2], 12);
    assert!(loaded.notes[0].contains("series 3 of 3 was taken"), "{:?}", loaded.notes);
    let two = [other_series(12, "1.9", 3, "CT"), other_series(11, "1.8", 1, "CT")].concat();
    let why = refusal(&two);
    let short = "holds 2 series, 2 of them CT, and none has far more slices; choose one with --series N";
    assert!(why.ends_with(short), "{why}");
    let choices = read(&two, &LoadOptions::default()).unwrap_err().choices;
    let line =
        |n: usize, slices: usize| format!("{n}  CT  {slices} slices  0.50×0.75×2.50 mm  supine  axial  patient 1  -");
    assert_eq!(choices, [line(1, 11), line(2, 12)], "for a window to list");
    // Half as many slices could be meant, fewer are another thing.
    let reformat = |n| [other_series(12, "1.9", 3, "CT"), other_series(n, "1.8", 1, "CT")].concat();
    assert!(refusal(&reformat(6)).contains("choose one"));
    let loaded = plain(&reformat(5));
    assert!(loaded.notes[0].contains("series 2 of 2 was taken, the CT series with the most slices (12, supine)"));
    let options = LoadOptions { series: Some(2), ..LoadOptions::default() };
    assert_eq!(read(&two, &options).unwrap().volume.grid().dims()[2], 12);
    let e = read(&two, &LoadOptions { series: Some(3), ..LoadOptions::default() }).unwrap_err();
    assert!(e.why.contains("has no series 3"));
}

#[test]
fn what_cannot_be_used_matters_only_where_it_is_chosen() {
    let report = Slice { samples: 3, photometric: "RGB", ..other_series(1, "1.7", 9, "CT")[0].clone() };
    let slices = [stack(12), vec![report]].concat();
    assert_eq!(plain(&slices).volume.grid().dims()[2], 12);
    let e = read(&slices, &LoadOptions { series: Some(2), ..LoadOptions::default() }).unwrap_err();
    assert!(e.why.contains("colours"), "{e}");
}

#[test]
fn only_ct_has_hu_and_info_takes_any() {
    let mr = other_series(12, "1.9", 3, "MR");
    assert!(refusal(&mr).contains("modality is MR"));
    let text = info(&mr);
    assert_eq!(text["modality"], "MR");
    assert_eq!(text["patient_position"], "HFS");
    assert_eq!(text["series"][0]["slices"], 12);
    for secret in ["Doe", "Jane", "SECRET7", "1.9"] {
        assert!(!text.to_string().contains(&format!("\"{secret}")), "{secret}");
    }
}

#[test]
fn other_files_in_the_folder_are_passed_over() {
    let dir = tempfile::tempdir().unwrap();
    let below = dir.path().join("below");
    std::fs::create_dir(&below).unwrap();
    write_series(&below, &stack(12));
    std::fs::write(dir.path().join("readme.txt"), "not a slice").unwrap();
    std::fs::write(dir.path().join("empty"), "").unwrap();
    assert_eq!(load(dir.path()).unwrap().volume.grid().dims()[2], 12);
    // A single file is read alone.
    assert_eq!(load(&below.join("3.dcm")).unwrap().volume.grid().dims()[2], 1);
}
