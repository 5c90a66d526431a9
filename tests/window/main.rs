//! The window on a virtual X server: its display, its keys, and the files it leaves behind.
#![cfg(all(feature = "window", target_os = "linux"))]

use std::fs;
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use colvis::components::output::LogLine;
use colvis::progress::Progress;
use colvis::volume::{Grid, Volume, io};
use glam::{DMat3, DVec3};
use image::RgbImage;

use support::failed::keep;
use support::logs::{place, read_log};
use support::panels::panels;
use support::program::colvis;
use support::skips::skip;
use support::xvfb;

#[cfg(feature = "dicom")]
mod archive;
mod findings;
mod positions;
#[cfg(feature = "dicom")]
mod sitting;

#[path = "../support"]
mod support {
    #[cfg(feature = "dicom")]
    #[expect(dead_code, reason = "the window needs one kind of archive")]
    pub(crate) mod archives;
    #[cfg(feature = "dicom")]
    pub(crate) mod dicom;
    pub(crate) mod failed;
    pub(crate) mod logs;
    pub(crate) mod panels;
    pub(crate) mod program;
    #[cfg(feature = "dicom")]
    pub(crate) mod scan_study;
    #[cfg(feature = "dicom")]
    pub(crate) mod scans;
    pub(crate) mod skips;
    pub(crate) mod xvfb;
}

const SIZE: (u32, u32) = (640, 480);
const PATIENCE: Duration = Duration::from_secs(180);
/// The camera's radius, mm.
const RADIUS_MM: f64 = 1.5;

/// A program that is killed at the end of the test, however that ends.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have exited already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Running {
    fn wait(&mut self) -> ExitStatus {
        let begun = Instant::now();
        loop {
            if let Some(status) = self.0.try_wait().unwrap() {
                return status;
            }
            assert!(begun.elapsed() < PATIENCE, "it does not end");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn output(&mut self) -> (String, String) {
        let (mut out, mut err) = (String::new(), String::new());
        self.0.stdout.take().unwrap().read_to_string(&mut out).unwrap();
        self.0.stderr.take().unwrap().read_to_string(&mut err).unwrap();
        (out, err)
    }
}

struct Screen {
    _server: Running,
    display: String,
}

impl Screen {
    /// Opens a virtual screen, or returns `None` if the tools for it are missing.
    fn open() -> Option<Self> {
        Self::open_with(&format!("{}x{}x24", SIZE.0, SIZE.1), &[], &[])
    }

    /// Works like [`Screen::open`] for a screen of that width, height and depth, with more arguments of its server and more tools.
    fn open_with(screen: &str, more: &[&str], tools: &[&str]) -> Option<Self> {
        for tool in ["Xvfb", "xdotool", "import"].iter().chain(tools) {
            if !xvfb::is_there(tool) {
                skip("screen", &format!("there is no {tool}"));
                return None;
            }
        }
        let (server, display) = xvfb::start(screen, more);
        Some(Self { _server: Running(server), display })
    }

    fn tool(&self, name: &str, args: &[&str]) -> Vec<u8> {
        Command::new(name).args(args).env("DISPLAY", &self.display).output().unwrap().stdout
    }

    fn key(&self, key: &str) {
        self.tool("xdotool", &["key", key]);
    }

    fn shot(&self) -> RgbImage {
        let png = self.tool("import", &["-silent", "-window", "root", "png:-"]);
        image::load_from_memory(&png).unwrap().to_rgb8()
    }

    /// Waits for a picture that `wanted` accepts.
    fn shot_when(&self, what: &str, wanted: impl FnMut(&RgbImage) -> bool) -> RgbImage {
        let kept = |shot: &RgbImage| format!("the last shot is {}", keep(&format!("window {what}"), shot).display());
        self.shot_when_else(what, wanted, kept)
    }

    /// Waits for a picture that `wanted` accepts. `told` shows the last one if none is accepted.
    fn shot_when_else(
        &self,
        what: &str,
        mut wanted: impl FnMut(&RgbImage) -> bool,
        told: impl Fn(&RgbImage) -> String,
    ) -> RgbImage {
        let begun = Instant::now();
        loop {
            let shot = self.shot();
            if wanted(&shot) {
                return shot;
            }
            assert!(begun.elapsed() < PATIENCE, "the window never shows {what}; {}", told(&shot));
            std::thread::sleep(Duration::from_millis(300));
        }
    }

    /// Waits for a screenshot that is written whole.
    fn saved(&self, path: &Path) -> RgbImage {
        let mut image = None;
        self.shot_when("that it is saved", |_| {
            image = image::open(path).ok();
            image.is_some()
        });
        image.unwrap().to_rgb8()
    }

    fn fly(&self, folder: &Path, log: &str) -> Running {
        self.fly_with(folder, &["--log", log])
    }

    fn fly_with(&self, folder: &Path, args: &[&str]) -> Running {
        let size = format!("{}x{}", SIZE.0, SIZE.1);
        let all = ["fly", "--size", &size, "--stats", "stats.json", "--layout", "flight"];
        self.open_window(folder, &[&all[..], args].concat(), flies)
    }

    /// Starts the program, waits until it shows a picture that `wanted` accepts, and gives it the keyboard focus.
    fn open_window(&self, folder: &Path, args: &[&str], wanted: impl FnMut(&RgbImage) -> bool) -> Running {
        self.open_program(colvis(), folder, args, wanted)
    }

    /// Works like [`Screen::open_window`] with another program.
    fn open_program(
        &self,
        mut program: Command,
        folder: &Path,
        args: &[&str],
        wanted: impl FnMut(&RgbImage) -> bool,
    ) -> Running {
        let child = program
            .args(args)
            .env("DISPLAY", &self.display)
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WAYLAND_SOCKET")
            .env("XDG_STATE_HOME", folder.join("state"))
            .env("XDG_CONFIG_HOME", folder.join("config"))
            .current_dir(folder)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let running = Running(child);
        self.shot_when("the flight", wanted);
        let window = String::from_utf8(self.tool("xdotool", &["search", "--name", "colvis"])).unwrap();
        // There is no window manager to set the keyboard focus.
        self.tool("xdotool", &["windowfocus", "--sync", window.lines().next().unwrap()]);
        running
    }
}

fn share(image: &RgbImage, of: impl Fn([u8; 3]) -> bool) -> f64 {
    let n = image.pixels().filter(|p| of(p.0)).count();
    n as f64 / f64::from(image.width() * image.height())
}

/// Returns true for the colour of the path bar.
fn is_bar([r, g, b]: [u8; 3]) -> bool {
    r < 140 && (160..220).contains(&g) && b > 240
}

/// Returns true if the image shows the lumen's pink, red strongest.
fn shows(image: &RgbImage) -> bool {
    share(image, |[r, g, b]| r > 60 && r > g + g / 4 && g >= b) > 0.2
}

/// Returns true if the image shows the lumen and the overlay, in flight.
fn flies(image: &RgbImage) -> bool {
    shows(image) && share(image, is_bar) > 0.0
}

fn log(folder: &Path, name: &str) -> Vec<LogLine> {
    read_log(&folder.join(name))
}

/// One session from the first picture to the last, step by step like an operator, since opening a window takes seconds.
#[test]
#[ignore = "slow: a session in a window"]
fn a_flight_in_a_window() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();

    // The window flies automatically and says so.
    keep_settings(folder, "screenshots = \".\"\n");
    let mut window = screen.fly(folder, "first.jsonl");
    let shot = screen.shot();
    let panel = image::imageops::crop_imm(&shot, 0, 0, 200, 110).to_image();
    assert!(share(&panel, |p| p.iter().all(|&c| c > 200)) > 0.01, "figures in the corner");
    let foot = image::imageops::crop_imm(&shot, 320, 440, 320, 25).to_image();
    assert!(share(&foot, |p| p.iter().all(|&c| c > 150)) > 0.01, "the line on diagnosis");
    std::thread::sleep(Duration::from_secs(2));
    assert!(screen.shot().pixels().ne(shot.pixels()), "it moves");

    // When paused, the picture is refined. The saved image matches the display except for the overlay.
    screen.key("space");
    let mut before = None;
    screen.shot_when("a still image", |now| before.replace(now.clone()).is_some_and(|b| b == *now));
    screen.key("F12");
    let saved = folder.join("colvis-0001.png");
    let image = screen.saved(&saved);
    assert_eq!(image.dimensions(), SIZE);
    assert_eq!(share(&image, is_bar), 0.0, "no overlay on what is saved");
    let middle = |i: &RgbImage| image::imageops::crop_imm(i, 220, 200, 200, 150).to_image();
    screen.shot_when_else(
        "what is saved",
        |shot| middle(shot).pixels().eq(middle(&image).pixels()),
        |shot| panels("window saved picture", &middle(&image), &middle(shot)),
    );

    // At rest, the list of keys is shown over the picture, and the picture again.
    let dark = |i: &RgbImage| share(&middle(i), |p| p.iter().all(|&c| c < 30));
    screen.key("h");
    screen.shot_when("the list of keys", |i| dark(i) > dark(&image) + 0.4);
    screen.key("Escape");
    screen.shot_when("the picture without the list", |i| middle(i) == middle(&image));

    // By hand, forwards, then back with the guide.
    screen.key("g");
    screen.key("space");
    screen.tool("xdotool", &["keydown", "Up"]);
    std::thread::sleep(Duration::from_secs(1));
    screen.tool("xdotool", &["keyup", "Up"]);
    screen.key("g");
    screen.key("r");
    std::thread::sleep(Duration::from_secs(2));
    screen.key("ctrl+q");
    let status = window.wait();
    let (out, err) = window.output();
    assert!(status.success(), "{status}: {err}");
    assert_eq!(err, "");

    // The stats contain the cost of the pictures and of presenting them.
    let stats: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("stats.json")).unwrap()).unwrap();
    let [median, p99] = ["median", "p99"].map(|of| stats["present_ms"][of].as_f64().unwrap());
    println!("presenting {}x{}: {median:.2} ms, 99 % within {p99:.2} ms", SIZE.0, SIZE.1);
    assert!(median > 0.0 && median <= p99 && stats["frames"].as_array().unwrap().len() > 10);

    // The log is complete and contains the printed pose, and there was no perforation.
    let lines = log(folder, "first.jsonl");
    let pose: serde_json::Value = serde_json::from_str(out.trim()).unwrap();
    assert_eq!(pose["fov_degrees"], 90.0);
    let at: [f64; 3] = serde_json::from_value(pose["poses"][0]["position"].clone()).unwrap();
    let nearest = lines.iter().map(|l| place(l).distance(DVec3::from_array(at))).fold(f64::INFINITY, f64::min);
    assert!(nearest < 1e-9, "{nearest} mm");
    assert!(lines.windows(2).all(|w| w[1].t > w[0].t));
    assert!(lines.iter().all(|l| l.clearance_mm >= RADIUS_MM - 1e-6));
    let steered: Vec<&str> = lines.iter().map(|l| l.guide.as_str()).fold(Vec::new(), |mut list, g| {
        if list.last() != Some(&g) {
            list.push(g);
        }
        list
    });
    assert_eq!(steered, ["tentacles", "manual", "tentacles"]);

    // When reopened, the flight resumes there. When interrupted, everything is still written.
    let mut window = screen.fly(folder, "second.jsonl");
    Command::new("kill").args(["-INT", &window.0.id().to_string()]).status().unwrap();
    let status = window.wait();
    let (_, err) = window.output();
    assert_eq!(status.code(), Some(4));
    assert!(err.starts_with("error: ") && err.lines().count() == 1, "{err}");
    let again = log(folder, "second.jsonl");
    let gap = place(&again[0]).distance(place(&lines[lines.len() - 1]));
    assert!(gap < 1.0, "{gap} mm from where it was left");
}

/// Writes the user's settings.
fn keep_settings(folder: &Path, settings: &str) {
    fs::create_dir_all(folder.join("config/colvis")).unwrap();
    fs::write(folder.join("config/colvis/settings.toml"), format!("version = 1\n{settings}")).unwrap();
}

/// A screenshot has all views, a strip that labels them, and a path that is not that of what was saved before.
#[test]
fn a_screenshot_shows_all_views_and_lies_in_the_folder_for_pictures() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let shots = folder.join("pictures/colvis");
    fs::create_dir_all(folder.join("config")).unwrap();
    let named = format!("XDG_PICTURES_DIR=\"{}\"\n", folder.join("pictures").display());
    fs::write(folder.join("config/user-dirs.dirs"), named).unwrap();
    let mut window = screen.open_window(folder, &["fly", "--size", "640x480", "--layout", "reading"], flies);
    screen.key("space");
    screen.key("ctrl+s");
    let image = screen.saved(&shots.join("colvis-0001.png"));
    // All but the menus above, with the strip below.
    assert!(image.width() == SIZE.0 && (400..480).contains(&image.height()), "{:?}", image.dimensions());
    let strip = image::imageops::crop_imm(&image, 0, image.height() - 46, SIZE.0, 46).to_image();
    let is_text = |p: [u8; 3]| p.iter().all(|&c| c > 150);
    assert!(share(&strip, is_text) > 0.01 && share(&strip, |p| p.iter().all(|&c| c < 30)) > 0.7);
    assert!(share(&image, is_bar) > 0.0 && shows(&image), "the flight and what is drawn over it");
    let slices = image::imageops::crop_imm(&image, 400, 0, 240, 200).to_image();
    assert!(share(&slices, |[r, g, b]| r == g && g == b && (90..180).contains(&r)) > 0.2, "a slice");
    screen.key("F12");
    screen.saved(&shots.join("colvis-0002.png"));
    let left: Vec<_> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert!(left.iter().all(|name| !name.to_string_lossy().ends_with(".png")), "{left:?}");
    screen.key("ctrl+q");
    assert!(window.wait().success() && window.output().1.is_empty());
}

/// Returns the session files kept for later.
fn sessions(folder: &Path) -> Vec<std::path::PathBuf> {
    let list = fs::read_dir(folder.join("state/colvis/sessions"));
    list.map_or_else(|_| Vec::new(), |list| list.map(|e| e.unwrap().path()).collect())
}

/// A scan can be opened again whatever state it was left in.
#[test]
#[ignore = "slow: opens a window again and again"]
fn a_kept_session_never_keeps_a_scan_from_being_opened() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let quit = |mut window: Running| {
        screen.key("ctrl+q");
        let status = window.wait();
        let (_, err) = window.output();
        assert!(status.success(), "{status}: {err}");
        err
    };
    // Without a guide.
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes/render.toml");
    let still = screen.open_window(folder, &["--scene", scene.to_str().unwrap(), "--layout", "flight"], shows);
    assert_eq!(quit(still), "");
    assert!(sessions(folder).is_empty());
    // A flight keeps its place, whatever its guide and whichever copy of the scan is used.
    let window = screen.fly(folder, "f.jsonl");
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(quit(window), "");
    let kept = sessions(folder);
    assert_eq!(kept.len(), 1);
    // An unusable session is reported, and the flight starts from the beginning.
    let text = fs::read_to_string(&kept[0]).unwrap();
    fs::write(&kept[0], text.replace("\"tentacles\"", "\"none\"")).unwrap();
    let err = quit(screen.fly(folder, "again.jsonl"));
    assert!(err.starts_with("note: ") && err.contains("\"none\""), "{err}");
    let [first, again] = ["f.jsonl", "again.jsonl"].map(|name| place(&log(folder, name)[0]));
    assert!(first.distance(again) < 1.0);
    // Kinds of gas that are damaged, invalid, or leave nothing to fly, neither.
    let kinds = folder.join("state/colvis/kinds").join(kept[0].file_name().unwrap());
    fs::create_dir_all(kinds.parent().unwrap()).unwrap();
    let start = place(&log(folder, "f.jsonl")[0]);
    let stomach = format!(r#"{{"at": [{}, {}, {}], "kind": "stomach"}}"#, start.x, start.y, start.z);
    for (told, noted) in [
        ("{".to_owned(), true),
        (
            r#"{"version": 1, "told": [7, {"at": [0, 0, 1e9], "kind": "lung"}, {"at": [1], "kind": "x"}]}"#.to_owned(),
            false,
        ),
        (format!(r#"{{"version": 1, "told": [{stomach}]}}"#), true),
    ] {
        fs::remove_file(&kept[0]).unwrap_or_default();
        fs::write(&kinds, &told).unwrap();
        let err = quit(screen.fly(folder, "told.jsonl"));
        assert!(if noted { err.starts_with("note: ") } else { err.is_empty() }, "{told}: {err}");
        assert_eq!(fs::read_to_string(&kinds).unwrap(), told, "it is left as it was");
    }
    fs::remove_file(&kinds).unwrap();
    // Playing a log, even backwards, leaves the session untouched.
    fs::write(&kept[0], &text).unwrap();
    for more in [&[][..], &["--reverse"]] {
        let played = screen.open_window(
            folder,
            &[&["--play", "f.jsonl", "--rate", "20", "--layout", "flight"][..], more].concat(),
            shows,
        );
        std::thread::sleep(Duration::from_secs(2));
        assert_eq!(quit(played), "");
        assert_eq!(fs::read_to_string(&kept[0]).unwrap(), text);
    }
}

/// The reading layout: slices follow the flight, a click in one stops it, and the layout persists.
#[test]
#[ignore = "slow: a flight in a window"]
fn slices_beside_the_flight() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let size = format!("{}x{}", SIZE.0, SIZE.1);
    let grey = |[r, g, b]: [u8; 3]| r == g && g == b && r > 90 && r < 200;
    let right = |i: &RgbImage| image::imageops::crop_imm(i, 380, 40, 250, 160).to_image();
    // Tissue in the axial slice, and the lumen beside it.
    let reads = |i: &RgbImage| share(&right(i), grey) > 0.2 && share(i, |[r, g, ..]| r > 100 && r > g + g / 3) > 0.1;
    let args = ["fly", "--size", &size, "--stats", "stats.json", "--log", "f.jsonl"];
    // It is the layout of a window that is opened for the first time.
    let mut window = screen.open_window(folder, &args, reads);
    let shot = right(&screen.shot());
    std::thread::sleep(Duration::from_secs(2));
    assert!(right(&screen.shot()).pixels().ne(shot.pixels()), "the slices follow the flight");
    // A click stops the flight, and the crosshair is at the clicked place.
    screen.tool("xdotool", &["mousemove", "560", "185", "click", "1"]);
    let mut before = None;
    let still = screen.shot_when("a still image", |now| before.replace(now.clone()).is_some_and(|b| b == *now));
    let yellow = |[r, g, b]: [u8; 3]| r > 120 && r > b + 40 && g > b + 30;
    let row = |y: u32| (400..600).filter(|&x| yellow(still.get_pixel(x, y).0)).count();
    let kept = || keep("window crosshair", &still).display().to_string();
    assert!((184..=186).any(|y| row(y) > 120), "a crosshair through the click: {}", kept());
    // Another window of greys, then four slices, then the flight and the slice across the path.
    screen.key("ctrl+2");
    screen.shot_when("soft tissue", |i| right(i).pixels().ne(right(&still).pixels()));
    screen.key("F4");
    screen.shot_when("four slices", |i| share(i, |p| p[0] == p[1] && p[1] == p[2]) > 0.9);
    screen.key("F5");
    screen.shot_when("the slice across the path", |i| share(i, |[r, g, ..]| r > 100 && r > g + g / 3) > 0.1);
    screen.key("ctrl+q");
    let status = window.wait();
    let (_, err) = window.output();
    assert!(status.success() && err.is_empty(), "{status}: {err}");
    let lines = log(folder, "f.jsonl");
    let last = lines.iter().rev().take(30).map(place).collect::<Vec<_>>();
    assert!(last.iter().all(|p| p.distance(last[0]) < 0.5), "it stands still");
    // The layout is restored. A damaged file is reported and left unchanged.
    let kept = folder.join("state/colvis/layout.json");
    assert!(fs::read_to_string(&kept).unwrap().contains("\"layout\": \"across\""));
    let across = |i: &RgbImage| shows(i) && share(&right(i), |p| p[0] == p[1] && p[1] == p[2]) > 0.8;
    let mut window = screen.open_window(folder, &args, across);
    screen.key("ctrl+q");
    assert!(window.wait().success() && window.output().1.is_empty());
    fs::write(&kept, "{}").unwrap();
    let mut window = screen.open_window(folder, &args, reads);
    screen.key("ctrl+q");
    let status = window.wait();
    let (_, err) = window.output();
    assert!(status.success() && err.starts_with("note: ") && err.lines().count() == 1, "{status}: {err}");
    assert_eq!(fs::read_to_string(&kept).unwrap(), "{}");
}

/// Tag is taken out while the flight goes on, and one key brings it back.
#[test]
#[ignore = "slow: a flight in a window"]
fn a_scan_with_tag_in_a_window() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let made = colvis()
        .args(["phantom", "--out", "scan.nii", "--size", "small", "--with", "folds,pools,noise", "--seed", "2"])
        .current_dir(folder)
        .status();
    assert!(made.unwrap().success());
    let size = format!("{}x{}", SIZE.0, SIZE.1);
    // Around the camera in the axial slice.
    let right = |i: &RgbImage| image::imageops::crop_imm(i, 440, 170, 120, 75).to_image();
    // Tag of 470 HU is brighter than tissue, and so are letters.
    let tag = |i: &RgbImage| share(&right(i), |[r, g, b]| r == g && g == b && (175..215).contains(&r));
    let args =
        ["fly", "scan.nii", "--guide", "manual", "--size", &size, "--stats", "stats.json", "--layout", "reading"];
    let grey = |[r, g, b]: [u8; 3]| r == g && g == b && r > 90 && r < 200;
    let mut window = screen.open_window(folder, &args, |i| share(&right(i), grey) > 0.2);
    let still = || {
        let mut before = None;
        screen.shot_when("a still image", |now| before.replace(now.clone()).is_some_and(|b| b == *now))
    };
    // Until it is known what is tag, and the message is gone.
    std::thread::sleep(Duration::from_secs(4));
    let clean = still();
    screen.key("x");
    let scanned = screen.shot_when("the scan as it is", |i| tag(i) > tag(&clean) + 0.01);
    screen.key("x");
    screen.shot_when("the scan without tag", |i| tag(i) < 0.5 * (tag(&clean) + tag(&scanned)));
    screen.key("ctrl+q");
    let status = window.wait();
    let (_, err) = window.output();
    assert!(
        status.success() && err.contains("of tagged fluid and stool") && err.lines().count() == 1,
        "{status}: {err}"
    );
    let stats: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("stats.json")).unwrap()).unwrap();
    assert!(stats["cleansing"]["box_bytes"].as_u64().unwrap() > 0, "{stats}");
}

/// Candidates are looked for when their panel is shown; an answer is stored at once, and there when the scan is opened again.
#[test]
#[ignore = "slow: a flight in a window"]
fn candidates_are_answered_in_a_window() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let right = |i: &RgbImage| image::imageops::crop_imm(i, 460, 60, 180, 400).to_image();
    let pink = |i: &RgbImage| share(&right(i), |[r, g, b]| r > 60 && r > g + g / 4 && g >= b);
    let chosen = |i: &RgbImage| share(&right(i), |p| p == [38, 62, 84]);
    // Beside the flight, on the panel's ground.
    let lists = |i: &RgbImage| pink(i) > 0.1 && share(&right(i), |p| p == [27; 3]) > 0.3;
    let quit = |mut window: Running| {
        screen.key("ctrl+q");
        // It asks, since some candidates are not answered.
        std::thread::sleep(Duration::from_secs(1));
        screen.key("Return");
        let status = window.wait();
        assert!(status.success() && window.output().1.is_empty(), "{status}");
        let stats: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("stats.json")).unwrap()).unwrap();
        stats["assistant"].clone()
    };
    // The server may still show a window that has ended, and the next one would not get the keyboard.
    let gone = || screen.shot_when("an empty screen", |i| !shows(i));
    // Without the panel there is neither a list nor a file.
    let window = screen.fly(folder, "f.jsonl");
    std::thread::sleep(Duration::from_secs(1));
    assert!(quit(window).is_null());
    gone();
    let kept = folder.join("state/colvis/findings");
    assert!(!kept.exists());
    let mut window = screen.fly(folder, "f.jsonl");
    std::thread::sleep(Duration::from_secs(1));
    screen.key("k");
    let list = screen.shot_when("a list of candidates", lists);
    assert!(chosen(&list) == 0.0);
    screen.key("Return");
    screen.shot_when("the first candidate", |i| chosen(i) > 0.01);
    screen.key("ctrl+y");
    let answers = || {
        let file = fs::read_dir(&kept).ok()?.next()?.ok()?.path();
        fs::read_to_string(file).ok()
    };
    screen.shot_when("an answer", |_| answers().is_some_and(|a| a.contains("\"yes\"")));
    // Nothing is left to be done at the end: the window may be killed.
    window.0.kill().unwrap();
    window.wait();
    gone();
    let text = answers().unwrap();
    let window = screen.fly(folder, "f.jsonl");
    std::thread::sleep(Duration::from_secs(1));
    screen.key("k");
    screen.shot_when("the list again", lists);
    screen.key("Return");
    screen.shot_when("the first candidate again", |i| chosen(i) > 0.01);
    screen.key("ctrl+n");
    screen.shot_when("another answer", |_| answers().is_some_and(|a| a == text.replace("\"yes\"", "\"no\"")));
    let took = quit(window);
    assert!(took["candidates"].as_u64().unwrap() > 0 && took["bytes"].as_u64().unwrap() > 0, "{took}");
}

/// Writes a scan of 512 voxels of tissue, of which the file holds the first `held`.
fn write_tissue(path: &Path, held: usize) {
    let head = "ObjectType = Image\nNDims = 3\nDimSize = 8 8 8\nElementSpacing = 1 1 1\nElementType = MET_SHORT\n\
                BinaryDataByteOrderMSB = False\nElementDataFile = LOCAL\n";
    let voxels = std::iter::repeat_n(40i16.to_le_bytes(), held).flatten();
    fs::write(path, head.bytes().chain(voxels).collect::<Vec<u8>>()).unwrap();
}

/// A scan that cannot be flown is shown, and the reason is the same as without a window.
#[test]
fn a_scan_without_a_way_leaves_an_empty_log_and_the_reason() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_tissue(&folder.join("s.mha"), 512);
    let args = ["fly", "s.mha", "--size", "640x480", "--log", "f.jsonl", "--stats", "stats.json"];
    let mut told = 0;
    // The text no longer changes after the failure.
    let mut window = screen.open_window(folder, &args, |i| {
        told += usize::from(share(i, |p| p.iter().all(|&c| c > 150)) > 0.005);
        told > 3
    });
    screen.key("ctrl+q");
    assert_eq!(window.wait().code(), Some(4));
    let (_, err) = window.output();
    assert!(err.starts_with("error: ") && err.lines().count() == 1, "{err}");
    assert_eq!(fs::read(folder.join("f.jsonl")).unwrap(), b"");
    let stats: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("stats.json")).unwrap()).unwrap();
    assert!(stats["state"] == "operator" && err.contains(stats["reason"].as_str().unwrap()), "{stats}");
}

/// Without a colon, the slices are shown, and a double click into gas starts a flight there.
#[test]
fn a_scan_without_a_colon_is_read_in_slices_and_flown_where_gas_is_clicked() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let grid = Grid::new([48, 48, 48], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let at = |n: usize| DVec3::new((n % 48) as f64, (n / 48 % 48) as f64, (n / (48 * 48)) as f64);
    let bubble = DVec3::splat(23.5);
    let data = (0..48 * 48 * 48).map(|n| if at(n).distance(bubble) < 6.0 { -1000 } else { 40 }).collect();
    io::save(&folder.join("s.nii"), &Volume::new(grid, data), &Progress::new()).unwrap();
    let is_tissue = |[r, g, b]: [u8; 3]| r == g && g == b && (120..145).contains(&r);
    // The layout has no slice, and is there again for the flight.
    let args = ["fly", "s.nii", "--size", "640x480", "--layout", "flight", "--log", "f.jsonl"];
    let mut window = screen.open_window(folder, &args, |i| share(i, is_tissue) > 0.15);
    // The gas is the longest run without tissue, beside the crosshair of the axial slice. Letters are shorter.
    let shot = screen.shot_when("slices", |i| share(i, is_tissue) > 0.15);
    let tissue: Vec<u32> = (90..280).filter(|y| is_tissue(shot.get_pixel(512, *y).0)).collect();
    let gas = tissue.windows(2).max_by_key(|w| w[1] - w[0]).unwrap();
    assert!(gas[1] - gas[0] > 30, "{gas:?}");
    let y = u32::midpoint(gas[0], gas[1]).to_string();
    screen.tool("xdotool", &["mousemove", "512", &y, "click", "--repeat", "2", "--delay", "80", "1"]);
    screen.shot_when("the flight", |i| share(i, is_bar) > 0.0 && share(i, is_tissue) < 0.05);
    screen.key("ctrl+q");
    let status = window.wait();
    let (_, err) = window.output();
    assert!(status.success(), "{status}: {err}");
    assert!(place(&log(folder, "f.jsonl")[0]).distance(bubble) < 6.0);
}

/// The exit status is about the scan of the command line, not about one that was chosen in the window.
#[test]
fn a_scan_chosen_in_the_window_fails_there_alone() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // Both end early: one that is whole is looked at, even without a colon.
    write_tissue(&folder.join("s.mha"), 128);
    write_tissue(&folder.join("t.mha"), 256);
    // Two lines below the title say why it cannot be flown.
    let why = |i: &RgbImage| image::imageops::crop_imm(i, 40, 48, 560, 30).to_image();
    let says_why = |i: &RgbImage| share(&why(i), |p| p.iter().all(|&c| c > 150)) > 0.03;
    let mut window = screen.open_window(folder, &["fly", "s.mha", "--size", "640x480"], says_why);
    // The last file of the folder is the lowest button. It ends early.
    let first = screen.shot();
    let button = first.enumerate_pixels().filter(|(_, _, p)| p.0 == [60; 3]).max_by_key(|(_, y, _)| *y);
    let (x, y, _) = button.expect("a list of files");
    screen.tool("xdotool", &["mousemove", &(x - 4).to_string(), &(y - 8).to_string(), "click", "1"]);
    screen.shot_when("another reason", |i| says_why(i) && why(i) != why(&first));
    screen.key("ctrl+q");
    let status = window.wait();
    let (_, err) = window.output();
    assert!(status.success() && err.is_empty(), "{status}: {err}");
}

/// The log of a short flight is written when the window is closed.
#[test]
#[ignore = "slow: a flight in a window"]
fn a_full_disk_is_told_when_the_window_is_closed() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut window = screen.fly(folder, "/dev/full");
    screen.key("ctrl+q");
    assert_eq!(window.wait().code(), Some(5));
    let (_, err) = window.output();
    assert!(err.starts_with("error: /dev/full: ") && err.lines().count() == 1, "{err}");
    assert!(folder.join("stats.json").exists(), "the other outputs are written");
}

/// The recorded input, which pushes into the wall, gives the same log in the window and headless, and never a
/// perforation.
#[test]
#[ignore = "slow: a flight in a window and without"]
fn a_recorded_hand_is_the_same_in_the_window_and_headless() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let input = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/inputs/hand.jsonl");
    let input = input.to_str().unwrap();
    for guide in ["path", "tentacles"] {
        let args = ["--guide", guide, "--replay", input, "--seconds", "9"];
        let mut window = screen.fly_with(folder, &[&args[..], &["--log", "window.jsonl"]].concat());
        let status = window.wait();
        let (_, err) = window.output();
        assert!(status.success(), "{status}: {err}");
        let headless = colvis()
            .args(["fly", "--headless", "--log", "headless.jsonl", "--threads", "1"])
            .args(args)
            .current_dir(folder)
            .status()
            .unwrap();
        assert!(headless.success());
        let (window, headless) = (log(folder, "window.jsonl"), log(folder, "headless.jsonl"));
        // The last line has the final state. A window may notice a few steps late that its time is over.
        let steps = headless.len() - 1;
        assert!(steps > 1000 && window.len() >= steps);
        assert_eq!(window[..steps], headless[..steps], "{guide}");
        assert!(window.iter().all(|l| l.clearance_mm >= RADIUS_MM - 1e-6));
    }
}

/// Guides selected by number, and a click on the bar.
#[test]
#[ignore = "slow: flights in a window"]
fn guides_and_places_are_chosen_in_flight() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut window = screen.fly(folder, "f.jsonl");
    std::thread::sleep(Duration::from_secs(2));
    let steers = |guide: &str| {
        screen.key(match guide {
            "tentacles" => "1",
            "potential" => "2",
            "path" => "3",
            _ => "4",
        });
        // The guide's data is built in the background.
        std::thread::sleep(Duration::from_secs(6));
    };
    steers("path");
    let y = (SIZE.1 - 10).to_string();
    screen.tool("xdotool", &["mousemove", "480", &y, "click", "1"]);
    std::thread::sleep(Duration::from_secs(3));
    for guide in ["potential", "manual", "tentacles"] {
        steers(guide);
    }
    screen.key("ctrl+q");
    let status = window.wait();
    let (_, err) = window.output();
    assert!(status.success() && err.is_empty(), "{status}: {err}");
    let lines = log(folder, "f.jsonl");
    let mut steered: Vec<&str> = lines.iter().map(|l| l.guide.as_str()).collect();
    steered.dedup();
    assert_eq!(steered, ["tentacles", "path", "potential", "manual", "tentacles"]);
    let jumps = lines.windows(2).filter(|w| place(&w[0]).distance(place(&w[1])) > 5.0).count();
    assert_eq!(jumps, 1, "one click, one jump");
    assert!(lines.iter().all(|l| l.clearance_mm >= RADIUS_MM - 1e-6));
}

/// Roll and view angle by keys and mouse; tentacles, mines and forces over the picture but not in the saved one; and
/// all operator input replayed without a window.
#[test]
#[ignore = "slow: a flight in a window"]
fn the_view_is_rolled_and_narrowed_and_what_is_felt_is_drawn() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // Overlays have keys where the settings say so.
    let keys = "[keys]\noverlay-tentacles = [\"7\"]\noverlay-mines = [\"8\"]\noverlay-forces = [\"9\"]\n";
    keep_settings(folder, &format!("screenshots = \".\"\n{keys}"));
    let mut window = screen.fly_with(folder, &["--log", "f.jsonl", "--record-input", "hand.jsonl"]);
    std::thread::sleep(Duration::from_secs(2));
    // The colours of the overlays, none of which are in the pink wall.
    let is_sky = |[r, g, b]: [u8; 3]| b > 200 && (150..210).contains(&g) && r < 130 && b > g + 30;
    let is_yellow = |[r, g, b]: [u8; 3]| (225..250).contains(&r) && (215..240).contains(&g) && b < 100;
    let is_green = |[r, g, b]: [u8; 3]| r < 40 && g > 150 && (100..170).contains(&b);
    let views = |i: &RgbImage| image::imageops::crop_imm(i, 330, 290, 300, 120).to_image();
    let none = screen.shot();
    assert!(share(&views(&none), is_yellow) == 0.0 && share(&views(&none), is_green) == 0.0);
    screen.key("7");
    screen.shot_when("tentacles", |i| share(&views(i), is_sky) > share(&views(&none), is_sky) + 0.0005);
    screen.key("8");
    screen.shot_when("mines", |i| share(&views(i), is_yellow) > 0.001);
    screen.key("9");
    screen.shot_when("forces", |i| share(&views(i), is_green) > 0.0005);
    // At rest: roll by key and by mouse, view angle by key, by wheel and by the browser's keys.
    screen.key("space");
    std::thread::sleep(Duration::from_secs(1));
    screen.tool("xdotool", &["keydown", "period", "sleep", "0.6", "keyup", "period"]);
    screen.tool("xdotool", &["mousemove", "300", "240", "mousedown", "3"]);
    screen.tool("xdotool", &["mousemove", "340", "240", "sleep", "0.2", "mouseup", "3"]);
    screen.key("bracketleft");
    screen.tool("xdotool", &["keydown", "ctrl", "click", "4", "key", "equal", "sleep", "0.2", "keyup", "ctrl"]);
    std::thread::sleep(Duration::from_secs(1));
    screen.key("F12");
    let saved = folder.join("colvis-0001.png");
    let image = screen.saved(&saved);
    assert!(share(&image, is_yellow) == 0.0 && share(&image, is_green) == 0.0, "no overlay on what is saved");
    screen.key("ctrl+q");
    let status = window.wait();
    let (out, err) = window.output();
    assert!(status.success() && err.is_empty(), "{status}: {err}");
    let pose: serde_json::Value = serde_json::from_str(out.trim()).unwrap();
    // Notches of 1.1: one for each key, and one for the wheel, or two if the server reports it twice.
    let angle = pose["fov_degrees"].as_f64().unwrap();
    assert!([67.6, 61.5].contains(&angle), "{angle}");
    let lines = log(folder, "f.jsonl");
    let paused = lines.iter().rposition(|l| DVec3::from_array(l.velocity).length() > 1.0).unwrap();
    let [before, after] = [&lines[paused], &lines[lines.len() - 1]].map(|l| DVec3::from_array(l.up));
    assert!(before.angle_between(after).to_degrees() > 40.0, "rolled by {}", before.angle_between(after).to_degrees());
    let hand = fs::read_to_string(folder.join("hand.jsonl")).unwrap();
    for command in ["\"turn\":[0.0,0.0,1.0]", "\"roll\":", "\"view_angle\":"] {
        assert!(hand.contains(command), "{hand}");
    }
    let seconds = lines[lines.len() - 1].t.to_string();
    let replay = ["fly", "--headless", "--replay", "hand.jsonl", "--log", "again.jsonl", "--seconds", &seconds];
    let status = colvis().args(replay).current_dir(folder).stderr(Stdio::null()).status().unwrap();
    let again = log(folder, "again.jsonl");
    let same = lines.iter().zip(&again).take(lines.len() - 1).all(|(a, b)| a == b);
    assert!(status.success() && same && again.len() == lines.len(), "{} of {}", again.len(), lines.len());
}

#[test]
#[ignore = "slow: a drawn lumen in a window"]
fn a_drawn_lumen_in_a_window() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let way = |i: &RgbImage| share(i, |[r, g, b]| r > 210 && (90..150).contains(&g) && b < 60);
    let feelers = |i: &RgbImage| share(i, |[r, g, b]| g > r + 20 && g > b + 12);
    let mut window = screen.open_window(folder.path(), &["plane", "ring"], |i| way(i) > 0.002);
    screen.key("space");
    let mut before = None;
    let paused = screen.shot_when("a still image", |now| before.replace(now.clone()).is_some_and(|b| b == *now));
    assert!(feelers(&paused) > 0.002, "tentacles: {}", feelers(&paused));
    let mines = |i: &RgbImage| share(i, |p| p == [200, 30, 40]);
    assert!(mines(&paused) > 0.0);
    screen.key("m");
    screen.shot_when("no mines", |i| mines(i) == 0.0);
    screen.key("m");
    screen.shot_when("the mines again", |i| *i == paused);
    screen.key("t");
    screen.shot_when("no tentacles", |i| feelers(i) < feelers(&paused) / 2.0);
    screen.key("s");
    screen.shot_when("no way flown", |i| way(i) < way(&paused) / 4.0);
    // The potential is shaded in many blues. Without it the lumen is a single grey.
    let grey = |i: &RgbImage| share(i, |p| p == [232, 236, 240]);
    screen.key("v");
    screen.shot_when("no potential", |i| grey(i) > grey(&paused) + 0.1);
    // A click on the ring's lower part starts there: when paused, the camera is at its start.
    let camera = |i: &RgbImage| {
        let there = image::imageops::crop_imm(i, 228, 385, 40, 30).to_image();
        share(&there, |p| p == [20, 20, 24])
    };
    screen.tool("xdotool", &["mousemove", "248", "400", "click", "1"]);
    screen.shot_when("another start", |i| camera(i) > 0.01);
    screen.key("q");
    let status = window.wait();
    assert!(status.success() && window.output().1.is_empty());
}

/// Without shared memory (`ssh -X`, containers), a frame may be longer than the server's longest request.
#[test]
#[ignore = "slow: windows of many sizes"]
fn a_window_of_any_size_without_shared_memory() {
    let Some(screen) = Screen::open_with("2560x1700x24", &["-extension", "MIT-SHM"], &[]) else { return };
    let folder = tempfile::tempdir().unwrap();
    let args = ["fly", "--size", "640x480", "--log", "f.jsonl", "--layout", "flight"];
    // The window is small at first.
    let begins = |i: &RgbImage| flies(&image::imageops::crop_imm(i, 0, 0, SIZE.0, SIZE.1).to_image());
    let mut window = screen.open_window(folder.path(), &args, begins);
    screen.key("space");
    let id = String::from_utf8(screen.tool("xdotool", &["search", "--name", "colvis"])).unwrap();
    screen.tool("xdotool", &["windowsize", id.lines().next().unwrap(), "2560", "1700"]);
    // To its lower right corner: what is above the last strip does not count.
    let corner = |i: &RgbImage| image::imageops::crop_imm(i, 1900, 1100, 600, 560).to_image();
    screen.shot_when("a large picture", |i| shows(&corner(i)));
    screen.key("ctrl+q");
    let status = window.wait();
    let (_, err) = window.output();
    assert!(status.success() && err.is_empty(), "{status}: {err}");
    assert!(!log(folder.path(), "f.jsonl").is_empty());
}

/// Displays of 16 and 30 bits show the same colours as usual ones, as far as they have them.
#[test]
#[ignore = "slow: a window on each display"]
fn a_window_on_displays_of_other_depths() {
    let folder = tempfile::tempdir().unwrap();
    let colours = |depth: u8| {
        let screen = Screen::open_with(&format!("{}x{}x{depth}", SIZE.0, SIZE.1), &[], &[])?;
        let way = |i: &RgbImage| share(i, |[r, g, b]| r > 210 && (90..150).contains(&g) && b < 60) > 0.002;
        let mut window = screen.open_window(folder.path(), &["plane", "ring"], way);
        screen.key("v");
        let grey = |[r, g, b]: [u8; 3]| r.abs_diff(232) < 9 && g.abs_diff(236) < 9 && b.abs_diff(240) < 9;
        let shot = screen.shot_when(&format!("the lumen in {depth} bits"), |i| share(i, grey) > 0.1);
        screen.key("q");
        let status = window.wait();
        let (_, err) = window.output();
        assert!(status.success() && err.is_empty(), "{depth}: {status}: {err}");
        Some(share(&shot, grey))
    };
    let Some(usual) = colours(24) else { return };
    for depth in [16, 30] {
        let share = colours(depth).unwrap();
        // The longer the flight takes, the more of it the path flown covers.
        assert!((share - usual).abs() < 0.05, "{depth} bits: {share}, {usual}");
    }
    // The flight's window.
    let Some(screen) = Screen::open_with(&format!("{}x{}x16", SIZE.0, SIZE.1), &[], &[]) else { return };
    let mut window = screen.fly(folder.path(), "f.jsonl");
    screen.key("ctrl+q");
    assert!(window.wait().success() && window.output().1.is_empty());
}

#[test]
#[ignore = "slow: a flight in a window"]
fn a_stale_wayland_display_does_not_hide_the_x_display() {
    // Without repeats: a held key is one press, however slow the machine is.
    let Some(screen) = Screen::open_with(&format!("{}x{}x24", SIZE.0, SIZE.1), &["-r"], &[]) else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut program = Command::new("env");
    program.arg("WAYLAND_DISPLAY=wayland-9").arg(format!("XDG_RUNTIME_DIR={}", folder.path().display()));
    program.arg(colvis().get_program());
    let way = |i: &RgbImage| share(i, |[r, g, b]| r > 210 && (90..150).contains(&g) && b < 60) > 0.002;
    let mut window = screen.open_program(program, folder.path(), &["plane", "ring"], way);
    // A key that is down as the window gets the focus was pressed for another window: this one stays.
    let id = String::from_utf8(screen.tool("xdotool", &["search", "--name", "colvis"])).unwrap();
    screen.tool("xdotool", &["windowfocus", "0"]);
    screen.tool("xdotool", &["keydown", "q", "windowfocus", "--sync", id.trim(), "sleep", "0.2", "keyup", "q"]);
    assert!(window.0.try_wait().unwrap().is_none(), "the key of another window counts");
    screen.key("q");
    let status = window.wait();
    let (_, err) = window.output();
    let is_told = err.starts_with("note: ") && err.contains("wayland-9") && err.lines().count() == 1;
    assert!(status.success() && is_told, "{status}: {err}");
}

/// The keys of digits and letters work where the layout prints other characters.
#[test]
#[ignore = "slow: a window for each layout of the keyboard"]
fn keys_work_on_other_layouts() {
    let Some(screen) = Screen::open_with(&format!("{}x{}x24", SIZE.0, SIZE.1), &[], &["setxkbmap"]) else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut window = screen.fly(folder.path(), "f.jsonl");
    // Keycodes of the places of 3, G and Q on a US keyboard.
    for (layout, place, seconds) in [("fr", "12", 5), ("ru", "42", 1), ("gr", "42", 5)] {
        screen.tool("setxkbmap", &[layout]);
        std::thread::sleep(Duration::from_millis(500));
        screen.key(place);
        std::thread::sleep(Duration::from_secs(seconds));
    }
    screen.tool("setxkbmap", &["ru"]);
    std::thread::sleep(Duration::from_millis(500));
    screen.tool("xdotool", &["keydown", "ctrl", "key", "24", "keyup", "ctrl"]);
    let status = window.wait();
    let (_, err) = window.output();
    assert!(status.success() && err.is_empty(), "{status}: {err}");
    let mut steered: Vec<String> = log(folder.path(), "f.jsonl").into_iter().map(|l| l.guide).collect();
    steered.dedup();
    assert_eq!(steered, ["tentacles", "path", "manual", "path"]);
}

/// The examples with window content show it, and exit correctly.
#[test]
#[ignore = "slow: every example with a window"]
fn examples_of_plug_ins_in_a_window() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("lamp.toml"), "plugins = [\"tentacles\", \"mines\"]\n[render]\nshade = \"lamp\"\n").unwrap();
    fs::write(folder.join("near.toml"), "plugins = [\"tentacles\", \"mines\"]\n[near_wall]\nnear_mm = 30.0\n").unwrap();
    let built = Path::new(colvis().get_program()).with_file_name("examples");
    // The rear view's frame; edges darker than the middle; the lamp's pale gloss; the overlay's green text.
    let grey = |i: &RgbImage| {
        // Along the upper edge of the inset.
        (0..SIZE.1).any(|y| (500..620).filter(|&x| i.get_pixel(x, y).0 == [170; 3]).count() > 100)
    };
    let pale = |i: &RgbImage| share(i, |[r, g, b]| r > 200 && g > 150 && b > 130) > 0.01;
    let dark = |i: &RgbImage| flies(i) && share(i, |[r, ..]| r > 20 && r < 80) > 0.3;
    let green = |i: &RgbImage| share(i, |p| p == [120, 220, 140]) > 0.0002;
    type Wanted<'a> = &'a dyn Fn(&RgbImage) -> bool;
    // The panel's line, at the right edge outside the flight's picture.
    let line = |i: &RgbImage| {
        let right = image::imageops::crop_imm(i, 460, 60, 180, 400).to_image();
        share(&right, |p| p == [27, 27, 27]) > 0.5 && share(&right, is_bar) > 0.0005
    };
    let cases: [(&str, &[&str], Wanted<'_>); 5] = [
        ("own_view", &[], &grey),
        ("own_post_process", &[], &pale),
        ("own_panel", &[], &line),
        ("own_shader", &["--scene", "lamp.toml"], &dark),
        ("own_plugin", &["--scene", "near.toml", "--overlay", "near_wall"], &green),
    ];
    for (name, args, wanted) in cases {
        let program = built.join(name);
        if !program.exists() {
            skip("examples", &format!("{} is not built: plain `cargo test --release` builds it", program.display()));
            continue;
        }
        let size = format!("{}x{}", SIZE.0, SIZE.1);
        let all = [&["fly", "--size", &size, "--layout", "flight"], args].concat();
        let mut window = screen.open_program(Command::new(program), folder, &all, |i| share(i, is_bar) > 0.0);
        screen.shot_when(name, wanted);
        screen.key("ctrl+q");
        let status = window.wait();
        let (_, err) = window.output();
        assert!(status.success() && err.is_empty(), "{name}: {status}: {err}");
    }
}

/// An action of another crate has its key, and its commands are recorded like those of the operator.
#[test]
#[ignore = "slow: an example with a window"]
fn an_action_of_another_crate_in_a_window() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let program = Path::new(colvis().get_program()).with_file_name("examples").join("own_action");
    if !program.exists() {
        skip("examples", &format!("{} is not built: plain `cargo test --release` builds it", program.display()));
        return;
    }
    let args = ["fly", "--size", "640x480", "--layout", "flight", "--record-input", "hand.jsonl"];
    let mut window = screen.open_program(Command::new(program), folder, &args, flies);
    // There must be a way back.
    std::thread::sleep(Duration::from_secs(2));
    screen.key("z");
    screen.key("ctrl+q");
    let status = window.wait();
    let (_, err) = window.output();
    assert!(status.success() && err.is_empty(), "{status}: {err}");
    let hand = fs::read_to_string(folder.join("hand.jsonl")).unwrap();
    let commands: Vec<&str> = hand.lines().filter_map(|l| l.split("\"command\":").nth(1)).collect();
    assert!(commands.len() == 2 && commands[0].starts_with("{\"seek\":") && commands[1].contains("true"), "{hand}");
}

/// The display is lost in flight: everything that was asked for is there, and complete.
#[test]
#[ignore = "slow: a flight in a window"]
fn a_lost_display_loses_no_files() {
    for options in [&[][..], &["-extension", "MIT-SHM"]] {
        let Some(screen) = Screen::open_with(&format!("{}x{}x24", SIZE.0, SIZE.1), options, &[]) else { return };
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let mut window = screen.fly_with(folder, &["--log", "f.jsonl", "--record-input", "hand.jsonl"]);
        std::thread::sleep(Duration::from_secs(1));
        drop(screen);
        let status = window.wait();
        assert_eq!(status.code(), Some(1), "{}", window.output().1);
        let lines = log(folder, "f.jsonl");
        assert!(lines.len() > 20, "{}", lines.len());
        let stats: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("stats.json")).unwrap()).unwrap();
        assert!(stats["frames"].as_array().is_some_and(|f| !f.is_empty()) && folder.join("hand.jsonl").exists());
    }
}
