//! Memory usage of this process, as the system reports it.

/// Returns an entry of the process status, in bytes: `VmRSS`, the resident set, or `VmHWM`, its peak. `None` if the system does
/// not report it (only Linux does).
pub fn resident_bytes(entry: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let value = status.lines().find_map(|l| l.strip_prefix(entry)?.strip_prefix(':'))?;
    value.trim().trim_end_matches("kB").trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_is_no_less_than_what_is_there() {
        if let Some(now) = resident_bytes("VmRSS") {
            assert!(now > 1 << 16 && resident_bytes("VmHWM").is_some_and(|most| most > 1 << 16));
        }
        assert_eq!(resident_bytes("Vm"), None);
    }
}
