//! A fence around other people's decoders: a panic inside becomes an error, and prints nothing.

use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

/// How many fences are closed just now.
static CLOSED: AtomicUsize = AtomicUsize::new(0);

/// Runs `work`; `None` if it panicked.
pub fn fenced<T>(work: impl FnOnce() -> T) -> Option<T> {
    static QUIET: Once = Once::new();
    QUIET.call_once(|| {
        let shown = take_hook();
        // A decoder may panic on a thread of its own pool, so it is not asked which thread it is.
        set_hook(Box::new(move |info| {
            if CLOSED.load(SeqCst) == 0 {
                shown(info);
            }
        }));
    });
    CLOSED.fetch_add(1, SeqCst);
    // What a decoder leaves half done is dropped with it.
    let result = catch_unwind(AssertUnwindSafe(work)).ok();
    CLOSED.fetch_sub(1, SeqCst);
    result
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_panic_is_caught() {
        assert_eq!(super::fenced(|| 3), Some(3));
        let empty: [u8; 0] = [];
        assert_eq!(super::fenced(|| empty[std::hint::black_box(7)]), None);
    }
}
