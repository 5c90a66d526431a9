//! Memory usage of this process, as the system reports it.

/// Returns an entry of the process status, in bytes: `VmRSS`, the resident set, or `VmHWM`, its peak. `None` if the system does
/// not report it (only Linux does).
pub fn resident_bytes(entry: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_freed_is_returned() {
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
    fn the_most_is_no_less_than_what_is_there() {
        if let Some(now) = resident_bytes("VmRSS") {
            assert!(now > 1 << 16 && resident_bytes("VmHWM").is_some_and(|most| most > 1 << 16));
        }
        assert_eq!(resident_bytes("Vm"), None);
    }
}
