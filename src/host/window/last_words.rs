//! Logs and other outputs are finished also where the window system ends the program: Xlib calls `exit` when its display is lost.
//!
//! The program's first thread then still drops its thread-local values. One of them holds the window, and ends it.

use std::cell::RefCell;
use std::rc::Rc;

use winit::application::ApplicationHandler;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::ActiveEventLoop;
use winit::window::WindowId;

use super::shell::{Shell, Wake};
use crate::{output, panics};

/// The window, until it is ended.
pub(super) type Kept = Rc<RefCell<Option<Shell>>>;

thread_local! {
    static LAST: RefCell<Option<LastWords>> = const { RefCell::new(None) };
}

/// Ends the window that it holds when it is dropped.
struct LastWords(Kept);

impl Drop for LastWords {
    fn drop(&mut self) {
        // The event loop does not hold it while it waits for the window system.
        let Some(shell) = self.0.try_borrow_mut().ok().and_then(|mut s| s.take()) else { return };
        match panics::catch(|| shell.end_without_display()) {
            Ok(Ok(())) => {}
            Ok(Err(e)) => output::to_stderr(format_args!("note: {e}")),
            Err(why) => output::to_stderr(format_args!("note: window: panicked: {why}")),
        }
    }
}

/// Keeps a window, so that it is ended whatever ends the program.
pub(super) fn keep(shell: Shell) -> Kept {
    let kept = Rc::new(RefCell::new(Some(shell)));
    LAST.with_borrow_mut(|last| *last = Some(LastWords(Rc::clone(&kept))));
    kept
}

/// Takes the window, to end it in order.
pub(super) fn take(kept: &Kept) -> Option<Shell> {
    kept.borrow_mut().take()
}

/// Passes events on to the window. It holds the window only while it does so.
pub(super) struct Handler(pub Kept);

impl Handler {
    fn with(&self, work: impl FnOnce(&mut Shell)) {
        if let Some(shell) = &mut *self.0.borrow_mut() {
            work(shell);
        }
    }
}

impl ApplicationHandler<Wake> for Handler {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        self.with(|shell| shell.resumed(events));
    }

    fn user_event(&mut self, events: &ActiveEventLoop, wake: Wake) {
        self.with(|shell| shell.user_event(events, wake));
    }

    fn window_event(&mut self, events: &ActiveEventLoop, id: WindowId, event: WindowEvent) {
        self.with(|shell| shell.window_event(events, id, event));
    }

    fn new_events(&mut self, events: &ActiveEventLoop, cause: StartCause) {
        self.with(|shell| shell.new_events(events, cause));
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        self.with(|shell| shell.about_to_wait(events));
    }
}
