//! The program's error type: what failed, why, a hint for the user, and the exit status.
//!
//! # Exit statuses
//!
//! | status | meaning |
//! |---|---|
//! | 0 | success, including when the time of `--seconds` is over, the window is closed, or the reader of standard output closes it |
//! | 1 | [`Kind::Fault`]: internal error, including a panic |
//! | 2 | [`Kind::Usage`]: invalid usage: unknown or contradictory arguments, settings out of range, an inconsistent scene, a command that is not part of this build |
//! | 3 | [`Kind::Input`]: an input cannot be read or used: missing, damaged, truncated, unsupported format or modality, missing slices, too large for the memory |
//! | 4 | [`Kind::Incomplete`]: the flight or path cannot be completed: nothing to fly through, a point outside the lumen, a flight that calls the operator without a window, or an interruption (Ctrl-C). Log, statistics and recording are written and complete up to that point |
//! | 5 | [`Kind::Output`]: an output cannot be written: no permission, disk full, missing folder, no `ffmpeg` for a video |
//!
//! Every failure prints exactly one line to standard error: `error: WHAT: WHY; HINT`. Notes and progress come before it, and so do
//! the choices, one line for each of [`Error::choices`]. Output files are written completely or not at all (see [`crate::output`]).

use std::ffi::OsStr;
use std::fmt;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// The name under which this program was started.
static PROGRAM: OnceLock<String> = OnceLock::new();

/// The name of the program that runs, for messages: `colvis`, or that of another crate's program.
#[must_use]
pub fn program_name() -> &'static str {
    PROGRAM.get().map_or("colvis", String::as_str)
}

/// Sets the name of the running program: the file name of its first argument. Only the first call counts.
#[doc(hidden)]
pub fn set_program_name(first_argument: &OsStr) {
    if let Some(name) = Path::new(first_argument).file_stem().and_then(OsStr::to_str).filter(|n| !n.is_empty()) {
        PROGRAM.get_or_init(|| name.to_owned());
    }
}

/// The kind of a failure. Its number is the exit status of the program, see the [module](self).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// 1: an internal error.
    Fault = 1,
    /// 2: invalid usage.
    Usage = 2,
    /// 3: an input cannot be read or used.
    Input = 3,
    /// 4: the flight or path cannot be completed, or it was interrupted.
    Incomplete = 4,
    /// 5: an output cannot be written.
    Output = 5,
}

/// A failure, printed as `WHAT: WHY; HINT` on one line.
///
/// ```
/// # use colvis_scan as colvis;
/// use colvis::error::Error;
///
/// let e = Error::usage("--fov", "0 is not between 0 and 180", "give an angle such as 90");
/// assert_eq!(e.to_string(), "--fov: 0 is not between 0 and 180; give an angle such as 90");
/// assert_eq!(e.kind as u8, 2, "the exit status");
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Error {
    /// The kind of failure, which determines the exit status.
    pub kind: Kind,
    /// What failed, usually a file or an option.
    pub what: String,
    /// Why it failed, with the offending value.
    pub why: String,
    /// What the user can do about it, in the imperative.
    pub hint: String,
    /// The error that caused this one, if there is one. `why` contains its message.
    pub cause: Option<Cause>,
    /// If an input holds several scans: one line for each, in the order in which `--series` counts them, from 1. They name no
    /// patient.
    pub choices: Vec<String>,
}

/// An error of another library, as the cause of an [`Error`].
pub type Cause = Arc<dyn std::error::Error + Send + Sync>;

/// The result of anything that can fail.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// Creates a failure of the given kind.
    pub fn new(kind: Kind, what: impl Into<String>, why: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { kind, what: what.into(), why: why.into(), hint: hint.into(), cause: None, choices: Vec::new() }
    }

    /// Adds the error that caused this one.
    #[must_use]
    pub fn caused_by(self, cause: impl std::error::Error + Send + Sync + 'static) -> Self {
        Self { cause: Some(Arc::new(cause)), ..self }
    }

    /// Renames what failed, from its name so far: to say in which file or table it stands.
    #[must_use]
    pub fn named(self, what: impl FnOnce(&str) -> String) -> Self {
        Self { what: what(&self.what), ..self }
    }

    /// An internal error: status 1.
    pub fn fault(what: impl Into<String>, why: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::new(Kind::Fault, what, why, hint)
    }

    /// Invalid usage: status 2.
    pub fn usage(what: impl Into<String>, why: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::new(Kind::Usage, what, why, hint)
    }

    /// An input cannot be read or used: status 3.
    pub fn input(what: impl Into<String>, why: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::new(Kind::Input, what, why, hint)
    }

    /// Same as [`Error::input`], for a file.
    pub fn file(path: &Path, why: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::input(path.display().to_string(), why, hint)
    }

    /// The flight or path cannot be completed: status 4.
    pub fn incomplete(what: impl Into<String>, why: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::new(Kind::Incomplete, what, why, hint)
    }

    /// An output cannot be written: status 5.
    pub fn output(path: &Path, why: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::new(Kind::Output, path.display().to_string(), why, hint)
    }

    /// The user asked to stop (Ctrl-C, or the window's cancel key): status 4.
    pub fn cancelled(what: impl Into<String>) -> Self {
        Self::incomplete(what, "interrupted", "run it again to finish")
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}; {}", one_line(&self.what), one_line(&self.why), one_line(&self.hint))
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.cause.as_deref().map(|cause| cause as _)
    }
}

/// Messages show at most this many characters of a name or a reason.
const MOST_CHARACTERS: usize = 600;
/// Longer runs of digits are a number such as 1e308, not part of a file's name.
const MOST_DIGITS: usize = 60;
/// Digits shown of a fraction that is as long.
const DECIMALS: usize = 8;

/// Replaces control characters by spaces. File names and messages of other programs may contain line breaks, which must not start
/// a second line. Numbers of hundreds of digits are written with an exponent, and endless names lose their middle.
fn one_line(s: &str) -> String {
    let mut line = String::with_capacity(s.len().min(2 * MOST_CHARACTERS));
    let mut digits = String::new();
    for c in s.chars().chain(['\n']) {
        if c.is_ascii_digit() {
            digits.push(c);
            continue;
        }
        if digits.len() <= MOST_DIGITS {
            line.push_str(&digits);
        } else if line.ends_with('.') {
            line.push_str(&digits[..DECIMALS]);
            line.push('…');
        } else {
            line.push_str(&format!("{}.{}e{}", &digits[..1], &digits[1..4], digits.len() - 1));
        }
        digits.clear();
        line.push(if c.is_control() { ' ' } else { c });
    }
    line.pop();
    let count = line.chars().count();
    if count <= MOST_CHARACTERS {
        return line;
    }
    let part = MOST_CHARACTERS / 2;
    let (head, tail) = (line.chars().take(part), line.chars().skip(count - part));
    head.chain(['…']).chain(tail).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endless_numbers_and_names_are_shortened() {
        let e = Error::usage("--seconds", format!("{} is not above 0", -1e308), "give seconds");
        assert_eq!(e.to_string(), "--seconds: -1.000e308 is not above 0; give seconds");
        let e = Error::usage("dims", "123456789012345678901234 voxels, 0.1234 mm", "é".repeat(5000));
        assert!(e.to_string().starts_with("dims: 123456789012345678901234 voxels, 0.1234 mm; éé"));
        assert_eq!(e.to_string().chars().filter(|c| *c == 'é').count(), MOST_CHARACTERS);
        let e = Error::usage("--seconds", format!("{} and {}", 1e-300, 1.5e99), "ok");
        assert_eq!(e.to_string(), "--seconds: 0.00000000… and 1.500e99; ok");
        let name = format!("{}.nii", "7".repeat(50));
        assert!(Error::file(Path::new(&name), "a", "b").to_string().starts_with(&name), "a name stays itself");
        assert_eq!(Error::usage("", "7", "x\u{7}y").to_string(), ": 7; x y");
    }

    #[test]
    fn the_chain_of_causes_is_kept_beside_the_line() {
        let cause = std::io::Error::new(std::io::ErrorKind::InvalidData, "bad\nchecksum".parse::<f64>().unwrap_err());
        let e = Error::file(Path::new("a.nii"), "is damaged", "copy it again").caused_by(cause);
        let chain: Vec<String> =
            std::iter::successors(std::error::Error::source(&e), |e| e.source()).map(ToString::to_string).collect();
        assert_eq!(chain, ["invalid float literal"], "an io::Error is as its content");
        let io = std::error::Error::source(&e).and_then(|s| s.downcast_ref::<std::io::Error>());
        assert_eq!(io.unwrap().kind(), std::io::ErrorKind::InvalidData);
        let told = Error { what: "b.nii".to_owned(), ..e.clone() };
        assert!(std::error::Error::source(&told).is_some(), "an error that is told again keeps its cause");
        assert_eq!(e.to_string(), "a.nii: is damaged; copy it again");
    }

    #[test]
    fn a_failure_is_one_line() {
        let e = Error::file(Path::new("a\nb.nii"), "wrong\r\nmagic", "give a NIfTI file");
        assert_eq!(e.to_string(), "a b.nii: wrong  magic; give a NIfTI file");
        assert_eq!(e.kind as i32, 3);
    }
}
