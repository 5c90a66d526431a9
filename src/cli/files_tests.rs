use std::any::TypeId;
use std::collections::BTreeMap;

use clap::{Arg, ArgAction};

use super::*;
use crate::cli::Program;
use crate::cli::args::{self, Args};

/// Options with a file that is read, as `command option`; all others are written. `*` stands for `fly` and its kin.
const READ: [&str; 39] = [
    "* input",
    "* second",
    "* answers",
    "* replay",
    "* play",
    "* scene",
    "render input",
    "render poses",
    "render scene",
    "slice input",
    "segment input",
    "surface input",
    "surface mask",
    "cleanse input",
    "centerline input",
    "centerline mask",
    "candidates input",
    "match a",
    "match b",
    "unfold input",
    "dataset input",
    "dataset poses",
    "dataset replay",
    "dataset play",
    "dataset scene",
    "measure input",
    "case input",
    "case findings",
    "case second",
    "case scheme",
    "batch manifest",
    "batch group",
    "archive names",
    "info input",
    "plane lumen",
    "plane scene",
    "phantom into",
    "report scan",
    "report truth",
];
/// Options with a text that is no file.
const NO_FILE: [&str; 6] = ["exposure", "overlay", "patient", "date", "description", "only"];

/// True if an option's value is a file: a path, or a text without a list to choose from.
fn is_file(arg: &Arg) -> bool {
    let of = arg.get_value_parser().type_id();
    let is_text = of == TypeId::of::<String>() && arg.get_possible_values().is_empty();
    let takes_value = matches!(arg.get_action(), ArgAction::Set | ArgAction::Append);
    takes_value && !arg.is_global_set() && (of == TypeId::of::<PathBuf>() || is_text) && {
        !NO_FILE.contains(&arg.get_id().as_str())
    }
}

/// A value for a required argument that names no file.
fn filler(arg: &Arg) -> String {
    let first = arg.get_possible_values().first().map(|v| v.get_name().to_owned());
    first.unwrap_or_else(|| if arg.get_id() == "plane" { "axial" } else { "0,0,0" }.to_owned())
}

/// The arguments of a command with `names` for its files by option, and every flag, for the options that need one.
fn parsed(command: &clap::Command, is_named: bool, names: &BTreeMap<String, String>) -> Args {
    let mut line = vec!["colvis".to_owned()];
    line.extend(is_named.then(|| command.get_name().to_owned()));
    for arg in command.get_arguments().filter(|a| !a.is_global_set()) {
        let value = match names.get(arg.get_id().as_str()) {
            Some(name) => name.clone(),
            None if arg.is_required_set() => filler(arg),
            None if matches!(arg.get_action(), ArgAction::SetTrue) => String::new(),
            None => continue,
        };
        line.extend(arg.get_long().map(|long| format!("--{long}")));
        line.extend((!value.is_empty()).then_some(value));
    }
    Program::default().parse(&line).unwrap_or_else(|e| panic!("{line:?}: {e}"))
}

/// Every command of the command line, and the line without one.
fn commands() -> Vec<(clap::Command, bool)> {
    let all = args::command(&Program::default());
    let named = all.get_subcommands().filter(|c| c.get_name() != "help").map(|c| (c.clone(), true));
    named.chain([(all.clone(), false)]).collect()
}

#[test]
fn every_file_of_every_command_is_known_as_read_or_written() {
    let mut used = Vec::new();
    for (command, is_named) in commands() {
        let name = command.get_name();
        let kin = ["fly", "explain", "colvis"].contains(&name);
        let names: BTreeMap<String, String> = command
            .get_arguments()
            .filter(|a| is_file(a))
            .map(|a| (a.get_id().to_string(), format!("none/{name}-{}", a.get_id())))
            .collect();
        let files = Files::of(&parsed(&command, is_named, &names));
        for (option, path) in &names {
            let key = format!("{} {option}", if kin { "*" } else { name });
            let is_read = READ.contains(&&*key);
            let has = |files: &[PathBuf]| files.iter().filter(|f| f.as_path() == Path::new(path)).count();
            let expected = (usize::from(is_read), usize::from(!is_read && name != "explain"));
            assert_eq!((has(&files.read), has(&files.written)), expected, "{name}: {option}");
            used.extend(is_read.then_some(key));
        }
    }
    let unused: Vec<&&str> = READ.iter().filter(|r| !used.iter().any(|u| u == **r)).collect();
    assert!(unused.is_empty(), "no such option: {unused:?}");
}

#[test]
fn no_output_of_any_command_is_an_input_or_another_output() {
    let mut pairs = 0;
    for (command, is_named) in commands().into_iter().filter(|(c, _)| c.get_name() != "explain") {
        let options: Vec<String> =
            command.get_arguments().filter(|a| is_file(a)).map(|a| a.get_id().to_string()).collect();
        let kin = ["fly", "colvis"].contains(&command.get_name());
        let key = |option: &str| format!("{} {option}", if kin { "*" } else { command.get_name() });
        let is_read = |option: &str| READ.contains(&&*key(option));
        let apart = |same: [&str; 2]| {
            let name = |o: &String| if same.contains(&o.as_str()) { "same" } else { o }.to_owned();
            let names = options.iter().map(|o| (o.clone(), name(o))).collect();
            Files::of(&parsed(&command, is_named, &names)).check_apart()
        };
        apart([""; 2]).unwrap();
        for (n, a) in options.iter().enumerate() {
            for b in &options[..n] {
                let expected = if is_read(a) && is_read(b) { Ok(()) } else { Err(crate::error::Kind::Usage) };
                assert_eq!(apart([a, b]).map_err(|e| e.kind), expected, "{}: {a}, {b}", command.get_name());
                pairs += 1;
            }
        }
    }
    assert!(pairs > 100, "{pairs}");
}

#[test]
fn data_beside_headers_and_slices_of_folders_are_not_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    std::fs::write(at("scan.nhdr"), "NRRD0004\ndimension: 3\ndata file: scan.raw\n").unwrap();
    std::fs::write(at("other.mhd"), "NDims = 3\nElementDataFile = voxels.raw\n").unwrap();
    std::fs::create_dir(at("slices")).unwrap();
    image::GrayImage::new(8, 8).save(at("slices/0.png")).unwrap();
    image::GrayImage::new(8, 8).save(at("alone.png")).unwrap();
    let apart = |read: &[&str], written: &[&str]| {
        let files = Files::default().reads(read.iter().map(|r| at(r))).writes(written.iter().map(|w| at(w)));
        files.check_apart().map_err(|e| e.to_string())
    };
    let refused = |read: &[&str], written: &[&str], why: &str| {
        let e = apart(read, written).unwrap_err();
        assert!(e.contains(why), "{e}");
    };
    refused(&["scan.nhdr"], &["scan.mhd"], "scan.raw: is used twice");
    refused(&["other.mhd"], &["voxels.mhd"], "voxels.raw: is used twice");
    refused(&[], &["a.mhd", "a.raw"], "a.raw: is used twice");
    refused(&["slices"], &["slices/0.png"], "is a slice of the input");
    refused(&[], &["made/", "made/0000.png"], "is also the name of an image in the output folder");
    refused(&[], &["made", "made/0007-near.png"], "is also the name of an image in the output folder");
    for (read, written) in [
        (&["scan.nhdr"][..], &["scan.nhdr.json"][..]),
        (&["other.mhd"], &["other.nii"]),
        (&["slices"], &["slices/1.png"]),
        (&["slices"], &["alone.png"]),
        (&["slices/0.png"], &["alone.png"]),
        (&[], &["a.mhd", "a.nhdr"]),
        (&[], &["made", "made/stats.json"]),
        (&[], &["made", "other/0000.png"]),
    ] {
        assert_eq!(apart(read, written), Ok(()), "{read:?} {written:?}");
    }
}
