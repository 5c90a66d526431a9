//! The file of what a reader finds in a scan: distances, answers to candidates, and kinds of gas.
//!
//! It lies beside the session and is named like it. A session is removed once the flight has arrived; what the reader said stays.
//! The file is one of [answers](crate::polyps::answers), too, so `--answers` takes it. Earlier versions kept three files. They are read
//! as long as there is no such file, and left as they are.

use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::folders;
use super::measures::{self, Measure};
use super::session::ScanFiles;
use crate::error::{Error, Result};
use crate::fields::lumen::{GasKind, Told};
use crate::polyps::answers::{Answered, Answers};

/// The current version of the file format, and of the earlier ones.
const VERSION: u32 = 1;
/// Consequence of an invalid file, for messages.
const HINT: &str = "move it away, then open the scan again";
/// Maximum number of places with a kind.
pub(crate) const MOST_KINDS: usize = 200;
/// Largest coordinate of such a place, mm.
const FARTHEST_MM: f64 = 1e5;

/// What a reader has found in a scan.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Findings {
    pub(crate) distances: Vec<Measure>,
    pub(crate) answers: Vec<Answered>,
    /// `None` if no file tells.
    pub(crate) kinds: Option<Vec<Told>>,
}

/// The file format.
#[derive(Serialize, Deserialize)]
struct Kept {
    version: u32,
    colvis: String,
    /// Not the scan's name, which may identify the patient.
    scan: String,
    answers: Vec<Answered>,
    /// The ends of each, world mm.
    distances: Vec<[[f64; 3]; 2]>,
    /// Each with `at`, world mm, and `kind`.
    kinds: Vec<Value>,
}

/// The earlier format of distances.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeptDistances {
    version: u32,
    measures: Vec<[[f64; 3]; 2]>,
}

/// The earlier format of kinds.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeptKinds {
    version: u32,
    told: Vec<Value>,
}

macro_rules! kept {
    ($($format:ty),*) => {
        $(impl folders::Kept for $format {
            const VERSION: u32 = VERSION;

            fn version(&self) -> u32 {
                self.version
            }
        })*
    };
}
kept!(Kept, KeptDistances, KeptKinds);

/// An entry of the kinds.
#[derive(Deserialize)]
struct Entry {
    at: [f64; 3],
    kind: GasKind,
}

/// Reads what was found in a scan; nothing if there is no file. Kinds that are invalid are ignored. If a file is damaged, returns what
/// the others say, and its error with status 3.
pub(crate) fn read(files: &ScanFiles) -> (Findings, Option<Error>) {
    if let Some(path) = files.findings.as_deref().filter(|path| path.exists()) {
        return match read_current(path) {
            Ok(found) => (found, None),
            Err(e) => (Findings::default(), Some(e)),
        };
    }
    let (mut found, mut damaged) = (Findings::default(), None);
    let mut note = |e| _ = damaged.get_or_insert(e);
    match files.measures.as_deref().map_or(Ok(None), |path| folders::read_kept::<KeptDistances>(path, HINT)) {
        Ok(kept) => found.distances = kept.map_or_else(Vec::new, |kept| distances(kept.measures)),
        Err(e) => note(e),
    }
    match files.answers.as_deref().filter(|path| path.exists()).map(answers).transpose() {
        Ok(answers) => found.answers = answers.unwrap_or_default(),
        Err(e) => note(e),
    }
    match files.kinds.as_deref().map_or(Ok(None), |path| folders::read_kept::<KeptKinds>(path, HINT)) {
        Ok(kept) => found.kinds = kept.map(|kept| kinds(kept.told)),
        Err(e) => note(e),
    }
    (found, damaged)
}

/// Reads the file of the findings.
fn read_current(path: &Path) -> Result<Findings> {
    let answers = answers(path)?;
    let Some(kept) = folders::read_kept::<Kept>(path, HINT)? else { return Ok(Findings::default()) };
    Ok(Findings { distances: distances(kept.distances), answers, kinds: Some(kinds(kept.kinds)) })
}

fn answers(path: &Path) -> Result<Vec<Answered>> {
    let answers = Answers::read(path).map_err(|mut e| {
        HINT.clone_into(&mut e.hint);
        e
    })?;
    Ok(answers.answers)
}

/// Writes what was found in a scan to its file.
///
/// # Errors
/// Returns status 5 if it cannot be written.
pub(crate) fn keep(path: &Path, found: &Findings) -> Result<()> {
    let kept = Kept {
        version: VERSION,
        colvis: "answers".to_owned(),
        scan: path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default(),
        answers: found.answers.clone(),
        distances: found.distances.iter().map(|m| [m.from, m.to].map(|p| p.to_array())).collect(),
        kinds: found.kinds.iter().flatten().map(|(at, kind)| json!({ "at": at.to_array(), "kind": kind })).collect(),
    };
    folders::keep(path, &kept)
}

fn distances(kept: Vec<[[f64; 3]; 2]>) -> Vec<Measure> {
    let ends = kept.into_iter().map(|ends| ends.map(DVec3::from_array));
    ends.take(measures::MOST).map(|[from, to]| Measure { from, to }).collect()
}

fn kinds(kept: Vec<Value>) -> Vec<Told> {
    let valid = kept.into_iter().filter_map(|e| serde_json::from_value::<Entry>(e).ok());
    let near = valid.filter(|e| e.at.iter().all(|mm| mm.abs() <= FARTHEST_MM));
    near.map(|e| (DVec3::from_array(e.at), e.kind)).take(MOST_KINDS).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads files that are all sound.
    fn sound(files: &ScanFiles) -> Findings {
        let (found, damaged) = read(files);
        assert!(damaged.is_none(), "{damaged:?}");
        found
    }

    fn is_damaged(files: &ScanFiles) -> bool {
        read(files).1.is_some_and(|e| !e.to_string().contains('\n') && e.hint == HINT)
    }
    use crate::polyps::answers::Answer;

    fn found() -> Findings {
        let answered = |rank: usize, answer| Answered {
            rank,
            position: DVec3::new(rank as f64, -0.1, 1e-3),
            answer,
            note: format!("note {rank}"),
        };
        let kind = |(n, kind): (usize, &GasKind)| (DVec3::new(n as f64, -0.1, 1e-3), *kind);
        Findings {
            distances: vec![Measure { from: DVec3::X, to: DVec3::new(3.0, 4.0, 0.1) }],
            answers: vec![answered(1, Some(Answer::Yes)), answered(3, None)],
            kinds: Some(GasKind::ALL.iter().enumerate().map(kind).collect()),
        }
    }

    #[test]
    fn what_is_kept_is_read_back_also_as_answers() {
        let dir = tempfile::tempdir().unwrap();
        let files = ScanFiles::below(dir.path(), "a.json");
        assert_eq!(sound(&files), Findings::default());
        let path = files.findings.clone().unwrap();
        keep(&path, &found()).unwrap();
        assert_eq!(sound(&files), found());
        assert!(std::fs::read_to_string(&path).unwrap().contains("\"small bowel\""));
        let answers = Answers::read(&path).unwrap();
        assert_eq!((answers.scan.as_str(), answers.answers), ("a", found().answers));
    }

    #[test]
    fn earlier_files_are_read_as_long_as_there_is_none_and_left_as_they_are() {
        let dir = tempfile::tempdir().unwrap();
        let files = ScanFiles::below(dir.path(), "a.json");
        let old = [&files.measures, &files.answers, &files.kinds].map(|path| path.clone().unwrap());
        let texts = [
            r#"{"version": 1, "measures": [[[1.0, 0.0, 0.0], [3.0, 4.0, 0.1]]]}"#,
            r#"{"colvis": "answers", "scan": "a", "answers": [
                {"rank": 1, "position": [1.0, -0.1, 0.001], "answer": "yes", "note": "note 1"},
                {"rank": 3, "position": [3.0, -0.1, 0.001], "answer": null, "note": "note 3"}]}"#,
            r#"{"version": 1, "told": [{"at": [4.0, -0.1, 0.001], "kind": "lung"}]}"#,
        ];
        for (path, text) in old.iter().zip(texts) {
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        let lung = Some(vec![(DVec3::new(4.0, -0.1, 1e-3), GasKind::Lung)]);
        let before = sound(&files);
        assert_eq!(before, Findings { kinds: lung, ..found() });
        keep(files.findings.as_deref().unwrap(), &Findings { distances: Vec::new(), ..before.clone() }).unwrap();
        assert_eq!(sound(&files), Findings { distances: Vec::new(), ..before });
        for (path, text) in old.iter().zip(texts) {
            assert_eq!(std::fs::read_to_string(path).unwrap(), text);
        }
    }

    #[test]
    fn kinds_that_are_invalid_are_ignored_and_files_that_are_damaged_refused() {
        let dir = tempfile::tempdir().unwrap();
        let files = ScanFiles::below(dir.path(), "a.json");
        let entries = r#"[7, null, {"at": [1, 2], "kind": "colon"}, {"at": [1, 2, 3], "kind": "gall bladder"},
            {"at": [1e300, 0, 0], "kind": "colon"}, {"at": [1, 2, 3], "kind": "lung", "more": []}, {"kind": "lung"}]"#;
        let write = |path: &Option<std::path::PathBuf>, text: &str| {
            let path = path.as_deref().unwrap();
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        write(&files.kinds, &format!(r#"{{"version": 1, "told": {entries}}}"#));
        let lung = Some(vec![(DVec3::new(1.0, 2.0, 3.0), GasKind::Lung)]);
        assert_eq!(sound(&files).kinds, lung);
        for bad in
            ["", "[]", "null", "{\"version\": 1}", "{\"version\": 2, \"told\": []}", "{\"version\": 1, \"told\": 3}"]
        {
            write(&files.kinds, bad);
            assert!(is_damaged(&files), "{bad}");
        }
        write(&files.kinds, "{\"version\": 1, \"told\": []}");
        for bad in
            ["", "{\"version\": 1}", "{\"version\": 2, \"measures\": []}", "{\"version\": 1, \"measures\": [[[1]]]}"]
        {
            write(&files.measures, bad);
            assert!(is_damaged(&files), "{bad}");
        }
        // With a file of findings, earlier ones do not count.
        let all = |version: u32, kind: &str| {
            format!(
                r#"{{"version": {version}, "colvis": "{kind}", "scan": "", "answers": [], "distances": [], "kinds": {entries}}}"#
            )
        };
        write(&files.findings, &all(1, "answers"));
        assert_eq!(sound(&files).kinds, lung);
        for bad in ["".to_owned(), all(2, "answers"), all(1, "list"), "{\"version\": 1}".to_owned()] {
            write(&files.findings, &bad);
            let e = read(&files).1.unwrap().to_string();
            assert!(!e.contains('\n'), "{e}");
        }
        std::fs::remove_file(files.findings.as_deref().unwrap()).unwrap();
        std::fs::create_dir(files.findings.as_deref().unwrap()).unwrap();
        assert!(is_damaged(&files), "a folder");
    }
}
