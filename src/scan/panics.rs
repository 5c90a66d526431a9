//! Catches panics of other people's code that should return an error instead (decoders on damaged data, a window system on a
//! machine without its libraries) and turns them into values.
//!
//! The process's panic hook belongs to the program, so this module leaves it alone: the hook is called for a caught panic as for
//! any other. A hook that should ignore caught panics checks [`is_catching`].

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::error::Error;

thread_local! {
    /// Number of nested catches around the work of this thread.
    static FENCES: Cell<usize> = const { Cell::new(0) };
    /// Location of the last caught panic of this thread, until it is read.
    static PLACE: Cell<Option<String>> = const { Cell::new(None) };
}

/// The work panicked and the panic was caught. Its message went to the panic hook.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Panicked;

/// Runs `work` and catches its panic.
///
/// Anything that `work` leaves half done must not be used afterwards. Do not pass it references to data that outlives it and
/// could be left inconsistent.
///
/// # Errors
/// Returns [`Panicked`] if `work` panicked, also on another thread that passes its panics on to this one, as thread pools do.
pub fn catch_panic<T>(work: impl FnOnce() -> T) -> Result<T, Panicked> {
    FENCES.with(|f| f.set(f.get() + 1));
    let result = catch_unwind(AssertUnwindSafe(work));
    FENCES.with(|f| f.set(f.get() - 1));
    result.map_err(|_| Panicked)
}

/// Same as [`catch_panic`], but returns the panic's message on one line, with its location if the program's hook has
/// [noted](note_place) it.
///
/// # Errors
/// Returns that message if `work` panicked.
pub fn catch<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    FENCES.with(|f| f.set(f.get() + 1));
    let result = catch_unwind(AssertUnwindSafe(work));
    FENCES.with(|f| f.set(f.get() - 1));
    result.map_err(|payload| panic_text(&*payload))
}

/// Calls code of another crate, named `what`, and turns a panic into an error with that name.
///
/// # Errors
/// Returns the error of `ask`, or status 1 if it panics.
pub fn ask_plugin<T>(what: impl FnOnce() -> String, ask: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    catch(ask).unwrap_or_else(|why| Err(Error::fault(what(), format!("panicked: {why}"), "fix it or leave it out")))
}

/// Returns a panic's message on one line, with its location if known.
pub fn panic_text(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().copied().or(payload.downcast_ref::<String>().map(String::as_str));
    let at = PLACE.with(Cell::take).map_or_else(String::new, |place| format!(" ({place})"));
    format!("{}{at}", text.unwrap_or("no reason given")).replace(char::is_control, " ")
}

/// Notes the location of a caught panic. For use in a panic hook.
pub fn note_place(place: String) {
    PLACE.with(|p| p.set(Some(place)));
}

/// True if a panic on this thread will be caught. For use in a panic hook. The threads of a pool that the work uses do not know
/// that they are inside a catch.
pub fn is_catching() -> bool {
    FENCES.try_with(|f| f.get() > 0).unwrap_or(false)
}

/// Lock for tests that replace the panic hook of the whole process.
pub static HOOK: std::sync::Mutex<()> = std::sync::Mutex::new(());

#[cfg(test)]
mod tests {
    use std::panic::{catch_unwind, set_hook, take_hook};
    use std::sync::{Arc, Mutex, PoisonError};

    use super::*;

    #[test]
    fn a_panic_is_caught_and_fences_nest() {
        assert_eq!(catch_panic(|| (3, is_catching())), Ok((3, true)));
        let _hook = HOOK.lock().unwrap_or_else(PoisonError::into_inner);
        let empty: [u8; 0] = [];
        let nested = catch_panic(|| (catch_panic(|| empty[std::hint::black_box(7)]), is_catching()));
        assert_eq!(nested, Ok((Err(Panicked), true)));
        assert!(!is_catching());
    }

    #[test]
    fn the_hook_stays_and_can_tell() {
        let _hook = HOOK.lock().unwrap_or_else(PoisonError::into_inner);
        let usual = Arc::new(take_hook());
        let heard = Arc::new(Mutex::new(Vec::new()));
        let (hear, mine, others) = (Arc::clone(&heard), std::thread::current().id(), Arc::clone(&usual));
        set_hook(Box::new(move |info| {
            if std::thread::current().id() == mine {
                hear.lock().unwrap().push(is_catching());
            } else {
                others(info);
            }
        }));
        assert_eq!(catch_panic(|| panic!("inside")), Err::<(), _>(Panicked));
        assert!(catch_unwind(|| panic!("outside")).is_err());
        set_hook(Box::new(move |info| usual(info)));
        assert_eq!(*heard.lock().unwrap(), [true, false]);
    }
}
