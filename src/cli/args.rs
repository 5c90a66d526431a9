//! The arguments of every command.

use std::ffi::OsString;
use std::fmt;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::error::ErrorKind;
use clap::{ArgAction, Args as ClapArgs, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};

pub use crate::cli::batch::steps::Step;
pub use crate::cli::phantom_args::{PhantomArgs, PhantomFeature, PhantomPosition, PhantomSize};
pub use crate::cli::values::{Pair, Point, SeedRange, SeriesChoice, Shard, Triple};
pub use crate::render::ImageSize;

use crate::app::findings::Scheme;
use crate::cli::Program;
use crate::cli::messages::{failed, print};
use crate::cli::shared::Shared;
use crate::cli::values::{bytes, count, number, plane, seconds, seed, seed_range, series, shard, slab, steps, threads};
use crate::dataset::layout;
use crate::dataset::paths::PathKind;
use crate::dataset::truth::Kind;
use crate::error::{Error, program_name, set_program_name};
use crate::fields::CenterlineMethod;
use crate::render::slice::{Slab, SlicePlane};

/// Virtual colonoscopy: flies a camera through the colon of a CT scan. Research software, not for diagnosis.
#[derive(Parser, Debug)]
#[command(name = "colvis", version, args_conflicts_with_subcommands = true, max_term_width = 120)]
pub struct Args {
    /// The command (default: `fly`).
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
    /// Number of threads [default: all cores]
    #[arg(long, global = true, value_name = "N", value_parser = threads, allow_negative_numbers = true)]
    pub threads: Option<usize>,
    /// HU at which the wall starts to be opaque, and at which it is fully opaque
    #[arg(long, global = true, value_name = "LO,HI", allow_hyphen_values = true)]
    pub wall: Option<Pair>,
    /// Voxel spacing in mm, for inputs without one (a folder of PNG slices)
    #[arg(long, global = true, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub spacing: Option<Triple>,
    /// HU of black and of white, for inputs that are not in HU (PNG slices)
    #[arg(long, global = true, value_name = "LO,HI", allow_hyphen_values = true)]
    pub hu: Option<Pair>,
    /// Number of the DICOM series to open, if a folder has several (`archive get`: the identifier of the series)
    #[arg(long, global = true, value_name = "N", value_parser = series, allow_negative_numbers = true)]
    pub series: Option<SeriesChoice>,
    /// Interpolate missing DICOM slices instead of refusing the series
    #[arg(long, global = true)]
    pub allow_gaps: bool,
    /// View angle over the shorter side of the image, in degrees; a panorama always shows all around [default: 90]
    #[arg(long, global = true, value_name = "D", allow_hyphen_values = true)]
    pub fov: Option<f64>,
    /// Camera model [default: perspective]
    #[arg(long, global = true, value_name = "MODEL")]
    pub camera: Option<String>,
    /// Remove tagged fluid and stool from the scan, as `colvis cleanse` does
    #[arg(long, global = true)]
    pub cleanse: bool,
    /// Random seed of the phantom
    #[arg(long, global = true, value_name = "N", value_parser = seed, allow_negative_numbers = true)]
    pub seed: Option<u64>,
    /// What the commands of one process share.
    #[arg(skip)]
    pub(super) shared: Shared,
}

impl Global {
    /// Returns the number of the series to open.
    pub(super) fn series_number(&self) -> Option<usize> {
        match self.series {
            Some(SeriesChoice::Number(number)) => Some(number),
            _ => None,
        }
    }
}

/// The commands.
#[derive(Subcommand, Debug)]
pub enum Command {
    /// Fly through the colon, in a window or headless
    Fly(FlyArgs),
    /// Render a list of poses
    Render(RenderArgs),
    /// Write a cross-section of the scan
    Slice(SliceArgs),
    /// Write the colon's lumen as a mask
    Segment(SegmentArgs),
    /// Write the surface of the colon's lumen as a closed mesh
    Surface(SurfaceArgs),
    /// Write the scan without the colon's tagged fluid and stool
    Cleanse(CleanseArgs),
    /// Write the colon's centerline
    Centerline(CenterlineArgs),
    /// List the places of the wall that look like polyps
    Candidates(CandidatesArgs),
    /// Measure the lesion at a point of the wall
    Measure(MeasureArgs),
    /// Find which places of two scans of one patient belong together
    Match(MatchArgs),
    /// Cut the colon open and lay it flat: a picture of its whole wall
    Unfold(UnfoldArgs),
    /// Write the report of a reading, and its findings for other programs
    Case(CaseArgs),
    /// Make masks, centerlines, flights and more of many scans
    #[command(after_help = crate::cli::batch::steps::help())]
    Batch(BatchArgs),
    /// Make the steps of one of them, as standard input asks.
    #[command(hide = true)]
    BatchWorker,
    /// Ask an archive (PACS) for scans, fetch them, send files to it
    #[command(after_help = ARCHIVE_SETTINGS)]
    Archive(ArchiveArgs),
    /// Write a synthetic colon and its ground truth
    Phantom(PhantomArgs),
    /// Print an input's size, spacing, orientation and header as JSON
    Info(InfoArgs),
    /// Print which systems a flight runs, what it builds, and what it leaves out and why
    Explain(ExplainArgs),
    /// Write the pictures of a flight with their ground truth, for learning and SLAM
    Dataset(Box<DatasetArgs>),
    /// Run tentacles and mines in a two-dimensional drawing
    Plane(PlaneArgs),
    /// Measure error against run time
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
    /// Scan: NIfTI, MetaImage, NRRD, DICOM, or a folder of PNG slices [default: the embedded phantom]
    pub input: Option<PathBuf>,
    /// The same patient's scan in another position, read beside this one in a window; of a study with several series, the paired one
    #[arg(long, value_name = "INPUT")]
    pub second: Option<PathBuf>,
    /// Read --second even if it is another patient's
    #[arg(long, requires = "second")]
    pub force: bool,
    /// Fly without a window
    #[arg(long)]
    pub headless: bool,
    /// Steering method (`--help` lists them)
    #[arg(long, value_name = "GUIDE")]
    pub guide: Option<String>,
    /// Start: rectum, cecum, or X,Y,Z in mm LPS
    #[arg(long, value_name = "P", allow_hyphen_values = true)]
    pub from: Option<Point>,
    /// Goal: rectum, cecum, or X,Y,Z in mm LPS
    #[arg(long, value_name = "P", allow_hyphen_values = true)]
    pub to: Option<Point>,
    /// Swap start and goal
    #[arg(long)]
    pub reverse: bool,
    /// Limit in simulated seconds [default: 600 if headless]
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    pub seconds: Option<f64>,
    /// Frames per simulated second in a recording [default: 30]
    #[arg(long, value_name = "F", allow_hyphen_values = true)]
    pub fps: Option<f64>,
    /// Image size in pixels [default: 1024x1024; a panorama's 2048x1024]
    #[arg(long, value_name = "WxH", allow_hyphen_values = true)]
    pub size: Option<ImageSize>,
    /// Image quality [default: high]
    #[arg(long, value_enum)]
    pub quality: Option<QualityName>,
    /// Renderer [default: default]
    #[arg(long, value_name = "PRESET")]
    pub preset: Option<String>,
    /// Record the flight to a folder of PNGs (a name that ends in /), a .gif or a .mp4
    #[arg(long, value_name = "OUT")]
    pub record: Option<String>,
    /// Log every simulation step as JSON lines
    #[arg(long, value_name = "F.jsonl")]
    pub log: Option<PathBuf>,
    /// Write the flight's outcome, times and memory as JSON
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
    /// Add the fraction of the wall that was seen, and the patches that were missed, to the stats
    #[arg(long)]
    pub coverage: bool,
    /// After the flight, fly the shortest tour past the missed patches (headless), and add the result to the stats
    #[arg(long)]
    pub review: bool,
    /// Answers to candidates, saved by the gallery or a window: the review also visits the unsure ones
    #[arg(long, value_name = "A.json", requires = "review")]
    pub answers: Option<PathBuf>,
    /// Write the wall as a mesh: for each face, the number of places from which it was seen
    #[arg(long, value_name = "F.ply")]
    pub coverage_mesh: Option<PathBuf>,
    /// Record the operator's input
    #[arg(long, value_name = "F")]
    pub record_input: Option<PathBuf>,
    /// Replay recorded operator input
    #[arg(long, value_name = "F")]
    pub replay: Option<PathBuf>,
    /// Replay a flight from its log
    #[arg(long, value_name = "LOG")]
    pub play: Option<PathBuf>,
    /// Speed of --play relative to the original flight
    #[arg(long, value_name = "R", allow_hyphen_values = true)]
    pub rate: Option<f64>,
    /// Scene file with plugins and settings
    #[arg(long, value_name = "S.toml")]
    pub scene: Option<PathBuf>,
    /// Panels of the window: the flight alone, the flight and three slices, four slices, the flight and the slice across the path, or
    /// both positions [default: as you left them; both with --second]
    #[arg(long, value_parser = ["flight", "reading", "slices", "across", "both"])]
    pub layout: Option<String>,
    /// Method that finds polyps in the window [default: shape]
    #[arg(long, value_name = "DETECTOR")]
    pub detector: Option<String>,
    /// Overlays to draw into the recording, or to show when the window opens (the list of keys names them)
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub overlay: Vec<String>,
}

/// `render`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct RenderArgs {
    /// Scan: NIfTI, MetaImage, NRRD, DICOM, or a folder of PNG slices
    pub input: PathBuf,
    /// Poses, as JSON
    #[arg(long, value_name = "P.json")]
    pub poses: PathBuf,
    /// Folder for the images
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Image size in pixels [default: 1024x1024; a panorama's 2048x1024]
    #[arg(long, value_name = "WxH", allow_hyphen_values = true)]
    pub size: Option<ImageSize>,
    /// Image quality [default: high]
    #[arg(long, value_enum)]
    pub quality: Option<QualityName>,
    /// Renderer [default: default]
    #[arg(long, value_name = "PRESET")]
    pub preset: Option<String>,
    /// Samples per pixel
    #[arg(long, value_name = "N", value_parser = count, allow_negative_numbers = true)]
    pub samples: Option<usize>,
    /// Render every frame from scratch, without reuse of the frame before
    #[arg(long)]
    pub no_reuse: bool,
    /// Also write depth as NumPy files
    #[arg(long)]
    pub depth: bool,
    /// Also write the wall's normals as NumPy files: unit vectors, world, towards the gas
    #[arg(long)]
    pub normals: bool,
    /// Colour the wall in the images
    #[arg(long, value_enum)]
    pub overlay: Option<WallOverlay>,
    /// Scene file with the settings of --overlay
    #[arg(long, value_name = "S.toml")]
    pub scene: Option<PathBuf>,
    /// Write times and sample counts of the frames as JSON
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
}

/// An overlay that colours the wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum WallOverlay {
    /// By what lies behind it: tag, fat, soft tissue or gas
    Translucency,
    /// Where thin tag lies on it
    Coats,
}

/// `slice`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct SliceArgs {
    /// Scan [default: the embedded phantom]
    pub input: Option<PathBuf>,
    /// Point at the centre of the image, mm LPS
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub at: Triple,
    /// axial, coronal, sagittal, or the normal of an oblique plane, which points at the viewer
    #[arg(long, value_name = "PLANE", value_parser = plane, allow_hyphen_values = true)]
    pub plane: SlicePlane,
    /// Output: .png (8-bit grey) or .npy (float32 HU)
    #[arg(long, value_name = "F")]
    pub out: PathBuf,
    /// Image size in pixels [default: 512x512]
    #[arg(long, value_name = "WxH", allow_hyphen_values = true)]
    pub size: Option<ImageSize>,
    /// Pixel size in mm [default: the scan's smallest spacing]
    #[arg(long, value_name = "S", value_parser = number, allow_hyphen_values = true)]
    pub mm_per_pixel: Option<f64>,
    /// Window level: HU shown as middle grey in a PNG [default: 0]
    #[arg(long, value_name = "L", value_parser = number, allow_hyphen_values = true)]
    pub level: Option<f64>,
    /// Window width: HU from black to white in a PNG [default: 2000]
    #[arg(long, value_name = "W", value_parser = number, allow_hyphen_values = true)]
    pub window: Option<f64>,
    /// Slab thickness in mm, 0 to 20, and its projection: mean, max or min
    #[arg(long, value_name = "MM,KIND", value_parser = slab, allow_hyphen_values = true)]
    pub slab: Option<Slab>,
}

/// `segment`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct SegmentArgs {
    /// Scan: NIfTI, MetaImage, NRRD, DICOM, or a folder of PNG slices
    pub input: PathBuf,
    /// Output mask: 0 outside, 1 gas, 2 tagged fluid
    #[arg(long, value_name = "MASK")]
    pub out: PathBuf,
    /// Labels to add
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LABEL,...")]
    pub labels: Vec<LabelName>,
    /// Treat the gas at this point (mm LPS) as colon, whatever it looks like
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub from: Option<Triple>,
    /// Write a small picture of the colon from outside, seen from the front
    #[arg(long, value_name = "F.png")]
    pub picture: Option<PathBuf>,
    /// Write volumes and bounds as JSON
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
}

/// `cleanse`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct CleanseArgs {
    /// Scan: NIfTI, MetaImage, NRRD, DICOM, or a folder of PNG slices
    pub input: PathBuf,
    /// Output scan
    #[arg(long, value_name = "SCAN")]
    pub out: PathBuf,
    /// Treat the gas at this point (mm LPS) as colon, whatever it looks like
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub from: Option<Triple>,
    /// Write volumes, pools and what remains as JSON
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
}

/// `surface`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct SurfaceArgs {
    /// Scan; the surface encloses its colon's gas and tagged fluid
    #[arg(required_unless_present = "mask")]
    pub input: Option<PathBuf>,
    /// Mask to use instead of a scan: every voxel other than 0 is lumen; voxel steps are smoothed
    #[arg(long, value_name = "M.nii.gz")]
    pub mask: Option<PathBuf>,
    /// Output mesh, mm LPS, normals pointing out of the lumen: .stl, .ply or .obj
    #[arg(long, value_name = "F")]
    pub out: PathBuf,
    /// Treat the gas at this point (mm LPS) as colon, whatever it looks like
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub from: Option<Triple>,
    /// Write area, volume and times as JSON
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
}

/// `centerline`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct CenterlineArgs {
    /// Scan: NIfTI, MetaImage, NRRD, DICOM, or a folder of PNG slices
    #[arg(required_unless_present = "mask")]
    pub input: Option<PathBuf>,
    /// Mask of the lumen to use instead of a scan
    #[arg(long, value_name = "M.nii.gz")]
    pub mask: Option<PathBuf>,
    /// Output: .json, .csv or .mrk.json (a curve for 3D Slicer)
    #[arg(long, value_name = "F")]
    pub out: PathBuf,
    /// Method: penalised (default; keeps away from walls, then moves to the axis), peel (peels from the wall inwards),
    /// roadmap (along inscribed balls; takes minutes on a whole scan) or cells (through free cells)
    #[arg(long, value_name = "METHOD", value_parser = methods())]
    pub method: Option<CenterlineMethod>,
    /// Start: rectum, cecum, or X,Y,Z in mm LPS
    #[arg(long, value_name = "P", allow_hyphen_values = true)]
    pub from: Option<Point>,
    /// End: rectum, cecum, or X,Y,Z in mm LPS
    #[arg(long, value_name = "P", allow_hyphen_values = true)]
    pub to: Option<Point>,
    /// Write length and times as JSON
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
}

/// `candidates`' arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct CandidatesArgs {
    /// Scan: NIfTI, MetaImage, NRRD, DICOM, or a folder of PNG slices
    pub input: PathBuf,
    /// Output list, JSON, best first
    #[arg(long, value_name = "C.json")]
    pub out: PathBuf,
    /// Maximum number of candidates in the list
    #[arg(long, value_name = "N", value_parser = count, allow_negative_numbers = true)]
    pub max: Option<usize>,
    /// Also write pictures of the best 200 and a page that shows them, index.html
    #[arg(long, value_name = "DIR/")]
    pub gallery: Option<PathBuf>,
    /// Method [default: shape]
    #[arg(long, value_name = "DETECTOR")]
    pub detector: Option<String>,
    /// Treat the gas at this point (mm LPS) as colon, whatever it looks like
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub from: Option<Triple>,
    /// Write times and memory as JSON
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
}

/// `measure`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct MeasureArgs {
    /// Scan: NIfTI, MetaImage, NRRD, DICOM, or a folder of PNG slices
    pub input: PathBuf,
    /// Point of the wall, mm LPS
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub at: Triple,
    /// Write the measures as JSON instead of printing them
    #[arg(long, value_name = "F.json")]
    pub out: Option<PathBuf>,
    /// Treat the gas at this point (mm LPS) as colon, whatever it looks like
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub from: Option<Triple>,
    /// Write times and memory as JSON
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
}

/// The category scheme of a report, unless another one is asked for.
const SCHEME: &str = "c-rads-2023";

/// `case`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct CaseArgs {
    /// Scan: NIfTI, MetaImage, NRRD, DICOM, or a folder of PNG slices
    pub input: PathBuf,
    /// Findings, as a window keeps them
    #[arg(long, value_name = "F.json")]
    pub findings: PathBuf,
    /// Output folder
    #[arg(long, value_name = "DIR/")]
    pub out: PathBuf,
    /// The same patient's scan in another position: what of the findings is there
    #[arg(long, value_name = "INPUT")]
    pub second: Option<PathBuf>,
    /// Take --second even if it is another patient's
    #[arg(long, requires = "second")]
    pub force: bool,
    /// Category scheme: c-rads-2023, england, or a .toml file
    #[arg(long, value_name = "SCHEME", default_value = SCHEME)]
    pub scheme: String,
    /// Write DICOM objects, too: report.dcm (structured report), segments.dcm, capture-NN.dcm
    #[arg(long)]
    pub dicom: bool,
    /// Write name, number and study of the patient of a DICOM input into the page and the DICOM objects
    #[arg(long)]
    pub identity: bool,
    /// Write times, quality by segment and the category as JSON
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
}

impl CaseArgs {
    /// Returns the arguments of a plain report.
    #[cfg(feature = "window")]
    pub(super) fn new(input: PathBuf, findings: PathBuf, out: PathBuf) -> Self {
        let scheme = SCHEME.to_owned();
        let (second, stats) = (None, None);
        Self { input, findings, out, second, force: false, scheme, dicom: false, identity: false, stats }
    }

    /// Returns the scheme's file, if it is one.
    pub(super) fn scheme_file(&self) -> Option<PathBuf> {
        Some(PathBuf::from(&self.scheme)).filter(|_| !Scheme::is_built_in(&self.scheme))
    }
}

/// How the settings name an archive, for the help.
const ARCHIVE_SETTINGS: &str = "\
Archives in the settings file (colvis/settings.toml in the folder for configuration):
  version = 1
  [archive.hospital]
  host = \"127.0.0.1\"
  port = 4242
  title = \"ORTHANC\"        its application entity title
  own_title = \"COLVIS\"     ours; may be left out
  connect_s = 10             seconds to wait for a connection; may be left out
  answer_s = 30              seconds to wait for each answer; may be left out
  [archive.hospital.tls]     only for encrypted connections; paths are relative to the file
  ca = \"ca.pem\"            certificates that the archive's is checked against
  cert = \"own.pem\"         our certificate, if the archive asks for one
  key = \"own.key\"          its key
  name = \"archive.local\"   the name in the archive's certificate, if it is not the host";

/// `match`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct MatchArgs {
    /// Scan of the patient in one position
    pub a: PathBuf,
    /// Scan in another position
    pub b: PathBuf,
    /// Pairs: distances along both colons from the rectum, with the uncertainty of the second, mm (.json)
    #[arg(long, value_name = "F")]
    pub out: PathBuf,
    /// Write statistics
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
}

/// `unfold`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct UnfoldArgs {
    /// Scan: NIfTI, MetaImage, NRRD, DICOM, or a folder of PNG slices
    pub input: PathBuf,
    /// Picture, the rectum on top, seen from inside with the patient's front in the middle (.png)
    #[arg(long, value_name = "F.png")]
    pub out: PathBuf,
    /// Also write the wall's point of each pixel, mm LPS: float32 rows×columns×3, NaN where there is none
    #[arg(long, value_name = "F.npy")]
    pub map: Option<PathBuf>,
    /// One end of what is shown: rectum, cecum, or X,Y,Z in mm LPS
    #[arg(long, value_name = "P", allow_hyphen_values = true)]
    pub from: Option<Point>,
    /// The other end: rectum, cecum, or X,Y,Z in mm LPS
    #[arg(long, value_name = "P", allow_hyphen_values = true)]
    pub to: Option<Point>,
    /// Write times, and how well the wall is shown, as JSON
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
}

/// `batch`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct BatchArgs {
    /// Manifest: a CSV file with a row for each case
    #[arg(required_unless_present = "group")]
    pub manifest: Option<PathBuf>,
    /// Folder to write a folder for each case into, or the report of --group
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Make one table and one page of the cases in this folder, and tell which of the manifest are missing
    #[arg(long, value_name = "DIR", conflicts_with_all = ["do", "only", "shard", "jobs", "memory", "timeout"])]
    pub group: Option<PathBuf>,
    /// What to make of each scan [default: all but unfold and case]
    #[arg(long, value_name = "STEP,…", value_delimiter = ',')]
    pub r#do: Vec<Step>,
    /// Only this share of the cases, counted from 1
    #[arg(long, value_name = "I/N", value_parser = shard)]
    pub shard: Option<Shard>,
    /// Only these cases; may be repeated, for an id with a comma
    #[arg(long, value_name = "ID,…")]
    pub only: Vec<String>,
    /// Print what each case is expected to take as JSON, and make nothing
    #[arg(long)]
    pub plan: bool,
    /// Number of cases at once [default: as many as there are cores, with --threads each]
    #[arg(long, value_name = "N", value_parser = threads, allow_negative_numbers = true)]
    pub jobs: Option<usize>,
    /// Memory that all cases together may take, such as 4G [default: what is free]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
    /// The longest that a case may take, s
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    pub timeout: Option<f64>,
}

/// `archive`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct ArchiveArgs {
    /// What to do
    #[arg(value_enum)]
    pub action: ArchiveAction,
    /// Name of the archive in the settings file, if that has several; `send`: and the files and folders to send
    #[arg(value_name = "NAME|FILE")]
    pub names: Vec<PathBuf>,
    /// `find`: name or identifier of the patient; * stands for any characters, ? for one
    #[arg(long, value_name = "P")]
    pub patient: Option<String>,
    /// `find`: day of the study, 20250131, or first and last day, of which one may be left out: 20250101-20250331
    #[arg(long, value_name = "A-B", allow_hyphen_values = true)]
    pub date: Option<String>,
    /// `find`: words in the description of the study or the series
    #[arg(long, value_name = "T")]
    pub description: Option<String>,
    /// `find`: maximum number of studies [default: 500]
    #[arg(long, value_name = "N", value_parser = count, allow_negative_numbers = true)]
    pub max: Option<usize>,
    /// `get`: folder for the series, a file for each instance
    #[arg(long, value_name = "DIR/")]
    pub out: Option<PathBuf>,
}

/// What is done with an archive.
#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
#[value(rename_all = "lower")]
pub enum ArchiveAction {
    /// Ask whether the archive is there.
    Echo,
    /// Print studies with CT series as JSON.
    Find,
    /// Fetch the series of --series; the same command goes on after an interruption.
    Get,
    /// Send DICOM files, as they are.
    Send,
}

/// `info`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct InfoArgs {
    /// Scan: NIfTI, MetaImage, NRRD, DICOM, or a folder of PNG slices
    pub input: PathBuf,
}

/// `explain`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct ExplainArgs {
    /// The flight to explain.
    #[command(flatten)]
    pub fly: FlyArgs,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// `dataset`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct DatasetArgs {
    /// Scan: NIfTI, MetaImage, NRRD, DICOM, or a folder of PNG slices [default: the embedded phantom]
    pub input: Option<PathBuf>,
    /// Phantoms of these seeds instead of a scan, each in a folder of its own
    #[arg(long, value_name = "A..B", value_parser = seed_range)]
    pub phantoms: Option<SeedRange>,
    /// Folder for the dataset: whole, or not there
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// How files are named and listed (`--help` lists the layouts)
    #[arg(long, value_name = "LAYOUT", default_value = "colvis")]
    pub layout: String,
    /// Poses of the pictures instead of a flight, as JSON
    #[arg(long, value_name = "P.json")]
    pub poses: Option<PathBuf>,
    /// A path along the centerline instead of a flight: an unsteady hand, one that looks at the wall, a withdrawal, or in and out with parts
    /// gone over again
    #[arg(long, value_name = "PATH", value_parser = PathKind::ALL.map(PathKind::name))]
    pub path: Option<String>,
    /// Deform the colon slowly, by breathing of so many millimetres and waves along it
    #[arg(long, value_name = "MM", allow_hyphen_values = true)]
    pub deform: Option<f64>,
    /// Kinds of ground truth [default: all]
    #[arg(long, value_name = "KIND,...", value_delimiter = ',', value_parser = Kind::ALL.map(Kind::name))]
    pub truth: Vec<String>,
    /// Steering method (`--help` lists them)
    #[arg(long, value_name = "GUIDE")]
    pub guide: Option<String>,
    /// Start: rectum, cecum, or X,Y,Z in mm LPS
    #[arg(long, value_name = "P", allow_hyphen_values = true)]
    pub from: Option<Point>,
    /// Goal: rectum, cecum, or X,Y,Z in mm LPS
    #[arg(long, value_name = "P", allow_hyphen_values = true)]
    pub to: Option<Point>,
    /// Swap start and goal
    #[arg(long)]
    pub reverse: bool,
    /// Limit in simulated seconds [default: 600]
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    pub seconds: Option<f64>,
    /// Pictures per simulated second [default: 30]
    #[arg(long, value_name = "F", allow_hyphen_values = true)]
    pub fps: Option<f64>,
    /// Image size in pixels [default: 1024x1024]
    #[arg(long, value_name = "WxH", allow_hyphen_values = true)]
    pub size: Option<ImageSize>,
    /// Replay recorded operator input
    #[arg(long, value_name = "F")]
    pub replay: Option<PathBuf>,
    /// Replay a flight from its log
    #[arg(long, value_name = "LOG")]
    pub play: Option<PathBuf>,
    /// Speed of --play relative to the original flight
    #[arg(long, value_name = "R", allow_hyphen_values = true)]
    pub rate: Option<f64>,
    /// Scene file with plugins and settings
    #[arg(long, value_name = "S.toml")]
    pub scene: Option<PathBuf>,
    /// Write the time of each part as JSON
    #[arg(long, value_name = "F.json")]
    pub stats: Option<PathBuf>,
    /// How much the mucosa's colour varies, and its vessels
    #[arg(long, value_name = "HOW", value_parser = ["off", "mild", "strong"], default_value = "mild")]
    pub mucosa: String,
    /// Lamps beside the lens, 1 or 2
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub lights: usize,
    /// Let the wall cast shadows, which takes some more time
    #[arg(long)]
    pub shadows: bool,
    /// What light is multiplied with, or auto to choose it for each picture
    #[arg(long, value_name = "X", default_value = "auto", allow_hyphen_values = true)]
    pub exposure: String,
    /// Gamma of the pictures, 1 to 3
    #[arg(long, value_name = "G", default_value_t = 2.2, allow_hyphen_values = true)]
    pub gamma: f64,
    /// Noise of the pictures: 0 for none, 1 as usual, at most 100
    #[arg(long, value_name = "N", default_value_t = 1.0, allow_hyphen_values = true)]
    pub noise: f64,
    /// Write linear light as OpenEXR and the wall's colour beside the pictures
    #[arg(long)]
    pub linear: bool,
    /// Chooses the pictures' noise, the mucosa's vessels and the sway of --path [default: --seed, or 1]
    #[arg(long, value_name = "N")]
    pub noise_seed: Option<u64>,
}

impl DatasetArgs {
    /// Returns the flight whose frames are the pictures.
    pub fn flight(&self) -> FlyArgs {
        FlyArgs {
            input: self.input.clone(),
            headless: true,
            guide: self.guide.clone(),
            from: self.from,
            to: self.to,
            reverse: self.reverse,
            seconds: self.seconds,
            fps: self.fps,
            size: self.size,
            replay: self.replay.clone(),
            play: self.play.clone(),
            rate: self.rate,
            scene: self.scene.clone(),
            ..FlyArgs::default()
        }
    }
}

/// `plane`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct PlaneArgs {
    /// Drawing of a lumen: a PNG (bright is lumen, dark is wall, red is the start, green the goal; 0.5 mm per pixel), or
    /// one of bends, straight, fork, pocket, ring, touching, bridge, polyp, neck, spiral (bends)
    pub lumen: Option<PathBuf>,
    /// Run without a window
    #[arg(long)]
    pub headless: bool,
    /// Output: .png of the end, or .gif of the whole flight
    #[arg(long, value_name = "F")]
    pub out: Option<PathBuf>,
    /// Scene file with settings of tentacles, mines, body and watch; its guide must be tentacles
    #[arg(long, value_name = "S.toml")]
    pub scene: Option<PathBuf>,
}

/// `report`'s arguments.
#[derive(ClapArgs, Clone, Debug)]
pub struct ReportArgs {
    /// Report to run
    #[arg(value_enum)]
    pub subject: ReportSubject,
    /// Output folder
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Smaller inputs and fewer repetitions: under a minute
    #[arg(long)]
    pub quick: bool,
    /// Scan to measure in addition to the phantom (`render`, `dynamics`, `fields`, `coverage`, `candidates`)
    #[arg(long, value_name = "F")]
    pub scan: Option<PathBuf>,
    /// Truth of --scan: its polyps, as JSON (`candidates`)
    #[arg(long, value_name = "T.json")]
    pub truth: Option<PathBuf>,
    /// Number of steps in the perforation test
    #[arg(long, value_name = "N", value_parser = steps, allow_negative_numbers = true)]
    pub steps: Option<u64>,
}

impl Args {
    /// Reads the arguments of a program, with its catalog as the values of the options. Fails if the arguments are invalid, or if
    /// help or the version is requested.
    pub(super) fn read(args: impl Iterator<Item = OsString>, program: &Program) -> Result<Self, ParseError> {
        let args: Vec<OsString> = args.collect();
        if let Some(name) = args.first() {
            set_program_name(name);
        }
        let command = command(program).bin_name(program_name());
        let args = command_first(args, &command);
        let mut matches = command.try_get_matches_from(args).map_err(ParseError)?;
        let own = matches.subcommand_name().filter(|n| program.commands.iter().any(|c| c.name == *n));
        if own.is_some()
            && let Some((name, matches)) = matches.remove_subcommand()
        {
            let global = Global::from_arg_matches(&matches).map_err(ParseError)?;
            return Ok(Self { command: Some(Command::Own { name, matches }), fly: FlyArgs::default(), global });
        }
        Self::from_arg_matches(&matches).map_err(ParseError)
    }
}

/// Why a command line was not run: it is invalid, or it requests help or the version.
#[derive(Debug)]
pub struct ParseError(clap::Error);

/// True if `name` is a command of this crate.
pub(super) fn is_command(name: &str) -> bool {
    name == "help" || Args::command().get_subcommands().any(|c| c.get_name() == name)
}

impl fmt::Display for ParseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// The command line, with the catalog's entries as the values of its options.
pub(super) fn command(program: &Program) -> clap::Command {
    let catalog = &program.catalog;
    let guides: Vec<_> = catalog.guides.iter().map(|g| (g.name, g.summary)).collect();
    let presets: Vec<_> = catalog.presets.iter().map(|p| (p.name, p.summary)).collect();
    let cameras: Vec<_> = catalog.cameras.iter().map(|c| (c.name, c.summary)).collect();
    let detectors: Vec<_> = catalog.detectors.iter().map(|d| (d.name, d.summary)).collect();
    let renders = |c| choices(c, "preset", "Renderer", &presets);
    let layouts: Vec<_> = layout::BUILT_IN.iter().map(|l| (l.name, l.summary)).collect();
    let flies = |c| {
        let what = "Method that finds polyps in the window";
        choices(choices(renders(c), "guide", "Steering method", &guides), "detector", what, &detectors)
    };
    let window = |c: clap::Command| c.after_help(keys(program));
    let all = Args::command().subcommands(program.commands.iter().map(|c| c.line()));
    choices(window(flies(all)), "camera", "Camera model", &cameras)
        .mut_subcommand("fly", |c| window(flies(c)))
        .mut_subcommand("explain", flies)
        .mut_subcommand("dataset", |c| {
            let c = choices(c, "guide", "Steering method", &guides);
            choices(c, "layout", "How files are named and listed", &layouts)
        })
        .mut_subcommand("render", renders)
        .mut_subcommand("candidates", |c| choices(c, "detector", "Method", &detectors))
}

/// The window's keys for the help; empty in builds without a window.
fn keys(program: &Program) -> String {
    let rows = program.key_help().unwrap_or_default();
    let wide = rows.iter().map(|r| r.0.chars().count()).max().unwrap_or(0);
    let lines = rows.iter().map(|(key, what)| format!("  {key:wide$}  {what}\n"));
    if rows.is_empty() {
        String::new()
    } else {
        format!("Keys in the window (by groups: --help keys):\n{}", lines.collect::<String>())
    }
}

/// The methods of a centerline, by their short names. The names of scene files work too.
fn methods() -> impl TypedValueParser<Value = CenterlineMethod> {
    let named = |name: String| CenterlineMethod::ALL.into_iter().find(|m| [m.name(), short_name(*m)].contains(&&*name));
    PossibleValuesParser::new(CenterlineMethod::ALL.map(|m| PossibleValue::new(short_name(m)).alias(m.name())))
        .map(move |name| named(name).unwrap_or_default())
}

/// A centerline method's name on the command line.
fn short_name(method: CenterlineMethod) -> &'static str {
    match method {
        CenterlineMethod::PeelOnion => "peel",
        CenterlineMethod::Cells => "cells",
        other => other.name(),
    }
}

/// Gives an option its values: names with their summaries.
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
    /// Full resolution, trilinear sampling.
    High,
    /// A third of the resolution, enlarged; with the presets colvis and lean, or `low = "nearest"` in a scene, nearest voxel.
    Low,
    /// As fine as frame time and motion allow; refined to the reference at rest.
    Adaptive,
    /// Brute force, the ground truth for measurements.
    Reference,
}

/// Labels of a mask besides gas and fluid.
#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
#[value(rename_all = "lower")]
pub enum LabelName {
    /// 3: certainly not colon, such as lungs and outside air.
    Other,
    /// 4: the colon's wall.
    Wall,
}

/// Subjects of a report.
#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
#[value(rename_all = "lower")]
pub enum ReportSubject {
    /// Ray casting.
    Render,
    /// Gradient estimators.
    Gradients,
    /// Savings from omitted parts of a scene.
    Scenes,
    /// Integrators.
    Dynamics,
    /// Distances and centerlines.
    Fields,
    /// Random steps against the wall.
    Perforation,
    /// The wall under tagged fluid.
    Cleansing,
    /// The share of the wall that flights see.
    Coverage,
    /// The colon laid flat.
    Unfold,
    /// Polyp detectors.
    Candidates,
    /// All of them.
    All,
}

/// Moves the command to the front, so that global options may precede it. clap would take the command for an input there,
/// because `colvis INPUT` is a flight.
fn command_first(mut args: Vec<OsString>, command: &clap::Command) -> Vec<OsString> {
    let at = command_place(&args, command);
    let is_command = |a: &OsString| command.get_subcommands().any(|c| a.as_os_str() == c.get_name());
    if at > 1 && args.get(at).is_some_and(is_command) {
        args[1..=at].rotate_right(1);
    }
    args
}

/// Position of the command: after the global options at the start of the line.
fn command_place(args: &[OsString], command: &clap::Command) -> usize {
    let mut at = 1;
    while let Some(arg) = args.get(at).and_then(|a| a.to_str()) {
        let (name, value) = arg.split_once('=').map_or((arg, None), |(name, value)| (name, Some(value)));
        let long = name.strip_prefix("--");
        let global = command.get_arguments().find(|a| a.is_global_set() && a.get_long() == long && long.is_some());
        let Some(global) = global else { break };
        let takes_value = matches!(global.get_action(), ArgAction::Set | ArgAction::Append);
        at += if takes_value && value.is_none() { 2 } else { 1 };
    }
    at
}

/// Prints help verbatim, and anything else as one line: `error: WHAT: WHY; HINT`.
pub fn refuse(refused: &ParseError) -> ExitCode {
    match refused {
        ParseError(e) if matches!(e.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) => {
            let printed = print(|out| write!(out, "{}", e.render()).and_then(|()| out.flush()));
            printed.map_or_else(|e| failed(&e), |()| ExitCode::SUCCESS)
        }
        _ => failed(&refused.error()),
    }
}

impl ParseError {
    /// Returns what is wrong with the line, in the form of all errors.
    pub(super) fn error(&self) -> Error {
        let text = self.0.render().to_string();
        let why: Vec<&str> = text
            .lines()
            .map(str::trim)
            .take_while(|l| !l.starts_with("Usage:") && !l.starts_with("For more"))
            .filter(|l| !l.is_empty() && !l.starts_with("tip:"))
            .collect();
        let why = why.join(" ");
        let why = why.strip_prefix("error: ").unwrap_or(&why);
        Error::usage("command line", why, format!("see {} --help", program_name()))
    }
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
        let moved = |line: &str| {
            let args = command_first(line.split(' ').map(OsString::from).collect(), &Args::command());
            args.iter().map(|a| a.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(moved("colvis --threads 1 info v.nii"), "colvis info --threads 1 v.nii");
        for as_it_is in
            ["colvis", "colvis info v.nii", "colvis --threads 2 scan.nii", "colvis --threads 2", "colvis --threads"]
        {
            assert_eq!(moved(as_it_is), as_it_is);
        }
    }

    #[test]
    fn every_global_option_may_precede_every_command() {
        let all = command(&Program::default());
        let mut options: Vec<Vec<String>> = Vec::new();
        for option in all.get_arguments().filter(|a| a.is_global_set()) {
            let name = format!("--{}", option.get_long().unwrap());
            if matches!(option.get_action(), ArgAction::SetTrue) {
                options.push(vec![name]);
            } else {
                options.push(vec![format!("{name}=1,2")]);
                options.push(vec![name, "1,2".to_owned()]);
            }
        }
        assert!(options.len() > 15, "{options:?}");
        let together = options.concat();
        options.push(together);
        let place = |line: &[String]| command_place(&line.iter().map(OsString::from).collect::<Vec<_>>(), &all);
        for option in options {
            let line = |rest: &[&str]| {
                let rest = rest.iter().map(|r| (*r).to_owned());
                std::iter::once("colvis".to_owned()).chain(option.clone()).chain(rest).collect::<Vec<_>>()
            };
            for command in all.get_subcommands() {
                let moved = command_first(line(&[command.get_name(), "v"]).iter().map(OsString::from).collect(), &all);
                let expected = [&["colvis".to_owned(), command.get_name().to_owned()][..], &option, &["v".to_owned()]];
                assert_eq!(moved, expected.concat().iter().map(OsString::from).collect::<Vec<_>>());
            }
            assert_eq!(place(&line(&["scan.nii"])), option.len() + 1, "an input is no option");
        }
        let read = Program::default().parse(["colvis", "--cleanse", "--allow-gaps", "info", "v.nii"]).unwrap();
        assert!(matches!(read.command, Some(Command::Info(_))) && read.global.cleanse && read.global.allow_gaps);
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
