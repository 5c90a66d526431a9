//! The arguments of every command.

use std::ffi::OsString;
use std::fmt;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::error::ErrorKind;
use clap::{Args as ClapArgs, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};

pub use crate::cli::values::{Pair, Point, Size, Triple};

use crate::cli::values::{count, number, plane, slab};
use crate::cli::{Program, unbuilt};
use crate::error::Error;
use crate::fields::CenterlineMethod;
use crate::render::slice::{Slab, SlicePlane};

/// Flies through the inside of the colon of a CT scan. Research software, not for diagnosis.
#[derive(Parser, Debug)]
#[command(name = "colvis", version, args_conflicts_with_subcommands = true, max_term_width = 120)]
pub struct Args {
    /// What to do; `fly` if left out.
    #[command(subcommand)]
    pub command: Option<Command>,
    /// Without a command: `fly`.
    #[command(flatten)]
    pub fly: FlyArgs,
    /// Options of every command.
    #[command(flatten)]
    pub global: Global,
}

/// Options that every command takes.
#[derive(ClapArgs, Clone, Debug, Default)]
pub struct Global {
    /// Threads to use (all cores if left out)
    #[arg(long, global = true, value_name = "N", value_parser = count)]
    pub threads: Option<usize>,
    /// HU where the wall's opacity starts and is full
    #[arg(long, global = true, value_name = "LO,HI", allow_hyphen_values = true)]
    pub wall: Option<Pair>,
    /// Voxel spacing in mm, for inputs that carry none (a folder of PNG slices)
    #[arg(long, global = true, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub spacing: Option<Triple>,
    /// HU of black and white, for inputs that carry no HU
    #[arg(long, global = true, value_name = "LO,HI", allow_hyphen_values = true)]
    pub hu: Option<Pair>,
    /// Which DICOM series of a folder to take
    #[arg(long, global = true, value_name = "N", value_parser = count)]
    pub series: Option<usize>,
    /// Resample over missing DICOM slices instead of refusing them
    #[arg(long, global = true)]
    pub allow_gaps: bool,
    /// View angle over the image's shorter side, degrees (90 if left out)
    #[arg(long, global = true, value_name = "D", allow_hyphen_values = true)]
    pub fov: Option<f64>,
    /// Which camera (perspective if left out)
    #[arg(long, global = true, value_name = "MODEL")]
    pub camera: Option<String>,
    /// Seed of the phantom
    #[arg(long, global = true, value_name = "N")]
    pub seed: Option<u64>,
}

/// The commands.
#[derive(Subcommand, Debug)]
pub enum Command {
    /// Flies through the colon, in a window or headless
    Fly(FlyArgs),
    /// Renders a list of poses
    Render(RenderArgs),
    /// Writes a cross-section
    Slice(SliceArgs),
    /// Writes the colon's lumen as a mask
    Segment(SegmentArgs),
    /// Writes the surface of the colon's lumen as a closed mesh
    Surface(SurfaceArgs),
    /// Writes the colon's centerline
    Centerline(CenterlineArgs),
    /// Writes a synthetic colon with its ground truth
    Phantom(PhantomArgs),
    /// Says what is in an input, as JSON
    Info(InfoArgs),
    /// Says what a flight would run and build, what it leaves out, and why
    Explain(ExplainArgs),
    /// Tentacles and mines in two dimensions
    Plane(PlaneArgs),
    /// Measures error against run time
    Report(ReportArgs),
    /// A command that another crate has added.
    #[command(skip)]
    Own {
        /// Its name.
        name: String,
        /// Its arguments.
        matches: clap::ArgMatches,
    },
}

/// `fly`'s arguments.
#[derive(ClapArgs, Clone, Debug, Default)]
pub struct FlyArgs {
    /// A scan: NIfTI, MetaImage, NRRD, DICOM, or a folder of PNG slices; the embedded phantom if left out
    pub input: Option<PathBuf>,
    /// Fly without a window
    #[arg(long)]
    pub headless: bool,
    /// Who steers (the help lists every guide)
    #[arg(long, value_name = "GUIDE")]
    pub guide: Option<String>,
    /// Where to start: rectum, cecum or X,Y,Z in mm LPS
    #[arg(long, value_name = "P", allow_hyphen_values = true)]
    pub from: Option<Point>,
    /// Where to arrive
    #[arg(long, value_name = "P", allow_hyphen_values = true)]
    pub to: Option<Point>,
    /// Swap the ends
    #[arg(long)]
    pub reverse: bool,
    /// Simulated seconds at the most (600 headless)
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    pub seconds: Option<f64>,
    /// Frames per simulated second of a recording (30)
    #[arg(long, value_name = "F", allow_hyphen_values = true)]
    pub fps: Option<f64>,
    /// Image size (1024x1024)
    #[arg(long, value_name = "WxH")]
    pub size: Option<Size>,
    /// Image quality (high)
    #[arg(long, value_enum)]
    pub quality: Option<QualityName>,
    /// Which renderer (default)
    #[arg(long, value_name = "PRESET")]
    pub preset: Option<String>,
    /// Where to record: a folder (ends in /), .gif or .mp4
    #[arg(long, value_name = "OUT")]
    pub record: Option<String>,
    /// Where to log each simulation step, as JSON lines
    #[arg(long, value_name = "F.jsonl")]
    pub log: Option<PathBuf>,
    /// Where to write what the flight took
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
    /// Add the share of the wall that was seen to the stats
    #[arg(long)]
    pub coverage: bool,
    /// Keep the operator's input
    #[arg(long, value_name = "F")]
    pub record_input: Option<PathBuf>,
    /// Repeat an operator's input
    #[arg(long, value_name = "F")]
    pub replay: Option<PathBuf>,
    /// Repeat a flight's log
    #[arg(long, value_name = "LOG")]
    pub play: Option<PathBuf>,
    /// Speed of --play relative to the flight's own
    #[arg(long, value_name = "R", requires = "play", allow_hyphen_values = true)]
    pub rate: Option<f64>,
    /// A scene file: plugins and settings
    #[arg(long, value_name = "S.toml")]
    pub scene: Option<PathBuf>,
    /// The window's panels: the flight alone, the flight and three slices, four slices, or the flight and the slice across the
    /// way; as they were the last time if left out
    #[arg(long, value_parser = ["flight", "reading", "slices", "across"])]
    pub layout: Option<String>,
    /// Overlays to draw into the recording, or to show in the window from the beginning (the help of keys lists them)
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub overlay: Vec<String>,
}

/// `render`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct RenderArgs {
    /// A scan
    pub input: PathBuf,
    /// The poses, as JSON
    #[arg(long, value_name = "P.json")]
    pub poses: PathBuf,
    /// The folder for the images
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Image size (1024x1024)
    #[arg(long, value_name = "WxH")]
    pub size: Option<Size>,
    /// Image quality (high)
    #[arg(long, value_enum)]
    pub quality: Option<QualityName>,
    /// Which renderer (default)
    #[arg(long, value_name = "PRESET")]
    pub preset: Option<String>,
    /// Samples a pixel
    #[arg(long, value_name = "N", value_parser = count)]
    pub samples: Option<usize>,
    /// Render every frame on its own
    #[arg(long)]
    pub no_reuse: bool,
    /// Write the depth too, as NumPy files
    #[arg(long)]
    pub depth: bool,
    /// Where to write what the frames took
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
}

/// `slice`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct SliceArgs {
    /// A scan; the embedded phantom if left out
    pub input: Option<PathBuf>,
    /// The point in the middle of the picture, mm LPS
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub at: Triple,
    /// axial, coronal, sagittal, or the normal of a plane that is seen against it
    #[arg(long, value_name = "PLANE", value_parser = plane, allow_hyphen_values = true)]
    pub plane: SlicePlane,
    /// The picture: .png (8-bit grey), or .npy (float32 HU)
    #[arg(long, value_name = "F")]
    pub out: PathBuf,
    /// Image size (512x512)
    #[arg(long, value_name = "WxH")]
    pub size: Option<Size>,
    /// Side of a pixel, mm (the scan's least spacing)
    #[arg(long, value_name = "S", value_parser = number, allow_hyphen_values = true)]
    pub mm_per_pixel: Option<f64>,
    /// HU in the middle of a PNG's greys (0)
    #[arg(long, value_name = "L", value_parser = number, allow_hyphen_values = true)]
    pub level: Option<f64>,
    /// HU from a PNG's black to its white (2000)
    #[arg(long, value_name = "W", value_parser = number, allow_hyphen_values = true)]
    pub window: Option<f64>,
    /// Thickness in mm, 0 to 20, and what is shown of it: mean, max or min
    #[arg(long, value_name = "MM,KIND", value_parser = slab, allow_hyphen_values = true)]
    pub slab: Option<Slab>,
}

/// `segment`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct SegmentArgs {
    /// A scan
    pub input: PathBuf,
    /// The mask: 0 outside, 1 gas, 2 tagged fluid
    #[arg(long, value_name = "MASK")]
    pub out: PathBuf,
    /// What else is marked: other (3: surely no colon, as lungs and the air outside) and wall (4: the colon's)
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LABEL,...")]
    pub labels: Vec<LabelName>,
    /// Take the gas there for the colon, whatever it looks like
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub from: Option<Triple>,
    /// Where to write volumes and bounds
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
}

/// `surface`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct SurfaceArgs {
    /// A scan: the surface of its colon's gas and tagged fluid
    #[arg(required_unless_present = "mask")]
    pub input: Option<PathBuf>,
    /// A mask instead of a scan: any voxel that is not 0 is lumen; its steps are smoothed
    #[arg(long, value_name = "M.nii.gz")]
    pub mask: Option<PathBuf>,
    /// The surface, mm LPS, normals out of the lumen: .stl, .ply or .obj
    #[arg(long, value_name = "F")]
    pub out: PathBuf,
    /// Take the gas there for the colon, whatever it looks like
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub from: Option<Triple>,
    /// Where to write area, volume and times
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
}

/// `centerline`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct CenterlineArgs {
    /// A scan
    #[arg(required_unless_present = "mask")]
    pub input: Option<PathBuf>,
    /// A mask of the lumen instead of a scan
    #[arg(long, value_name = "M.nii.gz")]
    pub mask: Option<PathBuf>,
    /// The line: .json, .csv or .mrk.json
    #[arg(long, value_name = "F")]
    pub out: PathBuf,
    /// How the line is found: penalised (the default: keeps from walls, moved to the axis), peel-onion (peeled from
    /// the wall inwards), roadmap (along inscribed balls; minutes on a whole scan) or cell-decomposition (over cells, voxel by
    /// voxel)
    #[arg(long, value_name = "METHOD", value_parser = methods())]
    pub method: Option<CenterlineMethod>,
    /// Where to start
    #[arg(long, value_name = "P", allow_hyphen_values = true)]
    pub from: Option<Point>,
    /// Where to end
    #[arg(long, value_name = "P", allow_hyphen_values = true)]
    pub to: Option<Point>,
    /// Where to write length and times
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
}

/// `phantom`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct PhantomArgs {
    /// The volume; the format follows the ending
    #[arg(long, value_name = "V.nii.gz")]
    pub out: PathBuf,
    /// Where to write the ground truth
    #[arg(long, value_name = "T.json")]
    pub truth: Option<PathBuf>,
    /// small, standard or large
    #[arg(long, value_enum, default_value = "standard")]
    pub size: PhantomSize,
    /// What it has
    #[arg(long, value_enum, value_delimiter = ',', default_value = "folds,polyps,noise")]
    pub with: Vec<PhantomFeature>,
}

/// `info`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct InfoArgs {
    /// A scan
    pub input: PathBuf,
}

/// `explain`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct ExplainArgs {
    /// The flight to explain.
    #[command(flatten)]
    pub fly: FlyArgs,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// `plane`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct PlaneArgs {
    /// A drawn lumen: a PNG (bright is lumen, dark is wall, red the start, green the goal; half a millimetre a pixel), or
    /// one of bends, straight, fork, pocket, ring, touching, bridge, polyp, neck, spiral (bends)
    pub lumen: Option<PathBuf>,
    /// Without a window
    #[arg(long)]
    pub headless: bool,
    /// The picture: .png, or .gif for all of the flight
    #[arg(long, value_name = "F")]
    pub out: Option<PathBuf>,
    /// A scene file: the settings of tentacles, mines, body and watch; its guide must be tentacles
    #[arg(long, value_name = "S.toml")]
    pub scene: Option<PathBuf>,
}

/// `report`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct ReportArgs {
    /// Which report
    #[arg(value_enum)]
    pub subject: ReportSubject,
    /// The folder
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Under a minute
    #[arg(long)]
    pub quick: bool,
    /// A scan to report on beside the phantom (`render`, `fields`)
    #[arg(long, value_name = "F")]
    pub scan: Option<PathBuf>,
    /// Steps of the perforation test
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub steps: Option<u64>,
}

impl Args {
    /// Reads the arguments of a program that has this to choose from.
    ///
    /// # Errors
    /// What is wrong with them; also help and version, which are asked for.
    pub(super) fn read(args: impl Iterator<Item = OsString>, program: &Program) -> Result<Self, ParseError> {
        let args: Vec<OsString> = args.collect();
        unbuilt::check_command(&args, command_place(&args)).map_err(ParseError::NotBuilt)?;
        let command = command(program);
        let args = command_first(args, &command);
        let mut matches = command.try_get_matches_from(args).map_err(ParseError::Line)?;
        let own = matches.subcommand_name().filter(|n| program.commands.iter().any(|c| c.name == *n));
        if own.is_some()
            && let Some((name, matches)) = matches.remove_subcommand()
        {
            let global = Global::from_arg_matches(&matches).map_err(ParseError::Line)?;
            return Ok(Self { command: Some(Command::Own { name, matches }), fly: FlyArgs::default(), global });
        }
        Self::from_arg_matches(&matches).map_err(ParseError::Line)
    }
}

/// Why a command line is not followed.
#[derive(Debug)]
pub enum ParseError {
    /// It is wrong, or asks for help or the version.
    Line(clap::Error),
    /// It names a command that is not built.
    NotBuilt(Error),
}

/// Whether `name` is a command of this crate, built or planned.
pub(super) fn is_command(name: &str) -> bool {
    name == "help" || unbuilt::is_command(name) || Args::command().get_subcommands().any(|c| c.get_name() == name)
}

impl fmt::Display for ParseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(e) => e.fmt(f),
            Self::NotBuilt(e) => e.fmt(f),
        }
    }
}

/// The command line, with what there is to choose from as the values of its options.
fn command(program: &Program) -> clap::Command {
    let catalog = &program.catalog;
    let guides: Vec<_> = catalog.guides.iter().map(|g| (g.name, g.summary)).collect();
    let presets: Vec<_> = catalog.presets.iter().map(|p| (p.name, p.summary)).collect();
    let cameras: Vec<_> = catalog.cameras.iter().map(|c| (c.name, c.summary)).collect();
    let renders = |c| choices(c, "preset", "Which renderer", &presets);
    let flies = |c| choices(renders(c), "guide", "Who steers", &guides);
    let window = |c: clap::Command| c.after_help(keys(program));
    let all = Args::command().subcommands(program.commands.iter().map(|c| c.line()));
    choices(window(flies(all)), "camera", "Which camera", &cameras)
        .mut_subcommand("fly", |c| window(flies(c)))
        .mut_subcommand("explain", flies)
        .mut_subcommand("render", renders)
}

/// The window's keys, for the help; nothing where there is no window.
fn keys(program: &Program) -> String {
    let rows = program.key_help().unwrap_or_default();
    let wide = rows.iter().map(|r| r.0.chars().count()).max().unwrap_or(0);
    let lines = rows.iter().map(|(key, what)| format!("  {key:wide$}  {what}\n"));
    if rows.is_empty() { String::new() } else { format!("Keys in the window:\n{}", lines.collect::<String>()) }
}

/// The methods of a centerline, by name.
fn methods() -> impl TypedValueParser<Value = CenterlineMethod> {
    let named = |name: String| CenterlineMethod::ALL.into_iter().find(|m| m.name() == name);
    PossibleValuesParser::new(CenterlineMethod::ALL.map(CenterlineMethod::name))
        .map(move |name| named(name).unwrap_or_default())
}

/// Gives an option its values, each a name and what it is.
fn choices(
    command: clap::Command,
    option: &'static str,
    what: &str,
    list: &[(&'static str, &'static str)],
) -> clap::Command {
    let reported: Vec<String> = list.iter().map(|(name, summary)| format!("{name} ({summary})")).collect();
    let names: Vec<&'static str> = list.iter().map(|l| l.0).collect();
    command.mut_arg(option, |a| {
        a.value_parser(PossibleValuesParser::new(names))
            .hide_possible_values(true)
            .help(format!("{what}: {}", reported.join(", ")))
    })
}

/// Image quality.
#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
#[value(rename_all = "lower")]
pub enum QualityName {
    /// Trilinear.
    High,
    /// A third of the resolution, stretched; with the presets colvis and lean, or if a scene says `low = "nearest"`, the nearest voxel.
    Low,
    /// What budget and speed allow; at rest, up to the reference.
    Adaptive,
    /// Brute force, to measure against.
    Reference,
}

/// What a mask marks beside gas and fluid.
#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
#[value(rename_all = "lower")]
pub enum LabelName {
    /// What is surely no colon: 3.
    Other,
    /// The colon's wall: 4.
    Wall,
}

/// The phantom's sizes.
#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
#[value(rename_all = "lower")]
pub enum PhantomSize {
    /// Quick, some 0.7 m of colon.
    Small,
    /// An adult's colon at the resolution of a scan.
    Standard,
    /// The same at twice the resolution.
    Large,
}

/// What a phantom can have.
#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
#[value(rename_all = "lower")]
pub enum PhantomFeature {
    /// Haustral folds.
    Folds,
    /// Polyps of known size.
    Polyps,
    /// Tagged fluid with a horizontal level.
    Fluid,
    /// Thin strands across the lumen.
    Bridges,
    /// Noise of the scanner.
    Noise,
}

/// Subjects of a report.
#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
#[value(rename_all = "lower")]
pub enum ReportSubject {
    /// Ray casting.
    Render,
    /// Gradient estimators.
    Gradients,
    /// What leaving out saves.
    Scenes,
    /// Integrators.
    Dynamics,
    /// Distances and centerlines.
    Fields,
    /// Random steps against the wall.
    Perforation,
    /// All of them.
    All,
}

/// Global options may stand before the command too. clap would take the command for an input there, as `colvis INPUT` is
/// a flight; so the command is moved to the front.
fn command_first(mut args: Vec<OsString>, command: &clap::Command) -> Vec<OsString> {
    let at = command_place(&args);
    let is_command = |a: &OsString| command.get_subcommands().any(|c| a.as_os_str() == c.get_name());
    if at > 1 && args.get(at).is_some_and(is_command) {
        args[1..=at].rotate_right(1);
    }
    args
}

/// Where a command stands: after the global options that begin the line.
fn command_place(args: &[OsString]) -> usize {
    let mut at = 1;
    while let Some(arg) = args.get(at).and_then(|a| a.to_str()) {
        let takes_value = ["--threads", "--wall", "--spacing", "--hu", "--series", "--fov", "--camera", "--seed"];
        let name = arg.split('=').next().unwrap_or(arg);
        if takes_value.contains(&name) {
            at += if arg.contains('=') { 1 } else { 2 };
        } else if arg == "--allow-gaps" {
            at += 1;
        } else {
            break;
        }
    }
    at
}

/// Prints help as it is, anything else as one line: `error: WHAT: WHY; HOW TO MEND`.
pub fn refuse(refused: &ParseError) -> ExitCode {
    let e = match refused {
        ParseError::Line(e) => e,
        ParseError::NotBuilt(error) => return failed(error),
    };
    if matches!(e.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) {
        // A closed pipe (`colvis --help | head -1`) is no failure.
        let _ = e.print();
        return ExitCode::SUCCESS;
    }
    if let Some(error) = unbuilt::refusal(e) {
        return failed(&error);
    }
    let text = e.render().to_string();
    let why: Vec<&str> = text
        .lines()
        .map(str::trim)
        .take_while(|l| !l.starts_with("Usage:") && !l.starts_with("For more"))
        .filter(|l| !l.is_empty() && !l.starts_with("tip:"))
        .collect();
    let why = why.join(" ");
    failed(&Error::usage("command line", why.strip_prefix("error: ").unwrap_or(&why), "see colvis --help"))
}

fn failed(error: &Error) -> ExitCode {
    eprintln!("error: {error}");
    ExitCode::from(error.kind as u8)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn the_definition_is_consistent() {
        command(&Program::default()).debug_assert();
    }

    #[test]
    fn global_options_may_come_first() {
        let parse = |line: &str| {
            let args = command_first(line.split(' ').map(OsString::from).collect(), &Args::command());
            Args::try_parse_from(args).unwrap()
        };
        let a = parse("colvis --threads 1 --wall=-900,-400 segment v.nii --out m.nii");
        assert!(matches!(a.command, Some(Command::Segment(_))) && a.global.threads == Some(1));
        assert!(a.global.wall == Some(Pair(-900.0, -400.0)));
        let a = parse("colvis --threads 2 scan.nii --headless");
        assert!(a.command.is_none() && a.fly.headless && a.global.threads == Some(2));
    }

    #[test]
    fn no_command_is_fly_and_points_may_begin_with_a_minus() {
        let a = Args::try_parse_from(["colvis", "scan.nii", "--headless", "--from", "-1,2,-3.5"]).unwrap();
        assert!(a.command.is_none() && a.fly.headless);
        assert_eq!(a.fly.from, Some(Point::World(DVec3::new(-1.0, 2.0, -3.5))));
        let a = Args::try_parse_from(["colvis", "fly", "--to", "cecum", "--wall", "-800,-500"]).unwrap();
        assert!(matches!(a.command, Some(Command::Fly(f)) if f.to == Some(Point::Cecum)));
        let program = Program::default();
        let read = |args: &[&str]| Args::read(args.iter().map(OsString::from), &program);
        for guide in program.catalog.guides.iter() {
            assert_eq!(read(&["colvis", "--guide", guide.name]).unwrap().fly.guide.as_deref(), Some(guide.name));
        }
        assert!(read(&["colvis", "fly", "--guide", "warp"]).is_err());
        assert!(Args::try_parse_from(["colvis", "--size", "0x5"]).is_err());
        assert!(Args::try_parse_from(["colvis", "--from", "1,2,nan"]).is_err());
    }
}
