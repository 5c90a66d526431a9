//! Measures what the flight has seen of the wall, and paints what it has not.

use bevy_ecs::prelude::*;

use crate::components::clock::Clock;
use crate::components::flight::{Flight, State};
use crate::components::output::Picture;
use crate::components::review::Review;
use crate::components::scan::Scan;
use crate::components::slices::SliceView;
use crate::components::trail::Trail;
use crate::coverage::{CoveragePaint, LiveCoverage, paint_slice};
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main, Slot};

/// Work of a step, in tests of whether a patch is in the picture: less than 0.1 ms, and there are four steps in a frame.
const WORK: u32 = 12_000;

/// Adds the system that measures coverage. The camera has a [`LiveCoverage`].
///
/// # Errors
/// Returns status 2 if the slot is already filled.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Coverage, "coverage")?;
    app.add_systems(FlightSystems::Log, watch_wall);
    Ok(())
}

/// Adds the system that paints what was not seen over the camera's picture and over slices with [marks](SliceView::marks), while the
/// camera has a [`CoveragePaint`].
///
/// # Errors
/// Returns status 2 if the slot is already filled.
pub fn paint_plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::CoveragePaint, "coverage paint")?;
    app.add_systems(FlightSystems::PostProcess, paint_unseen);
    Ok(())
}

/// The camera of a flight whose coverage is painted.
type Painted<'a> = (&'a LiveCoverage, &'a mut CoveragePaint, Option<&'a mut Picture>);

/// Paints the images that were made in this frame.
pub fn paint_unseen(
    clock: Res<Clock>,
    scan: Single<&Scan, With<Main>>,
    camera: Single<Painted, With<Main>>,
    mut slices: Query<&mut SliceView>,
) {
    let (coverage, mut paint, picture) = camera.into_inner();
    // The wall of the scan on display is not measured yet.
    if picture.as_ref().is_some_and(|p| p.scan.is_some() != coverage.is_beside()) {
        return;
    }
    if let Some(mut picture) = picture.filter(|p| p.traced)
        && let Some(view) = picture.view.clone()
    {
        paint.paint(coverage, &scan.0, &view, clock.seconds(), &mut picture.frame);
    }
    for mut slice in slices.iter_mut().filter(|s| s.made && s.marks.is_some()) {
        if let Some(shown) = slice.shown() {
            paint_slice(coverage, &shown, &mut slice.frame);
        }
    }
}

/// The camera of a flight whose coverage is watched.
type Watched<'a> = (&'a Trail, &'a mut LiveCoverage, Option<&'a Picture>, Option<&'a Flight>, Option<&'a Review>);

/// Continues with the newest views of the trail, with the view angle of the picture.
pub fn watch_wall(clock: Res<Clock>, scan: Single<&Scan, With<Main>>, camera: Single<Watched, With<Main>>) {
    let (trail, mut coverage, picture, flight, tour) = camera.into_inner();
    // At the end of a tour the flight may still continue.
    coverage.set_over(tour.is_none() && flight.is_some_and(|f| f.state == State::Arrived));
    if let Some(picture) = picture {
        coverage.set_fov(picture.fov_degrees);
    }
    coverage.watch(&scan.0, trail.views(), clock.seconds(), WORK);
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::components::camera::Pose;
    use crate::dynamics::Attitude;
    use crate::fields::lumen;
    use crate::progress::Progress;
    use crate::render::camera::Perspective;
    use crate::systems::trail;
    use crate::testing::{Room, TestApp};

    #[test]
    fn what_is_watched_while_flying_is_what_was_seen_afterwards() {
        let room = Room::new([30, 90, 24]);
        let volume = room.scan();
        let gas = Arc::new(lumen::gas_at(volume.voxels(), room.centre(), &Progress::new()).unwrap().unwrap());
        let mut test = TestApp::new(&room);
        test.app.camera().insert(LiveCoverage::of(&volume, &gas, &Progress::new()).unwrap());
        trail::plugin(&mut test.app).unwrap();
        plugin(&mut test.app).unwrap();
        let share = |test: &TestApp| test.get::<LiveCoverage>().share();
        let at = |y: f64| DVec3::new(15.0, y, 12.0);
        let turn = |angle: f64| Attitude::new(DVec3::new(angle.sin(), angle.cos(), 0.0), DVec3::Z);
        let mut before = 0.0;
        for n in 0..200 {
            test.place(at(20.0 + 0.25 * f64::from(n)));
            test.app.camera().get_mut::<Pose>().unwrap().attitude = turn(0.0);
            test.steps(1).unwrap();
            assert!(share(&test) >= before);
            before = share(&test);
        }
        // Half a turn on the spot shows the rest.
        for n in 0..200 {
            test.app.camera().get_mut::<Pose>().unwrap().attitude = turn(f64::from(n) * 0.0157);
            test.steps(1).unwrap();
        }
        let live = test.get::<LiveCoverage>();
        let (camera, views) = (Perspective::new(90.0).unwrap(), test.get::<Trail>().views());
        let sights = live.wall().seen(&volume, views, &camera, false, &Progress::new()).unwrap();
        let truth = live.wall().coverage(&sights).one_way;
        assert!(before > 0.5 && share(&test) > before + 0.05, "{before} and then {}", share(&test));
        assert!((share(&test) - truth).abs() < 0.005, "{} while flying, {truth} afterwards", share(&test));
        let mut over = live.clone();
        over.set_over(true);
        let missed = over.missed().iter().filter(|missed| **missed).count() as f64 / live.wall().len() as f64;
        assert!((missed - (1.0 - truth)).abs() < 0.02, "{missed} of the triangles");
    }

    #[test]
    fn nothing_breaks_it() {
        let room = Room::new([12; 3]);
        let volume = room.scan();
        let gas = Arc::new(lumen::gas_at(volume.voxels(), room.centre(), &Progress::new()).unwrap().unwrap());
        let mut live = LiveCoverage::of(&volume, &gas, &Progress::new()).unwrap();
        live.set_fov(f64::NAN);
        live.set_fov(500.0);
        let look = Attitude::new(DVec3::Y, DVec3::Z);
        for at in [DVec3::NAN, DVec3::splat(1e300), DVec3::splat(-5.0), room.centre()] {
            let mut seen = live.clone();
            let views = [(at, look), (DVec3::NAN, look), (at, look)];
            // With no work to do, with little, and backwards in the list of views.
            seen.watch(&volume, &views[..1], f64::NAN, 0);
            (0..100).for_each(|_| seen.watch(&volume, &views, 0.0, 7));
            seen.watch(&volume, &[], 0.0, 1000);
            seen.catch_up(&volume, &views, 0.0, &Progress::new()).unwrap();
            assert!((0.0..=1.0).contains(&seen.share()), "{at}: {}", seen.share());
        }
        let nothing = Arc::new(crate::fields::Lumen::none(volume.voxels().grid()));
        let mut empty = LiveCoverage::of(&volume, &nothing, &Progress::new()).unwrap();
        empty.watch(&volume, &[(room.centre(), look)], 0.0, 1000);
        assert!(empty.share() == 0.0 && empty.missed().is_empty());
    }
}
