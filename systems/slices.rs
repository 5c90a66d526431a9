//! Draws slices beside the flight's picture.

use bevy_ecs::prelude::*;

use crate::components::camera::Pose;
use crate::components::scan::Scan;
use crate::components::slices::SliceView;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main, Slot};

/// Adds the system that draws slices.
///
/// # Errors
/// Returns status 2 if the slot is already filled.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Slices, "slices")?;
    app.add_systems(FlightSystems::Slices, make_slices);
    Ok(())
}

/// Draws the slices that have changed: all slices without a budget, and one of those with a budget.
///
/// Slices follow the flight's camera and show the scan that is flown through, under their patches. `last` is the slice that was drawn in the
/// previous turn.
pub fn make_slices(
    mut last: Local<Option<Entity>>,
    cameras: Query<&Pose, With<Main>>,
    scans: Query<&Scan, With<Main>>,
    patches: Query<&Scan, Without<Main>>,
    mut slices: Query<(Entity, &mut SliceView)>,
) {
    let (Some(pose), Some(scan)) = (cameras.iter().next(), scans.iter().next()) else { return };
    let volume = scan.0.voxels();
    let patch_of = |slice: &SliceView| slice.patch.and_then(|e| patches.get(e).ok()).map(|scan| scan.0.voxels());
    // The first of the waiting slices, and the first after the last turn.
    let (mut first, mut after): (Option<Entity>, Option<Entity>) = (None, None);
    let earlier = |a: Option<Entity>, b: Entity| Some(a.map_or(b, |a| a.min(b)));
    for (entity, mut slice) in &mut slices {
        if !slice.may_wait() {
            let patch = patch_of(&slice);
            slice.make(volume, patch, pose);
            continue;
        }
        slice.wait();
        if slice.is_stale(volume.grid(), pose) {
            first = earlier(first, entity);
            if last.is_some_and(|l| entity > l) {
                after = earlier(after, entity);
            }
        }
    }
    if let Some((entity, mut slice)) = after.or(first).and_then(|e| slices.get_mut(e).ok()) {
        *last = Some(entity);
        let patch = patch_of(&slice);
        slice.make(volume, patch, pose);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DVec3};

    use super::*;
    use crate::components::slices::Orientation;
    use crate::dynamics::Attitude;
    use crate::space::{PreparedVolume, TransferFunction};
    use crate::volume::{Grid, Volume};

    #[test]
    fn slices_with_a_budget_take_turns() {
        let grid = Grid::new([8; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let volume = Arc::new(Volume::new(grid, (0..512).map(|n| (n % 8) as i16 * 100).collect()));
        let mut app = App::new();
        let scan = Scan(PreparedVolume::new(volume, TransferFunction::default()));
        let at = |x: f64| Pose { position: DVec3::splat(x), attitude: Attitude::new(DVec3::Y, DVec3::Z) };
        app.camera().insert((at(2.0), scan));
        let ids = Orientation::ALL.map(|o| {
            let mut view = SliceView::new(o, [16, 16]);
            view.budget = (o != Orientation::Across).then_some(1000);
            app.world.spawn(view).id()
        });
        plugin(&mut app).unwrap();
        app.build().unwrap();
        let made = |app: &mut App, x: f64| {
            app.camera().insert(at(x));
            app.frame().unwrap();
            ids.map(|e| u8::from(app.world.get::<SliceView>(e).unwrap().made))
        };
        assert_eq!(made(&mut app, 0.0), [1; 4], "each has an image at first");
        // The slice without a budget is drawn every time, and each of the others every third time.
        let moving: Vec<_> = (0..6).map(|n| made(&mut app, f64::from(n) + 1.0)).collect();
        assert!(moving.iter().all(|m| m[3] == 1 && m[..3].iter().sum::<u8>() == 1), "{moving:?}");
        assert!((0..3).all(|o| moving.iter().map(|m| m[o]).sum::<u8>() == 2), "{moving:?}");
        // At rest, all slices come to show the same position; after that none is drawn again.
        let rest: Vec<_> = (0..4).map(|_| made(&mut app, 6.0)).collect();
        assert_eq!(rest.iter().flatten().sum::<u8>(), 2, "{rest:?}");
        assert!(ids.iter().all(|e| {
            let view = app.world.get::<SliceView>(*e).unwrap();
            view.shown().is_some_and(|s| (s.centre.dot(s.frame.normal()).abs() - 6.0).abs() < 1e-9)
        }));
        // A new size is drawn immediately.
        app.world.get_mut::<SliceView>(ids[0]).unwrap().size = [9, 9];
        app.world.get_mut::<SliceView>(ids[1]).unwrap().size = [9, 9];
        assert_eq!(made(&mut app, 6.0), [1, 1, 0, 0]);
    }

    #[test]
    fn a_slice_is_made_when_it_changes_and_only_then() {
        let grid = Grid::new([8; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let volume = Arc::new(Volume::new(grid, (0..512).map(|n| (n / 64) as i16 * 100).collect()));
        let mut app = App::new();
        let scan = Scan(PreparedVolume::new(volume, TransferFunction::default()));
        let at = |z: f64| Pose { position: DVec3::new(4.0, 4.0, z), attitude: Attitude::new(DVec3::Y, DVec3::Z) };
        app.camera().insert((at(2.0), scan));
        let slice = app.world.spawn(SliceView::new(Orientation::Axial, [16, 16])).id();
        plugin(&mut app).unwrap();
        app.build().unwrap();
        let after = |app: &mut App, z: f64| {
            app.camera().insert(at(z));
            app.frame().unwrap();
            let view = app.world.get::<SliceView>(slice).unwrap();
            (view.made, view.hu_at([8, 8]).unwrap())
        };
        assert_eq!(after(&mut app, 2.0), (true, 200.0));
        assert_eq!(after(&mut app, 2.3), (false, 200.0));
        assert_eq!(after(&mut app, 5.9), (true, 600.0));
        app.world.get_mut::<SliceView>(slice).unwrap().place = Some(DVec3::ONE);
        assert_eq!(after(&mut app, 5.9), (true, 100.0));
    }
}
