//! The steps of a case: the command of each, its files, and the options of a row that it depends on.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use clap::ValueEnum;

/// The command that the processes of cases run: no user gives it.
pub(super) const WORKER: &str = "batch-worker";

/// Something to be made of a scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum Step {
    /// The lumen as a mask.
    Segment,
    /// The centerline.
    Centerline,
    /// The cleansed scan.
    Cleanse,
    /// A flight, and its log.
    Fly,
    /// The places of the wall that look like polyps.
    Candidates,
    /// What a flight along the centerline shows of the wall.
    Coverage,
    /// The wall laid flat.
    Unfold,
    /// The lumen's surface.
    Surface,
    /// The report of a reading; its findings are an option of the row.
    Case,
}

impl Step {
    /// All of them, in the order of records.
    pub(super) const ALL: [Self; 9] = [
        Self::Segment,
        Self::Centerline,
        Self::Cleanse,
        Self::Fly,
        Self::Candidates,
        Self::Coverage,
        Self::Unfold,
        Self::Surface,
        Self::Case,
    ];
    /// Those that are made unless some are chosen: a report needs findings, and the wall is laid flat only along a line from the rectum
    /// to the cecum.
    pub(super) const BY_DEFAULT: [Self; 7] =
        [Self::Segment, Self::Centerline, Self::Cleanse, Self::Fly, Self::Candidates, Self::Coverage, Self::Surface];

    /// Its name on the command line and in records.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Segment => "segment",
            Self::Centerline => "centerline",
            Self::Cleanse => "cleanse",
            Self::Fly => "fly",
            Self::Candidates => "candidates",
            Self::Coverage => "coverage",
            Self::Unfold => "unfold",
            Self::Surface => "surface",
            Self::Case => "case",
        }
    }

    /// The files, or the folder, that it writes into the case's folder: first what its command calls `--out`.
    pub(super) fn outputs(self) -> &'static [&'static str] {
        match self {
            Self::Segment => &["segment.nii.gz", "outside.png"],
            Self::Centerline => &["centerline.json"],
            Self::Cleanse => &["cleansed.nii.gz"],
            Self::Fly => &["flight.jsonl"],
            Self::Candidates => &["candidates.json"],
            Self::Coverage => &["coverage.json"],
            Self::Unfold => &["unfolded.png"],
            Self::Surface => &["surface.ply"],
            Self::Case => &["report"],
        }
    }

    /// Returns the arguments of its command, but for the row's options and `--stats`.
    pub(super) fn command(self, scan: &Path, folder: &Path, options: &[RowOption]) -> Vec<OsString> {
        let output = folder.join(self.outputs()[0]).into_os_string();
        let has = |name: &str| options.iter().any(|o| o.name == name);
        let (command, out) = match self {
            Self::Fly => ("fly", Some("--log")),
            // A mesh with a number on each face takes three times as long as all of the rest.
            Self::Coverage => ("fly", None),
            _ => (self.name(), Some("--out")),
        };
        let mut line: Vec<OsString> = vec![command.into(), scan.into()];
        line.extend(out.into_iter().flat_map(|out| [out.into(), output.clone()]));
        if matches!(self, Self::Fly | Self::Coverage) {
            line.push("--headless".into());
        }
        if self == Self::Segment {
            line.extend(["--picture".into(), folder.join(self.outputs()[1]).into_os_string()]);
        }
        if self == Self::Coverage {
            line.push("--coverage".into());
            // Whole colons are what coverage is asked for.
            if !has("--guide") && !has("--scene") {
                line.extend(["--guide".into(), "path".into()]);
            }
            if !has("--cleanse") {
                line.push("--cleanse".into());
            }
        }
        line
    }

    /// True if its output is what its command tells in its statistics.
    pub(super) fn is_of_numbers(self) -> bool {
        self == Self::Coverage
    }

    /// True if its command changes the scan in memory.
    pub(super) fn changes_scan(self, options: &[RowOption]) -> bool {
        matches!(self, Self::Cleanse | Self::Candidates | Self::Coverage | Self::Unfold | Self::Case)
            || options.iter().any(|o| o.name == "--cleanse")
    }

    /// Returns those of a row's options that it depends on.
    pub(super) fn own_options(self, options: &[RowOption]) -> Vec<RowOption> {
        let is_own = |o: &&RowOption| OPTIONS.iter().any(|known| known.name == o.name && known.steps.contains(&self));
        options.iter().filter(is_own).cloned().collect()
    }
}

/// An option in a row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct RowOption {
    pub name: &'static str,
    pub value: Option<String>,
    /// True if the value is a file.
    pub is_file: bool,
}

impl RowOption {
    /// Returns it as arguments.
    pub(super) fn arguments(&self) -> impl Iterator<Item = OsString> {
        [Some(self.name), self.value.as_deref()]
            .into_iter()
            .flatten()
            .map(OsString::from)
            .collect::<Vec<_>>()
            .into_iter()
    }

    /// Returns the file that it names.
    pub(super) fn file(&self) -> Option<PathBuf> {
        self.value.as_ref().filter(|_| self.is_file).map(PathBuf::from)
    }
}

/// An option that a row may have.
struct Known {
    name: &'static str,
    kind: ValueKind,
    /// The steps that take it.
    steps: &'static [Step],
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum ValueKind {
    None,
    Text,
    File,
}

const ALL: &[Step] = &Step::ALL;
const FLIGHTS: &[Step] = &[Step::Fly, Step::Coverage];

const fn known(name: &'static str, kind: ValueKind, steps: &'static [Step]) -> Known {
    Known { name, kind, steps }
}

/// The options of a row. `--identity` is not among them: nothing that identifies a patient leaves a batch.
const OPTIONS: [Known; 22] = [
    known("--wall", ValueKind::Text, ALL),
    known("--spacing", ValueKind::Text, ALL),
    known("--hu", ValueKind::Text, ALL),
    known("--allow-gaps", ValueKind::None, ALL),
    known("--cleanse", ValueKind::None, &[Step::Segment, Step::Centerline, Step::Fly, Step::Surface, Step::Coverage]),
    known("--fov", ValueKind::Text, FLIGHTS),
    known("--camera", ValueKind::Text, FLIGHTS),
    known(
        "--from",
        ValueKind::Text,
        &[
            Step::Segment,
            Step::Centerline,
            Step::Cleanse,
            Step::Fly,
            Step::Candidates,
            Step::Coverage,
            Step::Unfold,
            Step::Surface,
        ],
    ),
    known("--to", ValueKind::Text, &[Step::Centerline, Step::Fly, Step::Coverage, Step::Unfold]),
    known("--labels", ValueKind::Text, &[Step::Segment]),
    known("--method", ValueKind::Text, &[Step::Centerline]),
    known("--guide", ValueKind::Text, FLIGHTS),
    known("--reverse", ValueKind::None, FLIGHTS),
    known("--seconds", ValueKind::Text, FLIGHTS),
    known("--preset", ValueKind::Text, FLIGHTS),
    known("--scene", ValueKind::File, FLIGHTS),
    known("--review", ValueKind::None, &[Step::Coverage]),
    known("--max", ValueKind::Text, &[Step::Candidates]),
    known("--detector", ValueKind::Text, &[Step::Candidates]),
    known("--findings", ValueKind::File, &[Step::Case]),
    known("--scheme", ValueKind::Text, &[Step::Case]),
    known("--dicom", ValueKind::None, &[Step::Case]),
];

/// Returns the text that `colvis batch --help` ends with.
pub(in crate::cli) fn help() -> String {
    let options: Vec<&str> = OPTIONS.iter().map(|o| o.name).collect();
    format!(
        "Columns of the manifest: path, and if wanted id, series and options. A row's options may be\n  {}\n\
         A changed option repeats the steps that take it.",
        options.join(" ")
    )
}

/// Reads a row's options, with quotes as in a shell. Files count from `folder`. The error tells what is wrong.
pub(super) fn row_options(text: &str, folder: &Path) -> Result<Vec<RowOption>, String> {
    let mut words = shlex::split(text).ok_or_else(|| format!("a quote in {text:?} has no end"))?.into_iter();
    let mut options = Vec::new();
    while let Some(word) = words.next() {
        // Also `--from=rectum`.
        let (name, joined) = match word.split_once('=') {
            Some((name, value)) => (name, Some(value.to_owned())),
            None => (word.as_str(), None),
        };
        let Some(known) = OPTIONS.iter().find(|o| o.name == name) else {
            return Err(format!("{name} is no option of a row"));
        };
        let value = match known.kind {
            ValueKind::None if joined.is_some() => return Err(format!("{name} takes no value")),
            ValueKind::None => None,
            _ => Some(joined.or_else(|| words.next()).ok_or_else(|| format!("{name} has no value"))?),
        };
        let is_file = known.kind == ValueKind::File;
        let value = value.map(|v| if is_file { folder.join(v).to_string_lossy().into_owned() } else { v });
        if options.iter().any(|o: &RowOption| o.name == known.name) {
            return Err(format!("{name} is there twice"));
        }
        options.push(RowOption { name: known.name, value, is_file });
    }
    Ok(options)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_gets_the_options_that_it_takes() {
        let options =
            row_options("--from=-1,2,3 --max 5 --scene 'my scene.toml' --reverse", Path::new("/list")).unwrap();
        let own = |step: Step| step.own_options(&options).iter().map(|o| o.name).collect::<Vec<_>>();
        assert_eq!(own(Step::Segment), ["--from"]);
        assert_eq!(own(Step::Fly), ["--from", "--scene", "--reverse"]);
        assert_eq!(own(Step::Candidates), ["--from", "--max"]);
        assert_eq!(own(Step::Case), [""; 0]);
        assert_eq!(options[2].file().unwrap(), Path::new("/list/my scene.toml"));
        assert_eq!(options[0].arguments().collect::<Vec<_>>(), ["--from", "-1,2,3"]);
        for wrong in ["--max 5 --max 6", "--reverse=1", "stray", "--threads 2"] {
            assert!(row_options(wrong, Path::new("")).is_err(), "{wrong}");
        }
    }

    /// The command line knows every option that a row may have, at every step that takes it.
    #[test]
    fn every_step_is_a_line_that_the_program_understands() {
        let value = |name: &str| match name {
            "--wall" => "-800,-500",
            "--hu" => "-1000,1000",
            "--spacing" | "--from" | "--to" => "1,2,3",
            "--fov" | "--seconds" | "--max" => "60",
            "--camera" => "perspective",
            "--labels" => "wall",
            "--method" => "peel",
            "--guide" => "tentacles",
            "--scheme" => "c-rads-2023",
            "--preset" => "default",
            "--detector" => "shape",
            _ => "x",
        };
        for step in ALL.iter().copied() {
            assert_eq!(Step::from_str(step.name(), false), Ok(step));
            for known in OPTIONS.iter().filter(|o| o.steps.contains(&step)) {
                let text = match known.kind {
                    ValueKind::None => known.name.to_owned(),
                    _ => format!("{} {}", known.name, value(known.name)),
                };
                let mut options = row_options(&text, Path::new("")).unwrap();
                if step == Step::Case && known.name != "--findings" {
                    options.extend(row_options("--findings f.json", Path::new("")).unwrap());
                }
                let mut line: Vec<OsString> = vec!["colvis".into()];
                line.extend(step.command(Path::new("scan.nii"), Path::new("out"), &options));
                line.extend(options.iter().flat_map(RowOption::arguments));
                line.extend(["--stats".into(), "s.json".into()]);
                assert!(crate::cli::Program::default().parse(line.clone()).is_ok(), "{line:?}");
            }
        }
    }
}
