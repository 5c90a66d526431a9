//! The series of a DICOM study, as they are listed. A list holds no identity of a patient.

use std::fmt::Write as _;

use crate::volume::PatientPosition;

/// One series of a folder.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Its number in the list, from 1, as `--series` takes it.
    pub number: usize,
    /// The scanner's number of the series.
    pub series_number: Option<i64>,
    /// CT, MR, …
    pub modality: String,
    /// Number of slices; 0 if it holds no image.
    pub slices: usize,
    /// Number of columns and of rows of a slice.
    pub size: [u16; 2],
    /// Distance between columns, rows and slices, mm.
    pub spacing_mm: Option<[f64; 3]>,
    /// The header's code of the patient's position: HFS, FFP, …
    pub patient_position: Option<String>,
    /// The scanner's description of the series, cleaned, without the patient's name.
    pub description: String,
    /// Number of the patient among those of the folder, from 1.
    pub patient: usize,
    /// Number of the study among those of the folder, from 1.
    pub study: usize,
    /// Plane of the slices: axial, coronal, sagittal or oblique.
    pub plane: Option<&'static str>,
    /// True if it counts as a CT series when one is chosen.
    pub counts: bool,
    /// Why it cannot be opened as a scan; `None` if it can.
    pub why: Option<String>,
    /// Numbers of the series of the same patient in another position.
    pub pair: Vec<usize>,
}

impl Series {
    /// Returns the patient's position in words: supine, prone, right decubitus or left decubitus.
    pub fn position(&self) -> Option<&'static str> {
        self.patient_position.as_deref().and_then(PatientPosition::of_header).map(PatientPosition::name)
    }

    /// Returns the spacing in words, mm, such as `0.70×0.70×1.00 mm`.
    pub fn spacing_text(&self) -> String {
        self.spacing_mm.map_or_else(|| "-".to_owned(), |[x, y, z]| format!("{x:.2}×{y:.2}×{z:.2} mm"))
    }
}

/// A small picture of a series: rows of grey pixels from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// Grey levels.
    pub grey: Vec<u8>,
}

/// The series of a study, with a picture of each that can be decoded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Study {
    /// The series, in the order in which `--series` counts them.
    pub series: Vec<Series>,
    /// Their pictures.
    pub pictures: Vec<Option<Picture>>,
    /// Index of the series that opens without a choice.
    pub usual: Option<usize>,
}

/// Returns one line for each series, in aligned columns: number, modality, slices, spacing, position, plane, patient,
/// description, the series of the same patient in another position, and why it cannot be opened.
pub fn table(list: &[Series]) -> Vec<String> {
    let columns = |s: &Series| {
        [
            s.number.to_string(),
            s.modality.clone(),
            format!("{} {}", s.slices, if s.slices == 1 { "slice" } else { "slices" }),
            s.spacing_text(),
            s.position().unwrap_or("-").to_owned(),
            s.plane.unwrap_or("-").to_owned(),
            format!("patient {}", s.patient),
        ]
    };
    let rows: Vec<[String; 7]> = list.iter().map(columns).collect();
    let wide: [usize; 7] = std::array::from_fn(|k| rows.iter().map(|r| r[k].chars().count()).max().unwrap_or(0));
    let line = |(s, row): (&Series, &[String; 7])| {
        let mut line = String::new();
        for (k, (cell, wide)) in row.iter().zip(wide).enumerate() {
            let between = if k == 0 { "" } else { "  " };
            // Numbers end in one column, and words begin in one. Writing to a string cannot fail.
            let _ = match k {
                0 | 2 => write!(line, "{between}{cell:>wide$}"),
                _ => write!(line, "{between}{cell:<wide$}"),
            };
        }
        let _ = write!(line, "  {}", if s.description.is_empty() { "-" } else { &s.description });
        if !s.pair.is_empty() {
            let pair: Vec<String> = s.pair.iter().map(usize::to_string).collect();
            let _ = write!(line, " (same patient as {})", pair.join(", "));
        }
        if let Some(why) = &s.why {
            let _ = write!(line, " (cannot be opened: {why})");
        }
        line
    };
    list.iter().zip(&rows).map(line).collect()
}

/// Finds the series of each patient in another position: same patient, same study or frame of reference, and both positions
/// known. `frames` are the frames of reference in the order of the list; `None` where unknown.
#[cfg(any(feature = "dicom", test))]
pub(in crate::volume::io) fn pair(list: &mut [Series], frames: &[Option<u64>]) {
    let pairs: Vec<Vec<usize>> = (list.iter().zip(frames))
        .map(|(a, frame_a)| {
            let other = |(b, frame_b): &(&Series, &Option<u64>)| {
                let known = a.position().zip(b.position()).is_some_and(|(p, q)| p != q);
                let together = a.study == b.study || frame_a.is_some() && frame_a == *frame_b;
                a.counts && b.counts && known && a.patient == b.patient && together
            };
            list.iter().zip(frames).filter(other).map(|(b, _)| b.number).collect()
        })
        .collect();
    for (series, pair) in list.iter_mut().zip(pairs) {
        series.pair = pair;
    }
}

/// Returns the index of the CT series with the most slices, if no other CT series has half as many.
#[cfg(any(feature = "dicom", test))]
pub(in crate::volume::io) fn usual(list: &[Series]) -> Option<usize> {
    let counting = || list.iter().enumerate().filter(|(_, s)| s.counts);
    // Of equals the first, which the rule below then refuses.
    let (best, most) = counting().rev().max_by_key(|(_, s)| s.slices)?;
    counting().all(|(k, s)| k == best || 2 * s.slices < most.slices).then_some(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(number: usize, slices: usize, code: &str) -> Series {
        let patient_position = (!code.is_empty()).then(|| code.to_owned());
        let modality = "CT".to_owned();
        Series { number, slices, modality, patient_position, patient: 1, study: 1, counts: true, ..Series::default() }
    }

    #[test]
    fn half_as_many_slices_are_a_rival() {
        let chosen = |slices: &[usize]| {
            usual(&slices.iter().enumerate().map(|(k, n)| series(k + 1, *n, "HFS")).collect::<Vec<_>>())
        };
        assert_eq!(chosen(&[12]), Some(0));
        assert_eq!(chosen(&[5, 12, 3]), Some(1));
        assert_eq!(chosen(&[6, 12]), None, "half as many");
        assert_eq!(chosen(&[12, 12]), None);
        assert_eq!(chosen(&[7, 15]), Some(1), "less than half");
        assert_eq!(chosen(&[]), None);
        let scout = Series { counts: false, ..series(1, 400, "HFS") };
        assert_eq!(usual(&[scout.clone(), series(2, 3, "HFS")]), Some(1));
        assert_eq!(usual(&[scout]), None);
    }

    #[test]
    fn positions_of_one_patient_are_a_pair() {
        let mut list: Vec<Series> =
            ["HFS", "FFP", "HFS", "HFP", "HFP", "", "HFDL"].iter().zip(1..).map(|(c, n)| series(n, 9, c)).collect();
        list[3].patient = 2;
        (list[4].study, list[6].study) = (2, 3);
        let frames = [Some(7), Some(8), None, Some(7), Some(7), None, None];
        pair(&mut list, &frames);
        let pairs: Vec<&[usize]> = list.iter().map(|s| &s.pair[..]).collect();
        // Series 5 is of another study, in the frame of reference of series 1 only.
        assert_eq!(pairs, [&[2, 5][..], &[1, 3], &[2], &[], &[1], &[], &[]]);
        list[1].counts = false;
        pair(&mut list, &frames);
        assert_eq!(list[0].pair, [5], "a localizer is no scan");
    }

    #[test]
    fn every_code_of_a_position_has_a_name() {
        let names = ["HFS", "FFS", "HFP", "FFP", "HFDR", "FFDR", "HFDL", "FFDL", "LFP", ""]
            .map(|code| PatientPosition::of_header(code).map(PatientPosition::name));
        let [right, left] = [Some("right decubitus"), Some("left decubitus")];
        let [supine, prone] = [Some("supine"), Some("prone")];
        assert_eq!(names, [supine, supine, prone, prone, right, right, left, left, None, None]);
    }

    #[test]
    fn columns_are_aligned() {
        let spacing_mm = Some([0.7, 0.7, 1.0]);
        let one = Series { spacing_mm, plane: Some("axial"), pair: vec![2], ..series(1, 400, "HFS") };
        let two =
            Series { description: "Scout".to_owned(), why: Some("a localizer".to_owned()), ..series(2, 1, "HFP") };
        let lines = table(&[one, two]);
        assert_eq!(lines[0], "1  CT  400 slices  0.70×0.70×1.00 mm  supine  axial  patient 1  - (same patient as 2)");
        assert_eq!(
            lines[1],
            "2  CT     1 slice  -                  prone   -      patient 1  Scout (cannot be opened: a localizer)"
        );
        assert!(table(&[]).is_empty());
    }
}
