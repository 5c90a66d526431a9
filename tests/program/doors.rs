//! Calls of code of other crates: each goes through a door that turns its panic into an error with its name.
//!
//! The interfaces of other crates are function pointers in entries (`(entry.make)(…)`) and methods of a few traits. Whoever calls one
//! does so inside `ask_plugin`, `catch` or `on_account`, in the same statement; or stands below with the door that it is called
//! through. Reports call this crate's own tables only, and are left out.

use std::path::{Path, PathBuf};

/// Fields of entries that are functions of other crates.
const FIELDS: [&str; 9] = ["make", "check", "takes", "find", "draw", "run", "possible", "augment", "plug"];

/// Methods of traits that other crates implement, as they are called.
const METHODS: [&str; 11] = [
    "guide.cruise_mm_s(",
    "settings.cruise_mm_s(",
    ".with_options(",
    "plugin.build(",
    "plugin.stats(",
    "guide.plug(",
    "settings.check()",
    "presenter.present(",
    "presenter.beside(",
    "renderer.render(",
    ".panel.ui(",
];

const DOORS: [&str; 3] = ["ask_plugin(", "catch(", "on_account("];

/// Calls that are made through a door elsewhere: the file, what the call looks like, and the door.
const ELSEWHERE: &[(&str, &str, &str)] = &[
    ("src/app/scene.rs", "false => (look.plug)(app)?", "only for looks of this crate"),
    ("src/app/scene.rs", "Some(_) => guide.plug(app)?", "only for guides of this crate"),
    ("src/imaging/render/factory.rs", "(preset.make)(volume, settings, reuse)", "whoever calls `renderer` has one"),
    ("src/cli/own.rs", "(self.augment)(", "derived by clap, before there is anything to name"),
    ("src/host/window/panels/candidates.rs", "(view.find)(", "a closure of this crate"),
    ("src/host/window/panels/expected.rs", "(view.find)(", "a closure of this crate"),
    ("src/host/window/panels/findings.rs", "(view.find)(", "a closure of this crate"),
    ("src/host/window/workspace.rs", "shown.panel.ui(", "inside a `catch` of several lines"),
    ("src/cli/candidates/gallery.rs", "renderer.render(", "always the default preset"),
    ("src/imaging/render/low.rs", "self.renderer.render(", "a renderer of a renderer"),
    ("systems/raycast.rs", "picture.work = awake(|| renderer.render(", "`trace` is called through one"),
    ("systems/looks/review.rs", "(way::LOOK.plug)(app)", "a look of this crate"),
    ("src/flight/schedule/guide.rs", "self.settings.cruise_mm_s(body)", "whoever calls `GuideEntry` has one"),
];

fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && name != "report" {
            sources(&path, out);
        } else if name.ends_with(".rs") && !name.ends_with("tests.rs") && name != "pictures.rs" {
            out.push(path);
        }
    }
}

/// Returns the lines that call code of other crates past a door: `file:line: text`.
fn past_doors(file: &str, text: &str) -> Vec<String> {
    // Test modules are at the end of a file.
    let lines: Vec<&str> = text.split("#[cfg(test)]\nmod tests").next().unwrap_or("").lines().collect();
    let calls = |line: &str| {
        let code = line.split("//").next().unwrap_or("");
        FIELDS.iter().any(|field| code.contains(&format!(".{field})("))) || METHODS.iter().any(|m| code.contains(m))
    };
    let is_known = |line: &str| ELSEWHERE.iter().any(|(f, call, _)| *f == file && line.contains(call));
    // A statement begins after the end of another one.
    let first = |n: usize| {
        let above = (n.saturating_sub(2)..n).rev().take_while(|&l| !lines[l].trim_end().ends_with([';', '}']));
        above.last().unwrap_or(n)
    };
    let has_door = |n: usize| lines[first(n)..=n].iter().any(|l| DOORS.iter().any(|d| l.contains(d)));
    let wrong = (0..lines.len()).filter(|&n| calls(lines[n]) && !has_door(n) && !is_known(lines[n]));
    wrong.map(|n| format!("{file}:{}: {}", n + 1, lines[n].trim())).collect()
}

#[test]
fn code_of_other_crates_is_called_through_a_door_that_names_it() {
    let mut files = Vec::new();
    for folder in ["src", "systems"] {
        sources(Path::new(folder), &mut files);
    }
    let read = |path: &PathBuf| past_doors(path.to_str().unwrap(), &std::fs::read_to_string(path).unwrap());
    let wrong: Vec<String> = files.iter().flat_map(read).collect();
    assert!(wrong.is_empty(), "called past a door:\n{}", wrong.join("\n"));
    for &(file, call, _) in ELSEWHERE {
        assert!(std::fs::read_to_string(file).unwrap().contains(call), "{file} does not call {call}");
    }
}

#[test]
fn a_call_past_a_door_is_found() {
    let text = "fn f() {\n    let p = (entry.make)();\n    let q = catch(|| (entry.make)());\n    // (entry.make)()\n    \
                let r = (entry.make)();\n    let s = catch(|| {\n        (entry.make)()\n    });\n}\n";
    assert_eq!(past_doors("a.rs", text), ["a.rs:2: let p = (entry.make)();", "a.rs:5: let r = (entry.make)();"]);
}
