//! Logs each step.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::components::camera::{Contact, Pose, Velocity};
use crate::components::clock::Clock;
use crate::components::flight::Flight;
use crate::components::output::{FlightLog, GuideName, LogLine};
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main};

/// Adds the log to the scene.
pub fn plugin(app: &mut App) -> Result<()> {
    app.world.init_resource::<FlightLog>();
    app.add_systems(FlightSystems::Log, log_step);
    Ok(())
}

/// Appends the step that was just completed.
///
/// Values that a plug-in has made non-finite are not logged. The last valid value is logged instead, initially 0.
pub fn log_step(
    clock: Res<Clock>,
    guide: Res<GuideName>,
    mut log: ResMut<FlightLog>,
    camera: Single<(&Pose, &Flight, Option<&Velocity>, Option<&Contact>), With<Main>>,
    mut sound: Local<([DVec3; 4], f64)>,
) {
    let (pose, flight, velocity, contact) = camera.into_inner();
    let moving = velocity.map_or(DVec3::ZERO, |v| v.0);
    let now = [pose.position, pose.attitude.forward, pose.attitude.up, moving];
    let (sound, sound_mm) = &mut *sound;
    for (sound, now) in sound.iter_mut().zip(now).filter(|(_, now)| now.is_finite()) {
        *sound = now;
    }
    let [position, forward, up, velocity] = sound.map(|v| v.to_array());
    if let Some(now) = contact.map(|c| c.clearance_mm).filter(|mm| mm.is_finite()) {
        *sound_mm = now;
    }
    log.0.push(LogLine {
        t: (clock.tick + 1) as f64 / f64::from(clock.hz),
        position,
        forward,
        up,
        velocity,
        clearance_mm: *sound_mm,
        state: flight.state,
        guide: guide.0.to_owned(),
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::flight::State;
    use crate::dynamics::Attitude;
    use crate::testing::{Room, TestApp};

    fn test() -> TestApp {
        let mut test = TestApp::new(&Room::new([10; 3]));
        test.app.world.insert_resource(GuideName("path"));
        plugin(&mut test.app).unwrap();
        test
    }

    fn lines(test: &TestApp) -> &[LogLine] {
        &test.app.world.resource::<FlightLog>().0
    }

    #[test]
    fn a_line_holds_what_the_camera_is_after_its_step() {
        let mut test = test();
        // A camera without a body, then one with.
        test.steps(1).unwrap();
        let line = LogLine {
            t: 1.0 / 120.0,
            position: [5.0; 3],
            forward: [0.0, 1.0, 0.0],
            up: [0.0, 0.0, 1.0],
            velocity: [0.0; 3],
            clearance_mm: 0.0,
            state: State::Flying,
            guide: "path".to_owned(),
        };
        assert_eq!(lines(&test), [line]);
        let attitude = Attitude { forward: DVec3::X, up: DVec3::Y };
        test.app.equip((
            Pose { position: DVec3::new(1.0, 2.0, 3.0), attitude },
            Velocity(DVec3::new(4.0, 5.0, 6.0)),
            Contact { clearance_mm: 7.5, stuck_steps: 3 },
            Flight { state: State::Operator, length_mm: 80.0, ..Flight::default() },
        ));
        test.app.world.insert_resource(GuideName("manual"));
        test.steps(2).unwrap();
        let line = LogLine {
            t: 3.0 / 120.0,
            position: [1.0, 2.0, 3.0],
            forward: [1.0, 0.0, 0.0],
            up: [0.0, 1.0, 0.0],
            velocity: [4.0, 5.0, 6.0],
            clearance_mm: 7.5,
            state: State::Operator,
            guide: "manual".to_owned(),
        };
        assert_eq!((lines(&test).len(), &lines(&test)[2]), (3, &line));
        // Lines that were taken do not come again, and time goes on.
        test.app.world.resource_mut::<FlightLog>().0.clear();
        test.steps(117).unwrap();
        assert_eq!((lines(&test).len(), lines(&test)[116].t), (117, 1.0));
    }

    #[test]
    fn what_is_no_number_is_logged_as_its_last_valid_value() {
        let mut test = test();
        let put = |test: &mut TestApp, position: f64, forward: f64, velocity: f64, clearance_mm: f64| {
            let attitude = Attitude { forward: DVec3::new(forward, 0.0, 0.0), up: DVec3::Z };
            test.app.equip((
                Pose { position: DVec3::new(position, 2.0, 3.0), attitude },
                Velocity(DVec3::new(0.0, velocity, 0.0)),
                Contact { clearance_mm, stuck_steps: 0 },
            ));
            test.steps(1).unwrap();
            let l = lines(test).last().unwrap();
            assert_eq!(l.up, [0.0, 0.0, 1.0]);
            (l.position, l.forward[0], l.velocity[1], l.clearance_mm)
        };
        let nan = f64::NAN;
        assert_eq!(put(&mut test, nan, nan, nan, nan), ([0.0; 3], 0.0, 0.0, 0.0), "initially 0");
        assert_eq!(put(&mut test, 1.0, 1.0, 9.0, 4.0), ([1.0, 2.0, 3.0], 1.0, 9.0, 4.0));
        assert_eq!(put(&mut test, nan, 0.5, f64::INFINITY, 5.0), ([1.0, 2.0, 3.0], 0.5, 9.0, 5.0), "each for itself");
        assert_eq!(put(&mut test, 4.0, nan, 8.0, f64::NEG_INFINITY), ([4.0, 2.0, 3.0], 0.5, 8.0, 5.0));
        assert_eq!(put(&mut test, 6.0, 1.0, 7.0, 2.0), ([6.0, 2.0, 3.0], 1.0, 7.0, 2.0));
    }

    #[test]
    fn other_cameras_are_not_logged() {
        let mut test = test();
        let attitude = Attitude::new(DVec3::X, DVec3::Z);
        test.app.world.spawn((Pose { position: DVec3::ZERO, attitude }, Flight::default()));
        test.steps(2).unwrap();
        assert_eq!(lines(&test).iter().map(|l| l.position).collect::<Vec<_>>(), [[5.0; 3]; 2]);
    }
}
