//! The work on one case.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use serde_json::{Map, Value};

use super::child::{Ended, Worker};
use super::manifest::Case;
use super::queue::Ledger;
use super::record::{self, Class, Failure, Folder, Input, Made, Record, State};
use super::steps::{self, RowOption, Step};
use super::worker::{Answer, Request, Seen};
use crate::error::Result;
use crate::output;
use crate::progress::Progress;

/// Statistics that differ from run to run or from machine to machine.
const TIMES: [&str; 3] = ["prepare", "coverage_s", "peak_rss_bytes"];
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

/// How the work on a case ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Came {
    To(Outcome),
    /// It took too much memory beside other cases, and is to be tried again; the bytes that it had.
    TooLarge(u64),
}

/// What is left to do of a case.
struct Plan {
    /// What is known of it.
    record: Record,
    failures: Vec<Failure>,
    /// Steps to be made, with their keys and options.
    missing: Vec<(Step, String, Vec<RowOption>)>,
    /// True if the folder tells all of this.
    is_recorded: bool,
}

/// The work on one case.
struct Job<'a> {
    run: &'a Run,
    case: &'a Case,
    folder: Folder,
    worker: Worker<'a>,
    deadline: Option<Instant>,
    ledger: &'a Ledger,
    /// The case's place in the manifest.
    number: usize,
    progress: &'a Progress,
}

impl Run {
    /// Makes what is missing of the case with this `number` in the manifest. Fails with status 1 if this program cannot be started, 4 if
    /// interrupted, 5 if its folder cannot be written.
    pub(super) fn case(&self, case: &Case, number: usize, ledger: &Ledger, progress: &Progress) -> Result<Came> {
        // A process has one number of threads from its beginning.
        let threads = self.threads.to_string();
        let arguments = [steps::WORKER, "--threads", &threads];
        let job = Job {
            run: self,
            case,
            folder: Folder::new(&self.out, &case.id),
            worker: Worker::new(&self.program, &arguments),
            deadline: self.timeout.map(|t| Instant::now() + t),
            ledger,
            number,
            progress,
        };
        job.work()
    }
}

impl Job<'_> {
    fn work(mut self) -> Result<Came> {
        let old = self.folder.record();
        let input = match self.input(old.as_ref())? {
            Ok(input) => input,
            Err(Some(failure)) => {
                let input = Input { read_with: read_with(self.case), ..record::seen(&self.case.path) };
                return self.refuse(&input, failure);
            }
            Err(None) => return self.again(),
        };
        let plan = self.plan(old.as_ref(), &input, Vec::new());
        if plan.is_recorded {
            return Ok(ended(plan.failures.first(), true));
        }
        let Some(lock) = self.folder.lock(self.deadline, self.progress)? else { return Ok(busy()) };
        // Another run may have done it meanwhile.
        let Plan { mut record, mut failures, mut missing, is_recorded } =
            self.plan(self.folder.record().as_ref(), &input, Vec::new());
        if is_recorded {
            self.folder.give_up(lock);
            return Ok(ended(failures.first(), true));
        }
        self.folder.begin(&lock)?;
        for made in record.steps.values() {
            self.folder.keep(made)?;
        }
        // Steps that leave the scan as it is read share its voxels.
        missing.sort_by_key(|(step, _, options)| step.changes_scan(options));
        for (step, key, options) in missing {
            match self.make(step, &options)? {
                Ok(made) => {
                    record.steps.insert(step.name().to_owned(), Made { key, ..made });
                }
                Err(Some(failure)) => {
                    self.folder.drop_outputs(step)?;
                    let is_over = failure.class == Class::Timeout;
                    failures.push(Failure { key, ..failure });
                    if is_over {
                        break;
                    }
                }
                Err(None) => {
                    self.folder.give_up(lock);
                    return self.again();
                }
            }
        }
        self.finish(record, failures)
    }

    /// Records a case whose scan cannot be read.
    fn refuse(self, input: &Input, failure: Failure) -> Result<Came> {
        let Plan { record, failures, is_recorded, .. } = self.plan(self.folder.record().as_ref(), input, vec![failure]);
        if is_recorded {
            return Ok(ended(failures.first(), true));
        }
        let Some(lock) = self.folder.lock(self.deadline, self.progress)? else { return Ok(busy()) };
        self.folder.begin(&lock)?;
        self.finish(record, failures)
    }

    fn finish(&self, mut record: Record, mut failures: Vec<Failure>) -> Result<Came> {
        // In the order of the steps, whatever the order in which they were made.
        failures.sort_by_key(|f| Step::ALL.iter().position(|s| s.name() == f.step));
        let outcome = ended(failures.first(), false);
        let mut failures = failures.into_iter();
        record.state = if failures.len() > 0 { State::Failed } else { State::Done };
        (record.failure, record.also_failed) = (failures.next(), failures.collect());
        self.folder.finish(&record)?;
        Ok(outcome)
    }

    /// The case takes too much memory beside others.
    fn again(&self) -> Result<Came> {
        self.progress.check()?;
        Ok(Came::TooLarge(self.ledger.now(self.number)))
    }

    /// Returns what the scan is, or why it cannot be read; `Err(None)` if it takes too much memory beside other cases. `old` is what was
    /// recorded of the case.
    fn input(&mut self, old: Option<&Record>) -> Result<std::result::Result<Input, Option<Failure>>> {
        let input = Input { read_with: read_with(self.case), ..record::seen(&self.case.path) };
        let known = old.map(|r| &r.input).filter(|known| {
            let is_same = Input { content: known.content.clone(), voxels: known.voxels, ..input.clone() } == **known;
            input.files > 0 && is_same && !known.content.is_empty()
        });
        if let Some(known) = known {
            return Ok(Ok(known.clone()));
        }
        let mut line: Vec<OsString> = vec!["info".into(), (&self.case.path).into()];
        line.extend(self.case.options.iter().filter(|o| is_reading(o)).flat_map(RowOption::arguments));
        let looked = self.ask(&Request::Look(self.with_global(line)), "input")?;
        Ok(looked.and_then(|answer| match answer.seen {
            Some(Seen { content, voxels }) => Ok(Input { content, voxels, ..input }),
            None => Err(Some(self.failed("input", Class::Fault, "told nothing of the scan"))),
        }))
    }

    /// Returns what is known of the case and what is missing. `old` is what was recorded; `failures` are those before its steps: there are no steps then.
    fn plan(&self, old: Option<&Record>, input: &Input, mut failures: Vec<Failure>) -> Plan {
        let mut steps = BTreeMap::new();
        let mut missing = Vec::new();
        let all: &[Step] = if failures.is_empty() { &Step::ALL } else { &[] };
        for step in all.iter().copied() {
            let options = step.own_options(&self.case.options);
            let is_asked = self.run.steps.contains(&step);
            let key = match record::key(step, &input.content, self.case.series.as_deref(), &options) {
                Ok(key) => key,
                Err(e) if is_asked => {
                    failures.push(self.failed(step.name(), Class::Input, &e.to_string()));
                    continue;
                }
                Err(_) => continue,
            };
            let made = old.and_then(|r| r.steps.get(step.name())).filter(|m| m.key == key);
            let is_final = |f: &&Failure| f.step == step.name() && f.key == key && f.class.is_final();
            let failed = old.and_then(|r| r.failures().find(is_final)).filter(|_| is_asked);
            match (made.filter(|made| self.folder.has(made)), failed) {
                (Some(made), _) => {
                    steps.insert(step.name().to_owned(), made.clone());
                }
                (None, Some(failed)) => failures.push(failed.clone()),
                (None, None) if is_asked => missing.push((step, key, options)),
                (None, None) => {}
            }
        }
        let record = Record {
            id: self.case.id.clone(),
            state: State::Done,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            input: input.clone(),
            options: self.case.options.iter().flat_map(|o| [Some(o.name.to_owned()), shown(o)]).flatten().collect(),
            steps,
            failure: None,
            also_failed: Vec::new(),
        };
        let is_recorded = missing.is_empty() && old.is_some_and(|old| is_same(old, &record, &failures));
        Plan { record, failures, missing, is_recorded }
    }

    /// Makes a step. Returns what it made, or why it failed; `Err(None)` if it takes too much memory beside other cases.
    fn make(&mut self, step: Step, options: &[RowOption]) -> Result<std::result::Result<Made, Option<Failure>>> {
        let stats = self.folder.work().join(".stats.json");
        let mut line = step.command(&self.case.path, self.folder.work(), options);
        line.extend(options.iter().flat_map(RowOption::arguments));
        line.extend(["--stats".into(), stats.clone().into()]);
        let begun = Instant::now();
        let answered = self.ask(&Request::Run(self.with_global(line)), step.name())?;
        let seconds = begun.elapsed().as_secs_f64();
        let told = std::fs::read(&stats).ok().and_then(|text| serde_json::from_slice(&text).ok());
        // There is none if it failed early.
        let _ = std::fs::remove_file(&stats);
        if let Err(failure) = answered {
            return Ok(Err(failure));
        }
        let (mut results, mut times) = (Map::new(), Map::new());
        times.insert("seconds".to_owned(), seconds.into());
        let told: Map<String, Value> = told.unwrap_or_default();
        for (name, value) in told {
            if TIMES.contains(&&*name) {
                times.insert(name, value);
            } else if !DROPPED.contains(&&*name) {
                results.insert(name, value);
            }
        }
        if step.is_of_numbers() {
            output::write_json(&self.folder.work().join(step.outputs()[0]), &results)?;
        }
        Ok(Ok(Made { key: String::new(), outputs: self.folder.outputs(step)?, results, times }))
    }

    /// Asks the worker. Returns the answer, or the failure of `step`; `Err(None)` if it takes too much memory beside other cases.
    fn ask(&mut self, request: &Request, step: &str) -> Result<std::result::Result<Answer, Option<Failure>>> {
        let (ledger, number) = (self.ledger, self.number);
        let is_too_large = |now| ledger.is_too_large(number, now);
        Ok(match self.worker.ask(request, self.deadline, is_too_large, self.progress)? {
            Ended::Answered(answer) if answer.status == 0 => Ok(answer),
            Ended::Answered(answer) => Err(Some(self.failed(step, Class::of(answer.status), &answer.line))),
            Ended::Late => Err(Some(self.failed(step, Class::Timeout, "took longer than --timeout allows"))),
            Ended::Died => Err(Some(self.failed(step, Class::Killed, "was killed"))),
            // Alone it may fit.
            Ended::TooLarge(bytes) if ledger.holds(bytes) => Err(None),
            Ended::TooLarge(_) => Err(Some(self.failed(step, Class::Memory, "took more memory than --memory allows"))),
        })
    }

    fn failed(&self, step: &str, class: Class, line: &str) -> Failure {
        Failure { step: step.to_owned(), class, line: clean(line, self.case), key: String::new() }
    }

    fn with_global(&self, mut line: Vec<OsString>) -> Vec<OsString> {
        line.extend(self.case.series.iter().flat_map(|s| ["--series".into(), s.into()]));
        line
    }
}

/// True if an option decides how a scan is read.
fn is_reading(option: &RowOption) -> bool {
    ["--spacing", "--hu", "--allow-gaps"].contains(&option.name)
}

/// Returns how a scan is read: the options, and the number of the series.
pub(super) fn read_with(case: &Case) -> Vec<String> {
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

fn ended(failure: Option<&Failure>, is_old: bool) -> Came {
    let state = if failure.is_some() { State::Failed } else { State::Done };
    Came::To(Outcome { state, is_old, class: failure.map(|f| f.class) })
}

/// Another run still makes the case when its time is over.
fn busy() -> Came {
    Came::To(Outcome { state: State::Failed, is_old: false, class: Some(Class::Timeout) })
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
    use std::path::Path;

    use super::*;

    /// The same file read in another way is another scan.
    #[test]
    fn what_a_scan_is_depends_on_how_it_is_read() {
        let of = |options: &str, series: Option<&str>| {
            let options = steps::row_options(options, Path::new("")).unwrap();
            read_with(&Case { id: "a".to_owned(), path: PathBuf::new(), series: series.map(str::to_owned), options })
        };
        assert_eq!(of("--max 5 --hu=-1000,400 --allow-gaps", Some("2")), ["--hu", "-1000,400", "--allow-gaps", "2"]);
        assert_eq!(of("--max 5", None), of("", None));
    }

    #[test]
    fn errors_name_no_file() {
        let dir = tempfile::tempdir().unwrap();
        let options = steps::row_options("--findings SMITH.json", dir.path()).unwrap();
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
