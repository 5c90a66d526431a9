//! Adds a command to colvis: `widths` prints how wide the colon is along its path.
//!
//! `cargo run --release --example own_command -- widths scan.nii.gz --every 50` (also `--help`)

use std::path::PathBuf;
use std::process::ExitCode;

use colvis::app::{FlightRequest, Scene};
use colvis::cli::{Program, Session};
use colvis::error::Result;

/// The command's arguments, by `clap` 4. It also takes the options common to all commands.
#[derive(clap::Args)]
struct Widths {
    /// Scan to open; the embedded phantom if left out
    input: Option<PathBuf>,
    /// Print one line every MM millimetres
    #[arg(long, value_name = "MM", default_value_t = 100.0)]
    every: f64,
}

fn widths(args: &Widths, session: &Session<'_>) -> Result<()> {
    let scene = Scene { steering: Scene::guided_by("path").steering, ..session.scene() };
    let bar = session.progress_bar();
    let flight = session.open(args.input.as_deref())?.flight(scene, &FlightRequest::default())?;
    drop(bar);
    let Some(route) = flight.setup().fields.route() else { return Ok(()) };
    let lines = (0..).map(|n| f64::from(n) * args.every.max(1.0)).take_while(|&s| s < route.length_mm());
    let text = lines.map(|s| format!("{s:6.0} mm  {:5.1} mm wide", 2.0 * route.clearance(s)));
    session.print(text.collect::<Vec<_>>().join("\n"))
}

fn program() -> Program {
    Program::default().command("widths", "Prints how wide the colon is along its way", widths)
}

fn main() -> ExitCode {
    program().run()
}

#[test]
fn it_is_a_command_like_any_other() {
    assert_eq!(program().run_from(["colvis", "--threads", "2", "widths", "--every", "200"]), ExitCode::SUCCESS);
    assert_eq!(program().run_from(["colvis", "widths", "no-such.nii"]), ExitCode::from(3));
    assert!(program().parse(["colvis", "widths", "--evry", "7"]).is_err());
    assert!(program().parse(["colvis", "fly", "--headless"]).is_ok());
}
