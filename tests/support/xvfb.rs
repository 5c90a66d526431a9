//! A virtual X server.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

/// True if a program is in the path.
pub(crate) fn is_there(tool: &str) -> bool {
    std::env::var_os("PATH").is_some_and(|path| std::env::split_paths(&path).any(|p| p.join(tool).is_file()))
}

/// Starts a server with a screen such as `640x480x24`, and returns it with its display. The caller kills it.
pub(crate) fn start(screen: &str, options: &[&str]) -> (Child, String) {
    let mut server = Command::new("Xvfb")
        .args(["-displayfd", "1", "-nolisten", "tcp", "-screen", "0", screen])
        .args(options)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut number = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
    assert!(!number.trim().is_empty(), "Xvfb has no display");
    (server, format!(":{}", number.trim()))
}
