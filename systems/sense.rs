//! Senses the surroundings. Tentacles are rays like those of the image, but only their length matters.

use bevy_ecs::prelude::*;
use glam::DVec3;
use rayon::prelude::*;

use crate::components::camera::Pose;
use crate::components::guide::Tentacles;
use crate::components::scan::Scan;
use crate::dynamics::tentacles::TentacleSettings;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main};
use crate::space::{PreparedVolume, first_crossing};

/// Gives the camera tentacles, for any guide that uses them.
///
/// # Errors
/// Never fails.
pub fn plug(app: &mut App, settings: TentacleSettings) -> Result<()> {
    app.equip(Tentacles::new(settings));
    app.add_systems(FlightSystems::Sense, cast_tentacles);
    Ok(())
}

/// Casts all tentacles from the camera's position.
pub fn cast_tentacles(scan: Single<&Scan, With<Main>>, camera: Single<(&Pose, &mut Tentacles), With<Main>>) {
    let (pose, mut tentacles) = camera.into_inner();
    let Tentacles { settings, directions, lengths, .. } = &mut *tentacles;
    cast(&scan.0, pose.position, directions, settings.reach_mm, lengths);
}

/// Measures the free length from a point `at` (world mm) along each of the unit `directions`, mm, up to `reach`.
pub fn cast(volume: &PreparedVolume, at: DVec3, directions: &[DVec3], reach: f64, lengths: &mut [f64]) {
    lengths.par_iter_mut().zip(directions.par_iter()).with_min_len(32).for_each(|(length, &d)| {
        *length = first_crossing(volume, at, d, reach).unwrap_or(reach);
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::guide::GuideThrust;
    use crate::dynamics::Attitude;
    use crate::testing::{Room, TestApp};

    /// Checks every tentacle that does not end at an edge of the room. Returns how many meet a wall and how many do not.
    fn check(test: &TestApp, room: &Room, at: DVec3, reach: f64) -> [usize; 2] {
        let t = test.get::<Tentacles>();
        let mut met = [0; 2];
        for (&d, &length) in t.directions.iter().zip(&t.lengths) {
            let exact = room.distance_mm(at, d);
            let end = at + d * exact;
            // The scan rounds edges off, so near them only the reach is known.
            let walls = (0..3).filter(|&a| end[a].min(room.size_mm()[a] - end[a]) < 1.0).count();
            if exact > reach + 2.0 {
                assert_eq!(length, reach, "{d} from {at}");
                met[1] += 1;
            } else if walls == 1 && exact < reach {
                assert!((length - exact).abs() < 1e-9, "{d} from {at}: {length}, not {exact}");
                met[0] += 1;
            }
        }
        met
    }

    #[test]
    fn tentacles_are_as_long_as_the_room_and_stop_at_their_reach() {
        let room = Room::new([20, 40, 28]);
        let mut test = TestApp::new(&room);
        plug(&mut test.app, TentacleSettings { count: 200, reach_mm: 12.0, ..TentacleSettings::default() }).unwrap();
        assert_eq!(test.get::<Tentacles>().directions.len(), 200);
        for at in [DVec3::new(7.25, 12.0, 15.5), DVec3::new(13.0, 33.0, 4.0), room.centre()] {
            test.place(at);
            test.steps(1).unwrap();
            let met = check(&test, &room, at, 12.0);
            assert!(met.iter().all(|m| *m > 20), "{met:?}");
        }
        // A new reach holds at once, and the view has no part in it.
        for reach in [5.0, 150.0] {
            test.get_mut::<Tentacles>().settings.reach_mm = reach;
            test.get_mut::<Pose>().attitude = Attitude::new(DVec3::NEG_X, DVec3::Y);
            test.steps(1).unwrap();
            assert!(check(&test, &room, room.centre(), reach).iter().sum::<usize>() > 100);
        }
        // In the wall there is no free length.
        test.place(DVec3::new(-2.0, 10.0, 10.0));
        test.steps(1).unwrap();
        assert!(test.get::<Tentacles>().lengths.iter().all(|l| *l == 0.0));
    }

    #[test]
    fn only_the_cameras_tentacles_are_cast_and_only_in_the_scan_that_is_flown() {
        let room = Room::new([20, 40, 28]);
        let mut test = TestApp::new(&room);
        plug(&mut test.app, TentacleSettings::default()).unwrap();
        test.app.world.spawn(Scan(Room::new([4; 3]).scan()));
        let held = Tentacles { lengths: vec![-1.0; 128], ..Tentacles::new(TentacleSettings::default()) };
        let pose = *test.get::<Pose>();
        let other = test.app.world.spawn((pose, held)).id();
        test.app.equip(GuideThrust { limit: 5.0, ..GuideThrust::default() });
        test.steps(2).unwrap();
        assert!(check(&test, &room, room.centre(), 150.0)[0] > 80);
        assert!(test.app.world.get::<Tentacles>(other).unwrap().lengths.iter().all(|l| *l == -1.0));
        assert_eq!(test.get::<GuideThrust>().limit, 5.0, "what the guide does with them is its own affair");
        assert_eq!(*test.get::<Pose>(), pose);
    }
}
