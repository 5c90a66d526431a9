//! A process of this program that makes the steps of a case: it may fail, hang or be killed, and takes nothing with it.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use super::worker::{ANSWER, Answer, Request};
use crate::error::{Error, Result};
use crate::memory;
use crate::progress::Progress;

/// Time between two looks at a process.
const LOOKS: Duration = Duration::from_millis(20);

/// How a request ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Ended {
    Answered(Answer),
    /// The process was ended because its time was over.
    Late,
    /// … because it took too much memory; the bytes that it had.
    TooLarge(u64),
    /// Something else ended it.
    Died,
}

/// A worker of a case. There is a process from the first request on, and a new one after one has ended.
pub(super) struct Worker<'a> {
    program: &'a Path,
    arguments: &'a [&'a str],
    running: Option<Running>,
}

struct Running {
    child: Child,
    requests: ChildStdin,
    answers: Receiver<Answer>,
}

impl Drop for Running {
    fn drop(&mut self) {
        // An idle one would end by itself with its input; one that is busy must not outlive whoever waits.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl<'a> Worker<'a> {
    pub(super) fn new(program: &'a Path, arguments: &'a [&'a str]) -> Self {
        Self { program, arguments, running: None }
    }

    /// Waits for the answer to `request`, at most until `deadline`. `is_too_large` is told the memory that the process has, bytes, and may
    /// end it. Fails with status 1 if it cannot be started, 4 if interrupted.
    pub(super) fn ask(
        &mut self,
        request: &Request,
        deadline: Option<Instant>,
        mut is_too_large: impl FnMut(u64) -> bool,
        progress: &Progress,
    ) -> Result<Ended> {
        let line = serde_json::to_string(request)
            .map_err(|e| Error::fault("batch", e.to_string(), "report it").caused_by(e))?;
        let running = match &mut self.running {
            Some(running) => running,
            None => self.running.insert(start(self.program, self.arguments)?),
        };
        // One that has ended is noticed below.
        let _ = writeln!(running.requests, "{line}").and_then(|()| running.requests.flush());
        let ended = loop {
            match running.answers.recv_timeout(LOOKS) {
                Ok(answer) => break Ended::Answered(answer),
                Err(RecvTimeoutError::Disconnected) => break Ended::Died,
                Err(RecvTimeoutError::Timeout) => {}
            }
            if progress.is_cancelled() {
                break Ended::Died;
            }
            if deadline.is_some_and(|d| Instant::now() > d) {
                break Ended::Late;
            }
            if let Some(bytes) = memory::resident_of(running.child.id())
                && is_too_large(bytes)
            {
                break Ended::TooLarge(bytes);
            }
        };
        if !matches!(ended, Ended::Answered(_)) {
            self.running = None;
        }
        progress.check()?;
        Ok(ended)
    }
}

fn start(program: &Path, arguments: &[&str]) -> Result<Running> {
    let fault = |why: String| Error::fault(program.display().to_string(), why, "run it again");
    let mut child = Command::new(program)
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(|e| fault(format!("cannot be started: {e}")).caused_by(e))?;
    let (Some(requests), Some(out)) = (child.stdin.take(), child.stdout.take()) else {
        return Err(fault("has no standard input or output".to_owned()));
    };
    let (to, answers) = mpsc::channel();
    // It ends with the process.
    thread::spawn(move || {
        for line in BufReader::new(out).lines().map_while(std::io::Result::ok) {
            if let Some(answer) = line.strip_prefix(ANSWER).and_then(|text| serde_json::from_str(text).ok()) {
                let _ = to.send(answer);
            }
        }
    });
    Ok(Running { child, requests, answers })
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    fn ask(script: &str, seconds: Option<f64>, limit: u64) -> Vec<Ended> {
        let arguments = ["-c", script];
        let mut worker = Worker::new(Path::new("/bin/sh"), &arguments);
        (0..2)
            .map(|_| {
                let deadline = seconds.map(|s| Instant::now() + Duration::from_secs_f64(s));
                worker.ask(&Request::Run(vec!["x".into()]), deadline, |now| now > limit, &Progress::new()).unwrap()
            })
            .collect()
    }

    #[test]
    fn what_a_process_does_is_told_and_it_is_replaced() {
        let answer = |status: u8, line: &str| Answer { status, line: line.to_owned(), seen: None };
        let said = "read a; echo noise; echo 'answer: {\"status\":3,\"line\":\"bad\"}'";
        let all = u64::MAX;
        // The same process answers twice, or another one.
        let twice = format!("{said}; {said}");
        assert_eq!(ask(&twice, None, all), [Ended::Answered(answer(3, "bad")), Ended::Answered(answer(3, "bad"))]);
        assert_eq!(ask(said, None, all), [Ended::Answered(answer(3, "bad")), Ended::Died]);
        assert_eq!(ask("kill -9 $$", None, all), [Ended::Died, Ended::Died]);
        assert_eq!(ask("read a; exec sleep 60", Some(0.1), all), [Ended::Late, Ended::Late]);
        if cfg!(target_os = "linux") {
            assert!(matches!(ask("read a; exec sleep 60", None, 0)[..], [Ended::TooLarge(_), Ended::TooLarge(_)]));
        }
        let none = Worker::new(Path::new("/no/such/program"), &[]).ask(
            &Request::Run(Vec::new()),
            None,
            |_| false,
            &Progress::new(),
        );
        assert!(none.is_err());
        let progress = Progress::new();
        progress.cancel();
        let arguments = ["-c", "exec sleep 60"];
        let mut worker = Worker::new(Path::new("/bin/sh"), &arguments);
        assert!(worker.ask(&Request::Run(Vec::new()), None, |_| false, &progress).is_err());
    }
}
