//! The report, the segments and the pictures of findings as DICOM objects.

use std::fmt::Write as _;
use std::path::Path;
use std::time::UNIX_EPOCH;

use glam::DVec3;

use super::Case;
use super::outputs::Outputs;
use super::page::UNREAD;
use super::segments::Segments;
use crate::app::findings::{Finding, FindingPicture, Morphology, Outside, Tissue};
use crate::dicom::objects::{
    Capture, Code, Content, ImageReference, Node, Report, Segment, SegmentVoxels, Segmentation, Study, uid,
};
use crate::error::Result;
use crate::volume::io::identity::Identity;
use crate::volume::{Grid, Volume};

/// Numbers of the series, above those that scanners give.
const NUMBERS: [u32; 3] = [9501, 9502, 9503];
/// What every object says.
const CAUTION: &str = "Research use only. Not for diagnosis.";
/// Colour of findings.
const COLOUR: [u8; 3] = [255, 120, 200];

const MM: Code = Code::new("mm", "UCUM", "millimeter");
const MM3: Code = Code::new("mm3", "UCUM", "cubic millimeter");
const PERCENT: Code = Code::new("%", "UCUM", "Percent");
const POLYP: Code = Code::new("68496003", "SCT", "Polyp of colon");
const MASS: Code = Code::new("4147007", "SCT", "Mass");
const LIPOMA: Code = Code::new("134328007", "SCT", "Lipoma");
const COLON: Code = Code::new("71854001", "SCT", "Colon");
const ANATOMY: Code = Code::new("123037004", "SCT", "Anatomical Structure");
const LESION: Code = Code::new("49755003", "SCT", "Morphologically Abnormal Structure");
const IMAGE_REGION: Code = Code::new("111030", "DCM", "Image Region");
const COMMENT: Code = Code::new("121106", "DCM", "Comment");
const FINDING: Code = Code::new("121071", "DCM", "Finding");

/// Returns the code of a segment of the colon (PS3.16, CID 6210).
fn site(segment: Option<&str>) -> Code {
    match segment {
        Some("rectum") => Code::new("34402009", "SCT", "Rectum"),
        Some("sigmoid") => Code::new("60184004", "SCT", "Sigmoid colon"),
        Some("descending") => Code::new("32622004", "SCT", "Descending colon"),
        Some("splenic flexure") => Code::new("72592005", "SCT", "Splenic flexure of colon"),
        Some("transverse") => Code::new("485005", "SCT", "Transverse colon"),
        Some("hepatic flexure") => Code::new("48338005", "SCT", "Hepatic flexure of colon"),
        Some("ascending") => Code::new("9040008", "SCT", "Ascending colon"),
        Some("cecum") => Code::new("32713005", "SCT", "Cecum"),
        _ => COLON,
    }
}

/// Returns the code of a category of C-RADS (PS3.16, CID 6200), which has no letters.
fn assessment(scheme: &str, category: &str) -> Option<Code> {
    let known = scheme.starts_with("c-rads").then_some(category)?;
    Some(match known.get(..2)? {
        "C0" => Code::new("112240", "DCM", "C0 - Inadequate Study/Awaiting Prior Comparisons"),
        "C1" => Code::new("112241", "DCM", "C1 - Normal Colon or Benign Lesion"),
        "C2" => Code::new("112242", "DCM", "C2 - Intermediate Polyp or Indeterminate Finding"),
        "C3" => Code::new("112243", "DCM", "C3 - Polyp, Possibly Advanced Adenoma"),
        "C4" => Code::new("112244", "DCM", "C4 - Colonic Mass, Likely Malignant"),
        _ => return None,
    })
}

/// Returns the code of what a finding is.
fn kind(finding: &Finding) -> Code {
    match (finding.tissue, finding.morphology) {
        (Some(Tissue::Fat), _) => LIPOMA,
        (_, Some(Morphology::Mass)) => MASS,
        _ => POLYP,
    }
}

/// Returns the study that the objects belong to: that of `identity`, or an anonymous one. `findings` is the file of the reading, which
/// tells when it was read.
pub(super) fn study(identity: Option<&Identity>, scan: &str, findings: &Path) -> Study {
    let Some(identity) = identity else { return Study::anonymous(scan) };
    let modified = std::fs::metadata(findings).and_then(|m| m.modified()).unwrap_or(UNIX_EPOCH);
    Study::of(identity, scan, modified.duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs()))
}

/// Adds the objects to the report's files. Fails with status 5 if one cannot be written.
pub(super) fn write(case: &Case, segments: &Segments, outputs: &mut Outputs<'_>) -> Result<()> {
    let study = &case.study;
    // Objects of which anything differs are others.
    let findings = case.findings.json().to_string();
    let reading = format!("{findings} {} {study:?} {}", case.scheme.name, env!("CARGO_PKG_VERSION"));
    let ids = Ids { study, reading, scan: &case.findings.scan, grid: segments.grid() };
    for (n, (finding, pictures)) in case.findings.findings.iter().zip(&case.pictures).enumerate() {
        let Some(first) = pictures.first() else { continue };
        let marked: Vec<(&str, Vec<[u8; 3]>)> = pictures.iter().map(|p| (p.name, with_ends(p))).collect();
        let capture = Capture {
            study,
            instance: ids.capture(n),
            series: ids.of("captures"),
            series_number: NUMBERS[2],
            number: n + 1,
            description: "colvis pictures of findings, research use only",
            comment: format!("Finding {}. Crosses mark the ends of its diameter. {CAUTION}", finding.id),
            size: [first.side; 2],
            frames: marked.iter().map(|(name, rgb)| (*name, &rgb[..])).collect(),
        };
        outputs.add(&format!("capture-{:02}.dcm", n + 1), |w| capture.write(w))?;
    }
    let segmentation = Segmentation {
        study,
        seed: ids.reading.clone(),
        series: ids.of("segments"),
        series_number: NUMBERS[1],
        description: "colvis segments, research use only",
        grid: segments.grid(),
        labels: segments.labels(),
        segments: all_segments(case, segments, &ids),
    };
    for (n, frames) in segmentation.parts().iter().enumerate() {
        let name = if n == 0 { "segments.dcm".to_owned() } else { format!("segments-{:02}.dcm", n + 1) };
        outputs.add(&name, |w| segmentation.write(n, frames, w))?;
    }
    let report = Report {
        study,
        instance: ids.of("report"),
        series: ids.of("reports"),
        series_number: NUMBERS[0],
        description: "colvis CT colonography, research use only",
        root: root(case, &ids),
    };
    outputs.add("report.dcm", |w| report.write(w))
}

/// The UIDs of a reading's objects.
struct Ids<'a> {
    study: &'a Study,
    /// All that they say.
    reading: String,
    scan: &'a str,
    grid: &'a Grid,
}

impl Ids<'_> {
    fn of(&self, what: &str) -> String {
        uid(&[what, &self.reading])
    }

    fn capture(&self, n: usize) -> String {
        uid(&["capture", &self.reading, &n.to_string()])
    }

    /// Returns the UID under which what is at a place is tracked: the same in every report of the scan.
    fn tracking(&self, what: &str, place: DVec3) -> String {
        uid(&["tracking", self.scan, what, &format!("{place:?}")])
    }
}

/// Returns the segments of the colon, and a segment for each finding with a diameter.
fn all_segments(case: &Case, segments: &Segments, ids: &Ids<'_>) -> Vec<Segment> {
    let colon = segments.names().iter().map(|s| Segment {
        label: s.name.clone(),
        description: "lumen: gas and tagged fluid".to_owned(),
        category: ANATOMY,
        kind: site(Some(&s.name)),
        colour: s.colour,
        tracking: None,
        voxels: SegmentVoxels::Label(s.value),
    });
    let finding = |f: &Finding| {
        let voxels = within(segments, f.ends?);
        (!voxels.is_empty()).then(|| Segment {
            label: format!("finding {}", f.id),
            description: "tissue in the sphere over the largest diameter".to_owned(),
            category: LESION,
            kind: kind(f),
            colour: COLOUR,
            tracking: Some([format!("finding {}", f.id), ids.tracking(&f.id, f.place)]),
            voxels: SegmentVoxels::These(voxels),
        })
    };
    colon.chain(case.findings.findings.iter().filter_map(finding)).collect()
}

/// Returns the voxels outside the lumen whose centres are in the sphere over a diameter (world, mm).
fn within(segments: &Segments, [a, b]: [DVec3; 2]) -> Vec<[usize; 3]> {
    let grid = segments.grid();
    let (middle, radius) = (a.midpoint(b), 0.5 * a.distance(b));
    // The box of a sphere in voxels, on axes that may be oblique to each other.
    let to_voxel = |axis: usize| {
        let row = |world: DVec3| (grid.voxel(middle + world) - grid.voxel(middle))[axis];
        radius * DVec3::new(row(DVec3::X), row(DVec3::Y), row(DVec3::Z)).length()
    };
    let at = grid.voxel(middle);
    let range = |axis: usize| {
        let (reach, last) = (to_voxel(axis), grid.dims()[axis] as f64);
        (at[axis] - reach).ceil().clamp(0.0, last) as usize..(at[axis] + reach + 1.0).floor().clamp(0.0, last) as usize
    };
    let mut list = Vec::new();
    for (k, j) in range(2).flat_map(|k| range(1).map(move |j| (k, j))) {
        for i in range(0) {
            let centre = grid.world(DVec3::new(i as f64, j as f64, k as f64));
            if centre.distance(middle) <= radius && segments.labels()[grid.index(i, j, k)] == 0 {
                list.push([i, j, k]);
            }
        }
    }
    list
}

/// Returns the content of the report (PS3.16, TID 1500).
fn root(case: &Case, ids: &Ids<'_>) -> Node {
    let text = |code, text: &str| Node::new(code, Content::Text(text.to_owned()));
    let context = |node: Node| node.as_("HAS OBS CONTEXT");
    let language = Node::new(
        Code::new("121049", "DCM", "Language of Content Item and Descendants"),
        Content::Code(Code::new("en", "RFC5646", "English")),
    );
    let observer = [
        Node::new(Code::new("121005", "DCM", "Observer Type"), Content::Code(Code::new("121007", "DCM", "Device"))),
        Node::new(Code::new("121012", "DCM", "Device Observer UID"), Content::Uid(uid(&["observer"]))),
        text(Code::new("121013", "DCM", "Device Observer Name"), "colvis"),
        text(Code::new("121015", "DCM", "Device Observer Model Name"), concat!("colvis ", env!("CARGO_PKG_VERSION"))),
    ];
    let procedure = Node::new(
        Code::new("121058", "DCM", "Procedure reported"),
        Content::Code(Code::new("25045-6", "LN", "CT unspecified body region")),
    );
    let own = case.findings.findings.iter().enumerate().map(|(n, f)| group(n, f, ids));
    let outside = case.findings.outside.iter().enumerate().map(|(n, o)| outside(n, o, ids));
    let measurements = Node::new(Code::new("126010", "DCM", "Imaging Measurements"), Content::Container(None))
        .with(own.chain(outside));
    let draft = case.scheme.draft(&case.findings.findings, &case.findings.quality);
    let mut words = format!("{} (draft, {}): {}. {}", draft.category, case.scheme.title, draft.because, draft.advice);
    if !draft.unmeasured.is_empty() {
        let _ = write!(words, " Not counted, because without a diameter: {}.", draft.unmeasured.join(", "));
    }
    let is_read = case.findings.tells_a_reading();
    if !is_read {
        let _ = write!(words, " {UNREAD}");
    }
    // A code would be taken for the last word.
    let is_whole = is_read && draft.unmeasured.is_empty();
    let code = assessment(&case.scheme.name, &draft.category).filter(|_| is_whole);
    let code = code.map(|c| Node::new(Code::new("111005", "DCM", "Assessment Category"), Content::Code(c)));
    let beside = case.scheme.outside(&case.findings.outside);
    let beside = beside.map(|c| text(COMMENT, &format!("Outside the colon: {}, {}, as entered", c.name, c.says)));
    let evaluations = Node::new(Code::new("C0034375", "UMLS", "Qualitative Evaluations"), Content::Container(None))
        .with(
            code.into_iter()
                .chain([text(Code::new("121077", "DCM", "Conclusion"), words.trim())])
                .chain(beside)
                .chain([text(COMMENT, CAUTION)]),
        );
    Node::new(Code::new("126000", "DCM", "Imaging Measurement Report"), Content::Container(Some("1500")))
        .with([language.as_("HAS CONCEPT MOD")])
        .with(observer.map(context))
        .with([procedure.as_("HAS CONCEPT MOD"), measurements, evaluations])
}

/// Returns the beginning of a measurement group (PS3.16, TID 1410): under which name it is tracked, what it is and where.
fn begun(tracking: [String; 2], kind: Code, place: DVec3) -> Node {
    let [name, uid] = tracking;
    Node::new(Code::new("125007", "DCM", "Measurement Group"), Content::Container(Some("1410"))).with([
        Node::new(Code::new("112039", "DCM", "Tracking Identifier"), Content::Text(name)).as_("HAS OBS CONTEXT"),
        Node::new(Code::new("112040", "DCM", "Tracking Unique Identifier"), Content::Uid(uid)).as_("HAS OBS CONTEXT"),
        Node::new(FINDING, Content::Code(kind)),
        Node::new(IMAGE_REGION, Content::Points(vec![place])),
    ])
}

/// Returns the measurement group of a finding.
fn group(n: usize, f: &Finding, ids: &Ids<'_>) -> Node {
    let finding_site =
        Node::new(Code::new("363698007", "SCT", "Finding Site"), Content::Code(site(f.segment.as_deref())))
            .as_("HAS CONCEPT MOD");
    let number = |code, value: Option<f64>, unit| value.map(|v| Node::new(code, Content::Number(v, unit)));
    let ends = f
        .ends
        .map(|ends| Node::new(Code::new("121055", "DCM", "Path"), Content::Points(ends.to_vec())).as_("INFERRED FROM"));
    let largest = number(Code::new("373197004", "SCT", "Polyp size, largest dimension"), f.diameter_mm, MM);
    let largest = largest.map(|node| node.with(ends));
    let numbers = [
        largest,
        number(Code::new("121207", "DCM", "Height"), f.height_mm, MM),
        number(Code::new("118565006", "SCT", "Volume"), f.volume_mm3, MM3),
        number(Code::new("112233", "DCM", "Distance from anus"), f.along_mm, MM),
        number(Code::new("111012", "DCM", "Certainty of Finding"), f.confidence.map(|c| 100.0 * c), PERCENT),
    ];
    let form = f.morphology.and_then(|m| {
        Some(match m {
            Morphology::Sessile => Code::new("5712003", "SCT", "Sessile"),
            Morphology::Pedunculated => Code::new("25126001", "SCT", "Pedunculated"),
            Morphology::Flat => Code::new("6041008", "SCT", "Flat"),
            // The finding itself says so.
            Morphology::Mass => return None,
        })
    });
    let form = form.map(|c| Node::new(Code::new("116676008", "SCT", "Associated Morphology"), Content::Code(c)));
    let tissue = f.tissue.map(|t| match t {
        Tissue::Soft => Code::new("87784001", "SCT", "Soft tissue"),
        Tissue::Fat => Code::new("256674009", "SCT", "Fat"),
    });
    let tissue = tissue.map(|c| Node::new(Code::new("85756007", "SCT", "Tissue"), Content::Code(c)));
    let note = (!f.note.trim().is_empty()).then(|| Node::new(COMMENT, Content::Text(f.note.clone())));
    let pictures = ImageReference {
        series: ids.of("captures"),
        class: Capture::CLASS.to_owned(),
        instance: ids.capture(n),
        frames: Vec::new(),
    };
    let pictures = Node::new(Code::new("121200", "DCM", "Illustration of ROI"), Content::Image(pictures));
    begun([format!("finding {}", f.id), ids.tracking(&f.id, f.place)], kind(f), f.place)
        .with([finding_site])
        .with(numbers.into_iter().flatten())
        .with(form.into_iter().chain(tissue).chain(note))
        .with([pictures])
        .with(source(f.place, ids))
}

/// Returns the measurement group of a finding outside the colon.
fn outside(n: usize, o: &Outside, ids: &Ids<'_>) -> Node {
    let words = [&o.category[..], &o.text].map(str::trim).into_iter().filter(|w| !w.is_empty()).collect::<Vec<_>>();
    let words = if words.is_empty() { String::new() } else { format!(": {}", words.join(", ")) };
    let tracking = [format!("outside {}", n + 1), ids.tracking("outside", o.place)];
    begun(tracking, Code::new("404684003", "SCT", "Clinical finding"), o.place)
        .with([Node::new(COMMENT, Content::Text(format!("outside the colon{words}")))])
        .with(source(o.place, ids))
}

/// Returns the slice of the scan at a place; `None` if it may not be told.
fn source(place: DVec3, ids: &Ids<'_>) -> Option<Node> {
    let series = ids.study.series.clone()?;
    let normal = ids.grid.direction().x_axis.cross(ids.grid.direction().y_axis).normalize_or_zero();
    let image = ids.study.nearest(place, normal, ids.grid.spacing().max_element())?;
    let (class, instance) = (image.class.clone(), image.instance.clone());
    let image = ImageReference { series, class, instance, frames: image.frame.into_iter().collect() };
    Some(Node::new(Code::new("260753009", "SCT", "Source"), Content::Image(image)))
}

/// Returns a picture with a cross at each end of the diameter, as the page has them.
fn with_ends(picture: &FindingPicture) -> Vec<[u8; 3]> {
    let mut rgb = picture.rgb.clone();
    let side = picture.side as i64;
    // Dark around bright, so that it shows on everything.
    for (reach, width, colour) in [(6_i64, 1_i64, [0; 3]), (5, 0, COLOUR)] {
        for [x, y] in picture.ends.into_iter().flatten().map(|end| end.map(|x| x.round() as i64)) {
            for (along, beside) in (-reach..=reach).flat_map(|a| (-width..=width).map(move |b| (a, b))) {
                for (px, py) in [(x + along, y + beside), (x + beside, y + along)] {
                    if (0..side).contains(&px) && (0..side).contains(&py) {
                        rgb[(py * side + px) as usize] = colour;
                    }
                }
            }
        }
    }
    rgb
}

/// Refuses what cannot be a DICOM image. Fails with status 3.
pub(super) fn check(volume: &Volume, input: &Path) -> Result<()> {
    let [nx, ny, _] = volume.grid().dims();
    if nx.max(ny) > usize::from(u16::MAX) {
        let why = format!("has slices of {nx}×{ny} voxels, too many for DICOM");
        return Err(crate::error::Error::file(input, why, "leave --dicom out"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn categories_have_their_codes_and_those_of_other_schemes_none() {
        assert_eq!(assessment("c-rads-2023", "C2a").unwrap().value, "112242");
        assert_eq!(assessment("england", "C2"), None);
        assert_eq!(assessment("c-rads-2023", "é"), None);
        assert!(crate::fields::lumen::NAMES.iter().all(|name| site(Some(name)) != COLON));
    }
}
