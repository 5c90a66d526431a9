//! The work on one case.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde_json::{Map, Value};

use super::child::{self, Ended};
use super::manifest::Case;
use super::record::{self, Class, Failure, Folder, Input, Made, Record, State};
use super::steps::{RowOption, Step};
use crate::error::{Error, Result};
use crate::progress::Progress;

/// Statistics that differ from run to run or from machine to machine.
const TIMES: [&str; 2] = ["prepare", "peak_rss_bytes"];
/// Statistics that tell of the machine, and of each frame, which is no result.
const DROPPED: [&str; 4] = ["threads", "simd", "frames", "peak_by_stage_bytes"];

/// What every case of a run has in common.
pub(super) struct Run {
    /// This program.
    pub program: PathBuf,
    pub out: PathBuf,
    pub steps: Vec<Step>,
    /// Threads of each process.
    pub threads: usize,
    /// The longest that a case may take.
    pub timeout: Option<Duration>,
}

/// What came of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Outcome {
    pub state: State,
    /// True if nothing had to be done.
    pub is_old: bool,
    /// The first failure.
    pub class: Option<Class>,
}

impl Run {
    /// Makes what is missing of a case. Fails with status 1 if this program cannot be started, 4 if interrupted, 5 if its folder cannot be
    /// written.
    pub(super) fn case(&self, case: &Case, progress: &Progress) -> Result<Outcome> {
        let folder = Folder::new(&self.out, &case.id);
        let old = folder.record();
        let deadline = self.timeout.map(|t| Instant::now() + t);
        let mut input = Input { read_with: read_with(case), ..record::seen(&case.path) };
        let known = old.as_ref().map(|r| &r.input).filter(|known| {
            let is_same = Input { content: known.content.clone(), voxels: known.voxels, ..input.clone() } == **known;
            input.files > 0 && is_same && !known.content.is_empty()
        });
        let mut failures = Vec::new();
        match known {
            Some(known) => input = known.clone(),
            None => match self.look(case, deadline, progress)? {
                Ok((content, voxels)) => (input.content, input.voxels) = (content, voxels),
                Err(failure) => failures.push(failure),
            },
        }
        let mut steps = BTreeMap::new();
        let mut missing = Vec::new();
        if failures.is_empty() {
            for step in Step::WITHOUT_FINDINGS.into_iter().chain([Step::Case]) {
                let options = step.own_options(&case.options);
                let is_asked = self.steps.contains(&step);
                let key = match record::key(step, &input.content, case.series.as_deref(), &options) {
                    Ok(key) => key,
                    Err(e) if is_asked => {
                        failures.push(Failure {
                            step: step.name().to_owned(),
                            class: Class::Input,
                            line: clean(&e.to_string(), case),
                            key: String::new(),
                        });
                        continue;
                    }
                    Err(_) => continue,
                };
                let made = old.as_ref().and_then(|r| r.steps.get(step.name())).filter(|m| m.key == key);
                let is_final = |f: &&Failure| f.step == step.name() && f.key == key && f.class.is_final();
                let failed = old.as_ref().and_then(|r| r.failures().find(is_final)).filter(|_| is_asked);
                match (made.filter(|made| folder.has(made)), failed) {
                    (Some(made), _) => {
                        steps.insert(step.name().to_owned(), made.clone());
                    }
                    (None, Some(failed)) => failures.push(failed.clone()),
                    (None, None) if is_asked => missing.push((step, key, options)),
                    (None, None) => {}
                }
            }
        }
        let mut record = Record {
            id: case.id.clone(),
            state: State::Done,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            input,
            options: case.options.iter().flat_map(|o| [Some(o.name.to_owned()), shown(o)]).flatten().collect(),
            steps,
            failure: None,
            also_failed: Vec::new(),
        };
        let ended = |failure: Option<&Failure>, is_old: bool| Outcome {
            state: if failure.is_some() { State::Failed } else { State::Done },
            is_old,
            class: failure.map(|f| f.class),
        };
        if let Some(old) = &old
            && missing.is_empty()
            && is_same(old, &record, &failures)
        {
            return Ok(ended(failures.first(), true));
        }
        let work = folder.begin()?;
        for made in record.steps.values() {
            folder.keep(made)?;
        }
        for (step, key, options) in missing {
            match self.make(case, step, (&folder, work), &options, deadline, progress)? {
                Ok(made) => {
                    record.steps.insert(step.name().to_owned(), Made { key, ..made });
                }
                Err(failure) => {
                    folder.drop_outputs(step)?;
                    let is_over = failure.class == Class::Timeout;
                    failures.push(Failure { key, ..failure });
                    if is_over {
                        break;
                    }
                }
            }
        }
        let outcome = ended(failures.first(), false);
        let mut failures = failures.into_iter();
        (record.state, record.failure, record.also_failed) = (outcome.state, failures.next(), failures.collect());
        folder.finish(&record)?;
        Ok(outcome)
    }

    /// Returns the hash of a scan's content and its number of voxels, or why it cannot be read.
    fn look(
        &self,
        case: &Case,
        deadline: Option<Instant>,
        progress: &Progress,
    ) -> Result<std::result::Result<(String, u64), Failure>> {
        let mut line: Vec<OsString> = vec!["info".into(), (&case.path).into()];
        line.extend(case.options.iter().filter(|o| is_reading(o)).flat_map(RowOption::arguments));
        let ended = child::run(&self.program, &self.with_global(line, case), deadline, progress)?;
        if ended.status != Some(0) {
            return Ok(Err(failure("input", case, &ended)));
        }
        let info: Value = serde_json::from_slice(&ended.printed).unwrap_or_default();
        let voxels = info["dims"].as_array().into_iter().flatten().filter_map(Value::as_u64).product();
        match info["content"].as_str() {
            Some(content) => Ok(Ok((content.to_owned(), voxels))),
            None => Err(Error::fault("info", "told nothing of the scan", "report it")),
        }
    }

    /// Makes a step.
    fn make(
        &self,
        case: &Case,
        step: Step,
        (folder, work): (&Folder, &Path),
        options: &[RowOption],
        deadline: Option<Instant>,
        progress: &Progress,
    ) -> Result<std::result::Result<Made, Failure>> {
        let stats = work.join(".stats.json");
        let mut line = step.command(&case.path, work, options);
        line.extend(options.iter().flat_map(RowOption::arguments));
        line.extend(["--stats".into(), stats.clone().into()]);
        let begun = Instant::now();
        let ended = child::run(&self.program, &self.with_global(line, case), deadline, progress)?;
        let told = std::fs::read(&stats).ok().and_then(|text| serde_json::from_slice(&text).ok());
        // There is none if it failed early.
        let _ = std::fs::remove_file(&stats);
        if ended.status != Some(0) {
            return Ok(Err(failure(step.name(), case, &ended)));
        }
        let (mut results, mut times) = (Map::new(), Map::new());
        times.insert("seconds".to_owned(), begun.elapsed().as_secs_f64().into());
        let told: Map<String, Value> = told.unwrap_or_default();
        for (name, value) in told {
            if TIMES.contains(&&*name) {
                times.insert(name, value);
            } else if !DROPPED.contains(&&*name) {
                results.insert(name, value);
            }
        }
        Ok(Ok(Made { key: String::new(), outputs: folder.outputs(step)?, results, times }))
    }

    fn with_global(&self, mut line: Vec<OsString>, case: &Case) -> Vec<OsString> {
        line.extend(["--threads".into(), self.threads.to_string().into()]);
        line.extend(case.series.iter().flat_map(|s| ["--series".into(), s.into()]));
        line
    }
}

/// True if an option decides how a scan is read.
fn is_reading(option: &RowOption) -> bool {
    ["--spacing", "--hu", "--allow-gaps"].contains(&option.name)
}

/// Returns how a scan is read: the options, and the number of the series.
fn read_with(case: &Case) -> Vec<String> {
    let options = case.options.iter().filter(|o| is_reading(o)).flat_map(|o| [Some(o.name), o.value.as_deref()]);
    options.flatten().chain(case.series.as_deref()).map(str::to_owned).collect()
}

/// Returns an option's value for the record: a file has no place in it.
fn shown(option: &RowOption) -> Option<String> {
    option.value.clone().map(|v| if option.is_file { "FILE".to_owned() } else { v })
}

/// True if nothing would change.
fn is_same(old: &Record, new: &Record, failures: &[Failure]) -> bool {
    old.failures().eq(failures)
        && old.version == new.version
        && old.input == new.input
        && old.options == new.options
        && old.steps.keys().eq(new.steps.keys())
}

fn failure(step: &str, case: &Case, ended: &Ended) -> Failure {
    let class = if ended.is_late { Class::Timeout } else { Class::of(ended.status) };
    let line = match class {
        Class::Timeout => "took longer than --timeout allows".to_owned(),
        Class::Killed => "was killed".to_owned(),
        _ => clean(&ended.line, case),
    };
    Failure { step: step.to_owned(), class, line, key: String::new() }
}

/// Returns an error without the names of the scan, of a file in it, or of a file that the options name: files are often named after patients.
fn clean(line: &str, case: &Case) -> String {
    let mut text = line.to_owned();
    for file in case.options.iter().filter_map(RowOption::file) {
        text = text.replace(&*file.to_string_lossy(), "FILE");
    }
    let names = [case.path.clone(), std::fs::canonicalize(&case.path).unwrap_or_default()];
    for name in names.iter().filter(|n| !n.as_os_str().is_empty()) {
        text = text.replace(&*name.to_string_lossy(), "SCAN");
    }
    let mut parts = text.split("SCAN");
    let mut out = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        out.push_str("SCAN");
        // What follows the scan's name is the name of a file in its folder.
        let is_inside = part.starts_with(['/', '\\']);
        out.push_str(if is_inside { part.find(": ").map_or("", |at| &part[at..]) } else { part });
    }
    if let Some(name) = case.path.file_name().map(|n| n.to_string_lossy()).filter(|n| n.len() > 3) {
        out = out.replace(&*name, "SCAN");
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same file read in another way is another scan.
    #[test]
    fn what_a_scan_is_depends_on_how_it_is_read() {
        let of = |options: &str, series: Option<&str>| {
            let options = crate::cli::batch::steps::row_options(options, Path::new("")).unwrap();
            read_with(&Case { id: "a".to_owned(), path: PathBuf::new(), series: series.map(str::to_owned), options })
        };
        assert_eq!(of("--max 5 --hu=-1000,400 --allow-gaps", Some("2")), ["--hu", "-1000,400", "--allow-gaps", "2"]);
        assert_eq!(of("--max 5", None), of("", None));
    }

    #[test]
    fn errors_name_no_file() {
        let dir = tempfile::tempdir().unwrap();
        let options = crate::cli::batch::steps::row_options("--findings SMITH.json", dir.path()).unwrap();
        let case = Case { id: "a".to_owned(), path: dir.path().join("SMITH^JOHN"), series: None, options };
        let (at, findings) = (case.path.display(), dir.path().join("SMITH.json"));
        for (line, cleaned) in [
            (format!("{}: is no JSON; check it", findings.display()), "FILE: is no JSON; check it"),
            (format!("{at}: is empty; check it"), "SCAN: is empty; check it"),
            (format!("{at}/SMITH.0001.dcm: is cut short; copy it"), "SCAN: is cut short; copy it"),
            (format!("volume: nothing in {at}"), "volume: nothing in SCAN"),
            ("volume: SMITH^JOHN is one slice".to_owned(), "volume: SCAN is one slice"),
        ] {
            assert_eq!(clean(&line, &case), cleaned);
        }
    }
}
