//! The guide that leaves the steering to the operator: the body drifts to rest unless it is pushed.

use bevy_ecs::prelude::*;

use crate::components::guide::GuideThrust;
use crate::dynamics::Body;
use crate::dynamics::hand::PUSH_MM_S;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Guide, Main};

/// The settings of the manual guide. It has none.
#[derive(Clone, Copy, Debug, Default, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Manual {}

impl Guide for Manual {
    const NAME: &'static str = "manual";
    const SUMMARY: &'static str = "operator input only";
    const KEY: Option<char> = Some('4');
    const AUTOMATIC: bool = false;

    /// Returns the speed that a full push holds.
    fn cruise_mm_s(&self, _: &Body) -> f64 {
        PUSH_MM_S
    }

    fn plug(&self, app: &mut App) -> Result<()> {
        app.add_systems(FlightSystems::Guide, let_drift);
        Ok(())
    }
}

/// Clears the thrust left by a previous guide.
pub fn let_drift(mut guide: Single<&mut GuideThrust, With<Main>>) {
    **guide = GuideThrust::default();
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::components::guide::MinePush;
    use crate::testing::{Room, TestApp};

    #[test]
    fn the_order_of_an_earlier_guide_is_cleared_in_every_step() {
        let mut test = TestApp::new(&Room::new([10; 3]));
        let v = DVec3::new(1.0, 2.0, 3.0);
        let old = GuideThrust { thrust: v, limit: 4.0, wall: v, look_direction: v, exact: true };
        test.app.equip((old, MinePush(v)));
        let other = test.app.world.spawn(old).id();
        Manual {}.plug(&mut test.app).unwrap();
        for _ in 0..2 {
            test.app.equip(old);
            test.steps(1).unwrap();
            let g = test.get::<GuideThrust>();
            let left = (g.thrust, g.limit, g.wall, g.look_direction, g.exact);
            assert_eq!(left, (DVec3::ZERO, 0.0, DVec3::ZERO, DVec3::ZERO, false));
        }
        assert_eq!(test.app.world.get::<GuideThrust>(other).unwrap().thrust, v, "another camera keeps its order");
        assert_eq!(test.get::<MinePush>().0, v);
    }

    #[test]
    fn nothing_is_automatic_and_a_full_push_holds_45_mm_a_second() {
        const { assert!(!Manual::AUTOMATIC) };
        assert_eq!(Guide::cruise_mm_s(&Manual {}, &Body::default()), 45.0);
    }
}
