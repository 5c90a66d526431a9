//! Traces the images of all views.

use std::time::Instant;

use bevy_ecs::prelude::*;

use crate::components::camera::Pose;
use crate::components::output::{Follows, FrameCache, Picture};
use crate::components::scan::Scan;
use crate::error::{Kind, Result};
use crate::panics;
use crate::render::awake::awake;
use crate::render::{CameraModel, Options, Preset, ShaderModel, View, camera, presets, shaders};
use crate::schedule::{App, FlightSystems, Main, Phase, Slot, book_time, note, report_fault};
use crate::space::PreparedVolume;

/// Adds the ray caster to the renderer slot.
///
/// # Errors
/// Returns status 2 if the slot is already filled.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Renderer, "ray caster")?;
    app.add_systems(FlightSystems::RayCast, cast_pictures);
    Ok(())
}

/// Restores the size of pictures after post-processes, for scenes that have any.
///
/// # Errors
/// Returns status 2 if the slot is already filled.
pub fn keep_sizes_plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::PictureSize, "picture sizes")?;
    let between = keep_sizes.after(FlightSystems::PostProcess).before(FlightSystems::Present);
    app.add_systems_to(Phase::Frame, between);
    Ok(())
}

/// Restores each picture to the size that it was traced in.
pub fn keep_sizes(mut pictures: Query<&mut Picture>) {
    pictures.iter_mut().for_each(|mut picture| picture.keep_size());
}

/// The components of a view.
type Views<'w, 's> =
    Query<'w, 's, (&'static mut Picture, &'static mut FrameCache, Option<&'static Pose>, Option<&'static Follows>)>;

/// Renders every view that is due, in the order of the entities: the camera's first, then the others in the order in
/// which they were spawned.
///
/// A view without a pose, or with an entity that is not a scan, keeps its image.
pub fn cast_pictures(
    main: Query<Entity, With<Main>>,
    scans: Query<&Scan>,
    poses: Query<&Pose>,
    all: Query<Entity, With<Picture>>,
    mut views: Views,
    mut order: Local<Vec<Entity>>,
) {
    order.clear();
    order.extend(&all);
    order.sort_unstable_by_key(|e| e.index_u32());
    for &entity in &order {
        let Ok((mut picture, mut cache, own, follows)) = views.get_mut(entity) else { continue };
        let due = std::mem::take(&mut picture.due);
        (picture.traced, picture.resized) = (false, false);
        let followed = || poses.get(follows?.whom.or_else(|| main.iter().find(|&e| poses.contains(e)))?).ok();
        let pose = match follows {
            Some(follows) => followed().map(|p| follows.pose(p)),
            None => own.copied(),
        };
        let scan = picture.scan.or_else(|| main.iter().find(|&e| scans.contains(e)));
        let (Some(pose), Some(scan)) = (pose, scan.and_then(|e| scans.get(e).ok())) else { continue };
        let picture = &mut *picture;
        let (width, height) = (picture.frame.width(), picture.frame.height());
        let (forward, up) = (pose.attitude.forward, pose.attitude.up);
        let model = picture.camera;
        let view =
            panics::catch(|| View::with_model(pose.position, forward, up, model, picture.fov_degrees, width, height));
        let view = match view {
            Ok(Ok(view)) => view,
            Ok(Err(e)) if e.kind == Kind::Fault => {
                report_fault(e.what, e.why.trim_start_matches("panicked: "));
                fall_back(picture);
                continue;
            }
            Ok(Err(e)) => {
                note("a view", format!("is not rendered: {}: {}", e.what, e.why));
                continue;
            }
            Err(why) => {
                report_fault(format!("camera {}", model.name), why);
                fall_back(picture);
                continue;
            }
        };
        // If `Aim` has moved it, or it is to be rendered in another way, it is a different picture.
        let same =
            picture.view.as_ref() == Some(&view) && cache.is_renderer_for(&scan.0, picture.settings, picture.preset);
        if !due && same {
            continue;
        }
        match panics::catch(|| trace(picture, &mut cache, &scan.0, &view)) {
            Ok(()) => (picture.view, picture.traced) = (Some(view), true),
            Err(why) => {
                // The cache and the frame may be incomplete: the next frame traces the view again.
                (*cache, picture.view) = (FrameCache::default(), None);
                picture.frame.resize(width, height);
                report_fault(makers(picture), why);
                fall_back(picture);
            }
        }
    }
}

/// Traces a view into its picture.
fn trace(picture: &mut Picture, cache: &mut FrameCache, scan: &PreparedVolume, view: &View) {
    let renderer = cache.renderer_for(scan, picture.settings, picture.preset);
    if let Some(budget) = picture.budget {
        renderer.set_budget(budget);
    }
    let begun = Instant::now();
    picture.work = awake(|| renderer.render(view, &mut picture.frame));
    if let Some((who, what)) = renderer.complaint() {
        note(who, what);
    }
    if let Some(makers) = own_makers(picture) {
        book_time(makers, begun.elapsed().as_secs_f64() * 1e3);
    }
}

/// Falls back to this crate's parts: a part of another crate has panicked, and would panic again.
fn fall_back(picture: &mut Picture) {
    picture.preset = Preset::default();
    picture.settings.shader = ShaderModel::default();
    picture.settings.options = Options::NONE;
    picture.camera = CameraModel::default();
    picture.fov_degrees = picture.camera.clamp_fov(picture.fov_degrees).unwrap_or(90.0);
}

/// Returns the parts of other crates used for a picture, or its preset if there are none.
fn makers(picture: &Picture) -> String {
    own_makers(picture).unwrap_or_else(|| format!("preset {}", picture.preset.name))
}

/// Returns the parts of other crates used for a picture.
fn own_makers(picture: &Picture) -> Option<String> {
    let preset = (!presets::BUILT_IN.contains(&picture.preset)).then(|| format!("preset {}", picture.preset.name));
    let shader = picture.settings.shader.name;
    let shader = shaders::BUILT_IN.iter().all(|s| s.name != shader).then(|| format!("shader {shader}"));
    let camera = picture.camera.name;
    let camera = camera::BUILT_IN.iter().all(|c| c.name != camera).then(|| format!("camera {camera}"));
    let own: Vec<String> = [preset, shader, camera].into_iter().flatten().collect();
    (!own.is_empty()).then(|| own.join(" or "))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::components::scan::Walls;
    use crate::dynamics::Attitude;
    use crate::render::camera::perspective;
    use crate::render::presets::standard;
    use crate::render::{
        Budget, Frame, ImageSize, Light, MemoryPart, Quality, Renderer, Reuse, Settings, Work, renderer,
    };
    use crate::testing::{Room, TestApp};

    const SIZE: (usize, usize) = (24, 16);

    /// A camera with a picture in a room.
    fn test() -> TestApp {
        let mut test = TestApp::new(&Room::new([16, 24, 16]));
        plugin(&mut test.app).unwrap();
        test.app.equip(Picture::new(SIZE.0, SIZE.1));
        test
    }

    /// Runs a frame, in which only views that have changed are traced. Returns true if the camera's was.
    fn traced(test: &mut TestApp) -> bool {
        test.frame().unwrap();
        assert!(!test.get::<Picture>().due, "a frame has been made");
        test.get::<Picture>().traced
    }

    /// Renders what a picture should show, with a new renderer.
    fn fresh(scan: &PreparedVolume, pose: &Pose, picture: &Picture) -> Frame {
        let (width, height) = (picture.frame.width(), picture.frame.height());
        let Attitude { forward, up } = pose.attitude;
        let fov = picture.fov_degrees;
        let view = View::with_model(pose.position, forward, up, picture.camera, fov, width, height).unwrap();
        let mut frame = Frame::new(width, height);
        renderer(scan, picture.settings, picture.preset, Reuse::Allowed).render(&view, &mut frame);
        frame
    }

    /// Checks that the camera's picture is that of a new renderer, byte for byte.
    fn is_fresh(test: &TestApp) -> bool {
        let scan = test.app.scan_get::<Scan>().unwrap();
        test.get::<Picture>().frame == fresh(&scan.0, test.get(), test.get())
    }

    #[test]
    fn a_picture_is_traced_when_it_is_due_or_has_changed_and_not_otherwise() {
        let mut test = test();
        assert!(traced(&mut test) && is_fresh(&test), "the first one");
        let seen = test.get::<Picture>().frame.clone();
        assert!(seen.pixels().iter().any(|p| p[0] > 30));
        for _ in 0..2 {
            assert!(!traced(&mut test) && test.get::<Picture>().frame == seen, "nothing has changed");
        }
        test.get_mut::<Picture>().due = true;
        assert!(traced(&mut test) && !traced(&mut test), "once for each time it is due");
        let changes: [(&str, fn(&mut TestApp)); 9] = [
            ("position", |t| t.get_mut::<Pose>().position.x += 1.0),
            ("direction", |t| t.get_mut::<Pose>().attitude = Attitude::new(DVec3::X, DVec3::Z)),
            ("roll", |t| t.get_mut::<Pose>().attitude = Attitude::new(DVec3::X, DVec3::new(0.0, 1.0, 3.0))),
            ("view angle", |t| t.get_mut::<Picture>().fov_degrees = 60.0),
            ("size", |t| t.get_mut::<Picture>().frame.resize(20, 30)),
            ("preset", |t| t.get_mut::<Picture>().preset = Preset::named("lean").unwrap()),
            ("quality", |t| t.get_mut::<Picture>().settings = Settings::new(Quality::Low)),
            ("light", |t| t.get_mut::<Picture>().settings.light = Light::ENDOSCOPE),
            ("samples", |t| t.get_mut::<Picture>().settings.samples_per_pixel = 2),
        ];
        for (what, change) in changes {
            let before = test.get::<Picture>().frame.clone();
            change(&mut test);
            assert!(traced(&mut test), "{what}");
            // A renderer that goes on may reuse what it has seen; another one starts from scratch.
            let renews = ["preset", "quality", "light", "samples"].contains(&what);
            assert!(!renews || is_fresh(&test), "{what}");
            let now = test.get::<Picture>().frame.clone();
            assert!(["preset", "samples"].contains(&what) || now != before, "{what} makes another picture");
            assert!(!traced(&mut test) && test.get::<Picture>().frame == now, "{what}, once");
        }
    }

    #[test]
    fn a_picture_with_depth_gets_it_with_every_image() {
        let mut test = test();
        test.app.equip(Picture::with_depth(SIZE.0, SIZE.1));
        let mut before = Vec::new();
        for preset in presets::BUILT_IN {
            for adaptive in [false, true] {
                test.get_mut::<Pose>().position.y += 0.5;
                let picture = &mut *test.get_mut::<Picture>();
                (picture.preset, picture.settings.adaptive) = (preset, adaptive);
                assert!(traced(&mut test));
                let depth = test.get::<Picture>().frame.depth().unwrap().to_vec();
                assert!(depth.len() == SIZE.0 * SIZE.1 && depth.iter().all(|mm| (2.0..40.0).contains(mm)), "{depth:?}");
                assert!(depth != before, "{} {adaptive}", preset.name);
                before = depth;
            }
        }
    }

    #[test]
    fn a_view_shows_its_own_scan_and_follows_its_own_entity() {
        let mut test = test();
        let small = Room::new([6; 3]);
        let scan = small.scan();
        let (own, camera) = (Pose { position: small.centre(), ..*test.get() }, test.app.camera_id());
        let second = test.app.world.spawn(Scan(scan.clone())).id();
        let shows = |whom: Option<Entity>, scan: Option<Entity>| {
            let follows = Follows { whom, yaw_degrees: 180.0, ..Follows::default() };
            (Picture { scan, ..Picture::new(12, 10) }, follows)
        };
        let there = test.app.world.spawn((own, Picture { scan: Some(second), ..Picture::new(12, 10) })).id();
        let rear = test.app.world.spawn(shows(None, None)).id();
        let after = test.app.world.spawn(shows(Some(there), Some(second))).id();
        let lost = test.app.world.spawn(Picture::new(12, 10)).id();
        let no_scan = test.app.world.spawn((own, Picture { scan: Some(camera), ..Picture::new(12, 10) })).id();
        // The camera's own pose does not count for a view that follows.
        let both = test.app.world.spawn((own, shows(Some(camera), None))).id();
        assert!(traced(&mut test));
        let picture = |test: &TestApp, view: Entity| {
            let p = test.app.world.get::<Picture>(view).unwrap();
            (p.frame.clone(), p.traced)
        };
        let main = test.app.scan_get::<Scan>().unwrap().0.clone();
        let back = |p: &Pose| Follows::rear().pose(p);
        let like = Picture::new(12, 10);
        assert_eq!(picture(&test, there), (fresh(&scan, &own, &like), true));
        assert_eq!(picture(&test, rear), (fresh(&main, &back(test.get()), &like), true));
        assert_eq!(picture(&test, after), (fresh(&scan, &back(&own), &like), true));
        assert_eq!(picture(&test, both), picture(&test, rear));
        for view in [lost, no_scan] {
            assert_eq!(picture(&test, view), (Frame::new(12, 10), false));
        }
        // A view that loses its pose keeps its image; with another scan, it is another picture.
        test.app.world.entity_mut(there).remove::<Pose>();
        test.app.world.get_mut::<Picture>(rear).unwrap().scan = Some(second);
        let kept = picture(&test, there).0;
        assert!(!traced(&mut test));
        assert_eq!(picture(&test, there), (kept, false));
        assert!(picture(&test, rear).1);
        assert!(!picture(&test, after).1, "what it follows has no pose");
        test.app.world.entity_mut(lost).insert(own);
        assert!(!traced(&mut test) && picture(&test, lost) == (fresh(&main, &own, &like), true));
    }

    /// Paints the whole picture in one colour, or panics after the first row if the view is rolled.
    struct Painter;

    impl Renderer for Painter {
        fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
            let (width, rolled) = (view.width(), view.up() != DVec3::Z);
            for (n, pixel) in frame.buffers().0.iter_mut().enumerate() {
                assert!(n < width || !rolled, "spilled paint");
                *pixel = [7, 8, 9];
            }
            Work { rays: 5, ..Work::default() }
        }

        fn parts(&self) -> Vec<(MemoryPart, usize)> {
            Vec::new()
        }
    }

    const PAINTER: Preset = Preset { name: "painter", make: |_, _, _| Box::new(Painter), ..standard::PRESET };
    const NO_CAMERA: CameraModel =
        CameraModel { name: "broken", make: |_, _, _| panic!("no film"), ..perspective::MODEL };

    /// Reports its budget as its work, and with a budget of 7 samples makes a picture of another size. A picture takes it at
    /// least 2 ms.
    struct Careful(u64);

    impl Renderer for Careful {
        fn render(&mut self, _: &View, frame: &mut Frame) -> Work {
            std::thread::sleep(std::time::Duration::from_millis(2));
            if self.0 == 7 {
                frame.resize(3, 5);
            }
            Work { samples: self.0, ..Work::default() }
        }

        fn set_budget(&mut self, budget: Budget) {
            self.0 = budget.samples;
        }

        fn parts(&self) -> Vec<(MemoryPart, usize)> {
            Vec::new()
        }
    }

    const CAREFUL: Preset = Preset { name: "careful", make: |_, _, _| Box::new(Careful(1)), ..standard::PRESET };

    #[test]
    fn a_renderer_gets_its_budget_and_its_complaints_and_time_are_noted() {
        let mut test = test();
        assert!(traced(&mut test));
        let time = |test: &TestApp| test.app.inspect().plugin_times().into_iter().find(|t| t.name == "preset careful");
        assert!(time(&test).is_none(), "the built-in preset is not a plug-in");
        test.get_mut::<Picture>().preset = CAREFUL;
        assert!(traced(&mut test));
        assert_eq!(test.get::<Picture>().work.samples, 1, "without a budget it keeps its own");
        assert!(test.app.take_notes().is_empty());
        for samples in [900, 7] {
            test.get_mut::<Picture>().budget = Some(Budget::strict(samples));
            test.get_mut::<Picture>().due = true;
            assert!(traced(&mut test));
            assert_eq!(test.get::<Picture>().work.samples, samples);
        }
        assert_eq!(
            test.app.take_notes(),
            ["preset careful made a frame of 3x5 pixels instead of 24x16"],
            "and it has its size"
        );
        assert_eq!(test.get::<Picture>().frame.size(), ImageSize::new(SIZE.0, SIZE.1));
        let booked = time(&test).unwrap();
        assert!(booked.frame_ms >= 2.0 && booked.step_ms == 0.0, "{booked:?}");
        // What it is for: a preset that slows a flight down is named.
        test.get_mut::<Picture>().settings.shader = ShaderModel { name: "odd", ..ShaderModel::default() };
        assert_eq!(own_makers(test.get()), Some("preset careful or shader odd".to_owned()));
        test.get_mut::<Picture>().preset = Preset::default();
        assert_eq!(makers(test.get()), "shader odd");
        test.get_mut::<Picture>().settings.shader = ShaderModel::default();
        assert_eq!((own_makers(test.get()), makers(test.get())), (None, "preset default".to_owned()));
    }

    #[test]
    fn a_renderer_that_panics_is_reported_and_the_next_picture_is_complete() {
        let mut test = test();
        test.get_mut::<Picture>().preset = PAINTER;
        test.get_mut::<Picture>().fov_degrees = 70.0;
        assert!(traced(&mut test));
        let painted = test.get::<Picture>();
        assert!(painted.frame.pixels().iter().all(|p| *p == [7, 8, 9]) && painted.work.rays == 5);
        test.get_mut::<Pose>().attitude = Attitude::new(DVec3::Y, DVec3::X);
        let e = test.frame().unwrap_err();
        assert!(e.what == "preset painter" && e.why.contains("spilled paint"), "{e}");
        let picture = test.get::<Picture>();
        assert!(!picture.traced && picture.preset == Preset::default());
        assert_eq!((picture.frame.width(), picture.frame.height()), SIZE);
        assert!(traced(&mut test) && is_fresh(&test));
        assert_eq!((test.get::<Picture>().fov_degrees, test.get::<Picture>().view.is_some()), (70.0, true));
        // The same where the view has been traced before, and is not due again.
        test.place(DVec3::new(8.0, 12.0, 8.0));
        test.get_mut::<Picture>().preset = PAINTER;
        assert!(traced(&mut test));
        let rolled = Attitude::new(DVec3::Y, DVec3::X);
        test.get_mut::<Picture>().view = {
            let p = test.get::<Picture>();
            View::with_model(DVec3::new(8.0, 12.0, 8.0), DVec3::Y, DVec3::X, p.camera, 70.0, SIZE.0, SIZE.1).ok()
        };
        test.get_mut::<Pose>().attitude = rolled;
        test.get_mut::<Picture>().due = true;
        assert!(test.frame().is_err());
        assert!(traced(&mut test) && is_fresh(&test), "though nobody has asked for it");
    }

    #[test]
    fn a_camera_that_panics_or_cannot_be_is_reported_and_the_others_go_on() {
        let mut test = test();
        let other = test.app.world.spawn((*test.get::<Pose>(), Picture::new(8, 6))).id();
        test.get_mut::<Picture>().camera = NO_CAMERA;
        let e = test.frame().unwrap_err().to_string();
        assert!(e.contains("camera broken") && e.contains("no film"), "{e}");
        let picture = test.get::<Picture>();
        assert!(!picture.traced && picture.camera == perspective::MODEL && picture.fov_degrees == 90.0);
        assert!(test.app.world.get::<Picture>(other).unwrap().traced);
        assert!(traced(&mut test) && is_fresh(&test));
        // An angle that no camera has is noted and leaves the picture as it is.
        let kept = test.get::<Picture>().frame.clone();
        test.get_mut::<Picture>().fov_degrees = f64::NAN;
        assert!(!traced(&mut test) && test.get::<Picture>().frame == kept);
        let notes = test.app.take_notes().join("\n");
        assert!(notes.contains("a view is not rendered"), "{notes}");
        test.get_mut::<Picture>().fov_degrees = 50.0;
        assert!(traced(&mut test));
    }

    #[test]
    fn a_picture_that_was_resized_gets_its_size_back_once_it_was_traced() {
        let mut test = test();
        keep_sizes_plugin(&mut test.app).unwrap();
        let shrink = |mut pictures: Query<&mut Picture>| pictures.iter_mut().for_each(|mut p| p.frame.resize(5, 4));
        test.app.add_systems(FlightSystems::PostProcess, shrink);
        let size = |test: &TestApp| {
            let p = test.get::<Picture>();
            (p.frame.width(), p.frame.height(), p.traced, p.resized)
        };
        test.frame().unwrap();
        assert_eq!(size(&test), (SIZE.0, SIZE.1, true, true));
        assert!(test.app.scan_get::<Walls>().is_some() && plugin(&mut test.app).is_err(), "there is one renderer");
        assert!(keep_sizes_plugin(&mut test.app).is_err());
    }
}
