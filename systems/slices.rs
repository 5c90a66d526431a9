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
/// Status 2 when there is another one.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Slices, "slices")?;
    app.add_systems(FlightSystems::Slices, make_slices);
    Ok(())
}

/// Makes the images of all slices that have changed. They follow the flight's camera, and show the scan that is flown through.
pub fn make_slices(
    cameras: Query<&Pose, With<Main>>,
    scans: Query<&Scan, With<Main>>,
    mut slices: Query<&mut SliceView>,
) {
    let (Some(pose), Some(scan)) = (cameras.iter().next(), scans.iter().next()) else { return };
    for mut slice in &mut slices {
        slice.make(scan.0.volume(), pose);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DVec3};

    use super::*;
    use crate::components::slices::Orientation;
    use crate::dynamics::Attitude;
    use crate::render::{PreparedVolume, TransferFunction};
    use crate::volume::{Grid, Volume};

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
