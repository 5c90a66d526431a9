//! Looks where the guide sees the lumen open, and a little where the body moves.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::components::camera::Heading;
use crate::components::guide::GuideThrust;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Look, Main};

/// Share of the direction of motion, so that the view does not twitch between two similar openings.
const MOTION: f64 = 0.25;

/// The look.
pub const LOOK: Look = Look { name: "ahead", summary: "looks where the guide steers", plug };

fn plug(app: &mut App) -> Result<()> {
    app.add_systems(FlightSystems::Look, look_ahead);
    Ok(())
}

/// Blends the guide's direction with that of the motion.
pub fn look_ahead(camera: Single<(&Heading, &mut GuideThrust), With<Main>>) {
    let (heading, mut guide) = camera.into_inner();
    if guide.look_direction != DVec3::ZERO {
        guide.look_direction += heading.0 * MOTION;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Room, TestApp};

    #[test]
    fn the_direction_of_motion_counts_a_quarter_and_nothing_is_made_of_nothing() {
        let mut test = TestApp::new(&Room::new([20; 3]));
        test.app.equip((Heading(DVec3::X), GuideThrust { look_direction: DVec3::Y, ..GuideThrust::default() }));
        plug(&mut test.app).unwrap();
        test.steps(1).unwrap();
        assert_eq!(test.get::<GuideThrust>().look_direction, DVec3::new(0.25, 1.0, 0.0));
        test.get_mut::<GuideThrust>().look_direction = DVec3::ZERO;
        test.steps(1).unwrap();
        assert_eq!(test.get::<GuideThrust>().look_direction, DVec3::ZERO);
    }
}
