//! One kind of error for the whole program: what failed, why, and how to mend it, with the exit status it stands for.

use std::path::Path;

/// The exit statuses of the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A fault of the program's own (1).
    Fault = 1,
    /// Wrong usage (2).
    Usage = 2,
    /// The input cannot be read or used (3).
    Input = 3,
    /// The flight or path cannot be completed (4).
    Incomplete = 4,
    /// An output cannot be written (5).
    Output = 5,
}

/// A failure, printed as `WHAT: WHY; HOW TO MEND` on one line.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{}: {}; {}", one_line(.what), one_line(.why), one_line(.mend))]
pub struct Error {
    /// The exit status this failure stands for.
    pub kind: Kind,
    /// What failed, usually a file or an option.
    pub what: String,
    /// Why it failed, with the offending value.
    pub why: String,
    /// What the user can do about it.
    pub mend: String,
}

/// The result of anything that can fail.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// A failure of the given kind.
    pub fn new(kind: Kind, what: impl Into<String>, why: impl Into<String>, mend: impl Into<String>) -> Self {
        Self { kind, what: what.into(), why: why.into(), mend: mend.into() }
    }

    /// A fault of the program's own.
    pub fn fault(what: impl Into<String>, why: impl Into<String>, mend: impl Into<String>) -> Self {
        Self::new(Kind::Fault, what, why, mend)
    }

    /// Wrong usage.
    pub fn usage(what: impl Into<String>, why: impl Into<String>, mend: impl Into<String>) -> Self {
        Self::new(Kind::Usage, what, why, mend)
    }

    /// The input cannot be read or used.
    pub fn input(what: impl Into<String>, why: impl Into<String>, mend: impl Into<String>) -> Self {
        Self::new(Kind::Input, what, why, mend)
    }

    /// [`Error::input`] about a file.
    pub fn file(path: &Path, why: impl Into<String>, mend: impl Into<String>) -> Self {
        Self::input(path.display().to_string(), why, mend)
    }

    /// The flight or path cannot be completed.
    pub fn incomplete(what: impl Into<String>, why: impl Into<String>, mend: impl Into<String>) -> Self {
        Self::new(Kind::Incomplete, what, why, mend)
    }

    /// An output cannot be written.
    pub fn output(path: &Path, why: impl Into<String>, mend: impl Into<String>) -> Self {
        Self::new(Kind::Output, path.display().to_string(), why, mend)
    }

    /// The user asked to stop (Ctrl-C, or the window's cancel key).
    pub fn cancelled(what: impl Into<String>) -> Self {
        Self::incomplete(what, "interrupted", "run it again to finish")
    }
}

/// Error texts may carry file names and other programs' messages; a line break in them must not make a second line.
fn one_line(s: &str) -> String {
    s.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_is_one_line() {
        let e = Error::file(Path::new("a\nb.nii"), "wrong\r\nmagic", "give a NIfTI file");
        assert_eq!(e.to_string(), "a b.nii: wrong  magic; give a NIfTI file");
        assert_eq!(e.kind as i32, 3);
    }
}
