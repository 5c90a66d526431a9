//! Planned commands and options that are not built yet. They are refused with that reason and never mistaken for an input.

use std::ffi::OsString;

use clap::error::{ContextKind, ContextValue, ErrorKind};

use crate::error::{Error, program_name};

/// Planned commands.
const COMMANDS: [&str; 0] = [];
/// Planned options of built commands.
const OPTIONS: [&str; 1] = ["--truth"];

/// Refuses a command that is not built yet; `place` is the command's position in the line. An input with such a name needs a path
/// (`./dataset`) or an explicit command (`fly dataset`). Fails with status 2.
pub(super) fn check_command(line: &[OsString], place: usize) -> Result<(), Error> {
    let named = line.get(place).and_then(|a| a.to_str()).and_then(|a| COMMANDS.into_iter().find(|c| *c == a));
    named.map_or(Ok(()), |command| {
        let why = "this command is not built yet";
        Err(Error::usage(
            format!("{} {command}", program_name()),
            why,
            format!("see {} --help; open a scan of that name as ./{command}", program_name()),
        ))
    })
}

/// True if `name` is a planned command that is not built yet.
pub(super) fn is_command(name: &str) -> bool {
    COMMANDS.contains(&name)
}

/// The refusal of an option that is not built yet, if that is why the command line was refused.
pub(super) fn refusal(e: &clap::Error) -> Option<Error> {
    let text = |kind| match e.get(kind) {
        Some(ContextValue::String(s)) => s.as_str(),
        _ => "",
    };
    // An option is reported with its value's name: `--camera <MODEL>`.
    let argument = text(ContextKind::InvalidArg);
    let option = argument.split([' ', '=']).next().unwrap_or(argument);
    let what = match e.kind() {
        ErrorKind::UnknownArgument => OPTIONS.into_iter().find(|o| *o == option)?.to_owned(),
        _ => return None,
    };
    Some(Error::usage(what, "is not built yet", format!("see {} --help, or that of the command", program_name())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Program;
    use crate::cli::args::ParseError;

    #[test]
    fn planned_commands_are_known_and_refused_where_a_command_stands() {
        let line = |words: &[&str]| words.iter().map(OsString::from).collect::<Vec<_>>();
        for command in COMMANDS {
            assert!(is_command(command));
            let told = check_command(&line(&["colvis", command]), 1).unwrap_err().to_string();
            assert!(told.contains("not built") && told.contains(&format!("./{command}")), "{told}");
            assert!(check_command(&line(&["colvis", "fly", command]), 1).is_ok(), "an input of that name");
        }
        for command in ["fly", "segment", "", "./dataset"] {
            assert!(!is_command(command) && check_command(&line(&["colvis", command]), 1).is_ok());
        }
    }

    #[test]
    fn planned_options_are_told_from_unknown_ones() {
        let refused = |words: &[&str]| match Program::default().parse(words.iter().copied()) {
            Err(ParseError::Line(e)) => refusal(&e).map(|e| (e.what, e.why)),
            other => panic!("{other:?}"),
        };
        let planned = refused(&["colvis", "render", "--truth"]);
        assert_eq!(planned, Some(("--truth".to_owned(), "is not built yet".to_owned())));
        for words in [&["colvis", "fly", "--warp"][..], &["colvis", "--camera", "warp"], &["colvis", "report", "warp"]]
        {
            assert_eq!(refused(words), None, "{words:?}");
        }
    }
}
