//! A custom shader colours every point of the wall, with single rays and with packets.

use std::sync::Arc;

use colvis::app::{FlightRequest, Scan};
use colvis::error::Result;
use colvis::phantom::{Phantom, PhantomSettings, Size};
use colvis::progress::Progress;
use colvis::render::shaders::headlight::{AMBIENT, DIFFUSE, tissue};
use colvis::render::{
    Frame, Options, PreparedVolume, Preset, Quality, Reuse, Settings, Shader, ShaderModel, SurfacePoint,
    TransferFunction, View, psnr, renderer,
};
use glam::Vec3;

/// A shader that wraps a function.
#[derive(Debug)]
struct By(fn(&SurfacePoint) -> Vec3);

impl Shader for By {
    fn colour(&self, point: &SurfacePoint) -> Vec3 {
        (self.0)(point)
    }
}

fn headlight(_: Options) -> Result<Arc<dyn Shader>> {
    Ok(Arc::new(By(|p| tissue(p.hu) * (AMBIENT + DIFFUSE * p.facing))))
}

fn nothing(_: Options) -> Result<Arc<dyn Shader>> {
    Ok(Arc::new(By(|_| Vec3::new(f32::NAN, f32::NEG_INFINITY, -1e-30))))
}

/// A shader of distance as a share of 100 mm: red from the distance, green from the position, blue from the normal.
fn distance(_: Options) -> Result<Arc<dyn Shader>> {
    Ok(Arc::new(By(|p| {
        let back = (p.position.as_vec3() / 100.0).length();
        Vec3::new(p.distance_mm / 100.0, back, (p.normal.dot(p.direction) + 1.0) * 0.5)
    })))
}

fn model(name: &'static str, make: fn(Options) -> Result<Arc<dyn Shader>>) -> ShaderModel {
    ShaderModel { name, summary: "", options: Options::NONE, make }
}

fn colon() -> (PreparedVolume, View) {
    let phantom = Phantom::new(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let volume = phantom.voxelise(&phantom.grid(), &Progress::new()).unwrap();
    let volume = PreparedVolume::new(Arc::new(volume), TransferFunction::default());
    let mut scan = Scan::prepared(volume.clone(), Arc::default());
    let plan = scan.plan(&FlightRequest::default(), 1.5).unwrap();
    let view = View::new(plan.start, plan.goal().at - plan.start, glam::DVec3::Z, 90.0, 160, 120).unwrap();
    (volume, view)
}

fn rendered(volume: &PreparedVolume, view: &View, preset: Preset, settings: Settings) -> Frame {
    let mut frame = Frame::with_depth(view.width(), view.height());
    renderer(volume, settings, preset, Reuse::Allowed).render(view, &mut frame);
    frame
}

#[test]
fn a_copy_of_the_headlight_shows_what_the_headlight_shows() {
    let (volume, view) = colon();
    for preset in colvis::render::presets::BUILT_IN {
        for quality in [Quality::High, Quality::Low, Quality::Reference] {
            for several in [1, 3] {
                let settings = Settings { samples_per_pixel: several, ..Settings::new(quality) };
                let own = Settings { shader: model("own", headlight), ..settings };
                let [a, b] = [settings, own].map(|s| rendered(&volume, &view, preset, s));
                let near = psnr(&a, &b);
                // Packets interpolate pixels between rays with the headlight, but never with a shader that they do not
                // know.
                let packets = preset.name == "default" && quality != Quality::Reference && several == 1;
                assert!(near > if packets { 42.0 } else { 60.0 }, "{} {quality:?} {several}: {near} dB", preset.name);
            }
        }
    }
}

#[test]
fn a_point_is_told_as_it_is() {
    let (volume, view) = colon();
    for preset in ["default", "colvis", "lean"].map(|name| Preset::named(name).unwrap()) {
        let settings = Settings { shader: model("distance", distance), ..Settings::new(Quality::High) };
        let frame = rendered(&volume, &view, preset, settings);
        let depth = frame.depth().unwrap();
        let (mut compared, mut off) = (0, 0);
        for (n, (pixel, &mm)) in frame.pixels().iter().zip(depth).enumerate() {
            // Rims and grazed walls mix several points.
            let flat = [n.wrapping_sub(1), n + 1].iter().all(|&m| depth.get(m).is_some_and(|d| (d - mm).abs() < 0.5));
            if !flat || !mm.is_finite() || mm > 60.0 {
                continue;
            }
            let ray = view.ray(n % 160, n / 160).unwrap();
            let place = ray.origin + ray.direction * f64::from(mm);
            let expected = [f64::from(mm) / 100.0, place.length() / 100.0].map(|c| (c * 255.0).min(255.0));
            // 2.4 mm: the width of the ramp where a ray grazes it.
            let far = |c: usize| (f64::from(pixel[c]) - expected[c]).abs() > 6.0;
            off += usize::from(far(0) || far(1));
            assert!(pixel[2] <= 130, "the normal points at the camera: {pixel:?}");
            compared += 1;
        }
        assert!(compared > 4000 && off * 50 < compared, "{}: {off} of {compared} are off", preset.name);
    }
}

#[test]
fn what_is_no_colour_is_black() {
    let (volume, view) = colon();
    for preset in colvis::render::presets::BUILT_IN {
        for quality in [Quality::High, Quality::Low, Quality::Reference] {
            let settings = Settings { shader: model("nothing", nothing), ..Settings::new(quality) };
            let frame = rendered(&volume, &view, preset, settings);
            assert!(frame.pixels().iter().all(|p| *p == [0; 3]), "{} {quality:?}", preset.name);
        }
    }
}

#[test]
fn a_shader_is_the_same_on_every_level_and_number_of_threads() {
    use colvis::render::Renderer;
    use colvis::render::internals::{PacketRenderer, Pixels, levels};
    let (volume, view) = colon();
    let settings = Settings { shader: model("distance", distance), ..Settings::new(Quality::High) };
    let mut all = Vec::new();
    for (_, level) in levels() {
        let mut frame = Frame::default();
        PacketRenderer::with_level(&volume, settings, Pixels::Needed, level).render(&view, &mut frame);
        all.push(frame);
    }
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        all.push(pool.install(|| rendered(&volume, &view, Preset::default(), settings)));
    }
    assert!(all.iter().all(|f| f.pixels() == all[0].pixels()));
}
