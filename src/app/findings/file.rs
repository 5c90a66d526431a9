//! The file of findings.

use std::collections::BTreeSet;
use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Value, json};

use super::{Finding, Findings, Outside, Quality};
use crate::error::{Error, Result};
use crate::fields::lumen::{GasKind, Told};
use crate::output;
use crate::polyps::answers::{self, Answered};

/// The current version of the file format.
const VERSION: u64 = 1;
/// The value of "colvis" in files of findings.
const KIND: &str = "findings";
/// How the hash of a scan begins.
const HASHED: &str = "sha256:";
/// Maximum number of findings, of those outside the colon, and of segments.
const MOST: usize = 1000;
/// Maximum number of distances.
pub const MOST_DISTANCES: usize = 500;
/// Maximum number of places with a kind of gas.
pub const MOST_KINDS: usize = 200;
/// Maximum number of characters of a text.
const LONGEST: usize = 20_000;
/// Largest coordinate of a place, mm.
const FARTHEST_MM: f64 = 1e5;
/// Maximum size of a file, bytes.
const MOST_BYTES: u64 = 64 << 20;

/// Whether a file must name its scan. Those of versions before 0.3 did not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoScan {
    /// It may lack the hash.
    Allowed,
    /// It must have it.
    Refused,
}

/// The file format.
#[derive(Serialize, Deserialize)]
struct File {
    version: u64,
    #[serde(default)]
    colvis: Option<String>,
    scan: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    origin: Option<DVec3>,
    #[serde(default)]
    second: Option<String>,
    #[serde(default)]
    findings: Vec<Finding>,
    #[serde(default)]
    outside: Vec<Outside>,
    #[serde(default)]
    quality: Vec<Quality>,
    #[serde(default)]
    answers: Vec<Answered>,
    #[serde(default)]
    distances: Vec<[DVec3; 2]>,
    /// Each with `at`, world mm, and `kind`.
    #[serde(default)]
    kinds: Option<Vec<Value>>,
}

/// An entry of the kinds.
#[derive(Deserialize)]
struct Entry {
    at: DVec3,
    kind: GasKind,
}

impl Findings {
    /// Reads a file of findings. Entries of kinds that are not places with a kind of gas are left out. `hint` becomes the hint of an error.
    ///
    /// # Errors
    /// Returns status 3 if the file cannot be read, is another file or of another version, or holds an impossible value.
    pub fn read(path: &Path, no_scan: NoScan, hint: &str) -> Result<Self> {
        let wrong = |why: String| Error::file(path, why, hint);
        if std::fs::metadata(path).is_ok_and(|m| m.len() > MOST_BYTES) {
            return Err(wrong(format!("is larger than {} MiB", MOST_BYTES >> 20)));
        }
        let text = output::read_text(path, hint)?;
        // The version first: another one may differ in everything else.
        #[derive(Deserialize)]
        struct Version {
            version: u64,
        }
        let Version { version } = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()).caused_by(e))?;
        if version != VERSION {
            return Err(wrong(format!("has version {version}; this program reads version {VERSION}")));
        }
        let file: File = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()).caused_by(e))?;
        let known = [KIND, answers::KIND];
        if let Some(kind) = file.colvis.as_deref().filter(|kind| !known.contains(kind)) {
            return Err(wrong(format!("\"colvis\" is \"{kind}\" and not \"{KIND}\"")));
        }
        let is_hashed = |scan: &str| {
            let digits = scan.strip_prefix(HASHED).unwrap_or_default();
            !digits.is_empty() && digits.chars().all(|c| c.is_ascii_hexdigit())
        };
        if no_scan == NoScan::Refused && !is_hashed(&file.scan) {
            return Err(wrong(format!("\"scan\" is \"{}\" and not the hash of a scan, sha256:...", file.scan)));
        }
        if let Some(why) = file.impossible() {
            return Err(wrong(why));
        }
        Ok(file.into_findings(is_hashed))
    }

    /// Writes the findings to a file, in one piece.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be written. An existing file stays as it is.
    pub fn write(&self, path: &Path) -> Result<()> {
        output::write_json(path, &self.json())
    }

    /// Returns the findings as in a file.
    pub fn json(&self) -> Value {
        let kinds = self.kinds.iter().flatten().map(|(at, kind)| json!({ "at": at, "kind": kind })).collect();
        json!(File {
            version: VERSION,
            colvis: Some(KIND.to_owned()),
            scan: self.scan.clone(),
            origin: self.origin,
            second: self.second.clone(),
            findings: self.findings.clone(),
            outside: self.outside.clone(),
            quality: self.quality.clone(),
            answers: self.answers.clone(),
            distances: self.distances.clone(),
            kinds: Some(kinds),
        })
    }
}

impl File {
    /// Returns what of the file is impossible.
    fn impossible(&self) -> Option<String> {
        let counts =
            [("findings", self.findings.len()), ("outside", self.outside.len()), ("quality", self.quality.len())];
        if let Some((list, count)) = counts.into_iter().find(|(_, count)| *count > MOST) {
            return Some(format!("\"{list}\" has {count} entries; at most {MOST} are read"));
        }
        let mut ids = BTreeSet::new();
        for (n, finding) in self.findings.iter().enumerate() {
            let name = if finding.id.is_empty() { format!("{}", n + 1) } else { finding.id.clone() };
            if let Some(why) = finding.impossible() {
                return Some(format!("finding {name}: {why}"));
            }
            if !finding.id.is_empty() && !ids.insert(&finding.id) {
                return Some(format!("finding {name}: its id is there twice"));
            }
        }
        for (n, outside) in self.outside.iter().enumerate() {
            let why = far("place", outside.place)
                .or_else(|| long("category", &outside.category))
                .or_else(|| long("text", &outside.text));
            if let Some(why) = why {
                return Some(format!("finding {} outside the colon: {why}", n + 1));
            }
        }
        for quality in &self.quality {
            if let Some(why) = quality.impossible() {
                return Some(format!("quality of \"{}\": {why}", quality.segment));
            }
        }
        for (n, ends) in self.distances.iter().enumerate() {
            if let Some(why) = ends.iter().find_map(|end| far("end", *end)) {
                return Some(format!("distance {}: {why}", n + 1));
            }
        }
        let answer =
            self.answers.iter().find_map(|a| Some(format!("answer to {}: {}", a.rank, far("position", a.position)?)));
        answer.or_else(|| answers::impossible(&self.answers)).or_else(|| far("origin", self.origin?))
    }

    fn into_findings(self, is_hashed: impl Fn(&str) -> bool) -> Findings {
        let mut all = Findings {
            scan: if is_hashed(&self.scan) { self.scan } else { String::new() },
            origin: self.origin,
            second: self.second,
            findings: Vec::with_capacity(self.findings.len()),
            outside: self.outside,
            quality: self.quality,
            answers: self.answers,
            distances: self.distances.into_iter().take(MOST_DISTANCES).collect(),
            kinds: self.kinds.map(kinds),
        };
        // Those without a name get one that no other has.
        let mut unnamed = Vec::new();
        for (n, finding) in self.findings.into_iter().enumerate() {
            if finding.id.is_empty() {
                unnamed.push(n);
            }
            all.findings.push(finding);
        }
        for n in unnamed {
            all.findings[n].id = all.new_id();
        }
        all
    }
}

impl Finding {
    fn impossible(&self) -> Option<String> {
        let places = [("place", Some(self.place)), ("other", self.other)];
        let ends = self.ends.into_iter().flatten().map(|end| ("ends", Some(end)));
        let view = self.view.map(|v| v.position);
        let mut places = places.into_iter().chain(ends).chain([("view: position", view)]);
        let sizes = [
            ("along_mm", self.along_mm),
            ("diameter_mm", self.diameter_mm),
            ("height_mm", self.height_mm),
            ("volume_mm3", self.volume_mm3),
        ];
        places
            .find_map(|(name, place)| far(name, place?))
            .or_else(|| sizes.into_iter().find_map(|(name, size)| negative(name, size?)))
            .or_else(|| share("confidence", self.confidence?))
            .or_else(|| bent("normal", self.normal?))
            .or_else(|| self.view.and_then(|v| v.impossible()))
            .or_else(|| long("id", &self.id).or_else(|| long("note", &self.note)))
            .or_else(|| long("segment", self.segment.as_deref()?))
    }
}

impl super::View {
    fn impossible(&self) -> Option<String> {
        bent("view: forward", self.forward)
            .or_else(|| bent("view: up", self.up))
            .or_else(|| {
                let is_parallel = self.forward.normalize().cross(self.up.normalize()).length() < 1e-3;
                is_parallel.then(|| "view: up lies along forward".to_owned())
            })
            .or_else(|| {
                let fov = self.fov_degrees;
                (!(fov > 0.0 && fov < 180.0)).then(|| format!("view: fov_degrees is {fov}, not between 0 and 180"))
            })
    }
}

impl Quality {
    fn impossible(&self) -> Option<String> {
        let sizes =
            [("length_mm", self.length_mm), ("least_caliber_mm", self.least_caliber_mm), ("seconds", self.seconds)];
        let shares = [("distended", Some(self.distended)), ("fluid", Some(self.fluid)), ("coverage", self.coverage)];
        sizes
            .into_iter()
            .find_map(|(name, size)| negative(name, size))
            .or_else(|| shares.into_iter().find_map(|(name, x)| share(name, x?)))
            .or_else(|| long("segment", &self.segment))
    }
}

/// Returns why a place is none.
fn far(name: &str, place: DVec3) -> Option<String> {
    let is_near = place.is_finite() && place.abs().max_element() <= FARTHEST_MM;
    (!is_near).then(|| format!("{name} is not within {FARTHEST_MM:.0} mm"))
}

fn negative(name: &str, size: f64) -> Option<String> {
    (!(size >= 0.0 && size.is_finite())).then(|| format!("{name} is {size}, not 0 or more"))
}

fn share(name: &str, x: f64) -> Option<String> {
    (!(0.0..=1.0).contains(&x)).then(|| format!("{name} is {x}, not between 0 and 1"))
}

/// Returns why a direction is none.
fn bent(name: &str, direction: DVec3) -> Option<String> {
    let length = direction.length();
    (!(0.5..=2.0).contains(&length)).then(|| format!("{name} has length {length}, not 1"))
}

fn long(name: &str, text: &str) -> Option<String> {
    let count = text.chars().count();
    (count > LONGEST).then(|| format!("{name} has {count} characters; at most {LONGEST} are read"))
}

/// Returns the entries that are places with a kind of gas.
#[doc(hidden)]
pub fn kinds(list: Vec<Value>) -> Vec<Told> {
    let valid = list.into_iter().filter_map(|e| serde_json::from_value::<Entry>(e).ok());
    let near = valid.filter(|e| far("at", e.at).is_none());
    near.map(|e| (e.at, e.kind)).take(MOST_KINDS).collect()
}

/// Reads a name that may be a number.
pub(super) fn text_or_number<'de, D: Deserializer<'de>>(from: D) -> std::result::Result<String, D::Error> {
    match Value::deserialize(from)? {
        Value::String(text) => Ok(text),
        Value::Number(number) => Ok(number.to_string()),
        Value::Null => Ok(String::new()),
        other => Err(serde::de::Error::custom(format!("id {other} is neither a text nor a number"))),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Morphology, Tissue, View};
    use super::*;
    use crate::error::Kind;
    use crate::polyps::answers::{Answer, Answers};

    const SCAN: &str = "sha256:0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";

    fn all() -> Findings {
        let place = DVec3::new(0.1, -250.5, 1e-3);
        let finding = Finding {
            id: "7".to_owned(),
            place,
            normal: Some(DVec3::Y),
            segment: Some("sigmoid".to_owned()),
            along_mm: Some(310.25),
            diameter_mm: Some(8.1),
            ends: Some([place - DVec3::X * 4.0, place + DVec3::X * 4.1]),
            height_mm: Some(3.5),
            volume_mm3: Some(77.0),
            morphology: Some(Morphology::Pedunculated),
            tissue: Some(Tissue::Fat),
            confidence: Some(0.8),
            note: "on a \"fold\"\nüber the valve".to_owned(),
            view: Some(View {
                position: place + DVec3::Y * 20.0,
                forward: DVec3::NEG_Y,
                up: DVec3::Z,
                fov_degrees: 90.0,
            }),
            other: Some(DVec3::ZERO),
        };
        Findings {
            scan: SCAN.to_owned(),
            origin: Some(DVec3::new(-180.0, -180.0, 77.5)),
            second: Some(SCAN.replace('0', "f")),
            findings: vec![finding, Finding { id: "8".to_owned(), place, ..Finding::default() }],
            outside: vec![Outside { place, category: "E3".to_owned(), text: "a cyst of the left kidney".to_owned() }],
            quality: vec![Quality {
                segment: "cecum".to_owned(),
                length_mm: 40.0,
                coverage: None,
                ..Quality::default()
            }],
            answers: vec![Answered { rank: 3, position: place, answer: Some(Answer::Yes), note: String::new() }],
            distances: vec![[place, DVec3::ZERO]],
            kinds: Some(vec![(place, GasKind::SmallBowel)]),
        }
    }

    fn read(path: &Path) -> Result<Findings> {
        Findings::read(path, NoScan::Refused, "do something")
    }

    #[test]
    fn what_is_written_is_read_and_its_answers_are_answers() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f.json");
        let empty = Findings { scan: SCAN.to_owned(), kinds: Some(Vec::new()), ..Findings::default() };
        for findings in [all(), empty] {
            findings.write(&path).unwrap();
            assert_eq!(read(&path).unwrap(), findings);
            let answers = Answers::read(&path).unwrap();
            assert_eq!((answers.scan.as_str(), answers.answers), (SCAN, findings.answers));
        }
        assert_eq!(all().write(&dir.path().join("no/f.json")).unwrap_err().kind, Kind::Output);
    }

    #[test]
    fn a_file_of_another_program_needs_little() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f.json");
        let text = format!(
            r#"{{"version": 1, "scan": "{SCAN}", "second": null, "more": [1], "findings": [
                {{"id": 4, "place": [1, 2, 3], "diameter_mm": 7, "morphology": "flat", "other": null, "reader": "b"}},
                {{"place": [1, 2, 3]}}, {{"place": [1, 2, 3], "id": null, "note": "n"}}]}}"#
        );
        std::fs::write(&path, &text).unwrap();
        let found = read(&path).unwrap();
        let ids: Vec<&str> = found.findings.iter().map(|f| f.id.as_str()).collect();
        assert_eq!(ids, ["4", "5", "6"]);
        assert_eq!(found.findings[0].morphology, Some(Morphology::Flat));
        assert_eq!((found.new_id().as_str(), found.kinds), ("7", None));
        // Files of earlier versions name their scan by their own name.
        std::fs::write(&path, text.replace(SCAN, "00ff")).unwrap();
        assert!(read(&path).unwrap_err().why.contains("00ff"));
        assert_eq!(Findings::read(&path, NoScan::Allowed, "").unwrap().scan, "");
    }

    #[test]
    fn damaged_files_are_refused_with_what_is_wrong() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f.json");
        let whole = all().json().to_string();
        let changed = |what: &str, to: &str| {
            assert!(whole.contains(what), "{what}: {whole}");
            whole.replacen(what, to, 1)
        };
        for (text, told) in [
            (String::new(), "EOF"),
            (whole[..whole.len() / 2].to_owned(), "EOF"),
            ("[]".to_owned(), "invalid length"),
            (changed("\"version\":1", "\"version\":2"), "version 2"),
            (changed("\"version\":1", "\"version\":\"1\""), "invalid type"),
            (changed("\"colvis\":\"findings\"", "\"colvis\":\"list\""), "list"),
            (changed(SCAN, "sha256:none"), "sha256:none"),
            (changed("8.1", "-1.0"), "finding 7: diameter_mm is -1"),
            (changed("\"confidence\":0.8", "\"confidence\":1.5"), "finding 7: confidence is 1.5"),
            (changed("310.25", "1e999"), "out of range"),
            (changed("\"id\":\"8\"", "\"id\":\"7\""), "finding 7: its id is there twice"),
            (changed("\"id\":\"8\"", "\"id\":[]"), "neither a text nor a number"),
            (changed("pedunculated", "stalked"), "stalked"),
            (changed("\"fov_degrees\":90.0", "\"fov_degrees\":180.0"), "fov_degrees is 180"),
            (changed("\"up\":[0.0,0.0,1.0]", "\"up\":[0.0,1.0,0.0]"), "view: up lies along forward"),
            (changed("\"up\":[0.0,0.0,1.0]", "\"up\":[0.0,0.0,0.0]"), "view: up has length 0"),
            (changed("\"normal\":[0.0,1.0,0.0]", "\"normal\":[0.0,9.0,0.0]"), "normal has length 9"),
            (changed("\"length_mm\":40.0", "\"length_mm\":-40.0"), "quality of \"cecum\": length_mm"),
            (changed("\"rank\":3", "\"rank\":0"), "rank 0"),
            (changed("[0.1,-250.5,0.001]", "[0.1,-250.5e9,0.001]"), "not within"),
        ] {
            std::fs::write(&path, &text).unwrap();
            let e = read(&path).expect_err(&text);
            assert!(e.kind == Kind::Input && e.what.ends_with("f.json") && e.why.contains(told), "{told}: {e}");
            assert!(!e.to_string().contains('\n'));
        }
        assert_eq!(read(&dir.path().join("none.json")).unwrap_err().kind, Kind::Input);
        assert_eq!(read(dir.path()).unwrap_err().kind, Kind::Input);
    }

    #[test]
    fn findings_move_with_a_file_that_lies_elsewhere() {
        let by = DVec3::new(1.0, -20.0, 300.0);
        let there = all().moved_to(all().origin.unwrap() + by);
        let (a, b) = (&all().findings[0], &there.findings[0]);
        assert_eq!((b.place, b.ends.unwrap()[1]), (a.place + by, a.ends.unwrap()[1] + by));
        assert_eq!((b.view.unwrap().position, b.other), (a.view.unwrap().position + by, a.other));
        assert_eq!(there.outside[0].place, a.place + by);
        assert_eq!((there.answers[0].position, there.distances[0][1]), (a.place + by, by));
        assert_eq!(there.kinds.as_ref().unwrap()[0].0, a.place + by);
        assert_eq!(all().moved_to(all().origin.unwrap()), all());
        assert_eq!(Findings { origin: None, ..all() }.moved_to(by).findings[0].place, a.place);
    }

    #[test]
    fn kinds_that_are_none_are_left_out() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f.json");
        let entries = r#"[7, null, {"at": [1, 2], "kind": "colon"}, {"at": [1, 2, 3], "kind": "gall bladder"},
            {"at": [1e300, 0, 0], "kind": "colon"}, {"at": [1, 2, 3], "kind": "lung", "more": []}, {"kind": "lung"}]"#;
        std::fs::write(&path, format!(r#"{{"version": 1, "scan": "{SCAN}", "kinds": {entries}}}"#)).unwrap();
        assert_eq!(read(&path).unwrap().kinds, Some(vec![(DVec3::new(1.0, 2.0, 3.0), GasKind::Lung)]));
    }
}
