//! `colvis archive`: studies of an archive, by the network.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::cli::args::{ArchiveAction, ArchiveArgs, Global, SeriesChoice};
use crate::cli::messages::{print, say};
use crate::dicom::archive::{Archive, Found, Query};
use crate::error::{Error, Result};
use crate::host::archives::known;
use crate::progress::Progress;

/// Studies that are listed, if the command line says nothing about it.
const MOST_STUDIES: usize = 500;

/// Runs the command. Fails with status 2 if the arguments or the settings are invalid, 3 if the archive cannot be reached or refuses, 4
/// if interrupted, 5 if a file cannot be sent or written.
pub(super) fn run(args: &ArchiveArgs, global: &Global, progress: &Progress) -> Result<()> {
    check(args, global)?;
    let (file, known) = known()?;
    match args.action {
        ArchiveAction::Echo => {
            let archive = only(&args.names, &known, &file)?;
            archive.echo(progress)?;
            print(|out| {
                writeln!(out, "{} answers as {} at {}:{}", archive.name, archive.title, archive.host, archive.port)
            })
        }
        ArchiveAction::Find => {
            let archive = only(&args.names, &known, &file)?;
            let date = args.date.as_deref().map(str::parse).transpose().map_err(|why: String| {
                Error::usage(format!("--date {}", args.date.as_deref().unwrap_or_default()), why, "give days")
            })?;
            let query = Query { patient: args.patient.clone(), date, description: args.description.clone() };
            let most = args.max.unwrap_or(MOST_STUDIES);
            let found = archive.find(&query, most, progress)?;
            if found.has_more {
                say(&format!("{} has more studies: narrow the search, or raise --max {most}", archive.name));
            }
            print(|out| writeln!(out, "{:#}", listed(&found)))
        }
        ArchiveAction::Get => {
            let archive = only(&args.names, &known, &file)?;
            let series = match &global.series {
                Some(SeriesChoice::Uid(uid)) => uid.clone(),
                Some(SeriesChoice::Number(number)) => number.to_string(),
                None => String::new(),
            };
            let folder = args.out.as_deref().unwrap_or(Path::new("."));
            let got = archive.get(&series, folder, progress)?;
            let before = if got.before > 0 { format!(", {} of them before", got.before) } else { String::new() };
            print(|out| writeln!(out, "{} instances are in {}{before}", got.instances, folder.display()))
        }
        ArchiveAction::Send => {
            let first = args.names.first().and_then(|n| n.to_str());
            let named = first.is_some_and(|name| known.iter().any(|a| a.name == name));
            // What is no file either was meant as a name.
            let is_name = named || args.names.len() > 1 && args.names.first().is_some_and(|n| !n.exists());
            let (name, files) = args.names.split_at(usize::from(is_name));
            let archive = only(name, &known, &file)?;
            if files.is_empty() {
                return Err(Error::usage("archive send", "no file is named", "name DICOM files, or folders of them"));
            }
            let sent = archive.send(files, progress)?;
            sent.remarks.iter().for_each(|remark| say(remark));
            print(|out| writeln!(out, "{} files are in {}", sent.stored, archive.name))
        }
    }
}

/// Refuses options of another action.
fn check(args: &ArchiveArgs, global: &Global) -> Result<()> {
    let (find, get) = (args.action == ArchiveAction::Find, args.action == ArchiveAction::Get);
    for (option, given, belongs, action) in [
        ("--patient", args.patient.is_some(), find, "find"),
        ("--date", args.date.is_some(), find, "find"),
        ("--description", args.description.is_some(), find, "find"),
        ("--max", args.max.is_some(), find, "find"),
        ("--out", args.out.is_some(), get, "get"),
        ("--series", global.series.is_some(), get, "get"),
    ] {
        if given && !belongs {
            return Err(Error::usage(option, format!("belongs to `archive {action}`"), "leave it out"));
        }
        if get && belongs && !given {
            let hint = "give `archive get --series UID --out DIR/`; `archive find` lists the series";
            return Err(Error::usage("archive get", format!("{option} is missing"), hint));
        }
    }
    Ok(())
}

/// Returns the named archive, or the only one.
fn only<'a>(names: &[PathBuf], known: &'a [Archive], file: &Path) -> Result<&'a Archive> {
    let all = known.iter().map(|a| a.name.as_str()).collect::<Vec<_>>().join(", ");
    let none = || {
        let what = format!("settings {}", file.display());
        Error::usage(what, "name no archive", "write one there; `archive --help` shows how".to_owned())
    };
    match (names, known) {
        (_, []) => Err(none()),
        ([], [one]) => Ok(one),
        ([], _) => Err(Error::usage("archive", "the settings name several", format!("name one of {all}"))),
        ([name], _) => known.iter().find(|a| name.to_str() == Some(&a.name)).ok_or_else(|| {
            let why = "no archive of that name is in the settings";
            Error::usage(format!("archive {}", name.display()), why, format!("name one of {all}"))
        }),
        ([_, more, ..], _) => Err(Error::usage(more.display().to_string(), "a second name", "name one archive")),
    }
}

fn listed(found: &Found) -> Value {
    let studies = found.studies.iter().map(|study| {
        let series = study.series.iter().map(|s| {
            json!({
                "series": s.uid, "number": s.number, "description": s.description, "modality": s.modality,
                "instances": s.instances,
            })
        });
        json!({
            "study": study.uid, "patient_name": study.patient_name, "patient_id": study.patient_id, "date": study.date,
            "description": study.description, "series": series.collect::<Vec<_>>(),
        })
    });
    json!({ "studies": studies.collect::<Vec<_>>() })
}
