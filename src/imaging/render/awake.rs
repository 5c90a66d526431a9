//! Threads that stay awake for a frame.
//!
//! A frame is a handful of parallel loops of a millisecond. Between two loops, and between frames, the threads of the pool that find
//! nothing to do go to sleep within some ten microseconds; to wake one takes 50 to 100 µs where processors rest in a virtual machine
//! or in a deep state, and they wake each other one by one, so that with sixteen threads each loop begins late. Here they look for
//! work until the frame is done.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A thread that finds nothing for so long goes to sleep after all.
const PATIENCE: Duration = Duration::from_micros(1500);
/// Number of looks between two of them that let other programs run.
const LOOKS: u32 = 32;

/// Runs `work` with the other threads of this pool awake until it returns. Does nothing more outside a pool.
pub fn awake<T>(work: impl FnOnce() -> T) -> T {
    let Some(own) = rayon::current_thread_index().filter(|_| rayon::current_num_threads() > 1) else { return work() };
    // Also if `work` panics.
    let done = Done(Arc::default());
    let seen = Arc::clone(&done.0);
    rayon::spawn_broadcast(move |here| {
        // This thread has the work itself.
        if here.index() != own {
            look(&seen);
        }
    });
    let made = work();
    // Takes this thread's own part, which would wait for a frame in which it has to wait itself.
    rayon::yield_local();
    made
}

struct Done(Arc<AtomicBool>);

impl Drop for Done {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// Does what other threads offer until `done`.
fn look(done: &AtomicBool) {
    let mut idle: Option<Instant> = None;
    while !done.load(Ordering::Acquire) {
        match rayon::yield_now() {
            Some(rayon::Yield::Executed) => idle = None,
            _ if idle.get_or_insert_with(Instant::now).elapsed() > PATIENCE => return,
            _ => {
                (0..LOOKS).for_each(|_| std::hint::spin_loop());
                std::thread::yield_now();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rayon::prelude::*;

    use super::*;

    fn sum(n: u64) -> u64 {
        (0..n).into_par_iter().map(|n| n * n % 7).sum()
    }

    #[test]
    fn the_result_is_that_of_the_work_in_any_pool_one_within_another_and_again_after_a_panic() {
        let plain = sum(10_000);
        assert_eq!(awake(|| sum(10_000)), plain, "outside a pool");
        for threads in [1, 2, 3, 16] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                for _ in 0..200 {
                    assert_eq!(awake(|| awake(|| sum(500)) + sum(500)), 2 * sum(500));
                }
                let all: Vec<u64> = (0..40u64).into_par_iter().map(|_| awake(|| sum(10_000))).collect();
                assert!(all.iter().all(|s| *s == plain));
                let failed =
                    std::panic::catch_unwind(|| awake(|| (0..64).into_par_iter().for_each(|n| assert!(n < 50))));
                assert!(failed.is_err());
                assert_eq!(awake(|| sum(10_000)), plain);
            });
        }
    }

    /// Work that takes longer than the others' patience still gets their help afterwards.
    #[test]
    fn threads_that_have_gone_to_sleep_are_woken_again() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
        let who = pool.install(|| {
            awake(|| {
                std::thread::sleep(3 * PATIENCE);
                rayon::broadcast(|here| here.index())
            })
        });
        assert_eq!(who, [0, 1, 2, 3]);
    }
}
