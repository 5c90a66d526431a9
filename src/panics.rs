//! A fence around other people's code that panics where it should fail (decoders on damaged data, a window system on a
//! machine without its libraries): the panic becomes a value.
//!
//! The process's panic hook belongs to the program, so that a fence leaves it alone: the hook is called for a fenced
//! panic as for every other. A program that wants to hear nothing of these asks [`is_catching`] in its hook.

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::error::Error;

thread_local! {
    /// Number of fences around what this thread is doing.
    static FENCES: Cell<usize> = const { Cell::new(0) };
    /// Where the last fenced panic of this thread happened, until it is asked for.
    static PLACE: Cell<Option<String>> = const { Cell::new(None) };
}

/// The work behind a fence panicked. What it said went to the panic hook.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("panicked")]
pub struct Panicked;

/// Runs `work` and catches its panic.
///
/// What `work` leaves half done must not be used afterwards: give it nothing by reference that outlives it and can be
/// broken.
///
/// # Errors
/// [`Panicked`] where it panicked, also on another thread that passes its panics on to this one, as thread pools do.
pub fn catch_panic<T>(work: impl FnOnce() -> T) -> Result<T, Panicked> {
    FENCES.with(|f| f.set(f.get() + 1));
    let result = catch_unwind(AssertUnwindSafe(work));
    FENCES.with(|f| f.set(f.get() - 1));
    result.map_err(|_| Panicked)
}

/// As [`catch_panic`]; what the panic said, on one line, and where it happened if the program's hook has [noted](note_place) it.
///
/// # Errors
/// That text.
pub fn catch<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    FENCES.with(|f| f.set(f.get() + 1));
    let result = catch_unwind(AssertUnwindSafe(work));
    FENCES.with(|f| f.set(f.get() - 1));
    result.map_err(|payload| panic_text(&*payload))
}

/// Asks something of another crate's, named `what`, for a value: a panic is an error with that name.
///
/// # Errors
/// What `ask` returns; status 1 when it panics.
pub fn ask_plugin<T>(what: impl FnOnce() -> String, ask: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    catch(ask).unwrap_or_else(|why| Err(Error::fault(what(), format!("panicked: {why}"), "fix it, or do without it")))
}

/// What a panic said, on one line, and where it happened if that is known.
pub fn panic_text(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().copied().or(payload.downcast_ref::<String>().map(String::as_str));
    let at = PLACE.with(Cell::take).map_or_else(String::new, |place| format!(" ({place})"));
    format!("{}{at}", text.unwrap_or("no reason given")).replace(char::is_control, " ")
}

/// Notes where a fenced panic happens: for a panic hook.
pub fn note_place(place: String) {
    PLACE.with(|p| p.set(Some(place)));
}

/// Whether what this thread is doing is behind a fence, so that a panic on it will be caught: for a panic hook to ask.
/// The threads of a pool that the work uses do not know of the fence.
pub fn is_catching() -> bool {
    FENCES.try_with(|f| f.get() > 0).unwrap_or(false)
}

/// Held by tests that exchange the panic hook of the whole process.
#[cfg(test)]
pub(crate) static HOOK: std::sync::Mutex<()> = std::sync::Mutex::new(());

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
