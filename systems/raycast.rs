//! Traces the images of all views.

use bevy_ecs::prelude::*;

use crate::components::camera::Pose;
use crate::components::output::{Follows, FrameCache, Picture};
use crate::components::scan::Scan;
use crate::error::Result;
use crate::render::View;
use crate::schedule::{App, FlightSystems, Main, Slot};

/// Plugs the ray caster into the renderer's slot.
///
/// # Errors
/// Status 2 when there is another one.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Renderer, "ray caster")?;
    app.add_systems(FlightSystems::RayCast, cast_pictures);
    Ok(())
}

/// What makes up a view.
type Views<'w, 's> =
    Query<'w, 's, (&'static mut Picture, &'static mut FrameCache, Option<&'static Pose>, Option<&'static Follows>)>;

/// Renders every view that is due, in the order of the entities: the camera's first, others as they were spawned. A view
/// without a pose, or of an entity that is no scan, keeps its image.
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
        picture.traced = false;
        if !due {
            continue;
        }
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
        let Ok(view) = View::with_model(pose.position, forward, up, picture.camera, picture.fov_degrees, width, height)
        else {
            continue;
        };
        let renderer = cache.renderer_for(&scan.0, picture.settings, picture.preset);
        if let Some(samples) = picture.budget {
            renderer.set_budget(samples);
        }
        picture.work = renderer.render(&view, &mut picture.frame);
        picture.view = Some(view);
        picture.traced = true;
    }
}
