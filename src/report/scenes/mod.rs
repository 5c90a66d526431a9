//! `report scenes`: the bytes and milliseconds saved by each part that a scene leaves out, and what threads give.

mod threads;

use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use crate::app::explain::explain;
use crate::app::{FlightApp, FlightRequest, ImageSettings, Plan, Scan, Scene, Steering};
use crate::components::guide::Tentacles;
use crate::dynamics::STEP_HZ;
use crate::error::Result;
use crate::fields::Lumen;
use crate::progress::Progress;
use crate::render::{Light, Settings};
use crate::report::page::Page;
use crate::report::plot::{Plot, Point, Series};
use crate::report::table::{Table, table};
use crate::report::{Effort, median};
use crate::schedule::Plugins;
use crate::space::PreparedVolume;
use crate::space::flags::Flags;
use crate::systems::sense;

/// Number of steps between two readings of the clock.
const CHUNK: usize = 24;
/// Pictures per second that the steps are compared with.
const FPS: f64 = 30.0;
/// Bytes per MiB.
const MIB: f64 = 1_048_576.0;
/// Index of the volume, which every scene has: the first entry of the built parts.
const VOLUME: usize = 1;

/// The shipped scenes, by their file names.
const SHIPPED: [(&str, &str); 8] = [
    ("tentacles", include_str!("../../../assets/scenes/tentacles.toml")),
    ("paper", include_str!("../../../assets/scenes/paper.toml")),
    ("tentacles-for-pouches", include_str!("../../../assets/scenes/tentacles-for-pouches.toml")),
    ("tentacles-without-mines", include_str!("../../../assets/scenes/tentacles-without-mines.toml")),
    ("potential", include_str!("../../../assets/scenes/potential.toml")),
    ("path", include_str!("../../../assets/scenes/path.toml")),
    ("manual", include_str!("../../../assets/scenes/manual.toml")),
    ("render", include_str!("../../../assets/scenes/render.toml")),
];

/// Removes a part from a scene that has everything.
type LeaveOut = fn(&mut Scene);
const PARTS: [(&str, LeaveOut); 6] = [
    ("picture", |s| s.picture = false),
    ("mines", |s| s.mines = None),
    ("watch", |s| s.watch = None),
    ("log", |s| s.log = false),
    ("operator", |s| s.operator = false),
    ("tentacles (flown by hand)", |s| s.steering = Steering::Guide("manual")),
];

/// Alternatives to the headlight.
const LIGHTS: [(&str, Light); 4] = [
    ("light falloff", Light { falloff: true, ..Light::HEADLIGHT }),
    ("light gloss", Light { gloss: true, ..Light::HEADLIGHT }),
    ("light contact", Light { contact: true, ..Light::HEADLIGHT }),
    ("light endoscope", Light::ENDOSCOPE),
];

/// A scene during the measurement.
struct Running {
    name: String,
    flight: FlightApp,
    picture: bool,
    scene_ms: Vec<f64>,
    step_us: Vec<f64>,
    frame_ms: Vec<f64>,
    /// Time to cast only the tentacles.
    sense_us: Vec<f64>,
    bytes: usize,
    systems: usize,
}

/// The cost of a scene.
#[derive(Clone, Debug)]
struct Cost {
    name: String,
    bytes: f64,
    step_us: f64,
    /// `None` without a picture.
    frame_ms: Option<f64>,
    /// Number of tentacles, and the time to cast them; `None` without tentacles.
    sense: Option<(usize, f64)>,
    scene_ms: f64,
    systems: usize,
}

/// Measures and writes the report into `folder`. The scene that has everything is also measured with `plugins`. Returns the
/// findings, one sentence each.
///
/// # Errors
/// Returns status 4 if the scan cannot be flown or if interrupted, 5 if a file cannot be written.
pub fn report(
    volume: &PreparedVolume,
    plugins: &Plugins,
    effort: Effort,
    folder: &Path,
    progress: &Progress,
) -> Result<Vec<String>> {
    let (rounds, pixels) = effort.choose((12, 256), (60, 512));
    let begun = Instant::now();
    let flags = Flags::new(volume.voxels(), volume.transfer());
    let flags_s = begun.elapsed().as_secs_f64();
    let mut scan = Scan::prepared(volume.clone(), Arc::new(progress.clone()));
    let lumen = scan.lumen()?;
    let lumen_s: f64 = scan.timings().parts().iter().map(|p| p.1).sum();
    let default = Scene::default();
    let plan = scan.plan(&FlightRequest::default(), default.body.radius_mm)?;
    let full = Scene { picture: true, log: true, operator: true, ..Scene::default() };
    let mut scenes = vec![("default".to_owned(), default), ("everything".to_owned(), full.clone())];
    for (name, text) in SHIPPED {
        scenes.push((name.to_owned(), Scene::parse(text, &crate::app::Catalog::default())?));
    }
    for (part, leave_out) in PARTS {
        let mut scene = full.clone();
        leave_out(&mut scene);
        scenes.push((format!("without {part}"), scene));
    }
    for (name, light) in LIGHTS {
        let mut scene = full.clone();
        scene.render.light = Some(light);
        scenes.push((name.to_owned(), scene));
    }
    if !plugins.is_empty() {
        scenes.push(("with plug-ins".to_owned(), Scene { plugins: plugins.clone(), ..full }));
    }
    let mut running = Vec::new();
    for (name, scene) in scenes {
        running.push(Running::new(name, volume, &lumen, &plan, &scene, pixels)?);
    }
    progress.stage("measuring scenes", rounds as u64);
    for n in 0..rounds {
        for k in 0..running.len() {
            let k = (k + n) % running.len();
            running[k].round()?;
        }
        progress.advance(1)?;
    }
    let costs: Vec<Cost> = running.iter().map(Running::cost).collect();
    let built = [("homogeneous-region flags", flags.bytes(), flags_s), ("lumen (runs)", lumen.bytes(), lumen_s)];
    let threads = |page: &mut Page| threads::section(volume, effort, page, progress);
    write(&costs, &built, volume.voxels().bytes(), pixels, threads, folder)
}

impl Running {
    fn new(
        name: String,
        volume: &PreparedVolume,
        lumen: &Arc<Lumen>,
        plan: &Plan,
        scene: &Scene,
        pixels: usize,
    ) -> Result<Self> {
        let picture = scene.picture;
        let settings = scene.render.apply(Settings::default());
        let image = ImageSettings { width: pixels, height: pixels, settings, ..ImageSettings::default() };
        let scene = Scene { image, ..scene.clone() };
        let mut scene_ms = Vec::new();
        let make = || FlightApp::new(volume.clone(), Arc::clone(lumen), plan.clone(), scene.clone());
        for _ in 0..3 {
            let begun = Instant::now();
            drop(make()?);
            scene_ms.push(begun.elapsed().as_secs_f64() * 1e3);
        }
        let flight = make()?;
        let reported = explain(&flight);
        let bytes = reported.built.iter().skip(VOLUME).map(|b| b.bytes).sum();
        let systems = reported.step.len() + reported.frame.len();
        Ok(Self {
            name,
            flight,
            picture,
            scene_ms,
            step_us: Vec::new(),
            frame_ms: Vec::new(),
            sense_us: Vec::new(),
            bytes,
            systems,
        })
    }

    /// Runs some steps, and renders a frame if there is a picture.
    fn round(&mut self) -> Result<()> {
        let begun = Instant::now();
        for _ in 0..CHUNK {
            self.flight.step()?;
        }
        self.step_us.push(begun.elapsed().as_secs_f64() * 1e6 / CHUNK as f64);
        drop(self.flight.take_log());
        if let Some(t) = self.flight.app().camera_get::<Tentacles>() {
            let mut lengths = vec![0.0; t.directions.len()];
            let (volume, at) = (&self.flight.setup().volume, self.flight.pose().position);
            let begun = Instant::now();
            for _ in 0..CHUNK {
                sense::cast(volume, at, &t.directions, t.settings.reach_mm, black_box(&mut lengths));
            }
            self.sense_us.push(begun.elapsed().as_secs_f64() * 1e6 / CHUNK as f64);
        }
        if self.picture {
            let begun = Instant::now();
            self.flight.frame()?;
            self.frame_ms.push(begun.elapsed().as_secs_f64() * 1e3);
        }
        Ok(())
    }

    fn cost(&self) -> Cost {
        Cost {
            name: self.name.clone(),
            bytes: self.bytes as f64,
            step_us: median(&self.step_us),
            frame_ms: self.picture.then(|| median(&self.frame_ms)),
            sense: self.flight.app().camera_get::<Tentacles>().map(|t| (t.directions.len(), median(&self.sense_us))),
            scene_ms: median(&self.scene_ms),
            systems: self.systems,
        }
    }
}

fn write(
    costs: &[Cost],
    built: &[(&str, usize, f64)],
    volume: usize,
    pixels: usize,
    threads: impl FnOnce(&mut Page) -> Result<String>,
    folder: &Path,
) -> Result<Vec<String>> {
    let (lights, scenes): (Vec<&Cost>, Vec<&Cost>) = costs.iter().partition(|c| c.name.starts_with("light "));
    let (whole, parts): (Vec<&Cost>, Vec<&Cost>) = scenes.into_iter().partition(|c| !c.name.starts_with("without "));
    let Some(full) = whole.iter().find(|c| c.name == "everything") else { return Ok(Vec::new()) };
    let mut page = Page::new(folder, "colvis: savings from parts that a scene leaves out")?;
    page.text(&format!(
        "The same flight with different scenes, in turns: the median time of a simulation step and, with a picture, of a frame of {pixels} × {pixels} pixels. Bytes are those that `explain` reports, in addition to the volume of {:.1} MiB. \
         \"everything\" is the default flight with a picture, a log and an operator.",
        volume as f64 / MIB
    ));
    let mut findings = findings(full, &parts);
    page.findings(&findings);
    page.section("Scenes");
    let table = table!(for c in &whole;
        "scene" => &c.name,
        "systems" => c.systems,
        "bytes" => (c.bytes, 0),
        "step / µs" => (c.step_us, 1),
        "frame / ms" => (c.frame_ms, 2),
        "scene made in / ms" => (c.scene_ms, 3),
    );
    page.table("scenes", &table)?;
    if let Some((table, finding)) = tentacles(full, pixels) {
        page.section("The paper's claim about tentacles");
        page.table("tentacles", &table)?;
        page.finding(&finding);
        findings.push(finding);
    }
    page.section("Cost of the light at the camera");
    let lights = lights.iter().filter_map(|c| Some((c, full.frame_ms?, c.frame_ms?)));
    let table = table!(for (c, plain, ms) in lights;
        "light" => c.name.trim_start_matches("light "),
        "frame / ms" => (ms, 2),
        "more than the headlight / ms" => (ms - plain, 2),
        "share / %" => (100.0 * (ms / plain - 1.0), 1),
    );
    page.table("lights", &table)?;
    page.section("Savings from each part left out");
    let table = table!(for c in &parts;
        "left out" => c.name.trim_start_matches("without "),
        "systems" => (full.systems as f64 - c.systems as f64, 0),
        "bytes" => (full.bytes - c.bytes, 0),
        "step / µs" => (full.step_us - c.step_us, 1),
        "frame / ms" => (full.frame_ms.map(|ms| ms - c.frame_ms.unwrap_or(0.0)), 2),
        "scene made in / ms" => (full.scene_ms - c.scene_ms, 3),
    );
    page.table("parts", &table)?;
    page.text("Savings are differences of two medians: values near 0 are within their scatter and may be negative.");
    let points = |all: &[&Cost]| {
        all.iter().map(|c| Point { x: c.bytes / MIB, y: c.step_us, name: c.name.clone() }).collect::<Vec<_>>()
    };
    let series = |name: &str, all: &[&Cost]| Series { name: name.to_owned(), points: points(all), line: false };
    let series = vec![series("scenes", &whole), series("everything but one part", &parts)];
    let title = "A simulation step against memory";
    let plot = Plot::new(title, "memory in addition to the volume / MiB", "step / µs", series);
    page.plot("steps", &plot, "Less is better in both.")?;
    page.section("Built before the first step");
    let table = table!(for &(part, bytes, s) in built;
        "part" => part,
        "bytes" => bytes,
        "share of the volume" => (bytes as f64 / volume as f64, 4),
        "time / s" => (s, 4),
    );
    page.table("built", &table)?;
    let finding = threads(&mut page)?;
    page.finding(&finding);
    findings.push(finding);
    page.finish()?;
    Ok(findings)
}

/// Measures the paper's claim (section 3.2) that sensory rays cost nothing compared with those of the picture; `None` if either
/// is missing.
fn tentacles(full: &Cost, pixels: usize) -> Option<(Table, String)> {
    let ((count, sense_us), frame_ms) = (full.sense?, full.frame_ms?);
    let steps = f64::from(STEP_HZ) / FPS;
    let share = 100.0 * steps * sense_us / (1e3 * frame_ms);
    let said =
        "Casting these sensory rays is negligible overhead to the thousands of rays traced for rendering the scene.";
    let table = table!(for said in [said];
        "the paper" => said,
        "sensory rays" => count,
        "cast in / µs" => (sense_us, 1),
        "a picture's pixels" => pixels * pixels,
        "traced in / ms" => (frame_ms, 2),
        "share / %" => (share, 2),
    );
    let finding = format!(
        "Casting {count} tentacles takes {sense_us:.0} µs. At {FPS:.0} pictures a second, that is {share:.1} % of the time for a picture \
         of {pixels} × {pixels} pixels; the paper calls it negligible."
    );
    Some((table, finding))
}

/// Returns the findings, in two sentences.
fn findings(full: &Cost, parts: &[&Cost]) -> Vec<String> {
    let saves = |c: &Cost| full.step_us - c.step_us;
    let part = |c: &Cost| c.name.trim_start_matches("without ").to_owned();
    let Some(step) = parts.iter().max_by(|a, b| saves(a).total_cmp(&saves(b))) else { return Vec::new() };
    let Some(memory) = parts.iter().min_by(|a, b| a.bytes.total_cmp(&b.bytes)) else { return Vec::new() };
    let picture = full.frame_ms.map_or_else(String::new, |ms| {
        format!("A scene without a picture saves {ms:.1} ms a frame, as much as {:.0} steps. ", 1e3 * ms / full.step_us)
    });
    vec![
        format!(
            "A step of the whole scene takes {:.0} µs; leaving out {} saves the most, {:.0} µs.",
            full.step_us,
            part(step),
            saves(step)
        ),
        format!(
            "{picture}The largest saving of memory, {:.1} of {:.1} MiB, comes from leaving out {}.",
            (full.bytes - memory.bytes) / MIB,
            full.bytes / MIB,
            part(memory)
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shipped_scenes_are_those_of_the_folder() {
        let mut files: Vec<String> = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/scenes"))
            .unwrap()
            .map(|e| e.unwrap().path().file_stem().unwrap().to_str().unwrap().to_owned())
            .collect();
        files.sort();
        let mut shipped = SHIPPED.map(|s| s.0);
        shipped.sort_unstable();
        assert_eq!(files, shipped);
        assert!(SHIPPED.iter().all(|s| Scene::parse(s.1, &crate::app::Catalog::default()).is_ok()));
    }

    #[test]
    fn the_share_of_tentacles_is_of_a_picture() {
        let full = Cost {
            name: "everything".to_owned(),
            bytes: 0.0,
            step_us: 100.0,
            frame_ms: Some(10.0),
            sense: Some((128, 25.0)),
            scene_ms: 1.0,
            systems: 4,
        };
        let (_, finding) = tentacles(&full, 512).unwrap();
        assert!(finding.contains("25 µs") && finding.contains(" 1.0 % of"), "four steps of 25 µs in 10 ms: {finding}");
        assert!(tentacles(&Cost { sense: None, ..full }, 512).is_none());
    }

    #[test]
    fn findings_follow_the_numbers() {
        let cost = |name: &str, mib: f64, step_us: f64| Cost {
            name: name.to_owned(),
            bytes: mib * MIB,
            step_us,
            frame_ms: Some(5.0),
            sense: Some((128, 25.0)),
            scene_ms: 1.0,
            systems: 4,
        };
        let (a, b) = (cost("without a", 90.0, 40.0), cost("without b", 50.0, 95.0));
        let f = findings(&cost("everything", 100.0, 100.0), &[&a, &b]);
        assert!(f[0].contains("leaving out a saves the most, 60 µs"), "{}", f[0]);
        assert!(
            f[1].contains("5.0 ms a frame, as much as 50 steps")
                && f[1].contains("50.0 of 100.0 MiB")
                && f[1].ends_with("out b.")
        );
    }
}
