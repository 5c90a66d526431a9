//! What users of the library rely on: bases that keep their code compiling, re-exported crates, and documents that say the same as
//! the code.

use std::fs::read_to_string;
use std::path::Path;
use std::sync::Arc;

use colvis::app::{Catalog, Scene};
use colvis::cli::Program;
use colvis::glam::{DMat3, DVec3};
use colvis::polyps::{Colon, Detector, Wall};
use colvis::progress::Progress;
use colvis::render::{CameraModel, Preset, Settings, ShaderModel};
use colvis::schedule::{FlightSystems, Look};
use colvis::toml;
use colvis::volume::{Grid, Volume};

/// An entry that only has a name does what its base does.
#[test]
fn a_base_with_a_name_is_a_plug_in() {
    let camera = CameraModel { name: "own camera", ..CameraModel::BASE };
    let shader = ShaderModel { name: "own shader", ..ShaderModel::BASE };
    let preset = Preset { name: "own preset", ..Preset::BASE };
    let look = Look::new("own look", "", |_| Ok(()));
    let detector = Detector::new("own detector", "", |_, _| Ok(Vec::new()));
    Program::default().camera(camera).shader(shader).preset(preset).look(look).detector(detector).check().unwrap();
    assert!(camera.camera(90.0, 1.0).unwrap().tangent().is_some(), "perspective");
    preset.supports(&Settings { shader, ..Settings::default() }).unwrap();
    let text =
        "plugins = [\"path\"]\n[render]\nshade = \"own shader\"\ncamera = \"own camera\"\n[view]\nlook = \"own look\"";
    Scene::parse(text, &Catalog::default().camera(camera).shader(shader).look(look)).unwrap();
    let techniques = format!("{text}\npreset = \"own preset\"").replace("[view]", "gradients = \"cached\"\n[view]");
    assert!(Scene::parse(&techniques, &Catalog::default().preset(preset)).is_err(), "it has no techniques to choose");

    let grid = Grid::new([12; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let gas = |n: usize| [n % 12, n / 12 % 12, n / 144].iter().all(|c| (3..9).contains(c));
    let volume = Volume::try_new(grid.clone(), (0..grid.len()).map(|n| if gas(n) { -1000 } else { 50 }).collect());
    let (volume, progress) = (Arc::new(volume.unwrap()), Progress::new());
    let lumen = colvis::fields::lumen::find(&volume, &progress).unwrap();
    let wall = Wall::new(&volume, &lumen, -650.0, &progress).unwrap();
    let colon = Colon { volume: &volume, lumen: &lumen, wall: &wall };
    assert!(colvis::polyps::find(&detector, &colon, &progress).unwrap().is_empty());
}

/// Examples name crates in public signatures by the library's re-exports, and fill entries on their bases.
#[test]
fn examples_need_no_other_versions_and_no_later_fields() {
    for example in std::fs::read_dir("examples").unwrap() {
        let path = example.unwrap().path();
        let text = read_to_string(&path).unwrap();
        for line in text.lines().filter(|l| l.starts_with("use ")) {
            let own = ["bevy_ecs", "glam", "serde_json", "toml", "egui"]
                .iter()
                .find(|c| line.starts_with(&format!("use {c}")));
            assert_eq!(own, None, "{}: {line}", path.display());
        }
        for entry in
            ["CameraModel", "ShaderModel", "Preset", "Look", "Detector", "Overlay", "PanelEntry", "ActionEntry"]
        {
            let literals = text.matches(&format!("{entry} {{")).count();
            assert_eq!(text.matches(&format!("..{entry}::")).count(), literals, "{}: {entry}", path.display());
        }
    }
}

/// Returns the names in backticks of a table's first column, under the heading `| head |`.
fn first_column(text: &str, head: &str) -> Vec<String> {
    let rows = text.lines().map(|l| l.trim_start_matches("/// ").trim_start_matches("//! "));
    let rows = rows.skip_while(|l| !l.starts_with(head)).skip(2).take_while(|l| l.starts_with('|'));
    let cells = rows.map(|row| row.split('|').nth(1).unwrap_or_default().to_owned());
    cells.flat_map(|cell| cell.split('`').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>()).collect()
}

#[test]
fn documents_list_every_set_in_order() {
    let names = |sets: &[FlightSystems]| sets.iter().map(|s| format!("{s:?}")).collect::<Vec<_>>();
    let (step, frame) = (names(&FlightSystems::STEP), names(&FlightSystems::FRAME));
    let text = read_to_string("ARCHITECTURE.md").unwrap();
    for (phase, sets) in [("step", &step), ("frame", &frame)] {
        let line = text.lines().find(|l| l.trim_start().starts_with(&format!("{phase} "))).unwrap();
        let drawn: Vec<&str> = line.trim_start().trim_start_matches(phase).split('►').map(str::trim).collect();
        assert_eq!(&drawn, sets, "the diagram of a {phase}");
    }
    assert_eq!(first_column(&text, "| set |"), [step.clone(), frame.clone()].concat(), "the table of sets");
    // The table of the systems' files, by set.
    let modules = read_to_string("systems/mod.rs").unwrap();
    for row in modules.lines().filter_map(|l| l.strip_prefix("//! | `")) {
        let sets: Vec<&str> = row.split('|').nth(1).unwrap().split('`').skip(1).step_by(2).collect();
        assert!(!sets.is_empty() && sets.iter().all(|s| step.iter().chain(&frame).any(|n| n == s)), "{row}");
    }
}

#[test]
fn the_tables_of_extensions_list_every_method_of_a_program() {
    let text = read_to_string("src/cli/mod.rs").unwrap();
    let program = text.split("\nimpl Program {").nth(1).unwrap().split("\n}").next().unwrap();
    // Methods that take the program and return it.
    let methods: Vec<&str> = program
        .split("    #[must_use]\n")
        .skip(1)
        .filter_map(|m| m.split_once("pub fn ")?.1.split(['(', '<']).next())
        .collect();
    assert!(methods.len() > 8, "{methods:?}");
    let mut listed = first_column(&text, "| method |");
    let mut sorted = methods.clone();
    listed.sort();
    sorted.sort();
    assert_eq!(listed, sorted, "the docs of `Program`");
    let front = read_to_string("src/lib.rs").unwrap();
    for method in methods {
        assert!(front.contains(&format!("`Program::{method}`")), "the front page does not list {method}");
    }
    for example in std::fs::read_dir("examples").unwrap() {
        let name = example.unwrap().file_name().into_string().unwrap();
        let shown = front.contains(&format!("`examples/{name}`"));
        assert!(shown || !name.starts_with("own_"), "the front page does not list {name}");
    }
}

/// The profile to copy is the same in both places and names packages that there are.
#[test]
fn the_profile_for_dependents_names_packages_of_this_build() {
    let block = |path: &str, comment: &str| {
        let text = read_to_string(Path::new(path)).unwrap();
        let lines = text.lines().map(|l| l.strip_prefix(comment).unwrap_or(l).to_owned());
        let lines = lines.skip_while(|l| l != "[profile.dev.package]").take_while(|l| l != "```");
        lines.collect::<Vec<_>>().join("\n")
    };
    let profile = block("README.md", "");
    assert_eq!(profile, block("src/lib.rs", "//! "));
    let table: toml::Table = profile.parse().unwrap();
    let packages = table["profile"]["dev"]["package"].as_table().unwrap();
    let lock = read_to_string("Cargo.lock").unwrap();
    assert!(packages.contains_key("colvis-kernels") && packages.contains_key("*"));
    for name in packages.keys().filter(|n| *n != "*") {
        assert!(lock.contains(&format!("name = \"{name}\"")), "{name}");
    }
}
