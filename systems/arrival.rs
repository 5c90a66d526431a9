//! Handles arrivals: marks the segment as flown, and calls the operator if the requested goal is in other gas.

use bevy_ecs::prelude::*;

use crate::components::flight::{Flight, Flown, GoalMissed, State};
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Main};

/// Adds arrival handling to the scene and the components it needs to the camera.
pub fn plugin(app: &mut App) -> Result<()> {
    app.camera().insert_if_new(Flown::default());
    app.add_systems(FlightSystems::Call, note_arrival);
    Ok(())
}

/// Marks a segment flown to its end, and calls the operator if that end is not the goal.
pub fn note_arrival(camera: Single<(&mut Flight, &mut Flown, &GoalMissed), With<Main>>) {
    let (mut flight, mut flown, goal_missed) = camera.into_inner();
    if flight.state != State::Arrived {
        return;
    }
    flown.note(flight.state);
    if let Some(why) = &goal_missed.0 {
        flight.state = State::Operator;
        flight.reason = format!("the gas ends here: {why}");
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::testing::{Room, TestApp};

    fn test(missed: Option<&str>) -> TestApp {
        let mut test = TestApp::new(&Room::new([4; 3]));
        test.app.equip((GoalMissed(missed.map(str::to_owned)), Flown { segment: Some(2), done: vec![0] }));
        plugin(&mut test.app).unwrap();
        test
    }

    /// Enters a state and runs two steps. Returns the state, its reason, and the segments flown.
    fn after(test: &mut TestApp, state: State) -> (State, String, Vec<usize>) {
        let (reason, place) = ("before".to_owned(), DVec3::ONE);
        test.app.camera().insert(Flight { state, reason, place, length_mm: 9.0, turns: 1, escapes: 2 });
        test.steps(2).unwrap();
        let f = test.get::<Flight>();
        assert_eq!((f.place, f.length_mm, f.turns, f.escapes), (DVec3::ONE, 9.0, 1, 2), "nothing else is touched");
        (f.state, f.reason.clone(), test.get::<Flown>().done.clone())
    }

    #[test]
    fn a_segment_is_flown_on_arrival_and_counts_once() {
        let mut test = test(None);
        for state in [State::Flying, State::Operator, State::Ended] {
            assert_eq!(after(&mut test, state), (state, "before".to_owned(), vec![0]), "only arrivals count");
        }
        for _ in 0..2 {
            assert_eq!(after(&mut test, State::Arrived), (State::Arrived, "before".to_owned(), vec![0, 2]));
        }
        // In another segment, and in gas that is in none.
        test.get_mut::<Flown>().segment = Some(1);
        assert_eq!(after(&mut test, State::Arrived).2, [0, 2, 1]);
        test.get_mut::<Flown>().segment = None;
        assert_eq!(after(&mut test, State::Arrived), (State::Arrived, "before".to_owned(), vec![0, 2, 1]));
    }

    #[test]
    fn a_missed_goal_calls_the_operator_on_arrival_with_its_reason() {
        let mut test = test(Some("the cecum lies elsewhere"));
        for state in [State::Flying, State::Operator, State::Ended] {
            assert_eq!(after(&mut test, state), (state, "before".to_owned(), vec![0]));
        }
        let reason = "the gas ends here: the cecum lies elsewhere".to_owned();
        assert_eq!(after(&mut test, State::Arrived), (State::Operator, reason, vec![0, 2]), "and its segment is flown");
    }

    #[test]
    fn other_cameras_arrive_by_themselves_and_the_record_outlives_a_new_scene() {
        let mut test = test(None);
        plugin(&mut App::new()).unwrap();
        let arrived = Flight { state: State::Arrived, ..Flight::default() };
        let missed = GoalMissed(Some("nothing there".to_owned()));
        let other = test.app.world.spawn((arrived, missed, Flown { segment: Some(3), done: Vec::new() })).id();
        after(&mut test, State::Flying);
        assert!(test.app.world.get::<Flown>(other).unwrap().done.is_empty());
        assert_eq!(test.app.world.get::<Flight>(other).unwrap().state, State::Arrived);
        assert_eq!(test.get::<Flown>().done, [0], "adding the system keeps what is there");
    }
}
