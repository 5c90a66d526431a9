//! `colvis batch`: many scans, one process for each case, which shares what its steps have in common, and a folder for each case.
//!
//! What is done with the same input, version and options is not done again. A case's folder is written whole or not at all, so that a run
//! may end at any moment and be gone on with. This is no scheduler: `--shard` gives each machine its share, and whatever starts processes
//! on many machines may start these.

mod child;
mod group;
mod list;
mod manifest;
mod plan;
mod queue;
mod record;
pub(super) mod steps;
mod work;
pub(super) mod worker;

use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use crate::cli::args::{BatchArgs, Global};
use crate::cli::messages::{print, say};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::{memory, output};
use manifest::Case;
use plan::Learning;
use queue::{Ledger, Queue};
use record::{Class, State};
use steps::Step;
use work::{Came, Outcome, Run};

/// Share of the free memory that is used if none is given.
const SHARE: f64 = 0.9;

/// What came of a run.
#[derive(Default)]
struct Count {
    done: usize,
    old: usize,
    failed: BTreeMap<Class, usize>,
}

impl Count {
    fn add(&mut self, outcome: Outcome) {
        match outcome.class {
            Some(class) => *self.failed.entry(class).or_default() += 1,
            None => self.done += 1,
        }
        self.old += usize::from(outcome.is_old);
    }

    fn failed(&self) -> usize {
        self.failed.values().sum()
    }

    fn all(&self) -> usize {
        self.done + self.failed()
    }
}

/// Runs the command. Fails with status 2 for options that contradict each other or an unknown case, 3 if the manifest is wrong or `--group`
/// finds no case, 4 if cases failed or if interrupted, 5 if a folder cannot be written.
pub(crate) fn run(args: &BatchArgs, global: &Global, progress: &Progress) -> Result<()> {
    if let Some(cases) = &args.group {
        if args.plan {
            return Err(Error::usage("--plan", "tells nothing of --group", "leave one of them out"));
        }
        return group::run(cases, args.manifest.as_deref(), &args.out, progress);
    }
    let Some(manifest) = &args.manifest else {
        return Err(Error::usage("batch", "has no manifest", "give a CSV file with a row for each case"));
    };
    let mut steps = args.r#do.clone();
    if steps.is_empty() {
        steps.extend(Step::BY_DEFAULT);
    }
    let rows = manifest::read(manifest)?;
    let cases = manifest::only(rows.clone(), &args.only)?;
    if !args.plan {
        output::make_folder(&args.out)?;
        list::write(&args.out, &rows)?;
    }
    let cases: Vec<Case> = cases
        .into_iter()
        .filter(|c| args.shard.is_none_or(|shard| c.is_in_shard([shard.number, shard.count])))
        .collect();
    if args.plan {
        return plan::tell(&cases, &args.out, &steps);
    }
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let jobs = args.jobs.unwrap_or_else(|| (cores / global.threads.unwrap_or(1)).max(1));
    let program = std::env::current_exe()
        .map_err(|e| Error::fault("colvis", format!("does not know its own file: {e}"), "run it again").caused_by(e))?;
    let run = Run {
        program,
        out: args.out.clone(),
        steps,
        threads: global.threads.unwrap_or_else(|| (cores / jobs).max(1)),
        timeout: args.timeout.map(Duration::from_secs_f64),
    };
    // The limit of all processes together.
    let memory =
        args.memory.or_else(|| memory::available().map(|free| (free as f64 * SHARE) as u64)).unwrap_or(u64::MAX);
    let mut learning = Learning::new(&cases, &args.out);
    let queue = Queue::new(learning.waiting(), jobs, memory);
    let count = all(&run, &cases, queue, (&Ledger::new(memory), &mut learning), progress)?;
    let by_class: Vec<String> =
        count.failed.iter().map(|(class, n)| format!("{n} {}", format!("{class:?}").to_lowercase())).collect();
    let told = if by_class.is_empty() { String::new() } else { format!(" ({})", by_class.join(", ")) };
    print(|out| {
        let (old, failed) = (count.old, count.failed());
        writeln!(out, "{} cases: {} done, {failed} failed{told}; {old} were known", count.all(), count.done)
    })?;
    if count.failed() > 0 {
        let why = format!("{} of {} cases failed", count.failed(), count.all());
        return Err(Error::incomplete("batch", why, format!("see failure in their {}", record::FILE)));
    }
    Ok(())
}

/// Runs all cases. Fails if one cannot be recorded, or if interrupted.
fn all(
    run: &Run,
    cases: &[Case],
    mut queue: Queue,
    (ledger, learning): (&Ledger, &mut Learning<'_>),
    progress: &Progress,
) -> Result<Count> {
    let begun = Instant::now();
    let mut count = Count::default();
    let is_terminal = std::io::stderr().is_terminal();
    // The time that new cases took, s.
    let mut new = 0usize;
    thread::scope(|scope| {
        let (to, ended) = mpsc::channel();
        let mut running = 0;
        let mut broken = None;
        loop {
            while let Some(next) = if broken.is_none() { queue.next() } else { None } {
                let (to, n) = (to.clone(), next.case);
                running += 1;
                ledger.begin(next);
                scope.spawn(move || {
                    let since = Instant::now();
                    let came = run.case(&cases[n], n, ledger, progress);
                    // Whoever waits is there until all have ended.
                    let _ = to.send((n, came, since.elapsed().as_secs_f64()));
                });
            }
            if running == 0 {
                break;
            }
            let Ok((n, outcome, seconds)) = ended.recv() else { break };
            running -= 1;
            ledger.end(n);
            queue.end(n);
            match outcome {
                Ok(Came::TooLarge(bytes)) => {
                    learning.exceed(n);
                    queue.again(n, bytes);
                }
                Ok(Came::To(outcome)) => {
                    if !outcome.is_old {
                        learning.learn(n, &run.out, &mut queue);
                    }
                    count.add(outcome);
                    new += usize::from(!outcome.is_old);
                    if !outcome.is_old || is_terminal {
                        tell(&cases[n].id, outcome, seconds, (count.all(), cases.len()), new, begun);
                    }
                }
                // A full disk or an interrupt ends the run, once what is under way has ended.
                Err(e) => broken = broken.or(Some(e)),
            }
        }
        broken.map_or(Ok(()), Err)
    })?;
    Ok(count)
}

/// Tells of a case that has ended, and of the time that is left.
fn tell(id: &str, outcome: Outcome, seconds: f64, (ended, all): (usize, usize), new: usize, begun: Instant) {
    let state = match (outcome.state, outcome.class) {
        (State::Failed, Some(class)) => format!("failed ({class:?})").to_lowercase(),
        _ if outcome.is_old => "known".to_owned(),
        _ => format!("done in {seconds:.1} s"),
    };
    let left = (all - ended) as f64 * begun.elapsed().as_secs_f64() / new.max(1) as f64;
    let left = if new == 0 || ended == all { String::new() } else { format!(", {} left", span(left)) };
    say(&format!("{id}: {state} ({ended} of {all}{left})"));
}

/// Returns a time as text.
fn span(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    match (whole / 3600, whole / 60 % 60, whole % 60) {
        (0, 0, s) => format!("{s} s"),
        (0, m, s) => format!("{m} min {s} s"),
        (h, m, _) => format!("{h} h {m} min"),
    }
}
