//! Adds an action to the window of colvis: the key Z goes 50 mm back along the path and stops there.
//!
//! `cargo run --release --example own_action`

use std::borrow::Cow;

use colvis::app::FlightApp;
use colvis::cli::Program;
use colvis::components::input::{FlightCommand, HandCommand};
use colvis::panel::{ActionEntry, Context, Requests};

const BACK_MM: f64 = 50.0;

const GO_BACK: ActionEntry = ActionEntry {
    id: "go-back",
    text: "go 50 mm back and stop",
    key: Some('z'),
    possible: has_flown,
    run: go_back,
    ..ActionEntry::BASE
};

/// Greys the action out where there is no way back. The reason follows "not while".
fn has_flown(flight: &FlightApp) -> Result<(), Cow<'static, str>> {
    if flight.survey().progress().0 > 0.0 { Ok(()) } else { Err("the flight is at its start".into()) }
}

fn go_back(context: &Context<'_>, requests: &mut Requests) {
    let (share, length_mm) = context.flight.survey().progress();
    requests.command(FlightCommand::Seek((share - BACK_MM / length_mm).max(0.0)));
    requests.command(HandCommand::Pause(true));
    requests.say("look again");
}

fn main() -> std::process::ExitCode {
    Program::default().action(GO_BACK).run()
}

#[test]
fn it_is_possible_on_the_way() -> colvis::error::Result<()> {
    use colvis::app::{FlightRequest, Scan, Scene};
    let mut flight = Scan::phantom(1)?.flight(Scene::default(), &FlightRequest::default())?;
    assert_eq!(has_flown(&flight), Err("the flight is at its start".into()));
    flight.fly(1.0)?;
    assert_eq!(has_flown(&flight), Ok(()));
    // Neither its name nor its key may be taken by the window.
    Program::default().action(GO_BACK).check()?;
    let mut taken = GO_BACK;
    taken.key = Some('w');
    assert!(Program::default().action(taken).check().is_err());
    Ok(())
}
