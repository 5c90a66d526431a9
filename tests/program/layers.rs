//! The module dependencies: the table of layers in the docs of `src/lib.rs` holds for every path in the sources.
//!
//! The table is a block marked `text layers`. It has a line for each layer, from the bottom up, with the layer's
//! modules separated by commas. A module may use itself and modules on earlier lines. Modules on the same line must not
//! use each other. Test modules may use everything.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::rust_source::{SourceFile, uses};

/// Returns the line of each module in the table of layers, counted from the bottom.
fn layers(lib: &str) -> BTreeMap<String, usize> {
    let docs = lib.lines().map(|l| l.trim_start_matches("//!").trim());
    let table = docs.skip_while(|l| *l != "```text layers").skip(1).take_while(|l| *l != "```");
    let named = table.enumerate().flat_map(|(n, l)| l.split(',').map(move |m| (m.trim().to_owned(), n)));
    let mut all = BTreeMap::new();
    for (module, layer) in named {
        assert!(all.insert(module.clone(), layer).is_none(), "{module} stands twice in the table of layers");
    }
    assert!(!all.is_empty(), "the docs of the library have no block marked ```text layers");
    all
}

/// Returns the root of the crate and those of the members of its workspace in the folders beside it, whose modules it re-exports. A
/// member that is named in the table is a module itself.
fn roots(lib: &Path) -> Vec<SourceFile> {
    let table = layers(&std::fs::read_to_string(lib).unwrap());
    let beside = std::fs::read_dir(lib.parent().unwrap()).unwrap().map(|e| e.unwrap().path().join("lib.rs"));
    let mut all: Vec<PathBuf> = beside.filter(|p| p.is_file()).chain([lib.to_owned()]).collect();
    all.sort();
    let folder = |p: &Path| p.parent().unwrap().file_name().unwrap().to_string_lossy().into_owned();
    all.iter()
        .map(|p| SourceFile::read(p, Some(folder(p)).filter(|m| table.contains_key(m)).into_iter().collect()))
        .collect()
}

/// Returns the modules of the crate and of its members.
fn modules(lib: &Path) -> Vec<String> {
    let all = roots(lib).into_iter();
    all.flat_map(|r| if r.module.is_empty() { r.modules().into_iter().map(|m| m.0).collect() } else { r.module })
        .collect()
}

/// Returns the paths that point upwards or sideways in the crate with this root and in its members: `file:line: module uses path`.
fn upward(lib: &Path) -> Vec<String> {
    let mut files = roots(lib);
    let layers = layers(&std::fs::read_to_string(lib).unwrap());
    // Their own modules are at the root of their crate.
    let alone: Vec<String> = files.iter().flat_map(|r| r.module.clone()).collect();
    let unknown = modules(lib).into_iter().filter(|m| !layers.contains_key(m));
    let mut wrong: Vec<String> =
        unknown.map(|m| format!("{}: {m} is in no line of the table of layers", lib.display())).collect();
    while let Some(file) = files.pop() {
        for (name, path) in file.modules() {
            let module = [&file.module[..], &[name]].concat();
            files.push(SourceFile::read(&path, module));
        }
        // The root itself declares the modules.
        let Some(own) = file.module.first() else { continue };
        for used in uses(&file) {
            let Some(to) = used.path.first().filter(|to| *to != own) else { continue };
            let at = format!("{}:{}: {own} uses {}", file.path.display(), used.line, used.path.join("::"));
            match (layers.get(own), layers.get(to)) {
                (Some(own), Some(to)) if to < own => {}
                (Some(_), Some(_)) => wrong.push(format!("{at}, which is not below it")),
                (_, None) if alone.contains(own) => {}
                (_, None) => wrong.push(format!("{at}, which is in no line of the table of layers")),
                // Reported above.
                (None, _) => {}
            }
        }
    }
    wrong.sort();
    wrong
}

#[test]
fn nothing_points_upwards() {
    let wrong = upward(Path::new("src/lib.rs"));
    assert!(wrong.is_empty(), "the table of layers in src/lib.rs does not allow:\n{}", wrong.join("\n"));
}

#[test]
fn the_table_names_the_modules_that_there_are() {
    let lib = Path::new("src/lib.rs");
    let there = modules(lib);
    let gone: Vec<String> =
        layers(&std::fs::read_to_string(lib).unwrap()).into_keys().filter(|m| !there.contains(m)).collect();
    assert!(gone.is_empty(), "in the table of layers and nowhere else: {gone:?}");
}

/// Writes an artificial crate to a folder.
pub(crate) fn made_up(files: &[(&str, &str)]) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let path = dir.path().join("src").join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    let lib = dir.path().join("src/lib.rs");
    (dir, lib)
}

const MADE_UP: &str = "//! Made up.\n//!\n//! ```text layers\n//! error, math\n//! render\n//! app, plane\n//! ```\n\n\
                       pub mod app;\npub mod error;\npub mod math;\npub mod plane;\n\n\
                       #[path = \"../parts/mod.rs\"]\npub mod render;\n";

#[test]
fn an_upward_import_is_found_wherever_it_stands() {
    let (_dir, lib) = made_up(&[
        ("lib.rs", MADE_UP),
        ("error.rs", "use crate::error::own;\n// use crate::app::commented;\nconst S: &str = \"crate::app::text\";\n"),
        ("math.rs", "/* crate::app::commented */\nuse crate::error::Error;\n"),
        ("app/mod.rs", "mod deep;\nuse crate::{error::Error, render::{self, Frame}};\n"),
        ("app/deep.rs", "pub(in crate::app) use super::super::plane;\nuse super::super::math;\n"),
        ("plane.rs", "pub mod flight;\n#[cfg(test)]\nmod tests;\n#[cfg(test)]\nuse crate::app::App;\n"),
        ("plane/flight.rs", "mod inner {\n    fn f() {\n        super::super::super::app::fly();\n    }\n}\n"),
        ("plane/tests.rs", "use crate::app::App;\n"),
        (
            "../parts/mod.rs",
            "mod ray;\n\n#[cfg(test)]\nmod tests {\n    use crate::app::App;\n    const A: char = '}';\n}\n",
        ),
        (
            "../parts/ray.rs",
            "use crate::{error::Error, math::{hash, uniform}};\n\nfn f<'a>(x: &'a str) -> char {\n    crate::app::call(x);\n    \
             super::ray::f(x);\n    '\"'\n}\nuse crate::{\n    math,\n    plane::{flight::Flight, Plane},\n};\nuse crate::gone;\n",
        ),
    ]);
    let found: Vec<String> = upward(&lib)
        .iter()
        .map(|w| {
            w.rsplit_once('/')
                .map_or(w.clone(), |(folder, rest)| format!("{}/{rest}", folder.rsplit('/').next().unwrap()))
        })
        .collect();
    let not_below = "which is not below it";
    let expected = [
        format!("app/deep.rs:1: app uses plane, {not_below}"),
        format!("parts/ray.rs:10: render uses plane::Plane, {not_below}"),
        format!("parts/ray.rs:10: render uses plane::flight::Flight, {not_below}"),
        "parts/ray.rs:12: render uses gone, which is in no line of the table of layers".to_owned(),
        format!("parts/ray.rs:4: render uses app::call, {not_below}"),
        format!("plane/flight.rs:3: plane uses app::fly, {not_below}"),
        // A module on the same line is not below.
        format!("src/math.rs:2: math uses error::Error, {not_below}"),
    ];
    let mut found = found;
    found.sort();
    assert_eq!(found, expected);
}

#[test]
fn a_module_that_the_table_lacks_is_told_of() {
    let lib = MADE_UP.replace("render\n", "\n");
    let (_dir, lib) = made_up(&[
        ("lib.rs", &lib),
        ("error.rs", ""),
        ("math.rs", ""),
        ("app.rs", ""),
        ("plane.rs", ""),
        ("../parts/mod.rs", ""),
    ]);
    let wrong = upward(&lib);
    assert!(wrong.len() == 1 && wrong[0].ends_with("render is in no line of the table of layers"), "{wrong:?}");
}
