//! `colvis render`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::app::boxed::boxed;
use crate::app::coats::{COAT, find};
use crate::app::overlays::translucency;
use crate::app::{Scan, Scene};
use crate::cli::args::{Global, ImageSize, QualityName, RenderArgs, WallOverlay};
use crate::cli::messages::say;
use crate::cli::{Program, intrinsics, prepare};
use crate::components::translucent::Translucent;
use crate::error::{Error, Kind, Result};
use crate::host::frames::FrameStats;
use crate::host::terminal::Bar;
use crate::output;
use crate::panics;
use crate::progress::Progress;
use crate::render::translucency::TranslucencySettings;
use crate::render::wall_paint::{Pictured, SpotPaint};
use crate::render::{Camera, CameraModel, Frame, Preset, Reuse, View, depths, normals, renderer};
use crate::volume::Volume;

/// A list of poses for `--poses`. Unknown fields are ignored, and so is the view angle if there is a camera.
#[derive(Default, Deserialize)]
pub(super) struct Poses {
    pub(super) fov_degrees: Option<f64>,
    pub(super) camera: Option<Value>,
    pub(super) poses: Vec<Pose>,
}

#[derive(Deserialize)]
pub(super) struct Pose {
    pub(super) position: [f64; 3],
    pub(super) forward: [f64; 3],
    pub(super) up: [f64; 3],
}

/// Runs the command. Fails with status 2 for invalid options, 3 for an unusable input, 4 if interrupted, 5 if an output cannot be
/// written.
pub(crate) fn run(program: &Program, args: &RenderArgs, global: &Global, progress: &Arc<Progress>) -> Result<()> {
    if args.no_reuse && args.quality == Some(QualityName::Adaptive) {
        let why = "with --quality adaptive each image builds on the one before";
        return Err(Error::usage("--no-reuse", why, "leave one of them out"));
    }
    if args.scene.is_some() && args.overlay.is_none() {
        return Err(Error::usage("--scene", "has the settings of an overlay", "add --overlay, or leave it out"));
    }
    let stats: Vec<&Path> = args.stats.iter().map(PathBuf::as_path).collect();
    let preset = prepare::preset(program, args.preset.as_deref(), Preset::default())?;
    let mut settings = prepare::quality(args.quality);
    settings.samples_per_pixel = args.samples.unwrap_or(1).min(4096) as u32;
    let (poses, model) = read(program, global, &args.poses)?;
    let size = args.size.map_or_else(|| prepare::usual_size(model), Ok)?;
    let (camera, name) = camera(global, &poses, model, (&args.poses, size))?;
    let views: Vec<View> = poses
        .poses
        .iter()
        .enumerate()
        .map(|(n, p)| {
            let [position, forward, up] = [p.position, p.forward, p.up].map(DVec3::from_array);
            View::with_camera(position, forward, up, Arc::clone(&camera), size.width, size.height).map_err(|e| match e
                .kind
            {
                // A size that the camera does not have is no fault of the file.
                Kind::Usage if e.what != "image size" => {
                    Error::file(&args.poses, format!("pose {n}: {}: {}", e.what, e.why), e.hint)
                }
                _ => e,
            })
        })
        .collect::<Result<_>>()?;
    output::make_folder(&args.out)?;
    output::check_folders(&stats)?;
    let translucency = translucency(program, args)?;
    let has_coats = args.overlay == Some(WallOverlay::Coats);
    let bar = Bar::show(progress);
    let mut scan = prepare::open(Some(&args.input), global, preset, progress)?;
    let mut translucent = match translucency {
        Some(settings) => Some(Translucent::new(settings, as_scanned(&mut scan)?)),
        None => None,
    };
    let mut coats = if has_coats { Some(coats(&mut scan, progress)?) } else { None };
    let mut timings = scan.timings().clone();
    let reuse = if args.no_reuse { Reuse::Never } else { Reuse::Allowed };
    let make = || {
        panics::ask_plugin(
            || format!("preset {}", preset.name),
            || Ok(renderer(scan.volume(), settings, preset, reuse)),
        )
    };
    let mut renderer = timings.time("renderer_s", make)?;
    let mut frame = Frame::new(size.width, size.height);
    let mut depth = vec![0.0; if args.depth { size.width * size.height } else { 0 }];
    let mut normal = vec![[0.0; 3]; if args.normals { size.width * size.height } else { 0 }];
    let mut frames = Vec::with_capacity(views.len());
    progress.stage("rendering", views.len() as u64);
    let mut complaints = BTreeSet::new();
    let mut one = |n: usize, view: &View| {
        let begun = Instant::now();
        if args.depth {
            let measure = || depths(scan.volume(), view, &mut depth, progress);
            panics::ask_plugin(|| format!("camera {name}"), measure)?;
        }
        if args.normals {
            let measure = || normals(scan.volume(), view, &mut normal, progress);
            panics::ask_plugin(|| format!("camera {name}"), measure)?;
        }
        let work = panics::catch(|| renderer.render(view, &mut frame)).map_err(|why| {
            let what = format!("preset {}", preset.name);
            Error::fault(what, format!("panicked at pose {n}: {why}"), "fix it, or choose another preset")
        })?;
        if let Some(translucent) = &mut translucent {
            translucent.paint(scan.volume(), view, renderer.distances(), &mut frame);
        }
        if let Some(coats) = &mut coats {
            let of = Pictured { volume: scan.volume(), scanned: None, view, distances: renderer.distances() };
            coats.paint(of, &mut frame);
        }
        if let Some((who, what)) = renderer.complaint().filter(|c| complaints.insert(c.clone())) {
            say(&format!("{who} {what}"));
        }
        progress.check()?;
        let ms = begun.elapsed().as_secs_f64() * 1e3;
        frames.push(FrameStats { ms, rays: work.rays, samples: work.samples, reused: work.reused });
        frame.write_png(args.out.join(format!("{n:04}.png")))?;
        if args.depth {
            // mm, row 0 on top.
            output::write_npy(&args.out.join(format!("{n:04}.npy")), &depth, &[size.height, size.width])?;
        }
        if args.normals {
            let path = args.out.join(format!("{n:04}.normals.npy"));
            output::write_npy(&path, normal.as_flattened(), &[size.height, size.width, 3])?;
        }
        progress.advance(1)
    };
    // If interrupted, it reports the frames so far.
    let rendered = views.iter().enumerate().try_for_each(|(n, view)| one(n, view));
    drop(bar);
    let reported = args.stats.as_ref().map_or(Ok(()), |path| {
        let mut m = prepare::stats_head(&timings);
        m.insert("frames".to_owned(), json!(frames));
        output::write_json(path, &m)
    });
    rendered.and(reported)
}

/// Returns the settings of the overlay, if it is asked for. Fails with status 2 if a setting is invalid.
fn translucency(program: &Program, args: &RenderArgs) -> Result<Option<TranslucencySettings>> {
    if args.overlay != Some(WallOverlay::Translucency) {
        return Ok(None);
    }
    let overlay = match &args.scene {
        Some(file) => Scene::read(file, &program.catalog)?.options.overlay(translucency::OVERLAY),
        None => translucency::OVERLAY,
    };
    TranslucencySettings::read(overlay.options).map(Some)
}

/// Returns the scan as scanned, or of a cleansed one the part around the colon.
fn as_scanned(scan: &mut Scan) -> Result<Arc<Volume>> {
    if !scan.is_cleansed() {
        return Ok(scan.volume().shared_voxels());
    }
    let (cleansed, lumen) = (scan.cleanse()?, scan.lumen()?);
    Ok(Arc::new(boxed(scan.volume().voxels(), &lumen, &cleansed.changes)))
}

/// Returns the paint of coated spots.
fn coats(scan: &mut Scan, progress: &Progress) -> Result<SpotPaint> {
    let lumen = scan.lumen()?;
    let cleansed = if scan.is_cleansed() { Some(scan.cleanse()?) } else { None };
    let found = find(scan.volume(), &lumen, cleansed.as_deref(), &[], progress)?;
    Ok(SpotPaint::new(found.places, COAT))
}

/// Returns the camera of the command line or of the poses' file, and its name. Fails with status 2 for one that there is not, and if both
/// name one.
pub(super) fn camera(
    global: &Global,
    poses: &Poses,
    model: CameraModel,
    (path, size): (&Path, ImageSize),
) -> Result<(Arc<dyn Camera>, String)> {
    let Some(value) = poses.camera.as_ref().filter(|v| !v.is_string()) else {
        let fov = match global.fov {
            Some(_) => prepare::fov(global, model)?,
            None => poses.fov_degrees.unwrap_or(90.0),
        };
        return Ok((model.camera(fov, size.width as f64 / size.height as f64)?, model.name.to_owned()));
    };
    for (option, given) in [("--camera", global.camera.is_some()), ("--fov", global.fov.is_some())] {
        if given {
            let why = format!("{} holds a camera", path.display());
            return Err(Error::usage(option, why, "leave the option out, or the file's camera"));
        }
    }
    Ok((intrinsics::camera(path, value, size)?, format!("in {}", path.display())))
}

/// Reads the poses, and returns the model that they or the command line name.
pub(super) fn read(program: &Program, global: &Global, path: &Path) -> Result<(Poses, CameraModel)> {
    let hint = r#"give {"fov_degrees": 90, "poses": [{"position": […], "forward": […], "up": […]}, …]}"#;
    let text = output::read_text(path, hint)?;
    let poses: Poses = serde_json::from_str(&text).map_err(|e| Error::file(path, e.to_string(), hint).caused_by(e))?;
    let named = poses.camera.as_ref().and_then(Value::as_str).filter(|_| global.camera.is_none());
    let camera = match named {
        Some(name) => program.catalog.find_camera(name).map_err(|e| {
            Error::usage(format!("camera in {}", path.display()), format!("{}: {}", e.what, e.why), e.hint)
        })?,
        None => prepare::camera(program, global, CameraModel::default())?,
    };
    if let Some(fov) = poses.fov_degrees.filter(|_| poses.camera.as_ref().is_none_or(Value::is_string)) {
        camera.camera(fov, 1.0).map_err(|e| match e.kind {
            Kind::Usage => Error::file(path, format!("fov_degrees: {}", e.why), hint),
            _ => e,
        })?;
    }
    Ok((poses, camera))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::args::Command;
    use crate::testing::Room;
    use crate::volume::io;

    #[test]
    fn pictures_depths_and_times_are_written_for_every_pose() {
        let dir = tempfile::tempdir().unwrap();
        let [scan, poses, out, stats] =
            ["room.nii", "poses.json", "out", "stats.json"].map(|n| dir.path().join(n).to_string_lossy().into_owned());
        let room = Room::new([20, 40, 20]);
        io::save(Path::new(&scan), room.scan().voxels(), &Progress::new()).unwrap();
        let pose = |y: f64| json!({"position": [10.0, y, 10.0], "forward": [0.0, 1.0, 0.0], "up": [0.0, 0.0, 1.0]});
        output::write_json(Path::new(&poses), &json!({"poses": [pose(20.0), pose(30.0)]})).unwrap();
        let line = [
            "colvis", "render", &scan, "--poses", &poses, "--out", &out, "--size", "9x5", "--depth", "--stats", &stats,
        ];
        let program = Program::default();
        let args = program.parse(line).unwrap();
        let Some(Command::Render(render)) = args.command else { panic!("{:?}", args.command) };
        let begun = Instant::now();
        run(&program, &render, &args.global, &Arc::new(Progress::new())).unwrap();
        let took_ms = begun.elapsed().as_secs_f64() * 1e3;
        for (name, to_the_wall) in [("0000", 20.0), ("0001", 10.0)] {
            let picture = image::open(dir.path().join(format!("out/{name}.png"))).unwrap();
            assert_eq!((picture.width(), picture.height()), (9, 5));
            let npy = std::fs::read(dir.path().join(format!("out/{name}.npy"))).unwrap();
            let (head, values) = npy.split_at(npy.len() - 9 * 5 * 4);
            assert!(String::from_utf8_lossy(head).contains("(5, 9)"));
            let depth = f32::from_le_bytes(values[4 * (2 * 9 + 4)..][..4].try_into().unwrap());
            assert!((depth - to_the_wall).abs() < 0.5, "{depth} mm in the middle");
        }
        let stats: Value = serde_json::from_str(&std::fs::read_to_string(&stats).unwrap()).unwrap();
        let frames = stats["frames"].as_array().unwrap();
        let ms: Vec<f64> = frames.iter().map(|f| f["ms"].as_f64().unwrap()).collect();
        assert!(
            ms.len() == 2 && ms.iter().all(|ms| *ms > 0.0) && ms.iter().sum::<f64>() < took_ms,
            "{ms:?} in {took_ms} ms"
        );
    }
}
