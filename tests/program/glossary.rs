//! The words of the glossary: help, statistics, messages and the window use one word for one thing.
//!
//! The table in the docs of `src/lib.rs` has a row for each word: what it means, and the words that must not stand for it. Every word of
//! the table is used somewhere, so the table has no dead rows.

use std::path::{Path, PathBuf};

use clap::CommandFactory;
use colvis::cli::args::Args;
use colvis::cli::clap;
use serde_json::Value;

use crate::rust_source::literals;
use crate::support::run::run;

/// A word, and those that must not stand for it.
struct Word {
    word: String,
    not: Vec<String>,
}

/// A text that users read, and where it comes from.
struct Shown {
    origin: String,
    text: String,
}

/// Returns the rows of the glossary's table.
fn words(lib: &str) -> Vec<Word> {
    let docs = lib.lines().map(|l| l.trim_start_matches("//!").trim());
    let rows = docs.skip_while(|l| *l != "| word | means | not |").skip(2).take_while(|l| l.starts_with('|'));
    rows.map(|row| {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let &[_, word, means, not, _] = cells.as_slice() else { panic!("a row of the glossary: {row}") };
        assert!(!word.is_empty() && !means.is_empty() && !not.is_empty(), "{row}");
        Word { word: word.to_owned(), not: not.split(',').map(|n| n.trim().to_owned()).collect() }
    })
    .collect()
}

/// True if the text contains the phrase as whole words, or in the plural.
fn has(text: &str, phrase: &str) -> bool {
    let text = text.to_lowercase();
    let is_word = |c: char| c.is_alphanumeric();
    text.match_indices(&phrase.to_lowercase()).any(|(at, found)| {
        let before = text[..at].chars().next_back();
        let after = &text[at + found.len()..];
        let after = after
            .strip_prefix("es")
            .or_else(|| after.strip_prefix('s'))
            .filter(|a| !a.starts_with(is_word))
            .unwrap_or(after);
        !before.is_some_and(is_word) && !after.starts_with(is_word)
    })
}

/// The help of the program, of every command, and of the keys.
fn help() -> Vec<Shown> {
    let commands = Args::command();
    let names = commands.get_subcommands().map(|c| vec![c.get_name().to_owned(), "--help".to_owned()]);
    let others = [vec!["--help".to_owned()], vec!["--help".to_owned(), "keys".to_owned()]];
    let all: Vec<Vec<String>> = names.chain(others).collect();
    assert!(all.len() > 14, "{all:?}");
    all.iter()
        .map(|args| {
            let out = run(&args.iter().map(String::as_str).collect::<Vec<_>>(), 0);
            let text = String::from_utf8(out.stdout).unwrap();
            // Help is wrapped.
            let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
            Shown { origin: format!("colvis {}", args.join(" ")), text }
        })
        .collect()
}

/// Appends the keys of a JSON value, as words.
fn keys(value: &Value, origin: &str, all: &mut Vec<Shown>) {
    match value {
        Value::Object(map) => {
            for (key, value) in map {
                all.push(Shown { origin: format!("{origin}: {key}"), text: key.replace(['_', '-'], " ") });
                keys(value, origin, all);
            }
        }
        Value::Array(list) => list.iter().for_each(|v| keys(v, origin, all)),
        _ => {}
    }
}

/// The keys of the statistics of a short flight and of a segmentation.
fn statistics() -> Vec<Shown> {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let [scan, mask, flight, segments] = ["p.nii", "m.nii", "f.json", "s.json"].map(at);
    run(&["phantom", "--size", "small", "--out", &scan], 0);
    run(&["fly", &scan, "--headless", "--seconds", "0.5", "--coverage", "--stats", &flight], 0);
    run(&["segment", &scan, "--out", &mask, "--stats", &segments], 0);
    let mut all = Vec::new();
    for (file, origin) in [(flight, "fly --stats"), (segments, "segment --stats")] {
        keys(&serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap(), origin, &mut all);
    }
    assert!(all.len() > 30);
    all
}

/// The sources below a folder, without files of tests.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    let name = |p: &Path| p.file_stem().unwrap().to_string_lossy().into_owned();
    entries
        .into_iter()
        .filter(|p| !name(p).ends_with("tests"))
        .flat_map(|p| if p.is_dir() { sources(&p) } else { vec![p] })
        .filter(|p| p.extension().is_some_and(|e| e == "rs"))
        .collect()
}

/// The texts in the sources: messages, notes, and what panels and menus say.
fn texts() -> Vec<Shown> {
    let files = ["src", "systems"].iter().flat_map(|f| sources(Path::new(f)));
    let all: Vec<Shown> = files
        .flat_map(|file| {
            let found = literals(&std::fs::read_to_string(&file).unwrap());
            found.into_iter().map(move |(line, text)| Shown { origin: format!("{}:{line}", file.display()), text })
        })
        .collect();
    assert!(all.len() > 2000 && all.iter().any(|t| t.origin.contains("panels")), "{}", all.len());
    all
}

#[test]
fn one_thing_has_one_word_in_help_statistics_messages_and_panels() {
    let words = words(&std::fs::read_to_string("src/lib.rs").unwrap());
    assert!(words.len() > 15);
    let shown: Vec<Shown> = help().into_iter().chain(statistics()).chain(texts()).collect();
    let mut wrong = Vec::new();
    for word in &words {
        if !shown.iter().any(|t| has(&t.text, &word.word)) {
            wrong.push(format!("nothing says {:?}: the glossary has a dead row", word.word));
        }
        for not in &word.not {
            let others = shown.iter().filter(|t| has(&t.text, not));
            wrong.extend(others.map(|t| format!("{}: {:?} for {:?}: {}", t.origin, not, word.word, t.text)));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn words_are_found_whole_and_in_the_plural() {
    for (text, phrase, expected) in [
        ("two segments of gas", "segment", true),
        ("Missed patches", "missed patch", true),
        ("a segmentation", "segment", false),
        ("replaced", "place", false),
        ("places", "place", true),
        ("as_scanned", "as scanned", false),
    ] {
        assert_eq!(has(text, phrase), expected, "{phrase} in {text}");
    }
    let source = "fn a() { say(\"one \\\n    line\"); } // \"no\"\n#[cfg(test)]\nmod tests { const A: &str = \"no\"; }\nconst B: &str = r#\"two\"#;";
    assert_eq!(literals(source), [(1, "one line".to_owned()), (5, "two".to_owned())]);
}
