//! Misbehaving plug-ins in the real window. Whatever they do, the window ends in order, log and statistics are whole, and whoever did
//! it is named.
//!
//! This program is both: without `COLVIS_CASE` it runs all cases on a virtual screen, each in a process of its own; with it, it is
//! colvis with the plug-in of that case.

#[cfg(not(all(feature = "window", target_os = "linux")))]
fn main() {}

#[cfg(all(feature = "window", target_os = "linux"))]
fn main() -> std::process::ExitCode {
    match std::env::var("COLVIS_CASE") {
        Ok(case) => cases::program(&case).run(),
        Err(_) => judge::all(),
    }
}

#[cfg(all(feature = "window", target_os = "linux"))]
mod cases {
    use std::sync::Arc;

    use bevy_ecs::prelude::*;
    use colvis::app::{Overlay, overlay::Align};
    use colvis::cli::Program;
    use colvis::components::camera::Pose;
    use colvis::components::output::Picture;
    use colvis::components::scan::Scan as ScanData;
    use colvis::egui::{Align2, Color32, FontId, RichText, Shape, Stroke, Ui, pos2};
    use colvis::error::Result;
    use colvis::panel::{ActionEntry, Context, Panel, PanelEntry, Requests};
    use colvis::schedule::{App, FlightSystems, Main, Plugin, Slot, note, report_fault};
    use colvis::systems::present::{self, Presenter};
    use glam::DVec3;

    /// What a case must come to: its name, the exit status, the fewest lines of the log (of 30; the step in which something is taken
    /// may be missing), and what is said. Nothing is said where that is empty.
    pub(crate) const ALL: [(&str, i32, usize, &str); 30] = [
        ("nothing", 0, 30, ""),
        ("presents, too", 0, 30, ""),
        ("presents badly", 0, 30, "presenter dark room: panicked: presented badly"),
        ("fills the renderer", 0, 30, "there is no image to show: the renderer dark room"),
        ("fills the presentation", 0, 30, "there is no image to show"),
        ("takes the picture", 0, 29, "plug-in bad: took Picture from the camera"),
        ("despawns the camera", 0, 29, "plug-in bad: despawned the camera"),
        ("despawns the scan", 0, 29, "plug-in bad: despawned the scan"),
        ("takes the pose", 0, 29, "plug-in bad: took Pose from the camera"),
        ("steps badly", 0, 30, "stepped badly"),
        ("paints badly", 0, 30, "painted badly"),
        ("commands badly", 0, 30, "commanded badly"),
        ("writes nonsense", 0, 30, "invalid position"),
        ("breaks pictures", 0, 30, "keeps its size"),
        ("reports from a worker", 0, 30, "worked badly"),
        ("drops badly", 0, 30, "plug-in bad panicked when it was dropped: dropped badly"),
        ("draws badly", 0, 30, "drew badly"),
        ("draws absurdly", 0, 30, ""),
        ("panel panics", 0, 30, "laid out badly"),
        ("panel cannot be made", 0, 30, "made badly"),
        ("panel with large letters", 0, 30, "panel bad"),
        ("panel with absurd shapes", 0, 30, "panel bad draws shapes without a reasonable size"),
        ("panel with absurd places", 0, 30, "panel bad draws shapes without a reasonable size"),
        ("two panels panic", 0, 30, "laid out badly"),
        ("action panics", 0, 30, "action bad panicked: acted badly"),
        ("action is asked badly", 0, 30, "action bad panicked: asked badly"),
        ("asks for an unknown action", 0, 30, "action \"jump\" does not exist"),
        ("asks for a held key", 0, 30, "action \"forward\" cannot be requested, because it works by its key alone"),
        ("tells badly", 0, 30, "plug-in bad: panicked: told badly"),
        ("action asks for itself", 0, 30, "action bad requests itself"),
    ];

    /// Returns colvis with the plug-in of a case.
    pub(crate) fn program(case: &str) -> Program {
        let bad = Program::default();
        let panel = |make| PanelEntry { name: "bad", title: "Bad", shown: true, make, ..PanelEntry::NONE };
        let overlay = |draw| Overlay { name: "bad", shown: true, draw, ..Overlay::PLAIN };
        match case {
            "nothing" => bad,
            "presents, too" => bad.plugin(("bad", |app: &mut App| present_by(app, DarkRoom { panics: false }))),
            "presents badly" => bad.plugin(("bad", |app: &mut App| present_by(app, DarkRoom { panics: true }))),
            "fills the renderer" => bad.plugin(("bad", |app: &mut App| app.fill(Slot::Renderer, "dark room"))),
            "fills the presentation" => bad.plugin(("bad", |app: &mut App| app.fill(Slot::Presentation, "dark room"))),
            "takes the picture" => {
                bad.plugin(("bad", |app: &mut App| camera_at_ten(app, |mut c| _ = c.remove::<Picture>())))
            }
            "takes the pose" => bad.plugin(("bad", |app: &mut App| camera_at_ten(app, |mut c| _ = c.remove::<Pose>()))),
            "despawns the camera" => bad.plugin(("bad", |app: &mut App| camera_at_ten(app, |c| c.despawn()))),
            "despawns the scan" => bad.plugin(("bad", |app: &mut App| {
                let scan = |mut n: Local<u32>, scan: Single<Entity, (With<Main>, With<ScanData>)>, mut c: Commands| {
                    *n += 1;
                    if *n == 10 {
                        c.entity(*scan).despawn();
                    }
                };
                app.add_systems(FlightSystems::Sense, scan);
                Ok(())
            })),
            "steps badly" => bad.plugin(("bad", |app: &mut App| step(app, || panic!("stepped badly")))),
            "paints badly" => bad.plugin(("bad", |app: &mut App| {
                app.add_systems(FlightSystems::PostProcess, |_: Single<&Picture, With<Main>>| panic!("painted badly"));
                Ok(())
            })),
            "commands badly" => bad.plugin(("bad", |app: &mut App| {
                app.add_systems(FlightSystems::Log, |mut c: Commands| {
                    c.queue(|_: &mut World| panic!("commanded badly"));
                });
                Ok(())
            })),
            "writes nonsense" => bad.plugin(("bad", |app: &mut App| {
                app.add_systems(FlightSystems::Clock, |mut p: Single<&mut Pose, With<Main>>| p.position = DVec3::NAN);
                Ok(())
            })),
            "breaks pictures" => bad.plugin(("bad", |app: &mut App| {
                app.add_systems(FlightSystems::PostProcess, |mut p: Single<&mut Picture, With<Main>>| {
                    p.frame.resize(0, 0);
                });
                Ok(())
            })),
            "reports from a worker" => bad.plugin(("bad", |app: &mut App| {
                step(app, || {
                    rayon::broadcast(|_| note("a worker", "has a word to say"));
                    rayon::scope(|s| s.spawn(|_| report_fault("part of it", "worked badly")));
                })
            })),
            "drops badly" => bad.plugin(("bad", |app: &mut App| {
                app.world.insert_resource(Grenade);
                Ok(())
            })),
            "draws badly" => bad.overlay(overlay(|_, _| panic!("drew badly"))),
            "draws absurdly" => bad.overlay(overlay(|_, canvas| {
                for number in [5000.0, 1e9, f32::NAN, f32::INFINITY, -1.0, f32::MAX] {
                    canvas.label([9.0, 9.0], Align::Left, number, "large", [255; 3]);
                    canvas.panel([0.0; 2], [number, 5.0], [255; 3], number);
                }
            })),
            "panel panics" => bad.panel(panel(|| Box::new(Bad(|_| panic!("laid out badly"))))),
            "panel cannot be made" => bad.panel(panel(|| panic!("made badly"))),
            "panel with large letters" => bad.panel(panel(|| Box::new(Bad(letters)))),
            "panel with absurd shapes" => bad.panel(panel(|| Box::new(Bad(shapes)))),
            "panel with absurd places" => bad.panel(panel(|| Box::new(Bad(places)))),
            "two panels panic" => bad
                .panel(panel(|| Box::new(Bad(|_| panic!("laid out badly")))))
                .panel(PanelEntry { name: "worse", ..panel(|| Box::new(Bad(|_| panic!("laid out badly, too")))) }),
            "action panics" => acts(bad, ActionEntry { run: |_, _| panic!("acted badly"), ..ActionEntry::BASE }),
            "action is asked badly" => {
                acts(bad, ActionEntry { possible: |_| panic!("asked badly"), ..ActionEntry::BASE })
            }
            "action asks for itself" => {
                acts(bad, ActionEntry { run: |_, requests| requests.action("bad"), ..ActionEntry::BASE })
            }
            "asks for an unknown action" => bad
                .panel(panel(|| Box::new(Asks(|context, ui, requests| context.button(ui, "Jump", "jump", requests))))),
            "asks for a held key" => bad.panel(panel(|| Box::new(Asks(|_, _, requests| requests.action("forward"))))),
            "tells badly" => bad.plugin(TellsBadly),
            other => panic!("there is no case {other:?}"),
        }
    }

    #[derive(Resource)]
    struct Grenade;

    impl Drop for Grenade {
        fn drop(&mut self) {
            panic!("dropped badly");
        }
    }

    struct DarkRoom {
        panics: bool,
    }

    impl Presenter for DarkRoom {
        fn name(&self) -> &'static str {
            "dark room"
        }

        fn present(&mut self, _: &Picture) {
            assert!(!self.panics, "presented badly");
        }
    }

    fn present_by(app: &mut App, room: DarkRoom) -> Result<()> {
        let camera = app.camera_id();
        present::plug(app, camera, room);
        Ok(())
    }

    /// Calls `work` at the tenth step.
    fn step(app: &mut App, work: impl Fn() + Send + Sync + 'static) -> Result<()> {
        let work = Arc::new(work);
        app.add_systems(FlightSystems::Trail, move |mut n: Local<u32>| {
            *n += 1;
            if *n == 10 {
                work();
            }
        });
        Ok(())
    }

    /// Hands the camera to `steal` at the tenth step.
    fn camera_at_ten(app: &mut App, steal: fn(EntityWorldMut)) -> Result<()> {
        app.add_systems(
            FlightSystems::Trail,
            move |mut n: Local<u32>, camera: Single<Entity, (With<Main>, With<Pose>)>, mut c: Commands| {
                *n += 1;
                if *n == 10 {
                    let camera = *camera;
                    c.queue(move |world: &mut World| steal(world.entity_mut(camera)));
                }
            },
        );
        Ok(())
    }

    /// Adds an action, and a panel that asks for it.
    fn acts(program: Program, action: ActionEntry) -> Program {
        let make = || {
            Box::new(Asks(|context, ui, requests| {
                context.button(ui, "Bad", "bad", requests);
                requests.action("bad");
            })) as Box<dyn Panel>
        };
        let panel = PanelEntry { name: "asks", title: "Asks", shown: true, make, ..PanelEntry::NONE };
        program.action(ActionEntry { id: "bad", ..action }).panel(panel)
    }

    struct Asks(fn(&Context<'_>, &mut Ui, &mut Requests));

    impl Panel for Asks {
        fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
            (self.0)(context, ui, requests);
        }
    }

    struct TellsBadly;

    impl Plugin for TellsBadly {
        fn name(&self) -> std::borrow::Cow<'static, str> {
            "bad".into()
        }

        fn build(&self, _: &mut App) -> Result<()> {
            Ok(())
        }

        fn stats(&self, _: &App) -> Option<serde_json::Value> {
            panic!("told badly");
        }
    }

    struct Bad(fn(&mut Ui));

    impl Panel for Bad {
        fn ui(&mut self, _: &Context<'_>, ui: &mut Ui, _: &mut Requests) {
            (self.0)(ui);
        }
    }

    fn letters(ui: &mut Ui) {
        ui.label(RichText::new("A").size(5000.0));
    }

    fn shapes(ui: &mut Ui) {
        for number in [1e9, f32::INFINITY, f32::NAN, -1e30, f32::MAX] {
            ui.painter().circle_filled(pos2(9.0, 9.0), number, Color32::RED);
            ui.painter().add(Shape::line(vec![pos2(0.0, 0.0), pos2(number, 9.0)], Stroke::new(number, Color32::RED)));
        }
    }

    fn places(ui: &mut Ui) {
        for number in [1e9, f32::INFINITY, f32::NAN] {
            let at = pos2(number, -number);
            ui.painter().text(at, Align2::LEFT_TOP, "far", FontId::proportional(14.0), Color32::RED);
            ui.painter().add(Shape::Vec(vec![Shape::circle_filled(at, 3.0, Color32::RED)]));
        }
    }
}

#[cfg(all(feature = "window", target_os = "linux"))]
mod judge {
    use std::path::Path;
    use std::process::{Child, Command, ExitCode, Stdio};
    use std::sync::Arc;
    use std::time::{Duration, Instant};

    use colvis::components::output::LogLine;
    use colvis::progress::Progress;
    use colvis::volume::{Grid, Volume, io};
    use glam::{DMat3, DVec3};

    use super::cases::ALL;
    use super::skips::skip;
    use super::xvfb;

    const PATIENCE: Duration = Duration::from_secs(120);

    /// Runs the cases whose names contain the argument, if there is one.
    pub(crate) fn all() -> ExitCode {
        let wanted = std::env::args().skip(1).find(|a| !a.starts_with('-')).unwrap_or_default();
        if !xvfb::is_there("Xvfb") {
            skip("screen", "there is no Xvfb");
            return ExitCode::SUCCESS;
        }
        let (mut server, display) = xvfb::start("640x480x24", &[]);
        let dir = tempfile::tempdir().unwrap();
        write_tube(&dir.path().join("tube.nii"));
        let mut failed = 0;
        for case in ALL.iter().filter(|c| format!("misbehaving {}", c.0).contains(&wanted)) {
            let outcome = judge(dir.path(), &display, *case);
            println!("test misbehaving {} ... {}", case.0, if outcome.is_ok() { "ok" } else { "FAILED" });
            if let Err(why) = outcome {
                failed += 1;
                println!("{why}");
            }
        }
        let _ = server.kill();
        let _ = server.wait();
        println!("\ntest result: {} cases, {failed} failed", ALL.len());
        ExitCode::from(u8::from(failed > 0))
    }

    /// Writes a square tube of 20 mm along y.
    fn write_tube(path: &Path) {
        let grid = Grid::new([32, 80, 32], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let gas = |n: usize| {
            let (i, j, k) = (n % 32, n / 32 % 80, n / (32 * 80));
            (6..26).contains(&i) && (4..76).contains(&j) && (6..26).contains(&k)
        };
        let data = (0..32 * 80 * 32).map(|n| if gas(n) { -1000 } else { 40 }).collect();
        io::save(path, &Volume::new(grid, data), &Arc::new(Progress::new())).unwrap();
    }

    /// Flies a quarter of a second in a window and returns what is wrong.
    fn judge(dir: &Path, display: &str, (case, status, fewest, word): (&str, i32, usize, &str)) -> Result<(), String> {
        let (log, stats) = (dir.join("f.jsonl"), dir.join("s.json"));
        for file in [&log, &stats] {
            // Of the case before.
            let _ = std::fs::remove_file(file);
        }
        let args =
            "fly tube.nii --size 320x240 --seconds 0.25 --log f.jsonl --stats s.json --from 16,14,16 --to 16,70,16";
        let home = dir.join("home");
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(args.split(' '))
            .current_dir(dir)
            .env("COLVIS_CASE", case)
            .env("DISPLAY", display)
            .env_remove("WAYLAND_DISPLAY")
            .env("XDG_CONFIG_HOME", &home)
            .env("XDG_DATA_HOME", &home)
            .env("XDG_STATE_HOME", &home)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let said = std::thread::spawn({
            let err = child.stderr.take().unwrap();
            move || std::io::read_to_string(err).unwrap_or_default()
        });
        let ended = wait(&mut child);
        let said = said.join().unwrap();
        let Some(ended) = ended else { return Err(format!("it hangs: {said}")) };
        let lines = std::fs::read_to_string(&log).unwrap_or_default();
        let lines: Result<Vec<LogLine>, _> = lines.lines().map(serde_json::from_str).collect();
        let lines = lines.map_err(|e| format!("the log has a line that is not whole: {e}"))?;
        let stats = std::fs::read_to_string(&stats).unwrap_or_default();
        let whole = serde_json::from_str::<serde_json::Value>(&stats).is_ok();
        let notes: Vec<&str> = said.lines().filter(|l| l.starts_with("note: ") || l.starts_with("error: ")).collect();
        let quiet = !notes.iter().any(|l| l.contains("panic") || l.contains("bad"));
        let told = if word.is_empty() { quiet } else { said.contains(word) };
        // The panels of colvis itself are never in the wrong.
        let told = told && (!said.contains("panel flight"));
        if ended == status && lines.len() >= fewest && whole && told {
            return Ok(());
        }
        let told = if told { "" } else { ", not told" };
        Err(format!("status {ended}, {} lines, statistics whole: {whole}{told}; it says:\n{said}", lines.len()))
    }

    /// Waits for the end of a program and returns its status; `None` if it does not end by itself.
    fn wait(child: &mut Child) -> Option<i32> {
        let begun = Instant::now();
        loop {
            if let Some(status) = child.try_wait().unwrap() {
                return Some(status.code().unwrap_or(-1));
            }
            if begun.elapsed() > PATIENCE {
                let _ = child.kill();
                let _ = child.wait();
                return None;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

#[cfg(all(feature = "window", target_os = "linux"))]
#[path = "../support/skips.rs"]
mod skips;

#[cfg(all(feature = "window", target_os = "linux"))]
#[path = "../support/xvfb.rs"]
mod xvfb;
