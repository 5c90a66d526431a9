//! `colvis dataset`.

mod labels;
mod lens;
mod look;
mod takes;

use std::path::Path;
use std::sync::Arc;

use serde_json::json;

use crate::app::Scan;
use crate::cli::args::{DatasetArgs, Global, Pair, Point, Triple};
use crate::cli::messages::say;
use crate::cli::values::SeedRange;
use crate::cli::{Program, prepare};
use crate::dataset::layout::{BUILT_IN, LayoutModel};
use crate::dataset::look::Look;
use crate::dataset::truth::{Find, Kind, Rings};
use crate::dataset::writing::{Source, Written, write};
use crate::error::{Error, Kind as Status, Result, program_name};
use crate::fields::lumen::Interior;
use crate::host::terminal::Bar;
use crate::output;
use crate::phantom::{Phantom, PhantomSettings};
use crate::progress::Progress;
use crate::render::Preset;
use crate::surface::LumenMesh;
use crate::volume::content_hash;
use labels::{labels, names, number};
use takes::Takes;

/// Runs the command. Fails with status 2 for invalid options, 3 for an unusable input, 4 if there is no flight or if interrupted, 5 if a
/// file cannot be written.
pub(crate) fn run(program: &Program, args: &DatasetArgs, global: &Global, progress: &Arc<Progress>) -> Result<()> {
    let (kinds, layout) = (kinds(args), layout(&args.layout)?);
    takes::check(args)?;
    // A camera without a place in the layout is told before a scan is read.
    layout.layout(&lens::intrinsics(program, args, global)?)?;
    let look = look::of(args)?;
    let bar = Bar::show(progress);
    let jobs: Vec<(Option<u64>, std::path::PathBuf)> = match args.phantoms {
        None => vec![(None, args.out.clone())],
        Some(SeedRange { first, last }) => {
            (first..=last).map(|seed| (Some(seed), args.out.join(format!("phantom-{seed:04}")))).collect()
        }
    };
    if args.phantoms.is_some() {
        output::make_folder(&args.out)?;
    }
    let mut all = Vec::new();
    for (seed, folder) in jobs {
        all.push((folder.clone(), one(program, (args, global), (seed, &folder), (&kinds, layout, &look), progress)?));
    }
    drop(bar);
    for (folder, written) in &all {
        say(&told(folder, written));
    }
    args.stats.as_ref().map_or(Ok(()), |path| output::write_json(path, &stats(&all)))
}

/// Writes one dataset: of the scan of the arguments, or of a phantom.
fn one(
    program: &Program,
    (args, global): (&DatasetArgs, &Global),
    (seed, folder): (Option<u64>, &Path),
    (kinds, model, look): (&[Kind], LayoutModel, &Look),
    progress: &Arc<Progress>,
) -> Result<Written> {
    let global = &Global { seed: seed.or(global.seed), ..global.clone() };
    let mut scan = prepare::open(args.input.as_deref(), global, Preset::default(), progress)?;
    let takes = Takes::new(program, (args, global), &mut scan, progress)?;
    let layout = model.layout(&takes.camera)?;
    let phantom = args.input.is_none().then(|| Phantom::new(&PhantomSettings::embedded(global.seed.unwrap_or(1))));
    let has_place = kinds.iter().any(|k| matches!(k, Kind::Along | Kind::Labels));
    // Without a line there are no places in the colon: the pictures have the rest of the truth all the same.
    let along = if has_place { along(&mut scan, progress)? } else { None };
    let wall = along.as_ref().map(|_| wall(&mut scan, progress)).transpose()?;
    let find = |place| number(phantom.as_ref().and_then(|p| p.wall_kind(place)));
    let find: Option<Find<'_>> = if phantom.is_some() { Some(&find) } else { None };
    let labels = labels(scan.volume(), find, along.as_deref());
    let count = takes.poses.len();
    let source = Source {
        volume: scan.volume(),
        deformation: takes.deformation,
        views: &|n| takes.view(n),
        count,
        fps: takes.fps,
        camera: takes.camera.clone(),
        rings: along.as_ref().and_then(|a| Rings::new(a, scan.volume().voxels().grid())),
        wall,
        labels: Some(&labels),
        names: names(phantom.as_ref(), along.as_deref()),
        kinds: kinds.to_vec(),
        look: look.clone(),
        seed: args.noise_seed.or(global.seed).unwrap_or(1),
        told: json!({
            "version": env!("CARGO_PKG_VERSION"),
            "command": command(args, global, seed),
            "scan": args.input.as_deref().map_or_else(
                || format!("the phantom of seed {}", global.seed.unwrap_or(1)),
                |path| format!("{} ({})", name(path), content_hash(scan.volume().voxels())),
            ),
            "content": content_hash(scan.volume().voxels()),
            "layout": model.name,
            "licence": if args.input.is_none() {
                "The phantom is synthetic; its files are free of rights (CC0 1.0)."
            } else {
                "The licence is that of the scan."
            },
            "poses": takes.hash(),
        }),
    };
    write(&source, &*layout, folder, progress)
}

/// Returns the measure along the colon; `None` if there is no colon.
pub(super) fn along(scan: &mut Scan, progress: &Progress) -> Result<Option<Arc<crate::fields::Along>>> {
    let lumen = match scan.lumen() {
        Ok(lumen) => lumen,
        Err(e) if e.kind == Status::Incomplete => {
            progress.check()?;
            say(&format!("{}: {}; there are no places along the colon", e.what, e.why));
            return Ok(None);
        }
        Err(e) => return Err(e),
    };
    lumen.along(scan.volume().voxels(), progress).map(Some)
}

/// Returns the wall of the colon as a mesh.
fn wall(scan: &mut Scan, progress: &Progress) -> Result<LumenMesh> {
    let lumen = scan.lumen()?;
    let iso = scan.volume().transfer().iso();
    let interior = Interior::of_lumen(scan.volume().voxels(), &lumen, iso, progress)?;
    Ok(LumenMesh::new(&interior, progress)?.without_islands().0)
}

fn kinds(args: &DatasetArgs) -> Vec<Kind> {
    if args.truth.is_empty() {
        return Kind::ALL.to_vec();
    }
    Kind::ALL.into_iter().filter(|k| args.truth.iter().any(|name| name == k.name())).collect()
}

fn layout(name: &str) -> Result<LayoutModel> {
    let all = BUILT_IN.map(|l| l.name).join(", ");
    LayoutModel::named(name)
        .ok_or_else(|| Error::usage("--layout", format!("{name:?} is no layout"), format!("give one of {all}")))
}

/// Returns the command without the names of folders, which do not change the bytes.
fn command(args: &DatasetArgs, global: &Global, seed: Option<u64>) -> String {
    let mut line = vec![program_name().to_string(), "dataset".to_owned()];
    line.extend(args.input.as_deref().map(name));
    line.extend(seed.map(|seed| format!("--phantoms {seed}..{seed}")));
    line.extend(global.seed.filter(|_| seed.is_none()).map(|seed| format!("--seed {seed}")));
    line.push(format!("--layout {}", args.layout));
    line.extend(args.path.as_ref().map(|p| format!("--path {p}")));
    line.extend(args.deform.map(|mm| format!("--deform {mm}")));
    line.extend(args.poses.as_deref().map(|p| format!("--poses {}", name(p))));
    line.extend(args.play.as_deref().map(|p| format!("--play {}", name(p))));
    line.extend(args.replay.as_deref().map(|p| format!("--replay {}", name(p))));
    line.extend(args.guide.as_ref().map(|g| format!("--guide {g}")));
    line.extend(args.from.map(|p| format!("--from {}", point(p))));
    line.extend(args.to.map(|p| format!("--to {}", point(p))));
    line.extend(args.reverse.then(|| "--reverse".to_owned()));
    line.extend(args.rate.map(|r| format!("--rate {r}")));
    line.extend(args.scene.as_deref().map(|p| format!("--scene {}", name(p))));
    line.extend(args.seconds.map(|s| format!("--seconds {s}")));
    line.extend(args.fps.map(|f| format!("--fps {f}")));
    line.extend(args.size.map(|s| format!("--size {s}")));
    line.extend(global.camera.as_ref().map(|c| format!("--camera {c}")));
    line.extend(global.fov.map(|f| format!("--fov {f}")));
    line.extend(global.wall.map(|Pair(a, b)| format!("--wall {a},{b}")));
    line.extend(global.hu.map(|Pair(a, b)| format!("--hu {a},{b}")));
    line.extend(global.spacing.map(|Triple(s)| format!("--spacing {},{},{}", s.x, s.y, s.z)));
    line.extend(global.cleanse.then(|| "--cleanse".to_owned()));
    line.extend((!args.truth.is_empty()).then(|| format!("--truth {}", args.truth.join(","))));
    line.extend(look::options(args));
    line.push("--out DIR/".to_owned());
    line.join(" ")
}

/// Returns an end of a flight as it is given.
fn point(point: Point) -> String {
    match point {
        Point::Rectum => "rectum".to_owned(),
        Point::Cecum => "cecum".to_owned(),
        Point::World(p) => format!("{},{},{}", p.x, p.y, p.z),
    }
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

fn told(folder: &Path, written: &Written) -> String {
    let folder = folder.display();
    match (written.measured, written.frames) {
        (0, all) => format!("{folder} has all its {all} frames"),
        (new, all) if new < all => format!("{folder}: {new} frames added to {} that were there", all - new),
        (new, _) => {
            format!("{folder}: {new} frames, {:.1} a second", new as f64 / written.whole.as_secs_f64().max(1e-9))
        }
    }
}

fn stats(all: &[(std::path::PathBuf, Written)]) -> serde_json::Value {
    let sets = all.iter().map(|(folder, w)| {
        let ms = |time: std::time::Duration| 1e3 * time.as_secs_f64() / w.measured.max(1) as f64;
        json!({
            "folder": folder.display().to_string(), "frames": w.frames, "measured": w.measured,
            "ms_a_frame": {
                "crossings": ms(w.truth.crossings), "flow": ms(w.truth.flow), "anatomy": ms(w.truth.anatomy), "look": ms(w.look),
                "files": ms(w.files), "whole": ms(w.whole),
            },
        })
    });
    json!({"threads": rayon::current_num_threads(), "peak_rss_bytes": crate::memory::resident_bytes("VmHWM").unwrap_or(0), "datasets": sets.collect::<Vec<_>>()})
}
