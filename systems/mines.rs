//! Mines: laid behind the camera, they push it forward.

use bevy_ecs::prelude::*;

use crate::components::camera::{Heading, Pose};
use crate::components::flight::{SetOff, TakenOver};
use crate::components::guide::{MineField, MinePush, Tentacles};
use crate::dynamics::mines::{MineSettings, Mines};
use crate::dynamics::tentacles::Drive;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main};

/// Lets the camera lay mines.
///
/// # Errors
/// Never fails.
pub fn plug(app: &mut App, settings: MineSettings) -> Result<()> {
    app.equip((MineField { settings, mines: Mines::default() }, MinePush::default()));
    app.add_systems(FlightSystems::Force, (lay_mines, push_by_mines).chain());
    app.observe(clear_mines).observe(lay_first_mine);
    Ok(())
}

/// Clears the mines after operator input: they must not block the path that the operator took.
pub fn clear_mines(taken: On<TakenOver>, mut cameras: Query<&mut MineField>) {
    if let Ok(mut field) = cameras.get_mut(taken.entity) {
        field.mines.clear();
    }
}

/// Clears the mines when the flight sets off again, if they would hold the camera, and lays the first new one if mines alone
/// drive it.
pub fn lay_first_mine(off: On<SetOff>, mut cameras: Query<(&Pose, &mut MineField, Option<&Tentacles>)>) {
    let Ok((pose, mut field, tentacles)) = cameras.get_mut(off.entity) else { return };
    let MineField { settings, mines } = &mut *field;
    mines.set_off(pose.position, off.heading, off.clear_mines, are_alone(tentacles), settings);
}

/// Returns true if mines alone drive the camera.
fn are_alone(tentacles: Option<&Tentacles>) -> bool {
    tentacles.is_some_and(|t| t.settings.drive == Drive::Mines)
}

/// Computes the push of the mines at the camera's position.
pub fn push_by_mines(camera: Single<(&Pose, &MineField, &mut MinePush), With<Main>>) {
    let (pose, field, mut push) = camera.into_inner();
    push.0 = field.mines.push(pose.position, &field.settings);
}

/// Lays a mine once the camera is far enough from the last one. Without any, mines that alone drive the camera need one behind
/// the direction in which it will set out.
pub fn lay_mines(camera: Single<(&Pose, &Heading, &mut MineField, Option<&Tentacles>), With<Main>>) {
    let (pose, heading, mut field, tentacles) = camera.into_inner();
    let MineField { settings, mines } = &mut *field;
    mines.lay(pose.position, heading.0.normalize_or(pose.attitude.forward), are_alone(tentacles), settings);
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::dynamics::tentacles::TentacleSettings;
    use crate::testing::{Room, TestApp};

    const SETTINGS: MineSettings = MineSettings { kept: 3, spacing_mm: 4.0, reach_mm: 20.0, push: 50.0 };
    const START: DVec3 = DVec3::new(10.0, 10.0, 10.0);

    /// A camera at rest that lays mines, at [`START`].
    fn test(drive: Drive) -> TestApp {
        let mut test = TestApp::new(&Room::new([20, 80, 20]));
        plug(&mut test.app, SETTINGS).unwrap();
        test.app.equip((Heading::default(), Tentacles::new(TentacleSettings { drive, ..TentacleSettings::default() })));
        test.place(START);
        test
    }

    fn mines(test: &TestApp) -> Vec<DVec3> {
        test.get::<MineField>().mines.iter().collect()
    }

    fn near(a: DVec3, b: DVec3) {
        assert!(a.distance(b) < 1e-9, "{a}, not {b}");
    }

    /// Moves the camera along +y to each of these distances from the start, one a step.
    fn fly(test: &mut TestApp, along: impl IntoIterator<Item = f64>) {
        for y in along {
            test.place(START + DVec3::Y * y);
            test.steps(1).unwrap();
        }
    }

    #[test]
    fn a_mine_is_laid_every_spacing_and_the_last_few_are_kept() {
        let mut test = test(Drive::Thrust);
        test.get_mut::<MinePush>().0 = DVec3::ONE;
        fly(&mut test, [0.0, 3.99]);
        assert!(mines(&test).is_empty());
        assert_eq!(test.get::<MinePush>().0, DVec3::ZERO, "without mines nothing pushes");
        fly(&mut test, [4.0]);
        assert_eq!(mines(&test), [START], "where the camera was a spacing ago");
        fly(&mut test, (5..=19).map(f64::from));
        assert_eq!(mines(&test), [4.0, 8.0, 12.0].map(|y| START + DVec3::Y * y));
        // The mines lie 15, 11 and 7 mm behind and push on together.
        near(
            test.get::<MinePush>().0,
            DVec3::Y * (50.0 * [15.0, 11.0, 7.0].map(|d| 1.0 - d / 20.0).iter().sum::<f64>()),
        );
        // Fewer may be kept from now on: that holds for the next one laid.
        test.get_mut::<MineField>().settings.kept = 1;
        fly(&mut test, [20.0]);
        assert_eq!(mines(&test), [START + DVec3::Y * 16.0]);
    }

    #[test]
    fn a_push_falls_linearly_to_nothing_at_the_reach_and_points_away() {
        let mut test = test(Drive::Thrust);
        test.get_mut::<MineField>().settings.spacing_mm = 1e3;
        test.get_mut::<MineField>().mines.lay_behind(START + DVec3::X * 3.0, DVec3::X, &SETTINGS);
        let mine = START + DVec3::X;
        assert_eq!(mines(&test), [mine]);
        for direction in [DVec3::Y, DVec3::NEG_X, DVec3::new(0.6, 0.0, -0.8)] {
            for (d, share) in
                [(0.0, 0.0), (1.0, 0.95), (5.0, 0.75), (10.0, 0.5), (19.0, 0.05), (20.0, 0.0), (30.0, 0.0)]
            {
                test.place(mine + direction * d);
                test.steps(1).unwrap();
                near(test.get::<MinePush>().0, direction * (50.0 * share));
            }
        }
    }

    #[test]
    fn mines_that_alone_drive_begin_with_one_behind_the_heading() {
        // Before it moves, a camera heads where it looks: along +y.
        for (heading, ahead) in [(DVec3::ZERO, DVec3::Y), (DVec3::X, DVec3::X), (DVec3::NEG_Z * 2.0, DVec3::NEG_Z)] {
            let mut test = test(Drive::Mines);
            test.get_mut::<Heading>().0 = heading;
            test.steps(1).unwrap();
            assert_eq!(mines(&test).len(), 1);
            near(mines(&test)[0], START - ahead * 2.0);
            near(test.get::<MinePush>().0, ahead * (50.0 * 0.9));
            test.steps(2).unwrap();
            assert_eq!(mines(&test).len(), 1, "and only with one");
            assert_eq!(test.get::<Heading>().0, heading);
            // The next one follows a spacing away from where the camera was.
            fly(&mut test, [3.9, 4.0]);
            assert_eq!(mines(&test)[1..], [START]);
        }
        // A wide spacing does not lay it farther than 3 mm behind.
        let mut test = test(Drive::Mines);
        test.get_mut::<MineField>().settings.spacing_mm = 40.0;
        test.steps(1).unwrap();
        near(mines(&test)[0], START - DVec3::Y * 3.0);
        // A camera without tentacles is not driven by mines.
        test.get_mut::<MineField>().mines.clear();
        test.app.camera().remove::<Tentacles>();
        test.steps(1).unwrap();
        assert!(mines(&test).is_empty());
    }

    #[test]
    fn mines_are_cleared_when_the_operator_takes_over() {
        let mut test = test(Drive::Thrust);
        fly(&mut test, (0..=9).map(f64::from));
        let other = test.app.world.spawn_empty().id();
        test.app.world.trigger(TakenOver { entity: other });
        assert_eq!(mines(&test).len(), 2, "another camera was taken");
        let entity = test.app.camera_id();
        test.app.world.trigger(TakenOver { entity });
        assert!(mines(&test).is_empty());
        // The next one is laid once the camera is a spacing away from here, not from the last mine.
        fly(&mut test, [12.0]);
        assert!(mines(&test).is_empty());
        assert_eq!(test.get::<MinePush>().0, DVec3::ZERO);
        fly(&mut test, [15.9]);
        assert!(mines(&test).is_empty());
        fly(&mut test, [16.0]);
        assert_eq!(mines(&test), [START + DVec3::Y * 12.0]);
    }

    #[test]
    fn setting_off_clears_mines_if_asked_and_lays_one_where_they_alone_drive() {
        for (drive, alone) in [(Drive::Thrust, false), (Drive::Mines, true)] {
            for clear_mines in [false, true] {
                for heading in [None, Some(DVec3::NEG_X)] {
                    let mut test = test(drive);
                    fly(&mut test, (0..=9).map(f64::from));
                    let before = mines(&test);
                    let other = test.app.world.spawn_empty().id();
                    test.app.world.trigger(SetOff { entity: other, heading, clear_mines: true });
                    assert_eq!(mines(&test), before, "another camera sets off");
                    let entity = test.app.camera_id();
                    test.app.world.trigger(SetOff { entity, heading, clear_mines });
                    let mut left = if clear_mines { Vec::new() } else { before };
                    if alone && heading.is_some() {
                        // Behind the new heading, in the place of the oldest if there are enough.
                        left.push(START + DVec3::Y * 9.0 + DVec3::X * 2.0);
                        left.drain(..left.len().saturating_sub(3));
                    }
                    assert_eq!(mines(&test), left, "{drive:?} {clear_mines} {heading:?}");
                }
            }
        }
    }

    #[test]
    fn the_mines_of_other_cameras_are_left_alone() {
        let mut test = test(Drive::Mines);
        let pose = *test.get::<Pose>();
        let field = MineField { settings: SETTINGS, mines: Mines::default() };
        let tentacles = Tentacles::clone(test.get());
        let other = test.app.world.spawn((pose, Heading(DVec3::Y), field, MinePush(DVec3::ONE), tentacles)).id();
        fly(&mut test, (0..=9).map(f64::from));
        assert!(test.app.world.get::<MineField>(other).unwrap().mines.is_empty());
        assert_eq!(test.app.world.get::<MinePush>(other).unwrap().0, DVec3::ONE);
        assert_eq!(mines(&test).len(), 3);
    }
}
