//! A progress bar on a terminal. Shows nothing if standard error is not a terminal.

use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use crate::progress::Progress;

/// A progress bar on the terminal until dropped; nothing if standard error is not a terminal.
///
/// `cli::Session::progress_bar` makes one.
#[must_use = "the bar is shown until it is dropped"]
pub struct Bar {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Bar {
    /// Starts to show `progress`.
    #[doc(hidden)]
    pub fn show(progress: &Arc<Progress>) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let thread = std::io::stderr().is_terminal().then(|| {
            let (stop, progress) = (Arc::clone(&stop), Arc::clone(progress));
            std::thread::spawn(move || {
                let bar = ProgressBar::new(1);
                if let Ok(style) = ProgressStyle::with_template("{msg:24} {bar:40} {percent:>3} %  {elapsed}") {
                    bar.set_style(style);
                }
                while !stop.load(Ordering::Relaxed) {
                    let (stage, done, total) = progress.snapshot();
                    bar.set_message(stage);
                    bar.set_length(total.max(1));
                    bar.set_position(done.min(total.max(1)));
                    std::thread::sleep(Duration::from_millis(80));
                }
                bar.finish_and_clear();
            })
        });
        Self { stop, thread }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(t) = self.thread.take() {
            // A panic of the bar must not affect the job.
            let _ = t.join();
        }
    }
}
