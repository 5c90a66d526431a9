//! `colvis centerline`.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use serde_json::json;

use crate::app::Timings;
use crate::app::findings::DISTENDED_MM;
use crate::app::scan::check_thick;
use crate::cli::args::{CenterlineArgs, Global, Point};
use crate::cli::case::curve;
use crate::cli::files;
use crate::cli::messages::say;
use crate::cli::prepare::{self, Input};
use crate::cli::shared::Use;
use crate::error::{Error, Result};
use crate::fields::centerline::{self, Centerline, End};
use crate::fields::connection;
use crate::fields::lumen::{self, Lumen, Part};
use crate::fields::{Through, WallDistance};
use crate::output;
use crate::progress::Progress;
use crate::volume::Volume;

/// Maximum distance by which a point outside the lumen is moved into it, mm.
const SNAP_MM: f64 = 5.0;
/// Maximum number of narrow places that are listed …
const MOST_NARROWS: usize = 10;

/// Format of the line's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Json,
    Csv,
    Markups,
}

impl Format {
    fn of(path: &Path) -> Result<Self> {
        let name = path.file_name().map(|n| n.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        [(".mrk.json", Self::Markups), (".json", Self::Json), (".csv", Self::Csv)]
            .into_iter()
            .find(|(ending, _)| name.ends_with(ending) && name.len() > ending.len())
            .map(|f| f.1)
            .ok_or_else(|| {
                let why = "its extension is not that of a line format";
                Error::usage(path.display().to_string(), why, "end it in .json, .csv or .mrk.json")
            })
    }
}

/// Calibers along a line: the diameters of the largest balls around its points.
#[derive(Debug, PartialEq)]
struct Calibers {
    /// The mean, mm; guesses are left out.
    mean_mm: f64,
    /// The least, mm; 0 if the lumen is collapsed somewhere.
    least_mm: f64,
    /// The share of the length that is distended, 0 to 1.
    distended: f64,
}

impl Calibers {
    fn of(line: &Centerline) -> Self {
        // A guess has no radius.
        let known: Vec<f64> = line.radius_mm.iter().map(|r| 2.0 * r).filter(|mm| *mm > 0.0).collect();
        let all = line.radius_mm.len().max(1) as f64;
        Self {
            mean_mm: known.iter().sum::<f64>() / known.len().max(1) as f64,
            least_mm: 2.0 * line.radius_mm.iter().copied().reduce(f64::min).unwrap_or(0.0),
            distended: known.iter().filter(|mm| **mm >= DISTENDED_MM).count() as f64 / all,
        }
    }
}

/// Runs the command. Fails with status 2 for an unknown ending or an input beside a mask, 3 if the input cannot be read, 4 if there
/// is no lumen or no path through it, or if interrupted, 5 if an output cannot be written.
pub(crate) fn run(args: &CenterlineArgs, global: &Global, progress: &Progress) -> Result<()> {
    let format = Format::of(&args.out)?;
    let (input, is_mask) = prepare::scan_or_mask("centerline", args.input.as_deref(), args.mask.as_deref())?;
    files::check_folders(&args.out, args.stats.as_deref())?;
    let mut timings = Timings::default();
    let (line, names) = if is_mask {
        let volume = prepare::load_mask(input, global, &mut timings, progress)?;
        check_thick(&volume)?;
        let walls = timings.time("distance_s", || WallDistance::of_mask(&volume, progress))?;
        drop(volume);
        (timings.time("centerline_s", || through_mask(&walls, args, progress))?, Vec::new())
    } else {
        let input = prepare::load(input, global, Use::Look, &mut timings, progress)?;
        through_scan(&input, args, &mut timings, progress)?
    };
    for [a, b] in &line.guessed {
        say(&format!("from {a:.0} to {b:.0} mm the lumen is collapsed: the line is a guess there"));
    }
    let narrows = line.narrows(centerline::BODY_MM);
    for n in line.impassable().into_iter().take(MOST_NARROWS) {
        let (at, wide) = (n.at, 2.0 * n.radius_mm);
        say(&format!(
            "at {:.1},{:.1},{:.1}, {:.0} mm along, the lumen is {wide:.1} mm wide: the camera does not fit through",
            at.x, at.y, at.z, n.along_mm
        ));
    }
    write(&args.out, format, &line)?;
    if let Some(path) = &args.stats {
        let mut stats = prepare::stats_head(&timings);
        let calibers = Calibers::of(&line);
        for (name, value) in [
            ("method", json!(args.method.unwrap_or_default())),
            ("length_mm", json!(line.length_mm)),
            ("points", json!(line.points.len())),
            ("guessed_mm", json!(line.guessed)),
            ("caliber_mm", json!(calibers.mean_mm)),
            ("least_caliber_mm", json!(calibers.least_mm)),
            ("distended", json!(calibers.distended)),
            (
                "narrow",
                json!(
                    narrows
                        .iter()
                        .map(|n| json!({
                            "position": n.at.to_array(), "along_mm": n.along_mm, "width_mm": 2.0 * n.radius_mm
                        }))
                        .collect::<Vec<_>>()
                ),
            ),
            ("names", json!(names)),
        ] {
            stats.insert(name.to_owned(), value);
        }
        output::write_json(path, &stats)?;
    }
    Ok(())
}

fn through_mask(walls: &WallDistance, args: &CenterlineArgs, progress: &Progress) -> Result<Centerline> {
    if walls.voxels() == 0 {
        return Err(Error::incomplete("mask", "is empty: it has no lumen voxel", "give a mask of the colon's lumen"));
    }
    let named = |p: Option<Point>| matches!(p, Some(Point::World(_)));
    let ends =
        if named(args.from) && named(args.to) { [DVec3::ZERO; 2] } else { centerline::far_ends(walls, progress)? };
    plan(walls, args, ends, &[], progress)
}

fn through_scan(
    input: &Input,
    args: &CenterlineArgs,
    timings: &mut Timings,
    progress: &Progress,
) -> Result<(Centerline, Vec<Part>)> {
    let mut lumen = input.lumen(timings, progress)?;
    let volume: &Volume = &input.volume;
    if let Some(Point::World(p)) = args.from.or(args.to) {
        // A point selects the gas that it lies in, even if that was not classified as colon.
        if lumen.nearest_gas(p, SNAP_MM).is_none() && !lumen.is_fluid(p) {
            let found = timings.time("lumen_at_s", || lumen::gas_at(volume, p, progress))?;
            lumen = found.map(Arc::new).ok_or_else(|| {
                let why = format!("{:.1},{:.1},{:.1} has no gas within {SNAP_MM} mm", p.x, p.y, p.z);
                Error::incomplete("centerline", why, "give a point in the colon")
            })?;
        }
    }
    if lumen.segments.is_empty() {
        return Err(prepare::no_lumen(volume, &lumen, "give --from and --to, or a mask of the lumen"));
    }
    let walls =
        timings.time("distance_s", || WallDistance::of_lumen(volume, &lumen, Through::GasAndFluid, progress))?;
    let asked = args.from.is_some() || args.to.is_some();
    let mut ends = lumen.outermost(0..lumen.segments.len());
    if !asked {
        let joined = joined(&lumen);
        if !lumen.ordered {
            if lumen.segments.len() > 1 {
                let count = lumen.segments.len();
                say(&format!("the order of the {count} segments is not known: the line runs through the largest"));
            }
            ends = joined;
        }
    }
    let guesses = match between(&lumen, args) {
        which if which.len() > 1 => timings.time("guess_s", || connection::guesses(volume, &lumen, which, progress))?,
        _ => Vec::new(),
    };
    let line = timings.time("centerline_s", || plan(&walls, args, ends, &guesses, progress))?;
    let names = lumen.names().on(&line.points);
    Ok((line, names))
}

/// The segments between which the line may have to be guessed: all from that of one requested end to that of the other. Without a
/// request it is that of the whole colon.
fn between(lumen: &Lumen, args: &CenterlineArgs) -> Range<usize> {
    if !lumen.ordered {
        return 0..0;
    }
    let all = 0..lumen.segments.len();
    let segment = |p: Option<Point>| match p {
        Some(Point::World(p)) => lumen.nearest_gas(p, SNAP_MM).map(|f| f.0),
        Some(Point::Rectum) => Some(0),
        Some(Point::Cecum) => all.end.checked_sub(1),
        None => None,
    };
    match (segment(args.from), segment(args.to)) {
        (Some(a), Some(b)) => a.min(b)..a.max(b) + 1,
        _ => all,
    }
}

/// The ends of the largest segment and of those that fluid joins to it, one after the other.
fn joined(lumen: &Lumen) -> [DVec3; 2] {
    let which = joined_segments(lumen);
    if which.is_empty() {
        return [DVec3::ZERO; 2];
    }
    if which.len() > 1 {
        say(&format!("{} segments are joined through tagged fluid", which.len()));
    }
    lumen.outermost(which)
}

/// The largest segment and those that fluid joins to it, one after the other.
fn joined_segments(lumen: &Lumen) -> Range<usize> {
    let Some(largest) = lumen.largest() else { return 0..0 };
    let (mut first, mut last) = (largest, largest);
    if lumen.ordered {
        while first > 0 && lumen.segments[first].joined_to.contains(&(first - 1)) {
            first -= 1;
        }
        while last + 1 < lumen.segments.len() && lumen.segments[last].joined_to.contains(&(last + 1)) {
            last += 1;
        }
    }
    first..last + 1
}

/// The line between the requested points; `ends` are the rectal and the cecal end.
fn plan(
    walls: &WallDistance,
    args: &CenterlineArgs,
    ends: [DVec3; 2],
    guesses: &[Vec<DVec3>],
    progress: &Progress,
) -> Result<Centerline> {
    let end = |p: Point| match p {
        Point::Rectum => End::Tip(ends[0]),
        Point::Cecum => End::Tip(ends[1]),
        Point::World(p) => {
            if !walls.is_inside(walls.voxel(p)) {
                say(&format!("{:.1},{:.1},{:.1} lies outside the lumen; moved into it", p.x, p.y, p.z));
            }
            End::At(p)
        }
    };
    if args.from.zip(args.to).is_some_and(|(from, to)| same(from, to)) {
        return Err(Error::incomplete("centerline", "start and goal coincide", "give --from and --to farther apart"));
    }
    let method = args.method.unwrap_or_default();
    let line = |from: End, to: End| centerline::by(method, walls, from, to, guesses, progress);
    match (args.from, args.to) {
        (None, None) => line(End::Tip(ends[0]), End::Tip(ends[1])),
        (Some(from), Some(to)) => line(end(from), end(to)),
        (Some(Point::Rectum), None) | (None, Some(Point::Cecum)) => line(End::Tip(ends[0]), End::Tip(ends[1])),
        (Some(Point::Cecum), None) | (None, Some(Point::Rectum)) => line(End::Tip(ends[1]), End::Tip(ends[0])),
        // From a place to the end that is farther along the lumen, and the other way round.
        (Some(from), None) => farther(ends.map(|e| line(end(from), End::Tip(e)))),
        (None, Some(to)) => farther(ends.map(|e| line(End::Tip(e), end(to)))),
    }
}

/// True if both are the same end, or places within 3 mm.
fn same(a: Point, b: Point) -> bool {
    match (a, b) {
        (Point::World(a), Point::World(b)) => a.distance(b) < 3.0,
        _ => a == b,
    }
}

/// The longer of two lines, or the only one.
fn farther([a, b]: [Result<Centerline>; 2]) -> Result<Centerline> {
    match (a, b) {
        (Ok(a), Ok(b)) => Ok(if b.length_mm > a.length_mm { b } else { a }),
        (Ok(line), Err(_)) | (Err(_), Ok(line)) => Ok(line),
        (Err(e), Err(_)) => Err(e),
    }
}

fn write(path: &Path, format: Format, line: &Centerline) -> Result<()> {
    match format {
        Format::Json => {
            let radius_mm = &line.radius_mm;
            output::write_json(
                path,
                &json!({"points": line.points, "radius_mm": radius_mm, "length_mm": line.length_mm}),
            )
        }
        Format::Csv => output::write_whole(path, |w| {
            writeln!(w, "x_mm,y_mm,z_mm,radius_mm")?;
            line.points.iter().zip(&line.radius_mm).try_for_each(|(p, r)| writeln!(w, "{},{},{},{r}", p.x, p.y, p.z))
        }),
        Format::Markups => output::write_json(path, &curve(line)),
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::cli::Program;
    use crate::cli::args::Command;
    use crate::fields::lumen::Segment;
    use crate::volume::{Grid, io};

    fn lumen(segments: &[(f64, &[usize])], ordered: bool) -> Lumen {
        let segment = |(n, (ml, joined_to)): (usize, &(f64, &[usize]))| Segment {
            ml: *ml,
            fluid_ml: 0.0,
            bounds_mm: [DVec3::ZERO; 2],
            ends: [DVec3::X * n as f64, DVec3::Y * n as f64],
            joined_to: joined_to.to_vec(),
            length_mm: 100.0,
            way: Vec::new(),
            judged: None,
        };
        let grid = Grid::new([4; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let mut lumen = Lumen::none(&grid);
        (lumen.segments, lumen.ordered) = (segments.iter().enumerate().map(segment).collect(), ordered);
        lumen
    }

    #[test]
    fn an_ending_names_the_format_and_is_no_name() {
        for (name, format) in [
            ("a.json", Format::Json),
            ("A.JSON", Format::Json),
            ("a.csv", Format::Csv),
            ("b/a.mrk.json", Format::Markups),
            (".mrk.json", Format::Json),
        ] {
            assert_eq!(Format::of(Path::new(name)).unwrap(), format, "{name}");
        }
        for name in [".json", ".csv", "a", "a.txt", "json", "a.json/", ""].map(Path::new) {
            let format = Format::of(name);
            assert!(format.is_err() || name == Path::new("a.json/"), "{name:?}: {format:?}");
        }
    }

    #[test]
    fn the_line_runs_through_the_largest_segment_and_what_fluid_joins_to_it() {
        let ends = |n: [usize; 2]| [DVec3::X * n[0] as f64, DVec3::Y * n[1] as f64];
        // 0 | 1 - 2 - 3 | 4; the largest is 2.
        let chain: [(f64, &[usize]); 5] = [(5.0, &[]), (9.0, &[2]), (30.0, &[1, 3]), (8.0, &[2]), (20.0, &[])];
        assert_eq!(joined(&lumen(&chain, true)), ends([1, 3]));
        assert_eq!(joined(&lumen(&chain, false)), ends([2, 2]), "without an order, the largest alone");
        assert_eq!(joined(&lumen(&[(3.0, &[1]), (2.0, &[0])], true)), ends([0, 1]));
        assert_eq!(joined(&lumen(&[(3.0, &[]), (2.0, &[])], true)), ends([0, 0]));
        assert_eq!(joined(&lumen(&[], true)), [DVec3::ZERO; 2]);
        assert_eq!(lumen(&chain, true).outermost(0..5), ends([0, 4]));
        assert_eq!(lumen(&chain, false).outermost(0..5), ends([2, 2]));
    }

    #[test]
    fn calibers_leave_guesses_out_of_the_mean_and_count_them_as_collapsed() {
        let line = |radius_mm: &[f64]| Centerline {
            points: vec![DVec3::ZERO; radius_mm.len()],
            radius_mm: radius_mm.to_vec(),
            length_mm: radius_mm.len() as f64,
            guessed: Vec::new(),
        };
        let calibers = |radius_mm: &[f64]| Calibers::of(&line(radius_mm));
        assert_eq!(calibers(&[4.0, 5.0, 9.0]), Calibers { mean_mm: 12.0, least_mm: 8.0, distended: 2.0 / 3.0 });
        assert_eq!(calibers(&[4.0, 0.0, 8.0, 0.0]), Calibers { mean_mm: 12.0, least_mm: 0.0, distended: 0.25 });
        assert_eq!(calibers(&[]), Calibers { mean_mm: 0.0, least_mm: 0.0, distended: 0.0 });
    }

    #[test]
    fn ends_coincide_within_three_millimetres() {
        let at = |x: f64| Point::World(DVec3::new(x, -4.0, 7.0));
        assert!(same(at(1.0), at(3.9)) && !same(at(1.0), at(4.0)));
        assert!(
            same(Point::Cecum, Point::Cecum) && !same(Point::Cecum, Point::Rectum) && !same(Point::Rectum, at(0.0))
        );
    }

    #[test]
    fn the_longer_line_is_taken_or_the_only_one() {
        let line = |length_mm: f64| {
            Ok(Centerline { points: vec![DVec3::ZERO], radius_mm: vec![0.0], length_mm, guessed: Vec::new() })
        };
        let no = || Err(Error::incomplete("centerline", "no way", "none"));
        let length = |lines| farther(lines).map(|l| l.length_mm);
        assert_eq!(length([line(3.0), line(5.0)]).unwrap(), 5.0);
        assert_eq!(length([line(5.0), line(3.0)]).unwrap(), 5.0);
        assert_eq!(length([no(), line(3.0)]).unwrap(), 3.0);
        assert_eq!(length([line(2.0), no()]).unwrap(), 2.0);
        assert!(length([no(), no()]).is_err());
    }

    #[test]
    fn a_curve_for_slicer_has_the_points_of_the_line_in_its_frame() {
        let points = vec![DVec3::new(1.0, -2.0, 3.5), DVec3::new(4.0, 5.0, -6.0)];
        let line = Centerline { points, radius_mm: vec![2.0; 2], length_mm: 12.1, guessed: Vec::new() };
        let file = curve(&line);
        let curve = &file["markups"][0];
        assert_eq!([&curve["type"], &curve["coordinateSystem"], &curve["coordinateUnits"]], ["Curve", "LPS", "mm"]);
        let controls = curve["controlPoints"].as_array().unwrap();
        let placed: Vec<_> = controls.iter().map(|c| (&c["id"], &c["position"])).collect();
        assert_eq!(placed, [(&json!("1"), &json!([1.0, -2.0, 3.5])), (&json!("2"), &json!([4.0, 5.0, -6.0]))]);
    }

    #[test]
    fn the_line_through_a_mask_is_written_in_a_known_format() {
        let dir = tempfile::tempdir().unwrap();
        let [mask, out, unknown] =
            ["mask.nii", "line.json", "line.txt"].map(|n| dir.path().join(n).to_string_lossy().into_owned());
        // A tube along z of 5 × 5 mm, 26 mm long.
        let grid = Grid::new([9, 9, 30], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let is_lumen = |n: usize| [n % 9, n / 9 % 9].iter().all(|i| (2..7).contains(i)) && (2..28).contains(&(n / 81));
        let voxels: Vec<u8> = (0..grid.len()).map(|n| u8::from(is_lumen(n))).collect();
        io::save_mask(Path::new(&mask), &grid, &voxels, &Progress::new()).unwrap();
        let run_to = |out: &str| {
            let args = Program::default().parse(["colvis", "centerline", "--mask", &mask, "--out", out]).unwrap();
            let Some(Command::Centerline(centerline)) = args.command else { panic!("{:?}", args.command) };
            run(&centerline, &args.global, &Progress::new())
        };
        run_to(&out).unwrap();
        let line: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&out).unwrap()).unwrap();
        let length_mm = line["length_mm"].as_f64().unwrap();
        assert!((15.0..26.0).contains(&length_mm), "between the last balls in the tube: {length_mm} mm");
        let points: Vec<DVec3> = serde_json::from_value(line["points"].clone()).unwrap();
        assert!(points.iter().all(|p| (p.x - 4.0).abs() < 1.0 && (p.y - 4.0).abs() < 1.0), "{points:?}");
        let e = run_to(&unknown).unwrap_err();
        assert!(e.what.ends_with("line.txt") && !Path::new(&unknown).exists(), "{e}");
    }
}
