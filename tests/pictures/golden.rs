//! Golden pictures: every renderer and every camera of this crate, byte for byte, at every SIMD level and on one and two
//! threads.
//!
//! After an intended change, `COLVIS_REPLACE=1 cargo test --release --test pictures golden` rewrites
//! `tests/pictures/golden/*.png`. Look at the pictures before you commit them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use colvis::phantom::{Phantom, PhantomSettings, Size};
use colvis::progress::Progress;
use colvis::render::camera::{self, CameraModel};
use colvis::render::internals::{PacketRenderer, Pixels, levels};
use colvis::render::translucency::{Translucency, TranslucencySettings};
use colvis::render::wall_paint::{PaintedArea, Pictured};
use colvis::render::{
    Frame, Light, PreparedVolume, Preset, Quality, Renderer, Reuse, Settings, TransferFunction, View, presets, renderer,
};
use fearless_simd::Level;
use image::RgbImage;

use crate::support::embedded::embedded;
use crate::support::panels::panels;

const WIDTH: usize = 160;
const HEIGHT: usize = 120;

/// A view along a bend of the phantom, with a fold near and the lumen in the distance.
fn view(camera: CameraModel, fov_degrees: f64) -> View {
    let phantom = Phantom::new(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let at = phantom.axis().frame(phantom.axis().length() * 0.3);
    let up = at.normal;
    let aspect = camera.camera(fov_degrees, 1.0).unwrap().aspect();
    let width = aspect.map_or(WIDTH, |aspect| (aspect * HEIGHT as f64) as usize);
    View::with_model(at.at, at.tangent * 2.0 + up, at.binormal, camera, fov_degrees, width, HEIGHT).unwrap()
}

fn image(frame: &Frame) -> RgbImage {
    let (width, height) = (frame.width() as u32, frame.height() as u32);
    RgbImage::from_raw(width, height, frame.pixels().as_flattened().to_vec()).unwrap()
}

/// Compares pictures of one name with the stored one, or stores the first.
fn hold(name: &str, pictures: impl IntoIterator<Item = (String, Frame)>) {
    let path: PathBuf = Path::new("tests/pictures/golden").join(format!("{name}.png"));
    let mut pictures = pictures.into_iter().peekable();
    if std::env::var_os("COLVIS_REPLACE").is_some() {
        std::fs::create_dir_all("tests/pictures/golden").unwrap();
        image(&pictures.peek().unwrap().1).save(&path).unwrap();
    }
    let stored = image::open(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display())).into_rgb8();
    for (how, frame) in pictures {
        let got = image(&frame);
        assert!(got == stored, "{name} {how}: {}", panels(&format!("golden {name} {how}"), &stored, &got));
    }
}

/// Renders a view on one thread and on two.
fn on_threads(volume: &PreparedVolume, view: &View, preset: Preset, settings: Settings) -> Vec<(String, Frame)> {
    let render = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut frame = Frame::default();
        pool.install(|| renderer(volume, settings, preset, Reuse::Never).render(view, &mut frame));
        (format!("on {threads} threads"), frame)
    };
    [1, 2].map(render).to_vec()
}

/// Renders a view with packets at every SIMD level of this machine.
fn at_levels(volume: &PreparedVolume, view: &View, settings: Settings) -> Vec<(String, Frame)> {
    let render = |(name, level)| {
        let mut frame = Frame::default();
        PacketRenderer::with_level(volume, settings, Pixels::Needed, level).render(view, &mut frame);
        (format!("with {name}"), frame)
    };
    levels().into_iter().map(render).collect()
}

#[test]
fn every_preset_and_quality_makes_its_picture() {
    let (volume, view) = (embedded(), view(CameraModel::default(), 90.0));
    for preset in presets::BUILT_IN {
        for quality in [Quality::High, Quality::Low] {
            let name = format!("{}-{quality:?}", preset.name).to_lowercase();
            hold(&name, on_threads(&volume, &view, preset, Settings::new(quality)));
        }
    }
    hold("reference", on_threads(&volume, &view, Preset::default(), Settings::new(Quality::Reference)));
}

#[test]
fn every_level_and_light_makes_its_picture() {
    let (volume, view) = (embedded(), view(CameraModel::default(), 90.0));
    for (name, light) in [("headlight", Light::HEADLIGHT), ("endoscope", Light::ENDOSCOPE)] {
        let settings = Settings { light, ..Settings::default() };
        let mut all = on_threads(&volume, &view, Preset::default(), settings);
        all.extend(at_levels(&volume, &view, settings));
        hold(name, all);
    }
}

/// What lies behind the wall of a phantom with tag, on one, two and eight threads, at every SIMD level, in the whole picture and in a lens.
#[test]
fn what_lies_behind_the_wall_is_the_same_bytes_everywhere() {
    let settings =
        PhantomSettings { size: Size::Small, pools: true, films: true, stool: true, ..PhantomSettings::default() };
    let phantom = Phantom::new(&settings);
    let voxels = phantom.voxelise(&phantom.grid(), &Progress::new()).unwrap();
    let volume = PreparedVolume::new(Arc::new(voxels), TransferFunction::default());
    let at = phantom.axis().frame(phantom.axis().length() * 0.3);
    let view = View::new(at.at, at.tangent * 2.0 + at.normal, at.binormal, 90.0, WIDTH, HEIGHT).unwrap();
    let lens = PaintedArea::Lens { centre: [70.0, 60.0], radius: 40.0 };
    let paint = |level: Option<Level>, area: PaintedArea, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (mut frame, table) = (Frame::default(), TranslucencySettings::default());
        pool.install(|| {
            let mut renderer = PacketRenderer::new(&volume, Settings::default(), Pixels::Needed);
            renderer.render(&view, &mut frame);
            let of = Pictured { volume: &volume, scanned: None, view: &view, distances: renderer.distances() };
            let mut translucency = match level {
                Some(level) => Translucency::with_level(table, level),
                None => Translucency::new(table),
            };
            translucency.paint(of, area, &mut frame);
        });
        frame
    };
    for (name, area) in [("translucency", PaintedArea::Whole), ("translucency-lens", lens)] {
        let threads = [1, 2, 8].map(|n| (format!("on {n} threads"), paint(None, area, n)));
        let levels = levels().into_iter().map(|(level, simd)| (format!("with {level}"), paint(Some(simd), area, 2)));
        hold(name, threads.into_iter().chain(levels));
    }
}

#[test]
fn every_camera_makes_its_picture() {
    let volume = embedded();
    for camera in camera::BUILT_IN {
        let view = view(camera, camera.clamp_fov(110.0).unwrap_or(90.0));
        let mut all = on_threads(&volume, &view, Preset::default(), Settings::default());
        all.extend(at_levels(&volume, &view, Settings::default()));
        hold(&format!("camera-{}", camera.name), all);
    }
}
