//! What users of the library rely on: bases that keep their code compiling, and re-exported crates.

use std::fs::read_to_string;
use std::path::Path;
use std::sync::Arc;

use colvis::app::{Catalog, Scene};
use colvis::cli::Program;
use colvis::glam::{DMat3, DVec3};
use colvis::polyps::{Colon, Detector, Wall};
use colvis::progress::Progress;
use colvis::render::{CameraModel, Preset, Settings, ShaderModel};
use colvis::schedule::Look;
use colvis::toml;
use colvis::volume::{Grid, Volume};

/// An entry that only has a name does what its base does.
#[test]
fn a_base_with_a_name_is_a_plug_in() {
    let camera = CameraModel { name: "own camera", ..CameraModel::BASE };
    let shader = ShaderModel { name: "own shader", ..ShaderModel::BASE };
    let preset = Preset { name: "own preset", ..Preset::BASE };
    let look = Look { name: "own look", ..Look::BASE };
    let detector = Detector { name: "own detector", ..Detector::BASE };
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
        for entry in ["CameraModel", "ShaderModel", "Preset", "Look", "Detector", "Overlay", "PanelEntry"] {
            let literals = text.matches(&format!("{entry} {{")).count();
            assert_eq!(text.matches(&format!("..{entry}::")).count(), literals, "{}: {entry}", path.display());
        }
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
    assert!(packages.contains_key("colvis") && packages.contains_key("*"));
    for name in packages.keys().filter(|n| *n != "*") {
        assert!(lock.contains(&format!("name = \"{name}\"")), "{name}");
    }
}
