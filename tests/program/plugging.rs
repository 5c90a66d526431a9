//! Plug-ins of another program are available by name. Names and keys that are taken are refused, naming both owners.

use std::process::ExitCode;
use std::sync::Arc;

use colvis::app::{Catalog, FlightRequest, Overlay, Scan, Scene};
use colvis::cli::Program;
use colvis::cli::args::Command;
use colvis::dynamics::Body;
use colvis::error::{Error, Result};
use colvis::render::camera::perspective;
use colvis::render::presets::standard;
use colvis::render::shaders::headlight;
use colvis::render::{
    CameraModel, Frame, MemoryPart, Options, PreparedVolume, Preset, Quality, Renderer, Settings, ShaderModel, View,
    Work,
};
use colvis::schedule::{App, Guide, Plugin};

use crate::support::embedded::embedded;

/// A guide with a name and a key.
macro_rules! guide {
    ($type:ident, $name:literal, $key:expr) => {
        #[derive(Clone, Debug, Default, serde::Deserialize)]
        struct $type {}

        impl Guide for $type {
            const NAME: &'static str = $name;
            const SUMMARY: &'static str = "does nothing";
            const KEY: Option<char> = $key;

            fn cruise_mm_s(&self, _: &Body) -> f64 {
                0.0
            }

            fn plug(&self, _: &mut App) -> Result<()> {
                Ok(())
            }
        }
    };
}

guide!(Second, "manual", None);
guide!(Watch, "watch", None);
guide!(Keyed, "keyed", Some('Z'));
guide!(Space, "space", Some('w'));
guide!(Fine, "fine", Some('7'));

fn nothing(_: &mut App) -> Result<()> {
    Ok(())
}

#[derive(clap::Args)]
struct NoArgs {}

fn do_nothing(_: &NoArgs, _: &colvis::cli::Session<'_>) -> Result<()> {
    Ok(())
}

#[test]
fn names_and_keys_that_are_taken_are_refused_with_both_owners() {
    let program = Program::default;
    let preset = |name| Preset { name, ..standard::PRESET };
    let camera = |name| CameraModel { name, ..perspective::MODEL };
    let shader = |name| ShaderModel { name, ..headlight::MODEL };
    let overlay = |name, key| Overlay { name, key, ..Overlay::PLAIN };
    let refused: [(Program, [&str; 2]); 19] = [
        (program().guide::<Second>(), ["guide manual", "guide manual"]),
        (program().guide::<Watch>(), ["watch, a word of scene files", "guide watch"]),
        (program().preset(preset("default")), ["preset default", "preset default"]),
        (program().preset(preset("render")), ["render, a word of scene files", "preset render"]),
        (program().preset(preset("tentacles")), ["guide tentacles", "preset tentacles"]),
        (program().camera(camera("perspective")), ["camera perspective", "camera perspective"]),
        (program().camera(camera("mines")), ["mines, a word", "camera mines"]),
        (program().shader(shader("headlight")), ["shader headlight", "shader headlight"]),
        (program().shader(shader("colvis")), ["preset colvis", "shader colvis"]),
        (program().plugin(("body", nothing)), ["body, a word", "plug-in body"]),
        (program().plugin(("one", nothing)).plugin(("one", nothing)), ["plug-in one", "plug-in one"]),
        (program().plugin(("path", nothing)), ["guide path", "plug-in path"]),
        (program().overlay(overlay("mines", None)), ["overlay mines", "overlay mines"]),
        (
            program().overlay(overlay("one", Some('z'))).overlay(overlay("own", Some('z'))),
            ["overlay one", "overlay own"],
        ),
        (program().guide::<Keyed>().overlay(overlay("own", Some('z'))), ["guide keyed", "overlay own"]),
        (program().overlay(overlay("own", Some('1'))), ["guide tentacles", "overlay own"]),
        (program().command("render", "", do_nothing), ["a command of colvis", "a command of this program"]),
        (program().command("dataset", "", do_nothing), ["a command of colvis", "a command of this program"]),
        (
            program().command("own", "", do_nothing).command("own", "", do_nothing),
            ["a command of this program", "another one"],
        ),
    ];
    for (program, owners) in refused {
        let e = program.check().expect_err(owners[1]);
        let told = e.to_string();
        assert!(e.kind as u8 == 2 && owners.iter().all(|o| told.contains(o)), "{owners:?}: {told}");
        assert!(!told.contains('\n'));
    }
    #[cfg(feature = "window")]
    for taken in [program().guide::<Space>(), program().overlay(overlay("own", Some('H')))] {
        let told = taken.check().unwrap_err().to_string();
        assert!(told.contains("by the window's ") && told.contains(" and by "), "{told}");
    }
    #[cfg(feature = "window")]
    {
        use colvis::panel::{ActionEntry, PanelEntry};
        let action = |id, key| ActionEntry { id, key, ..ActionEntry::BASE };
        let keyed = PanelEntry { name: "keyed", title: "Keyed", key: Some('z'), ..PanelEntry::NONE };
        for (program, owners) in [
            (program().action(action("pause", None)), ["the window's pause", "action pause"]),
            (program().action(action("own", Some('w'))), ["the window's forward", "action own"]),
            (program().action(action("own", Some('z'))).panel(keyed), ["panel keyed", "action own"]),
            (
                program().overlay(overlay("x", None)).action(action("overlay-x", None)),
                ["overlay x", "action overlay-x"],
            ),
        ] {
            let told = program.check().expect_err(owners[1]).to_string();
            assert!(owners.iter().all(|o| told.contains(o)) && !told.contains('\n'), "{owners:?}: {told}");
        }
        program().action(action("own", Some('z'))).check().unwrap();
    }
    let own = program()
        .guide::<Fine>()
        .preset(preset("own preset"))
        .camera(camera("own camera"))
        .shader(shader("own shader"))
        .plugin(("own plugin", nothing))
        .overlay(overlay("own overlay", Some('o')))
        .command("own", "", do_nothing);
    own.check().unwrap();
    assert!(matches!(own.parse(["colvis", "own"]).unwrap().command, Some(Command::Own { name, .. }) if name == "own"));
    let parsed = own.parse(["colvis", "--fov", "60", "own"]).unwrap();
    assert_eq!((parsed.global.fov, parsed.command.is_some()), (Some(60.0), true));
    assert!(own.parse(["colvis", "fly", "--guide", "fine", "--preset", "own preset"]).is_ok());
}

/// Settings that take a number.
#[derive(Debug, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Number {
    number: f64,
}

impl Default for Number {
    fn default() -> Self {
        Self { number: 1.0 }
    }
}

fn checked(options: Options) -> Result<()> {
    match options.read::<Number>("own")?.number {
        n if n > 0.0 => Ok(()),
        n => Err(Error::usage("number", format!("{n} is not above 0"), "give a positive number")),
    }
}

/// A renderer that fills all pixels with the grey of its number.
struct Grey(u8);

impl Renderer for Grey {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        frame.resize(view.width(), view.height());
        frame.buffers().0.fill([self.0; 3]);
        Work { rays: 1, ..Work::default() }
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        Vec::new()
    }
}

const GREY: Preset = Preset {
    name: "grey",
    check: checked,
    make: |_: &PreparedVolume, settings: Settings, _| {
        Box::new(Grey(settings.options.read::<Number>("grey").unwrap_or_default().number as u8))
    },
    ..standard::PRESET
};

const NARROW: CameraModel = CameraModel {
    name: "narrow",
    summary: "",
    options: Options::NONE,
    make: |fov, _, options| {
        let share = options.read::<Number>("narrow")?.number;
        Ok(Arc::new(colvis::render::camera::Perspective::new(fov * share)?))
    },
};

#[derive(bevy_ecs::prelude::Resource)]
struct Told(f64);

struct Numbered(f64);

impl Plugin for Numbered {
    fn name(&self) -> std::borrow::Cow<'static, str> {
        "numbered".into()
    }

    fn with_options(&self, options: Options) -> Result<Option<Arc<dyn Plugin>>> {
        Ok(Some(Arc::new(Self(options.read::<Number>("numbered")?.number))))
    }

    fn build(&self, app: &mut App) -> Result<()> {
        app.world.insert_resource(Told(self.0));
        Ok(())
    }
}

fn catalog() -> Catalog {
    let marked = Overlay {
        name: "marked",
        draw: |_, canvas| {
            let number = canvas.options().read::<Number>("marked").unwrap_or_default().number;
            canvas.text([number as f32; 2], "x", [1; 3]);
        },
        check: checked,
        ..Overlay::PLAIN
    };
    Catalog::default().preset(GREY).camera(NARROW).plugin(Numbered(1.0)).overlay(marked)
}

fn scan() -> Scan {
    Scan::prepared(embedded(), Arc::default())
}

#[test]
fn a_scene_file_names_and_sets_everything() {
    let text = "plugins = [\"manual\", \"render\", \"numbered\"]\n\
                [render]\npreset = \"grey\"\ncamera = \"narrow\"\nfov_degrees = 60.0\nshade = \"headlight\"\n\
                [grey]\nnumber = 77\n[narrow]\nnumber = 0.5\n[numbered]\nnumber = 3.0\n[overlay.marked]\nnumber = 9.0\n";
    let scene = Scene::parse(text, &catalog()).unwrap();
    let marked = scene.options.overlay(catalog().find_overlay("marked").unwrap());
    let flight = scan().flight(scene, &FlightRequest::default()).unwrap();
    assert_eq!(flight.app().world.resource::<Told>().0, 3.0);
    let tangent = flight.view().unwrap().camera().tangent().unwrap();
    assert!((tangent - 15f64.to_radians().tan()).abs() < 1e-12, "half of 60°");
    assert!(flight.look(8, 8).unwrap().pixels().iter().all(|p| *p == [77; 3]));
    let mut canvas = colvis::app::Canvas::new(flight.view().unwrap());
    canvas.draw(&marked, &flight).unwrap();
    let drawn = format!("{:?}", canvas.into_marks());
    assert!(drawn.contains("[9.0, 9.0]"), "{drawn}");
    for (bad, said) in [
        ("[grey]\nnumber = -1", "[grey]"),
        ("[grey]\nnumbr = 1", "numbr"),
        ("[narrow]\nnumber = 7.0", "[narrow]"),
        ("[numbered]\nnum = 1", "[numbered]"),
        ("[overlay.marked]\nnumber = 0", "[overlay.marked]"),
        ("[overlay.none]\nnumber = 1", "there is no \"none\""),
        ("[overlay]\nmarked = 1", "overlay.marked"),
        ("[headlight]\nnumber = 1", "[headlight]"),
        ("[default]\nnumber = 1", "[default]"),
        ("[render]\ncamera = \"wide\"", "there is no \"wide\""),
        ("[render]\nshade = \"neon\"", "there is no \"neon\""),
        ("[render]\nfov_degrees = 190.0", "view angle"),
        ("[render]\nfov_degrees = nan", "view angle"),
        ("[grew]\nnumber = 1", "there is no \"grew\""),
    ] {
        let e = Scene::parse(&format!("plugins = [\"manual\", \"render\"]\n{bad}"), &catalog()).expect_err(bad);
        assert!(e.kind as u8 == 2 && e.to_string().contains(said), "{bad}: {e}");
    }
}

#[test]
fn no_quality_replaces_an_own_preset() {
    for (quality, adaptive) in
        [(Quality::High, true), (Quality::Low, true), (Quality::Reference, false), (Quality::Reference, true)]
    {
        let options = Options::new("number = 50".parse().unwrap());
        let settings = Settings { adaptive, options, ..Settings::new(quality) };
        let image =
            colvis::app::ImageSettings { width: 160, height: 120, settings, preset: GREY, ..Default::default() };
        let scene = Scene { picture: true, image, ..Scene::guided_by("manual") };
        let mut flight = scan().flight(scene, &FlightRequest::default()).unwrap();
        // At rest, like a window: the picture would be refined from the second one on.
        for n in 0..10 {
            flight.frame().unwrap();
            let picture = flight.camera::<colvis::components::output::Picture>().unwrap();
            let grey = picture.frame.pixels().iter().filter(|p| **p == [50; 3]).count();
            assert_eq!(grey, 19_200, "{quality:?} {adaptive}, frame {n}");
        }
    }
}

/// A plug-in that tells of a flight, or panics when it is asked.
struct Tells(&'static str, fn(&App) -> Option<serde_json::Value>);

impl Plugin for Tells {
    fn name(&self) -> std::borrow::Cow<'static, str> {
        self.0.into()
    }

    fn build(&self, app: &mut App) -> Result<()> {
        app.world.insert_resource(Told(0.5));
        Ok(())
    }

    fn stats(&self, app: &App) -> Option<serde_json::Value> {
        (self.1)(app)
    }
}

#[test]
#[ignore = "slow: runs of the program"]
fn plug_ins_tell_of_a_flight_in_its_statistics() {
    let first = |app: &App| Some(serde_json::json!({"zeta": f64::NAN, "alpha": app.world.resource::<Told>().0}));
    let told = || {
        let program = Program::default().plugin(("systems alone", nothing)).plugin(Tells("last", first));
        program.plugin(Tells("silent", |_| None)).plugin(Tells("early", |_| Some(serde_json::json!([1, "two"]))))
    };
    let bad = |program: Program| program.plugin(Tells("bad", |_| panic!("told badly")));
    let dir = tempfile::tempdir().unwrap();
    let path = |file: &str| dir.path().join(file).to_string_lossy().into_owned();
    let short = ["colvis", "fly", "--headless", "--seconds", "0.05"];
    let fly = |program: Program, file: &str| {
        program.run_from(short.iter().copied().map(str::to_owned).chain(["--stats".to_owned(), path(file)]))
    };
    // The first run in a process replaces the panic hook.
    let hook = std::panic::take_hook();
    let outcomes = [
        fly(told(), "told.json"),
        fly(bad(told()), "bad.json"),
        fly(Program::default().plugin(("systems alone", nothing)), "none.json"),
        // Whoever writes no statistics asks for none.
        bad(Program::default()).run_from(short),
    ];
    std::panic::set_hook(hook);
    assert_eq!(outcomes, [ExitCode::SUCCESS, ExitCode::from(1), ExitCode::SUCCESS, ExitCode::SUCCESS]);
    let plugins = |file: &str| {
        let all: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(path(file)).unwrap()).unwrap();
        all.get("plugins").map(|p| serde_json::to_string(p).unwrap())
    };
    let expected = r#"{"early":[1,"two"],"last":{"alpha":0.5,"zeta":null}}"#;
    assert_eq!([plugins("told.json"), plugins("bad.json")].map(Option::unwrap), [expected; 2]);
    assert_eq!(plugins("none.json"), None);
}

#[test]
fn a_view_angle_beyond_the_usual_is_explained_for_a_camera_of_the_scene() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("scene.toml").to_string_lossy().into_owned();
    let text = "plugins = [\"render\"]\n[render]\ncamera = \"narrow\"\n[narrow]\nnumber = 0.5\n";
    std::fs::write(&file, text).unwrap();
    let status = |scene: &[&str]| {
        let args = ["colvis", "explain", "no-such.nii", "--headless", "--fov", "190"];
        Program::default().camera(NARROW).run_from(args.iter().chain(scene).copied())
    };
    // The first run in a process replaces the panic hook.
    let hook = std::panic::take_hook();
    let outcomes = [status(&["--scene", &file]), status(&[])];
    std::panic::set_hook(hook);
    // Half of 190° suits the camera, so that only the scan is missing.
    assert_eq!(outcomes, [ExitCode::from(3), ExitCode::from(2)]);
}
