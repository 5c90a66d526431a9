//! A custom shader colours every point of the wall, with single rays and with packets.

use std::sync::Arc;

use colvis::app::{FlightRequest, Scan};
use colvis::error::Result;
use colvis::phantom::{Phantom, PhantomSettings, Size};
use colvis::progress::Progress;
use colvis::render::internals::{PacketRenderer, Pixels, levels};
use colvis::render::shaders::headlight::{AMBIENT, DIFFUSE, tissue};
use colvis::render::{
    Frame, Options, PreparedVolume, Preset, Quality, Renderer, Reuse, Settings, Shader, ShaderModel, SurfacePoint,
    TransferFunction, View, psnr, renderer,
};
use glam::Vec3;

/// A shader that wraps a function, and calls itself smooth or not.
#[derive(Debug)]
struct By<const SMOOTH: bool = false>(fn(&SurfacePoint) -> Vec3);

impl<const SMOOTH: bool> Shader for By<SMOOTH> {
    fn colour(&self, point: &SurfacePoint) -> Vec3 {
        (self.0)(point)
    }

    fn is_smooth(&self) -> bool {
        SMOOTH
    }
}

fn lit(p: &SurfacePoint) -> Vec3 {
    tissue(p.hu) * (AMBIENT + DIFFUSE * p.facing)
}

fn headlight(_: Options) -> Result<Arc<dyn Shader>> {
    Ok(Arc::new(By::<false>(lit)))
}

fn smooth_headlight(_: Options) -> Result<Arc<dyn Shader>> {
    Ok(Arc::new(By::<true>(lit)))
}

/// Light that falls off with distance, a gloss, and bands of colour across the colon that no headlight shows.
fn lamp(p: &SurfacePoint) -> Vec3 {
    let light = 1.0 / (1.0 + (p.distance_mm / 40.0).powi(2));
    let band = |mm: f64| 0.5 + 0.5 * (mm as f32 / 1.5).sin();
    let bands = Vec3::new(1.0, band(p.position.z), band(p.position.x));
    (tissue(p.hu) * p.facing * bands + 0.4 * p.facing.powi(40)) * light
}

fn own_lamp(_: Options) -> Result<Arc<dyn Shader>> {
    Ok(Arc::new(By::<false>(lamp)))
}

fn smooth_lamp(_: Options) -> Result<Arc<dyn Shader>> {
    Ok(Arc::new(By::<true>(lamp)))
}

fn nothing(_: Options) -> Result<Arc<dyn Shader>> {
    Ok(Arc::new(By::<false>(|_| Vec3::new(f32::NAN, f32::NEG_INFINITY, -1e-30))))
}

/// A shader of distance as a share of 100 mm: red from the distance, green from the position, blue from the normal.
fn distance(_: Options) -> Result<Arc<dyn Shader>> {
    Ok(Arc::new(By::<false>(|p| {
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
#[ignore = "slow: every preset and quality"]
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

/// Rays and pixels of a view with a shader, by the default renderer.
fn by_packets(volume: &PreparedVolume, view: &View, shader: ShaderModel, pixels: Pixels) -> (Frame, u64) {
    let settings = Settings { shader, ..Settings::new(Quality::High) };
    let mut frame = Frame::default();
    let work = PacketRenderer::new(volume, settings, pixels).render(view, &mut frame);
    (frame, work.rays)
}

#[test]
fn a_smooth_copy_of_the_headlight_makes_its_picture_with_its_rays() {
    let (volume, view) = colon();
    let (built_in, rays) = by_packets(&volume, &view, ShaderModel::default(), Pixels::Needed);
    let (own, own_rays) = by_packets(&volume, &view, model("own", smooth_headlight), Pixels::Needed);
    assert_eq!(own_rays, rays, "the same blocks are interpolated");
    let off = |(a, b): (&u8, &u8)| a.abs_diff(*b);
    let differences: Vec<u8> =
        own.pixels().as_flattened().iter().zip(built_in.pixels().as_flattened()).map(off).collect();
    let rounded = differences.iter().filter(|d| **d > 0).count();
    println!("{rounded} of {} values are rounded differently", differences.len());
    assert!(differences.iter().all(|d| *d <= 1) && rounded * 50 < differences.len(), "{rounded}");
    // One that does not call itself smooth gets a ray for every pixel, as before.
    let every = u64::from(160u16) * 120;
    let not_smooth = by_packets(&volume, &view, model("own", headlight), Pixels::Needed);
    assert_eq!(not_smooth, by_packets(&volume, &view, model("own", headlight), Pixels::All));
    assert!(not_smooth.1 == every && rays * 4 < every * 3, "{rays}");
}

#[test]
fn a_smooth_shader_is_as_close_to_the_reference_as_the_headlight() {
    let (volume, view) = colon();
    let view = View::new(view.position(), view.forward(), view.up(), 90.0, 320, 240).unwrap();
    let closeness = |shader: ShaderModel| {
        let settings = Settings { shader, ..Settings::new(Quality::Reference) };
        let reference = rendered(&volume, &view, Preset::default(), settings);
        let (frame, rays) = by_packets(&volume, &view, shader, Pixels::Needed);
        (psnr(&frame, &reference), rays)
    };
    let (built_in, rays) = closeness(ShaderModel::default());
    let (every, all) = closeness(model("lamp", own_lamp));
    let (smooth, fewer) = closeness(model("lamp", smooth_lamp));
    println!("headlight {built_in:.1} dB, {rays} rays; lamp {every:.1} dB, {all}; smooth lamp {smooth:.1} dB, {fewer}");
    assert!(smooth > 40.0 && smooth > every - 3.0, "{smooth} dB, {every} dB with a ray for every pixel");
    assert!(rays <= fewer && fewer * 4 < all * 3, "{rays} {fewer} {all}");
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
    let (volume, view) = colon();
    for shader in [model("distance", distance), model("lamp", smooth_lamp)] {
        let settings = Settings { shader, ..Settings::new(Quality::High) };
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
        assert!(all.iter().all(|f| f.pixels() == all[0].pixels()), "{}", shader.name);
    }
}
