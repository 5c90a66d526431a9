//! Memory usage of this process, as the system reports it.

/// Returns an entry of the process status, in bytes: `VmRSS`, the resident set, or `VmHWM`, its peak. `None` if the system does
/// not report it (only Linux does).
pub fn resident_bytes(entry: &str) -> Option<u64> {
    entry_of("/proc/self/status", entry)
}

/// Returns the resident set of another process, bytes. `None` as above, or if there is no such process.
pub fn resident_of(process: u32) -> Option<u64> {
    entry_of(&format!("/proc/{process}/status"), "VmRSS")
}

/// Returns the memory that processes may still take, bytes; `None` as above.
pub fn available() -> Option<u64> {
    entry_of("/proc/meminfo", "MemAvailable")
}

/// Lets the peak of the resident set begin at what it is now. Only Linux can.
pub fn reset_peak() {
    // Without the right to do so, the peak is that of the whole process.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

fn entry_of(file: &str, entry: &str) -> Option<u64> {
    let status = std::fs::read_to_string(file).ok()?;
    let value = status.lines().find_map(|l| l.strip_prefix(entry)?.strip_prefix(':'))?;
    value.trim().trim_end_matches("kB").trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

/// Returns what was freed to the system. The C library of Linux (glibc) keeps it for later, a fifth of a scan after each stage of a
/// preparation. Elsewhere this does nothing.
pub fn release() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    #[expect(unsafe_code, reason = "a function of the C library that has no other form")]
    // SAFETY: it may be called at any time from any thread, and touches only memory that is free.
    unsafe {
        libc::malloc_trim(0);
    }
}

/// The size from which blocks are returned to the system when they are freed, bytes: those of scans, fields and pictures. Cleansing works
/// in blocks of 0.6 MiB, one after the other, and is faster if it gets them again.
const LARGE: i32 = 3 << 18;

/// Lets blocks of three quarters of a MiB and more be returned to the system as soon as they are freed, from now on, in the whole program.
///
/// By itself the C library of Linux (glibc) raises that size with each block that is freed, up to 32 MiB, and keeps what is smaller
/// between blocks that are in use, where [`release`] does not get at it: a fifth of a scan in a window. Elsewhere this does nothing.
pub fn return_large_blocks() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    #[expect(unsafe_code, reason = "a function of the C library that has no other form")]
    // SAFETY: it may be called at any time from any thread, and changes only how blocks are made from then on. With a fixed size, the
    // end of the heap is returned from 128 KiB on, which is too often; twice the size is what the library itself takes.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, LARGE);
        libc::mallopt(libc::M_TRIM_THRESHOLD, 2 * LARGE);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Mutex, MutexGuard, PoisonError};

    use super::*;

    /// Tests that look at the process's memory do so one after the other.
    fn alone() -> MutexGuard<'static, ()> {
        static ALONE: Mutex<()> = Mutex::new(());
        ALONE.lock().unwrap_or_else(PoisonError::into_inner)
    }

    #[test]
    fn what_is_freed_is_returned() {
        let _alone = alone();
        // Small enough to be kept by the C library.
        let parts: Vec<Vec<u8>> = (0..2000).map(|n| vec![n as u8; 60_000]).collect();
        let Some(before) = resident_bytes("VmRSS") else { return };
        drop(parts);
        release();
        let after = resident_bytes("VmRSS").unwrap();
        if cfg!(all(target_os = "linux", target_env = "gnu")) {
            assert!(after + 60_000_000 < before, "{before} {after}");
        }
    }

    #[test]
    fn large_blocks_are_returned_at_once() {
        let _alone = alone();
        return_large_blocks();
        // As large as those that the C library would keep from now on.
        drop(vec![1u8; 30_000_000]);
        let Some(before) = resident_bytes("VmRSS") else { return };
        // What comes later lies behind a block, and would keep it from being returned.
        let blocks: Vec<_> = (0..5).map(|_| (vec![2u8; 29_000_000], vec![3u8; 100_000])).collect();
        let later: Vec<_> = blocks.into_iter().map(|(_, later)| later).collect();
        let after = resident_bytes("VmRSS").unwrap();
        if cfg!(all(target_os = "linux", target_env = "gnu")) {
            assert!(after < before + 70_000_000, "{before} {after}");
        }
        drop(later);
    }

    #[test]
    fn the_most_is_no_less_than_what_is_there() {
        if let Some(now) = resident_bytes("VmRSS") {
            assert!(now > 1 << 16 && resident_bytes("VmHWM").is_some_and(|most| most > 1 << 16));
        }
        assert_eq!(resident_bytes("Vm"), None);
        let own = resident_of(std::process::id());
        assert_eq!(own.is_some(), resident_bytes("VmRSS").is_some());
        assert_eq!(resident_of(u32::MAX), None);
        assert_eq!(available().is_some(), own.is_some());
    }

    #[test]
    fn a_peak_can_be_forgotten() {
        let _alone = alone();
        let large = vec![1u8; 200_000_000];
        let Some(before) = resident_bytes("VmHWM") else { return };
        assert!(large.iter().step_by(4096).all(|&b| b == 1));
        drop(large);
        reset_peak();
        assert!(resident_bytes("VmHWM").unwrap() + 100_000_000 < before, "{before}");
    }
}
