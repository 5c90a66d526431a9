//! Tests cameras that no renderer knows: they must show what they should with every preset and quality, with the exact depth.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::model::AnyCamera;
use super::*;
use crate::checks::cases;
use crate::phantom::{Phantom, PhantomSettings as Colon, Size};
use crate::render::adaptive::{Adaptive, Budget, SAMPLES};
use crate::render::{
    Classification, Direct, Frame, Preset, Quality, Renderer, Reuse, Settings, presets, psnr, renderer,
};
use crate::shared::shared;
use crate::space::{PreparedVolume, TransferFunction, first_crossing};

/// An equidistant fisheye: the angle from the axis grows with the distance from the middle, and ends at the shorter side.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Fisheye {
    half_angle: f64,
    /// True if it reports how much directions turn.
    tells: bool,
}

impl Camera for Fisheye {
    fn ray(&self, at: DVec2) -> Option<CameraRay> {
        let angle = at.length() * self.half_angle;
        let direction = (at.normalize_or_zero() * angle.sin()).extend(angle.cos());
        (at.length() <= 1.0).then_some(CameraRay { origin: DVec3::ZERO, direction })
    }

    fn project(&self, place: DVec3) -> Option<DVec2> {
        let r = place.truncate().length().atan2(place.z) / self.half_angle;
        (r <= 1.0 + 1e-9).then_some(place.truncate().normalize_or_zero() * r)
    }

    fn origins(&self) -> Origins {
        Origins::One
    }

    fn most_turn(&self) -> Option<f64> {
        self.tells.then_some(self.half_angle)
    }
}

/// Parallel rays.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Orthographic {
    half_mm: f64,
}

impl Camera for Orthographic {
    fn ray(&self, at: DVec2) -> Option<CameraRay> {
        Some(CameraRay { origin: (at * self.half_mm).extend(0.0), direction: DVec3::Z })
    }

    fn project(&self, place: DVec3) -> Option<DVec2> {
        (place.z >= 0.0).then_some(place.truncate() / self.half_mm)
    }

    fn origins(&self) -> Origins {
        Origins::Many
    }
}

/// A pinhole that does not report that it is one.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Disguised(Perspective);

impl Camera for Disguised {
    fn ray(&self, at: DVec2) -> Option<CameraRay> {
        self.0.ray(at)
    }

    fn project(&self, place: DVec3) -> Option<DVec2> {
        self.0.project(place)
    }

    fn origins(&self) -> Origins {
        Origins::One
    }

    fn most_turn(&self) -> Option<f64> {
        self.0.most_turn()
    }
}

const FISHEYE: Fisheye = Fisheye { half_angle: FRAC_PI_2, tells: true };

fn cameras() -> [Arc<dyn Camera>; 4] {
    [
        Arc::new(FISHEYE),
        Arc::new(Fisheye { half_angle: 0.6 * PI, tells: false }),
        Arc::new(Orthographic { half_mm: 4.0 }),
        Arc::new(Perspective::new(100.0).unwrap()),
    ]
}

fn volume(preset: Preset) -> PreparedVolume {
    let volume = Arc::new(shared(&Colon::embedded(1)).1);
    match preset.preparation {
        crate::render::Preparation::Flags => PreparedVolume::new(volume, TransferFunction::default()),
        crate::render::Preparation::BricksOnly => PreparedVolume::lean(volume, TransferFunction::default()),
    }
}

/// On the colon's axis.
fn view(camera: &Arc<dyn Camera>, share: f64) -> View {
    let phantom = Phantom::new(&Colon { size: Size::Small, ..Colon::default() });
    let axis = phantom.axis();
    let lumen = axis.frame(axis.length() * share);
    View::with_camera(lumen.at, lumen.tangent, lumen.normal, Arc::clone(camera), 144, 128).unwrap()
}

#[test]
fn every_preset_shows_what_the_reference_does() {
    for preset in presets::BUILT_IN.into_iter().take(cases(usize::MAX, 1)) {
        let volume = volume(preset);
        // The paper's preset classifies by filtered density.
        let filtered = preset == presets::colvis::PRESET;
        let classification = if filtered { Classification::Filtered } else { Classification::Value };
        let reference = Settings { classification, ..Settings::new(Quality::Reference) };
        let (mut reference, mut exact) = (Direct::new(&volume, reference), Frame::default());
        for camera in cameras().into_iter().take(cases(usize::MAX, 2)) {
            let mut high = renderer(&volume, Settings::default(), preset, Reuse::Allowed);
            let mut low = renderer(&volume, Settings::new(Quality::Low), preset, Reuse::Allowed);
            // Twice from nearby positions, so that data kept from frame to frame is used.
            for share in [0.3, 0.301, 0.7] {
                let view = view(&camera, share);
                let (mut frame, mut coarse) = (Frame::with_depth(1, 1), Frame::default());
                high.render(&view, &mut frame);
                low.render(&view, &mut coarse);
                reference.render(&view, &mut exact);
                let (high, low) = (psnr(&frame, &exact), psnr(&coarse, &exact));
                println!("{}, {camera:?} at {share}: {high:.1} dB, low {low:.1} dB", preset.name);
                assert!(high >= 40.0 && low >= 20.0, "{}, {camera:?} at {share}: {high} {low}", preset.name);
                assert!(exact.pixels().iter().any(|p| p[0] > 60), "there is something to see");
                for (n, &depth) in frame.depth().unwrap().iter().enumerate() {
                    let crossing = view
                        .ray(n % 144, n / 144)
                        .and_then(|ray| first_crossing(&volume, ray.origin, ray.direction, f64::INFINITY));
                    assert_eq!(depth, crossing.map_or(f32::INFINITY, |mm| mm as f32));
                }
            }
        }
    }
}

#[test]
fn pictures_at_rest_come_to_the_reference() {
    let volume = volume(Preset::default());
    for camera in cameras().into_iter().take(cases(usize::MAX, 2)) {
        let settings = Settings { adaptive: true, ..Settings::default() };
        let mut adaptive = renderer(&volume, settings, Preset::default(), Reuse::Allowed);
        let (view, mut frame, mut exact) = (view(&camera, 0.5), Frame::default(), Frame::default());
        adaptive.set_budget(Budget::strict(u64::MAX));
        for _ in 0..4 {
            adaptive.render(&view, &mut frame);
        }
        assert!(adaptive.detail().unwrap().best, "{camera:?} is equal to itself");
        let settings = Settings { samples_per_pixel: SAMPLES, ..Adaptive::fine(Settings::default()).unwrap() };
        Direct::new(&volume, settings).render(&view, &mut exact);
        let db = psnr(&frame, &exact);
        println!("{camera:?}: {db:.1} dB");
        assert!(db >= 40.0, "{camera:?}: {db}");
    }
}

/// Whether packets set up directions at once or request each makes no visible difference.
#[test]
fn a_pinhole_is_a_pinhole_however_it_is_asked() {
    let volume = volume(Preset::default());
    let pinhole = Perspective::new(90.0).unwrap();
    let views: [View; 2] =
        [&(Arc::new(pinhole) as Arc<dyn Camera>), &(Arc::new(Disguised(pinhole)) as _)].map(|camera| view(camera, 0.4));
    let [plain, disguised] = views.each_ref().map(|view| {
        let mut frame = Frame::default();
        renderer(&volume, Settings::default(), Preset::default(), Reuse::Never).render(view, &mut frame);
        frame
    });
    let db = psnr(&plain, &disguised);
    assert!(db > 50.0, "{db}");
}

#[test]
fn a_point_is_seen_at_the_pixel_whose_ray_goes_through_it() {
    let disguised: Arc<dyn Camera> = Arc::new(Disguised(Perspective::new(60.0).unwrap()));
    for camera in cameras().into_iter().chain([disguised]) {
        let whole = view(&camera, 0.2);
        for view in [whole.clone(), whole.resized(72, 64), whole.strip(40..90, [0.25, -0.5])] {
            let mut shown = 0;
            for n in 0..view.width() * view.height() {
                let at = [(n % view.width()) as f64 + 0.3, (n / view.width()) as f64 + 0.8];
                let Some(ray) = view.ray_at(at[0], at[1]) else { continue };
                shown += 1;
                assert!((ray.direction.length() - 1.0).abs() < 1e-12);
                let [x, y] = view.project(ray.origin + ray.direction * 37.0).unwrap();
                assert!((x - at[0]).abs() < 1e-6 && (y - at[1]).abs() < 1e-6, "{camera:?}: {at:?} {x} {y}");
            }
            assert!(shown > view.width() * view.height() / 2);
        }
    }
}

#[test]
fn models_are_found_by_their_names_and_know_their_limits() {
    assert_eq!(CameraModel::named("perspective"), Some(CameraModel::default()));
    assert_eq!(CameraModel::named("keyhole"), None);
    assert!(CameraModel::default().camera(90.0, 1.5).unwrap().tangent().is_some_and(|t| (t - 1.0).abs() < 1e-12));
    assert!(CameraModel::default().camera(180.0, 1.0).is_err());
    let [a, b, ..] = cameras();
    assert!(a.is_same(&FISHEYE) && !b.is_same(&FISHEYE) && !FISHEYE.is_same(&Orthographic { half_mm: 4.0 }));
}

#[test]
fn a_view_angle_is_held_to_what_a_model_can_show() {
    let flat = CameraModel::default();
    for (asked, clamp_fov) in [(60.0, 60.0), (170.0, 170.0), (175.0, 170.0), (1e9, 170.0), (0.0, 1.0), (-5.0, 1.0)] {
        assert_eq!(flat.clamp_fov(asked), Some(clamp_fov), "{asked}");
    }
    assert_eq!((flat.clamp_fov(f64::NAN), flat.clamp_fov(f64::INFINITY)), (None, None));
    let round = CameraModel {
        name: "round",
        summary: "",
        options: crate::render::Options::NONE,
        make: |degrees, _, _| match degrees {
            d if d <= 220.0 => Ok(Arc::new(Fisheye { half_angle: 0.5 * d.to_radians(), tells: true })),
            d => Err(crate::error::Error::usage("view angle", format!("{d}°"), "give 220° at the most")),
        },
    };
    assert_eq!([219.5, 220.4, 1e3].map(|d| round.clamp_fov(d)), [Some(219.5), Some(220.0), Some(220.0)]);
}
