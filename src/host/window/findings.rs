//! The files of what a reader finds in a scan, as a window keeps them.
//!
//! The file of [`Findings`] is named by the scan's content. Earlier versions kept one file named like the session, or three. They are
//! read as long as there is no file of today's, and left as they are. A session is removed once the flight has arrived; what the reader
//! found stays.

use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::session::ScanFiles;
use crate::app::findings::{Findings, MOST_DISTANCES, NoScan, kinds};
use crate::error::{Error, Result};
use crate::host::folders;
use crate::output;
use crate::polyps::answers::{Answered, Answers};

/// What to do about an invalid file, for messages.
const HINT: &str = "move it away, then open the scan again";

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
            const VERSION: u32 = 1;

            fn version(&self) -> u32 {
                self.version
            }
        })*
    };
}
kept!(KeptDistances, KeptKinds);

/// Reads what was found in a scan; nothing if there is no file. Kinds that are invalid are ignored. If a file is damaged, returns what
/// the others say, and its error with status 3.
pub(crate) fn read(files: &ScanFiles) -> (Findings, Option<Error>) {
    let (found, damaged) = read_files(files);
    let found = Findings { scan: files.content.hash.clone(), ..found.moved_to(files.content.origin) };
    (found, damaged)
}

fn read_files(files: &ScanFiles) -> (Findings, Option<Error>) {
    for (path, no_scan) in [(&files.findings, NoScan::Refused), (&files.earlier, NoScan::Allowed)] {
        if let Some(path) = path.as_deref().filter(|path| path.exists()) {
            return match of_scan(path, no_scan, &files.content.hash) {
                Ok(found) => (found, None),
                Err(e) => (Findings::default(), Some(e)),
            };
        }
    }
    let (mut found, mut damaged) = (Findings::default(), None);
    let mut note = |e| _ = damaged.get_or_insert(e);
    match files.measures.as_deref().map_or(Ok(None), |path| folders::read_kept::<KeptDistances>(path, HINT)) {
        Ok(kept) => {
            let ends = kept.into_iter().flat_map(|kept| kept.measures).map(|ends| ends.map(DVec3::from_array));
            found.distances = ends.take(MOST_DISTANCES).collect();
        }
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

/// Reads a file of findings, which must be of the scan with this hash if it names one.
fn of_scan(path: &Path, no_scan: NoScan, hash: &str) -> Result<Findings> {
    let found = Findings::read(path, no_scan, HINT)?;
    if !found.scan.is_empty() && found.scan != hash {
        return Err(Error::file(path, "belongs to another scan", HINT));
    }
    Ok(found)
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
    if let Some(folder) = path.parent() {
        output::make_folder(folder)?;
    }
    found.write(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::lumen::GasKind;

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

    fn found(files: &ScanFiles) -> Findings {
        let answered = |rank: usize, answer| Answered {
            rank,
            position: DVec3::new(rank as f64, -0.1, 1e-3),
            answer,
            note: format!("note {rank}"),
        };
        let kind = |(n, kind): (usize, &GasKind)| (DVec3::new(n as f64, -0.1, 1e-3), *kind);
        Findings {
            scan: files.content.hash.clone(),
            origin: Some(files.content.origin),
            distances: vec![[DVec3::X, DVec3::new(3.0, 4.0, 0.1)]],
            answers: vec![answered(1, Some(Answer::Yes)), answered(3, None)],
            kinds: Some(GasKind::ALL.iter().enumerate().map(kind).collect()),
            ..Findings::default()
        }
    }

    fn write(path: &Option<std::path::PathBuf>, text: &str) {
        let path = path.as_deref().unwrap();
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    #[test]
    fn what_is_kept_is_read_back_also_as_answers() {
        let dir = tempfile::tempdir().unwrap();
        let files = ScanFiles::below(dir.path(), "a.json");
        let none = Findings { scan: "sha256:a".to_owned(), origin: Some(DVec3::ZERO), ..Findings::default() };
        assert_eq!(sound(&files), none);
        let (path, found) = (files.findings.clone().unwrap(), found(&files));
        keep(&path, &found).unwrap();
        assert_eq!(sound(&files), found);
        assert!(std::fs::read_to_string(&path).unwrap().contains("\"small bowel\""));
        assert_eq!(Answers::read(&path).unwrap().answers, found.answers);
        // The same scan in a file that lies elsewhere.
        let by = DVec3::new(0.0, 100.0, -7.0);
        let mut there = files;
        there.content.origin = by;
        assert_eq!(sound(&there).distances[0][0], found.distances[0][0] + by);
    }

    #[test]
    fn findings_of_another_scan_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let [files, other] = ["a.json", "b.json"].map(|name| ScanFiles::below(dir.path(), name));
        keep(files.findings.as_deref().unwrap(), &found(&other)).unwrap();
        let (none, damaged) = read(&files);
        assert!(damaged.unwrap().why.contains("another scan") && none.answers.is_empty());
    }

    #[test]
    fn earlier_files_are_read_as_long_as_there_is_none_and_left_as_they_are() {
        let dir = tempfile::tempdir().unwrap();
        let files = ScanFiles::below(dir.path(), "a.json");
        let old = [&files.measures, &files.answers, &files.kinds, &files.earlier];
        let texts = [
            r#"{"version": 1, "measures": [[[1.0, 0.0, 0.0], [3.0, 4.0, 0.1]]]}"#,
            r#"{"colvis": "answers", "scan": "a", "answers": [
                {"rank": 1, "position": [1.0, -0.1, 0.001], "answer": "yes", "note": "note 1"},
                {"rank": 3, "position": [3.0, -0.1, 0.001], "answer": null, "note": "note 3"}]}"#,
            r#"{"version": 1, "told": [{"at": [4.0, -0.1, 0.001], "kind": "lung"}]}"#,
            r#"{"version": 1, "colvis": "answers", "scan": "00ff", "answers": [], "distances": [[[1, 2, 3], [4, 5, 6]]],
                "kinds": [{"at": [1, 2, 3], "kind": "lung"}]}"#,
        ];
        let lung = |at| Some(vec![(at, GasKind::Lung)]);
        old.into_iter().zip(texts).take(3).for_each(|(path, text)| write(path, text));
        let before = sound(&files);
        assert_eq!(before, Findings { kinds: lung(DVec3::new(4.0, -0.1, 1e-3)), ..found(&files) });
        // Of these, the one file is the later one.
        write(old[3], texts[3]);
        let one = sound(&files);
        assert_eq!(
            (one.distances[0][1], one.kinds.clone()),
            (DVec3::new(4.0, 5.0, 6.0), lung(DVec3::new(1.0, 2.0, 3.0)))
        );
        assert_eq!((one.scan.as_str(), one.answers.len()), ("sha256:a", 0));
        keep(files.findings.as_deref().unwrap(), &Findings { distances: Vec::new(), ..before.clone() }).unwrap();
        assert_eq!(sound(&files), Findings { distances: Vec::new(), ..before });
        for (path, text) in old.into_iter().zip(texts) {
            assert_eq!(std::fs::read_to_string(path.as_deref().unwrap()).unwrap(), text);
        }
    }

    #[test]
    fn kinds_that_are_invalid_are_ignored_and_files_that_are_damaged_refused() {
        let dir = tempfile::tempdir().unwrap();
        let files = ScanFiles::below(dir.path(), "a.json");
        let entries = r#"[7, null, {"at": [1, 2], "kind": "colon"}, {"at": [1, 2, 3], "kind": "gall bladder"},
            {"at": [1e300, 0, 0], "kind": "colon"}, {"at": [1, 2, 3], "kind": "lung", "more": []}, {"kind": "lung"}]"#;
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
                r#"{{"version": {version}, "colvis": "{kind}", "scan": "sha256:a", "answers": [], "distances": [], "kinds": {entries}}}"#
            )
        };
        write(&files.findings, &all(1, "answers"));
        assert_eq!(sound(&files).kinds, lung);
        for bad in ["".to_owned(), all(2, "answers"), all(1, "list"), "{\"version\": 1}".to_owned()] {
            write(&files.findings, &bad);
            assert!(is_damaged(&files), "{bad}");
        }
        std::fs::remove_file(files.findings.as_deref().unwrap()).unwrap();
        std::fs::create_dir(files.findings.as_deref().unwrap()).unwrap();
        assert!(is_damaged(&files), "a folder");
    }
}
