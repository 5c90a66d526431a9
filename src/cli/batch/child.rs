//! A command of this program in a process of its own: it may fail, hang or be killed, and takes nothing with it.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::error::{Error, Result};
use crate::progress::Progress;

/// Time between two looks at a process.
const LOOKS: Duration = Duration::from_millis(10);

/// How a process ended.
pub(super) struct Ended {
    /// Its exit status; `None` if something killed it.
    pub status: Option<i32>,
    /// True if it was ended because its time was over.
    pub is_late: bool,
    /// Its error, without `error: `; empty if it told none.
    pub line: String,
    /// What it printed.
    pub printed: Vec<u8>,
}

/// Runs `program` with `line` until it ends or until `deadline`. Fails with status 1 if it cannot be started, 4 if interrupted.
pub(super) fn run(program: &Path, line: &[OsString], deadline: Option<Instant>, progress: &Progress) -> Result<Ended> {
    let begun =
        Command::new(program).args(line).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let mut child = begun.map_err(|e| {
        Error::fault(program.display().to_string(), format!("cannot be started: {e}"), "run it again").caused_by(e)
    })?;
    let (out, err) = (child.stdout.take(), child.stderr.take());
    thread::scope(|scope| {
        // Both are read at once: a full pipe would stop the process.
        let printed = scope.spawn(move || {
            let mut all = Vec::new();
            // What was read before an error is all there is.
            let _ = out.map(|mut out| out.read_to_end(&mut all));
            all
        });
        let told = scope.spawn(move || {
            let lines = err.into_iter().flat_map(|err| BufReader::new(err).lines().map_while(std::io::Result::ok));
            lines.filter_map(|l| l.strip_prefix("error: ").map(str::to_owned)).last().unwrap_or_default()
        });
        let ended = wait(&mut child, deadline, progress);
        let (printed, line) = (printed.join().unwrap_or_default(), told.join().unwrap_or_default());
        let (status, is_late) = ended?;
        Ok(Ended { status, is_late, line, printed })
    })
}

/// Waits for the end of a process, or brings it about. Returns its exit status, and true if its time was over.
fn wait(child: &mut Child, deadline: Option<Instant>, progress: &Progress) -> Result<(Option<i32>, bool)> {
    let lost = |e: std::io::Error| Error::fault("process", e.to_string(), "run it again").caused_by(e);
    let mut is_late = false;
    loop {
        if let Some(status) = child.try_wait().map_err(lost)? {
            progress.check()?;
            return Ok((if is_late { None } else { status.code() }, is_late));
        }
        is_late = is_late || deadline.is_some_and(|d| Instant::now() > d);
        if is_late || progress.is_cancelled() {
            // It may have ended by itself.
            let _ = child.kill();
        }
        thread::sleep(LOOKS);
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    fn shell(script: &str, seconds: Option<f64>) -> Ended {
        let deadline = seconds.map(|s| Instant::now() + Duration::from_secs_f64(s));
        run(Path::new("/bin/sh"), &["-c".into(), script.into()], deadline, &Progress::new()).unwrap()
    }

    #[test]
    fn what_a_process_does_is_told() {
        let done = shell("echo found; echo note: x >&2", None);
        assert_eq!(
            (done.status, done.is_late, done.line.as_str(), &*done.printed),
            (Some(0), false, "", &b"found\n"[..])
        );
        let failed = shell("echo error: a: b; exit 3", None);
        assert_eq!((failed.status, failed.line.as_str()), (Some(3), ""), "only what it tells as an error");
        assert_eq!(shell("echo error: a: b >&2; exit 3", None).line, "a: b");
        let killed = shell("kill -9 $$", None);
        assert_eq!((killed.status, killed.is_late), (None, false));
        let late = shell("exec sleep 60", Some(0.1));
        assert_eq!((late.status, late.is_late), (None, true));
        // More than a pipe holds.
        assert_eq!(shell("head -c 300000 /dev/zero; head -c 300000 /dev/zero >&2", None).printed.len(), 300_000);
        assert!(run(Path::new("/no/such/program"), &[], None, &Progress::new()).is_err());
        let progress = Progress::new();
        progress.cancel();
        assert!(run(Path::new("/bin/sh"), &["-c".into(), "exec sleep 60".into()], None, &progress).is_err());
    }
}
