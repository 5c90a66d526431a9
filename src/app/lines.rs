//! Where a scene file has its settings, so that errors name the line.

use std::ops::Range;

use toml::de::{DeTable, DeValue};

use crate::error::Error;

/// A key of a scene file.
struct Setting {
    /// Its name after those of its tables: `tentacles.count`.
    name: String,
    /// From its key to the end of its value, bytes.
    place: Range<usize>,
}

/// Returns all settings and tables of a text; none if it is not TOML.
fn settings(text: &str) -> Vec<Setting> {
    fn add(table: &DeTable<'_>, prefix: &str, all: &mut Vec<Setting>) {
        for (key, value) in table {
            let name = format!("{prefix}{}", key.get_ref());
            if let DeValue::Table(inner) = value.get_ref() {
                add(inner, &format!("{name}."), all);
            }
            all.push(Setting { name, place: key.span().start..value.span().end });
        }
    }
    let mut all = Vec::new();
    if let Ok(table) = DeTable::parse(text) {
        add(table.get_ref(), "", &mut all);
    }
    all
}

/// Returns the error for a text that is not a scene, with the setting and the line if they are known.
pub(super) fn unread(text: &str, e: &toml::de::Error, hint: &str) -> Error {
    let all = settings(text);
    let span = e.span().unwrap_or(0..text.len());
    let around = all.iter().filter(|s| s.place.start <= span.start && span.end <= s.place.end);
    let (what, start) = match around.min_by_key(|s| s.place.len()) {
        Some(setting) => (setting.name.as_str(), Some(setting.place.start)),
        // What is not TOML at all has a line. What misses a setting has none.
        None => ("scene", Some(span.start).filter(|_| all.is_empty())),
    };
    let what = start.map_or_else(|| what.to_owned(), |start| format!("line {}: {what}", line(text, start)));
    Error::usage(what, e.message().to_owned(), hint).caused_by(e.clone())
}

/// Adds the line to an error about a setting, if the text has it.
pub(super) fn with_line(text: &str, e: Error) -> Error {
    // `count` of tentacles is reported as `tentacles.count`, one that it does not have as `[tentacles]: unknown field`.
    let table = e.what.strip_prefix('[').and_then(|t| t.strip_suffix(']'));
    let unknown = e.why.strip_prefix("unknown field `").and_then(|w| w.split('`').next());
    let name = match (table, unknown) {
        (Some(table), Some(key)) => format!("{table}.{key}"),
        _ => e.what.rsplit("] ").next().unwrap_or_default().to_owned(),
    };
    let nested = format!(".{name}");
    let is_meant = |s: &&Setting| s.name == name || (name.contains('.') && s.name.ends_with(&nested));
    match settings(text).iter().find(is_meant) {
        Some(setting) => e.named(|what| format!("line {}: {what}", line(text, setting.place.start))),
        None => e,
    }
}

/// Returns the number of the line at a byte, from 1.
fn line(text: &str, at: usize) -> usize {
    text.bytes().take(at).filter(|b| *b == b'\n').count() + 1
}
