//! Settings of presets, cameras, shaders, overlays and plug-ins, as written in a scene file.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Mutex, PoisonError};

use serde::de::DeserializeOwned;

use crate::error::{Error, Result};

/// A table of settings: the table that a scene file has under the name of a preset, camera, shader, overlay or plug-in.
/// It is empty if there is none.
///
/// The value is small and cheap to copy. Equal tables are stored once, until the program ends.
///
/// ```
/// # use colvis_imaging as colvis;
/// use colvis::render::Options;
///
/// #[derive(serde::Deserialize)]
/// #[serde(default, deny_unknown_fields)]
/// struct Fog {
///     far_mm: f64,
/// }
///
/// impl Default for Fog {
///     fn default() -> Self {
///         Self { far_mm: 60.0 }
///     }
/// }
///
/// let options = Options::new("far_mm = 40.0".parse()?);
/// assert_eq!(options.read::<Fog>("fog")?.far_mm, 40.0);
/// assert_eq!(Options::default().read::<Fog>("fog")?.far_mm, 60.0);
/// assert!(Options::new("fra_mm = 40.0".parse()?).read::<Fog>("fog").is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Default)]
pub struct Options(Option<&'static toml::Table>);

/// Every table created so far, by its text.
static TABLES: Mutex<BTreeMap<String, &'static toml::Table>> = Mutex::new(BTreeMap::new());

impl Options {
    /// No settings: everything is at its default.
    pub const NONE: Self = Self(None);

    /// Creates the settings from a table.
    pub fn new(table: toml::Table) -> Self {
        if table.is_empty() {
            return Self::NONE;
        }
        let mut tables = TABLES.lock().unwrap_or_else(PoisonError::into_inner);
        Self(Some(tables.entry(table.to_string()).or_insert_with(|| Box::leak(Box::new(table)))))
    }

    /// Returns true if there are no settings.
    pub fn is_empty(self) -> bool {
        self.0.is_none()
    }

    /// Deserialises the settings into a type. `name` is the table's name for error messages.
    ///
    /// # Errors
    /// Returns status 2 if there is a setting that the type does not have.
    pub fn read<T: DeserializeOwned>(self, name: &str) -> Result<T> {
        let table = self.0.cloned().unwrap_or_default();
        table.try_into().map_err(|e| unread(name, &e))
    }

    /// Rejects any setting. For types that have none.
    ///
    /// # Errors
    /// Returns status 2 if there is a setting.
    pub fn none(self) -> Result<()> {
        #[derive(serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Nothing {}
        self.read::<Nothing>("settings").map(|Nothing {}| ())
    }
}

/// Returns the error for a table that could not be read, or for one of its settings.
#[doc(hidden)]
pub fn unread(table: &str, e: &toml::de::Error) -> Error {
    // The error has the key in its text alone: "…\nin `count`\n".
    let text = e.to_string();
    match text.trim_end().strip_suffix('`').and_then(|t| t.rsplit_once("\nin `")) {
        Some((_, key)) => Error::usage(format!("{table}.{key}"), e.message().to_owned(), "give another value"),
        None => Error::usage(format!("[{table}]"), e.message().to_owned(), "use settings that it has"),
    }
}

impl PartialEq for Options {
    fn eq(&self, other: &Self) -> bool {
        match (self.0, other.0) {
            (None, None) => true,
            (Some(a), Some(b)) => std::ptr::eq(a, b),
            _ => false,
        }
    }
}

impl Eq for Options {}

impl fmt::Debug for Options {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            None => f.write_str("{}"),
            Some(table) => write!(f, "{table:?}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_tables_are_one() {
        let table = |text: &str| Options::new(text.parse().unwrap());
        assert_eq!(table("a = 1\nb = nan"), table("b = nan\na = 1"));
        assert_ne!(table("a = 1"), table("a = 2"));
        assert_eq!(table(""), Options::NONE);
        assert!(table("a = 1").none().is_err() && Options::NONE.none().is_ok());
    }
}
