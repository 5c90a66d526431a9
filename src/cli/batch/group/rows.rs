//! The cases of a folder, each as a row of numbers: a record may be large, a million rows must fit.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde_json::Value;

use super::super::record::{FILE, OLD, WORK};
use super::super::steps::Step;
use super::measures::{self, Values};
use crate::error::{Error, Result};
use crate::output;
use crate::progress::Progress;

/// A larger record is none.
const MOST_BYTES: u64 = 64 << 20;
/// Output of the step `segment` that shows the colon from outside.
const PICTURE: &str = "outside.png";

/// What is known of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum State {
    Done,
    Failed,
    /// Its record cannot be read.
    Unreadable,
    /// The list has it, but no folder.
    Missing,
}

impl State {
    pub(super) const ALL: [Self; 4] = [Self::Done, Self::Failed, Self::Unreadable, Self::Missing];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Failed => "failed",
            Self::Unreadable => "unreadable",
            Self::Missing => "missing",
        }
    }
}

/// Why a step failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Failure {
    pub(super) class: String,
    pub(super) step: String,
    pub(super) line: String,
}

/// What a step took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cost {
    pub(super) seconds: Option<f64>,
    pub(super) peak_bytes: Option<f64>,
}

/// A case.
#[derive(Clone, Debug)]
pub(super) struct Row {
    /// Name of its folder.
    pub(super) id: String,
    pub(super) state: State,
    /// Those of a failed case, the first one first; or why it is unreadable or missing.
    pub(super) failures: Vec<Failure>,
    pub(super) version: String,
    /// Hash of its scan; empty if that could not be read.
    pub(super) content: String,
    pub(super) voxels: Option<u64>,
    pub(super) bytes: Option<u64>,
    pub(super) values: Values,
    /// What each step took, by its place in [`Step::ALL`].
    pub(super) costs: [Option<Cost>; Step::ALL.len()],
    /// Its picture from outside.
    pub(super) picture: Option<PathBuf>,
    /// The case that its record names, if that is another one.
    pub(super) other_id: Option<String>,
}

impl Row {
    /// A row of which nothing but the reason is known.
    pub(super) fn unknown(id: &str, state: State, class: &str, line: &str) -> Self {
        Self {
            id: id.to_owned(),
            state,
            failures: vec![Failure { class: class.to_owned(), step: "record".to_owned(), line: line.to_owned() }],
            version: String::new(),
            content: String::new(),
            voxels: None,
            bytes: None,
            values: measures::values(&Value::Null),
            costs: [None; Step::ALL.len()],
            picture: None,
            other_id: None,
        }
    }
}

/// What is in a folder of cases.
#[derive(Default)]
pub(super) struct Found {
    /// By their ids.
    pub(super) rows: Vec<Row>,
    /// Folders without a record.
    pub(super) without_record: Vec<String>,
    /// Cases that are being written, or were when a run was interrupted.
    pub(super) interrupted: Vec<String>,
}

/// Reads all records of a folder; `except` is a folder in it that holds no case. Fails with status 3 if the folder cannot be read, 4 if
/// interrupted.
pub(super) fn read(dir: &Path, except: &Path, progress: &Progress) -> Result<Found> {
    let no = |e: io::Error| Error::file(dir, format!("cannot be read ({})", output::plain(&e)), "check the name");
    let mut found = Found::default();
    // By the ids. A folder that was being replaced stands for a case whose folder is gone.
    let mut folders: BTreeMap<String, PathBuf> = BTreeMap::new();
    for entry in fs::read_dir(dir).map_err(no)? {
        let path = entry.map_err(no)?.path();
        if !path.is_dir() || fs::canonicalize(&path).is_ok_and(|p| p == except) {
            continue;
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if let Some(id) = name.strip_prefix(WORK) {
            found.interrupted.push(id.to_owned());
        } else if let Some(id) = name.strip_prefix(OLD) {
            folders.entry(id.to_owned()).or_insert(path);
        } else {
            folders.insert(name, path);
        }
    }
    found.interrupted.sort_unstable();
    let folders: Vec<(String, PathBuf)> = folders.into_iter().collect();
    let read = folders.par_iter().map(|(id, folder)| {
        progress.check()?;
        Ok(row(id, folder))
    });
    let read: Vec<Option<Row>> = read.collect::<Result<_>>()?;
    for (row, (id, _)) in read.into_iter().zip(folders) {
        match row {
            Some(row) => found.rows.push(row),
            None => found.without_record.push(id),
        }
    }
    Ok(found)
}

/// Reads a case; `None` without a record.
fn row(id: &str, folder: &Path) -> Option<Row> {
    let broken = |why: &str| Some(Row::unknown(id, State::Unreadable, "unreadable", &format!("{FILE} {why}")));
    let path = folder.join(FILE);
    let text = match fs::metadata(&path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return None,
        Err(e) => return broken(&format!("cannot be read ({})", output::plain(&e))),
        // Reading a pipe would wait for ever.
        Ok(meta) if !meta.is_file() => return broken("is no file"),
        Ok(meta) if meta.len() > MOST_BYTES => return broken("is too large"),
        Ok(_) => fs::read(&path),
    };
    let text = match text {
        Ok(text) => text,
        Err(e) => return broken(&format!("cannot be read ({})", output::plain(&e))),
    };
    // The error's own text may cite what is in the file.
    let record: Value = match serde_json::from_slice(&text) {
        Ok(record) => record,
        Err(e) if e.is_eof() => return broken("is cut short"),
        Err(e) => return broken(&format!("is no JSON (line {}, column {})", e.line(), e.column())),
    };
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let state = match record["state"].as_str() {
        Some("done") => State::Done,
        Some("failed") => State::Failed,
        _ => return broken("is no record of a case"),
    };
    let steps = &record["steps"];
    let also = record["also_failed"].as_array().into_iter().flatten();
    let failures = Some(&record["failure"]).filter(|f| f.is_object()).into_iter().chain(also);
    let cost = |step: Step| {
        let times = steps[step.name()]["times"].as_object()?;
        let number = |name: &str| times.get(name).and_then(Value::as_f64);
        Some(Cost { seconds: number("seconds"), peak_bytes: number("peak_rss_bytes") })
    };
    let has_picture = steps[Step::Segment.name()]["outputs"][PICTURE].is_string();
    Some(Row {
        id: id.to_owned(),
        state,
        failures: failures
            .map(|f| Failure { class: text(&f["class"]), step: text(&f["step"]), line: text(&f["line"]) })
            .collect(),
        version: text(&record["version"]),
        content: text(&record["input"]["content"]),
        voxels: record["input"]["voxels"].as_u64().filter(|n| *n > 0),
        bytes: record["input"]["bytes"].as_u64(),
        values: measures::values(steps),
        costs: Step::ALL.map(cost),
        picture: has_picture.then(|| folder.join(PICTURE)),
        other_id: record["id"].as_str().filter(|other| *other != id).map(str::to_owned),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_has_cases_and_whatever_else_there_may_be() {
        let dir = tempfile::tempdir().unwrap();
        let put = |name: &str, text: &str| {
            let folder = dir.path().join(name);
            fs::create_dir_all(&folder).unwrap();
            fs::write(folder.join(FILE), text).unwrap();
        };
        let record = |id: &str| {
            format!(
                r#"{{"id": "{id}", "state": "failed", "version": "7", "input": {{"content": "sha256:1", "voxels": 5, "bytes": 9}},
                "steps": {{"segment": {{"outputs": {{"outside.png": "x"}}, "times": {{"seconds": 2.5}}}}}},
                "failure": {{"class": "input", "step": "fly", "line": "no"}}, "also_failed": [{{"class": "killed"}}, 3]}}"#
            )
        };
        put("a", &record("a"));
        put("copy of a", &record("a"));
        put("cut", &record("cut")[..40]);
        put("broken", "{\"name\": SMITH}");
        put("other", "{\"id\": \"other\"}");
        put(".old-gone", &record("gone"));
        put(".old-a", "");
        put(".work-b", "");
        put("report", "");
        fs::create_dir_all(dir.path().join("empty")).unwrap();
        fs::create_dir_all(dir.path().join("folder/case.json")).unwrap();
        fs::write(dir.path().join("cases.csv"), "id\n").unwrap();
        let report = fs::canonicalize(dir.path().join("report")).unwrap();
        let found = read(dir.path(), &report, &Progress::new()).unwrap();
        let states: Vec<_> = found.rows.iter().map(|r| (r.id.as_str(), r.state)).collect();
        let unreadable = State::Unreadable;
        assert_eq!(
            states,
            [
                ("a", State::Failed),
                ("broken", unreadable),
                ("copy of a", State::Failed),
                ("cut", unreadable),
                ("folder", unreadable),
                ("gone", State::Failed),
                ("other", unreadable),
            ]
        );
        assert_eq!((found.without_record, found.interrupted), (vec!["empty".to_owned()], vec!["b".to_owned()]));
        let (a, copy) = (&found.rows[0], &found.rows[2]);
        assert_eq!((a.version.as_str(), a.content.as_str(), a.voxels, a.bytes), ("7", "sha256:1", Some(5), Some(9)));
        let classes: Vec<_> = a.failures.iter().map(|f| f.class.as_str()).collect();
        assert_eq!((classes, a.failures[0].line.as_str()), (vec!["input", "killed", ""], "no"));
        assert_eq!(a.costs[0], Some(Cost { seconds: Some(2.5), peak_bytes: None }));
        assert!(a.costs[1].is_none() && a.picture.as_ref().unwrap().ends_with("a/outside.png") && a.other_id.is_none());
        assert_eq!(copy.other_id.as_deref(), Some("a"));
        let lines: Vec<_> = found.rows.iter().filter(|r| r.state == unreadable).map(|r| &*r.failures[0].line).collect();
        assert_eq!(
            lines,
            [
                "case.json is no JSON (line 1, column 10)",
                "case.json is cut short",
                "case.json is no file",
                "case.json is no record of a case"
            ]
        );
        let gone = read(&dir.path().join("none"), &report, &Progress::new()).err().unwrap();
        assert_eq!(gone.kind, crate::error::Kind::Input);
    }
}
