//! The guide that steers by tentacles: they keep the camera off the wall and find the path, and mines keep it from turning back.

use bevy_ecs::prelude::*;
use bevy_ecs::query::QueryData;

use crate::components::camera::{Body, Heading, Pose};
use crate::components::flight::{Goal, Watch};
use crate::components::guide::{GuideThrust, MineField, Tentacles};
use crate::components::scan::Scan;
use crate::dynamics;
use crate::dynamics::tentacles::{TentacleSettings, approach, steer};
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Guide, Main};
use crate::space::first_crossing;
use crate::systems::sense;

impl Guide for TentacleSettings {
    const NAME: &'static str = "tentacles";
    const SUMMARY: &'static str = "sensory rays keep off the wall and find the path ahead";
    const KEY: Option<char> = Some('1');

    fn check(&self) -> Result<()> {
        Self::check(self)
    }

    fn cruise_mm_s(&self, _: &dynamics::Body) -> f64 {
        self.cruise_mm_s
    }

    fn plug(&self, app: &mut App) -> Result<()> {
        sense::plug(app, *self)?;
        app.add_systems(FlightSystems::Guide, guide_by_tentacles);
        Ok(())
    }
}

/// The camera that tentacles steer.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct TentacleGuide {
    pose: &'static Pose,
    heading: &'static Heading,
    body: &'static Body,
    tentacles: &'static Tentacles,
    guide: &'static mut GuideThrust,
    mines: Option<&'static MineField>,
    goal: Option<&'static Goal>,
    watch: Option<&'static Watch>,
}

/// Chooses the direction from the tentacle readings.
pub fn guide_by_tentacles(scan: Single<&Scan, With<Main>>, camera: Single<TentacleGuide, With<Main>>) {
    let TentacleGuideItem { pose, heading, body, tentacles, mut guide, mines, goal, watch } = camera.into_inner();
    let mines = mines.map(|m| (&m.mines, &m.settings));
    // While the guide looks for another direction, its whole trail is forbidden ground, not only the last few mines.
    let trail = watch.map_or((&[][..], 0.0), |w| w.rescue.forbidden());
    let settings = watch.map_or(tentacles.settings, |w| w.rescue.temper(&tentacles.settings));
    let s = steer(
        (&tentacles.directions, &tentacles.lengths),
        pose.position,
        heading.0,
        mines,
        trail,
        &settings,
        body.0.drag_per_s,
    );
    *guide = GuideThrust {
        thrust: s.thrust,
        limit: s.limit,
        wall: s.wall,
        look_direction: s.look,
        ..GuideThrust::default()
    };
    // A goal in direct view attracts the camera, as the paper's D_t does; a goal behind a wall does not.
    if let Some(goal) = goal
        && let Some((thrust, direction)) = approach(pose.position, goal.at, &tentacles.settings, body.0.drag_per_s)
        && first_crossing(&scan.0, pose.position, direction, pose.position.distance(goal.at)).is_none()
    {
        guide.thrust = thrust;
        guide.limit = thrust.length();
        guide.look_direction = direction;
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::dynamics::Attitude;
    use crate::dynamics::mines::{MineSettings, Mines};
    use crate::dynamics::monitor::MonitorSettings;
    use crate::dynamics::rescue::{Rescue, RescueAction};
    use crate::dynamics::tentacles::Drive;
    use crate::dynamics::trap::TentacleReading;
    use crate::testing::{Room, TestApp};

    const AXES: [DVec3; 6] = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    /// Cruise speed times drag: what a body needs to fly at cruise speed, mm/s².
    const CRUISE: f64 = 30.0 * 6.0;

    /// A camera with six tentacles along the axes, whose guide has just replaced another.
    fn six(room: &Room, settings: TentacleSettings) -> TestApp {
        let mut test = TestApp::new(room);
        test.app.equip((Body(dynamics::Body::default()), Heading::default()));
        Guide::plug(&settings, &mut test.app).unwrap();
        test.get_mut::<Tentacles>().directions = AXES.to_vec();
        test.get_mut::<Tentacles>().lengths = vec![0.0; 6];
        test
    }

    /// Runs one step after the order of an earlier guide.
    fn order(test: &mut TestApp) -> GuideThrust {
        let old = DVec3::splat(7e3);
        test.app.equip(GuideThrust { thrust: old, limit: 1.0, wall: old, look_direction: old, exact: true });
        test.steps(1).unwrap();
        *test.get::<GuideThrust>()
    }

    fn near(a: DVec3, b: DVec3) {
        assert!(a.distance(b) < 1e-6 * (1.0 + b.length()), "{a}, not {b}");
    }

    #[test]
    fn the_longest_way_is_taken_at_cruise_speed_and_walls_push_away() {
        let room = Room::new([20, 60, 24]);
        let mut test = six(&room, TentacleSettings::default());
        test.place(DVec3::new(3.0, 30.0, 12.0));
        // The tentacles measure 17 and 3, 30 and 30, 12 and 12 mm. Only the wall 3 mm away is within 10 mm.
        let o = order(&mut test);
        near(o.thrust, DVec3::X * CRUISE);
        near(o.look_direction, DVec3::X);
        let p = 10.0 / 3.0;
        let wall = DVec3::X * ((p - 1.0) * p * p * 2.0 * 60.0 / 6.0);
        near(o.wall, wall);
        assert_eq!((o.limit, o.exact), (CRUISE, false));
        // With a heading along +y, the directions across count a quarter, the one back not at all.
        test.get_mut::<Heading>().0 = DVec3::Y;
        let o = order(&mut test);
        let pull = DVec3::new(0.25 * (17.0 * 17.0 - 9.0), 900.0, 0.0).normalize();
        near(o.thrust, pull * (CRUISE * (0.3 + 0.7 * pull.y)));
        near(o.look_direction, DVec3::new(0.25 * (17f64.powi(4) - 81.0), 810_000.0, 0.0).normalize());
        near(o.wall, wall);
        // The view has no part in it; the heading has.
        test.get_mut::<Pose>().attitude = Attitude::new(DVec3::NEG_Y, DVec3::Z);
        near(order(&mut test).thrust, o.thrust);
        // In the middle nothing is within reach of the wall's push, and no side is better than another.
        test.get_mut::<Heading>().0 = DVec3::ZERO;
        test.get_mut::<Tentacles>().settings.wall_mm = 9.0;
        test.place(room.centre());
        let o = order(&mut test);
        assert!(o.wall == DVec3::ZERO && o.look_direction == DVec3::ZERO || o.thrust.length() <= CRUISE + 1e-9);
        assert_eq!(o.wall, DVec3::ZERO);
    }

    #[test]
    fn a_goal_in_sight_attracts_and_one_behind_a_wall_does_not() {
        let room = Room::new([20, 140, 20]);
        let mut test = six(&room, TentacleSettings::default());
        test.app.camera().insert(Heading(DVec3::Y));
        let at = DVec3::new(4.0, 20.0, 10.0);
        test.place(at);
        let without = order(&mut test);
        assert!(without.wall.x > 1.0, "it is 4 mm from the wall");
        let mut towards = |to: DVec3| {
            test.app.camera().insert(Goal { at: to, within_mm: 1.0, other_end: DVec3::ZERO });
            let o = order(&mut test);
            near(o.wall, without.wall);
            assert!(!o.exact);
            o
        };
        // Visible, and so near to the wall behind it that the ray would meet the wall next.
        for (to, share) in [
            (DVec3::new(16.0, 60.0, 3.0), 1.0),
            (DVec3::new(19.5, 20.0, 10.0), 1.0),
            (DVec3::new(4.0, 14.0, 10.0), 0.4),
            (DVec3::new(4.0, 79.9, 10.0), 1.0),
        ] {
            let (o, d) = (towards(to), (to - at).normalize());
            near(o.thrust, d * (CRUISE * share));
            near(o.look_direction, d);
            assert!((o.limit - CRUISE * share).abs() < 1e-9, "{}", o.limit);
        }
        // Behind the wall, beyond 60 mm, and where the camera is.
        for to in [DVec3::new(26.0, 30.0, 10.0), DVec3::new(-3.0, 20.0, 10.0), DVec3::new(4.0, 80.1, 10.0), at] {
            let o = towards(to);
            near(o.thrust, without.thrust);
            near(o.look_direction, without.look_direction);
            assert_eq!(o.limit, CRUISE);
        }
    }

    #[test]
    fn a_mine_ahead_is_avoided_and_mines_that_drive_leave_no_thrust() {
        let room = Room::new([20, 60, 20]);
        let mut test = six(&room, TentacleSettings::default());
        let mines = MineSettings::default();
        let mut field = MineField { settings: mines, mines: Mines::default() };
        // A mine at y = 40, 10 mm ahead of the camera. Another camera's mine lies behind.
        field.mines.follow(room.centre().with_y(40.0), &mines);
        field.mines.follow(room.centre().with_y(50.0), &mines);
        let mut other = field.clone();
        other.mines.clear();
        other.mines.follow(room.centre().with_y(20.0), &mines);
        other.mines.follow(room.centre().with_y(30.0), &mines);
        let pose = *test.get::<Pose>();
        let kept = GuideThrust { limit: 3.0, ..GuideThrust::default() };
        let other = (pose, Heading::default(), Body::clone(test.get()), Tentacles::clone(test.get()), kept, other);
        let other = test.app.world.spawn(other).id();
        test.app.camera().insert(field);
        near(order(&mut test).thrust, DVec3::NEG_Y * CRUISE);
        assert_eq!(test.app.world.get::<GuideThrust>(other).unwrap().limit, 3.0, "another camera keeps its order");
        // The mines drive: neither thrust nor goal, and no limit. The view still turns to the open side.
        test.get_mut::<Tentacles>().settings.drive = Drive::Mines;
        test.app.camera().insert(Goal { at: room.centre().with_y(35.0), within_mm: 1.0, other_end: DVec3::ZERO });
        let o = order(&mut test);
        assert_eq!((o.thrust, o.limit), (DVec3::ZERO, f64::INFINITY));
        near(o.look_direction, DVec3::NEG_Y);
    }

    /// A flight along +x has got stuck in a local minimum and looks for another direction.
    #[test]
    fn a_camera_that_leaves_a_trap_forbids_its_trail_and_fears_the_wall_less() {
        let room = Room::new([180, 24, 24]);
        let mut test = six(&room, TentacleSettings::default());
        let at = |x: f64| DVec3::new(x, 12.0, 12.0);
        let lengths = [85.0, 95.0, 12.0, 12.0, 12.0, 12.0];
        let reading = TentacleReading { directions: &AXES, lengths: &lengths, heading: DVec3::X, radius_mm: 1.5 };
        let (mut rescue, monitor) = (Rescue::default(), MonitorSettings::default());
        let escapes = (0..600).any(|n| {
            let x = 5.0 + 30.0 * (f64::from(n) / 120.0).min(3.0);
            rescue.follow(at(x), 1.0 / 120.0, Some(&reading), None, &monitor) != RescueAction::GoOn
        });
        assert!(escapes && rescue.is_escaping());
        let place = at(95.0).with_y(4.0);
        let p = 10.0 / 4.0;
        let wall = DVec3::Y * ((p - 1.0) * p * p * 2.0 * 60.0 / 6.0);
        test.place(at(95.0));
        assert!(order(&mut test).thrust.x < -0.9 * CRUISE, "without a trail the long way back is the best");
        test.place(place);
        near(order(&mut test).wall, wall);
        test.app.camera().insert(Watch { settings: monitor, rescue });
        near(order(&mut test).wall, wall * 0.1);
        test.place(at(95.0));
        assert!(order(&mut test).thrust.x > 0.9 * CRUISE, "the trail is forbidden: {}", order(&mut test).thrust);
        assert_eq!(test.get::<Tentacles>().settings, TentacleSettings::default(), "the settings themselves stay");
        test.get_mut::<Watch>().rescue.restart();
        assert!(order(&mut test).thrust.x < -0.9 * CRUISE);
    }
}
