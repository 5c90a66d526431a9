//! Simulated time, counted in whole steps and advanced at the end of each.

use bevy_ecs::prelude::*;

use crate::components::clock::Clock;
use crate::error::Result;
use crate::schedule::{App, FlightSystems};

/// Adds the clock to the scene.
pub fn plugin(app: &mut App) -> Result<()> {
    app.world.init_resource::<Clock>();
    app.add_systems(FlightSystems::Clock, tick);
    Ok(())
}

/// Advances the clock by one step.
pub fn tick(mut clock: ResMut<Clock>) {
    clock.tick += 1;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Room, TestApp};

    #[derive(Resource, Default)]
    struct Seen(Vec<u64>);

    #[test]
    fn steps_are_counted_at_their_end_and_frames_are_not() {
        let mut test = TestApp::new(&Room::new([4; 3]));
        test.app.world.init_resource::<Seen>();
        let see = |clock: Res<Clock>, mut seen: ResMut<Seen>| seen.0.push(clock.tick);
        test.app.add_systems(FlightSystems::Input, see).add_systems(FlightSystems::Log, see);
        test.steps(3).unwrap();
        test.frame().unwrap();
        test.frame().unwrap();
        assert_eq!(test.app.world.resource::<Seen>().0, [0, 0, 1, 1, 2, 2], "a step begins and ends with its number");
        assert_eq!(test.tick(), 3);
        test.steps(117).unwrap();
        let clock = *test.app.world.resource::<Clock>();
        assert_eq!((clock.hz, clock.seconds(), clock.dt()), (120, 1.0, 1.0 / 120.0));
    }

    #[test]
    fn a_new_scene_does_not_turn_the_clock_back() {
        let mut app = App::new();
        app.world.insert_resource(Clock { tick: 41, ..Clock::default() });
        plugin(&mut app).unwrap();
        app.build().unwrap();
        app.step().unwrap();
        assert_eq!(app.world.resource::<Clock>().tick, 42);
    }
}
