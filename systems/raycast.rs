//! Traces the images of all views.

use std::time::Instant;

use bevy_ecs::prelude::*;

use crate::components::camera::Pose;
use crate::components::output::{Follows, FrameCache, Picture};
use crate::components::scan::Scan;
use crate::error::Result;
use crate::panics;
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
        // If `Aim` has moved it, it is a different picture.
        if !due && picture.view.as_ref() == Some(&view) {
            continue;
        }
        match panics::catch(|| trace(picture, &mut cache, &scan.0, &view)) {
            Ok(()) => (picture.view, picture.traced) = (Some(view), true),
            Err(why) => {
                // The cache and the frame may be incomplete.
                *cache = FrameCache::default();
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
    picture.work = renderer.render(view, &mut picture.frame);
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
