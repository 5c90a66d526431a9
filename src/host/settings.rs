//! The user's settings: a small TOML file in the platform's folder for configuration.
//!
//! ```toml
//! version = 1
//! opens = "whole"                 # a scan opens with one flight through the whole colon; "flight" (usual) takes the largest segment
//! screenshots = "/home/me/colon"   # the folder of screenshots, instead of colvis in that of pictures
//! [keys]                       # an action's id, and its keys in the place of its own
//! reverse = ["Z", "Ctrl+R"]
//! light = []
//!
//! [translucency]               # what lies behind the wall; a scene's [overlay.translucency] comes before it
//! depth_mm = 5.0               # how far behind the wall is looked (usual)
//! lens = 0.2                   # the lens's radius as a share of the picture's shorter side (usual)
//! [[translucency.ranges]]      # the table, from the least values to the largest; all ranges, or none for the usual ones
//! name = "fat"
//! hu = [-140, -40]             # between two ranges the colour changes evenly
//! colour = [255, 205, 0]       # red, green, blue
//! opacity = 0.3                # the share of the light that 1 mm of it stops
//!
//! [archive.hospital]           # an archive, for `colvis archive`
//! host = "127.0.0.1"
//! port = 4242
//! title = "ORTHANC"            # the archive's application entity title
//! own_title = "COLVIS"         # ours (usual)
//! connect_s = 10               # seconds to wait for a connection (usual)
//! answer_s = 30                # seconds to wait for each answer (usual)
//! [archive.hospital.tls]       # only if the archive wants encrypted connections
//! ca = "ca.pem"                # the certificates that the archive's is checked against; relative to this file
//! cert = "own.pem"             # ours, if the archive asks for one
//! key = "own.key"
//! name = "archive.local"       # the name in the archive's certificate, if it is not the host
//! ```
//!
//! `colvis explain` prints the path of this file and the ids of all actions.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::folders::{self, Folder};
use crate::app::Overlay;
use crate::app::overlays::translucency;
use crate::error::{Error, Result};
use crate::render::Options;
use crate::render::translucency::TranslucencySettings;

/// The current version of the file format.
const VERSION: u32 = 1;
/// Hint for an invalid file.
const HINT: &str = "fix it or move it away; until then the defaults apply";

/// Keys by the actions' ids.
#[cfg(feature = "window")]
pub(crate) type KeySettings = BTreeMap<String, Vec<String>>;

/// The user's settings.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    version: u32,
    /// Keys by actions.
    #[serde(default)]
    pub keys: BTreeMap<String, Vec<String>>,
    /// How a scan opens.
    #[serde(default)]
    pub opens: Opens,
    /// The folder of screenshots.
    #[serde(default)]
    pub screenshots: Option<PathBuf>,
    /// What lies behind the wall: [`TranslucencySettings`].
    #[serde(default)]
    pub translucency: toml::Table,
    /// Archives by their names.
    #[serde(default, rename = "archive")]
    pub archives: BTreeMap<String, ArchiveSettings>,
}

/// An archive and how it is reached.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArchiveSettings {
    /// Its host, by name or address.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// Its application entity title.
    pub title: String,
    /// Our application entity title, if it is not the usual one.
    #[serde(default)]
    pub own_title: Option<String>,
    /// Limit for a connection, seconds, if it is not the usual one.
    #[serde(default)]
    pub connect_s: Option<f64>,
    /// Limit for each answer, seconds, if it is not the usual one.
    #[serde(default)]
    pub answer_s: Option<f64>,
    /// Encryption, if the archive wants it.
    #[serde(default)]
    pub tls: Option<TlsSettings>,
}

/// Encryption of the connection to an archive. Paths are relative to the settings file.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TlsSettings {
    /// The certificates that the archive's is checked against.
    pub ca: PathBuf,
    /// Our certificate, if the archive asks for one.
    #[serde(default)]
    pub cert: Option<PathBuf>,
    /// The key of our certificate.
    #[serde(default)]
    pub key: Option<PathBuf>,
    /// The name in the archive's certificate, if it is not the host.
    #[serde(default)]
    pub name: Option<String>,
}

/// How a scan opens where the command line says nothing about it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Opens {
    /// With a flight through the largest segment.
    #[default]
    Flight,
    /// With one flight through the whole colon, from the rectum, cleansed.
    Whole,
}

impl Settings {
    /// Reads the file; `None` if it does not exist.
    ///
    /// # Errors
    /// Returns status 3 if it cannot be read, is damaged or has another version. The file stays unchanged.
    pub fn read(path: &Path) -> Result<Option<Self>> {
        let wrong = |why: String| Error::file(path, why, HINT);
        let Some(bytes) = folders::read(path, HINT)? else { return Ok(None) };
        let text = String::from_utf8(bytes).map_err(|e| wrong(e.to_string()))?;
        let settings: Self = toml::from_str(&text).map_err(|e| {
            let line = e.span().map_or(0, |s| text[..s.start.min(text.len())].matches('\n').count() + 1);
            wrong(format!("line {line}: {}", e.message().lines().next().unwrap_or_default()))
        })?;
        if settings.version != VERSION {
            return Err(wrong(format!("has version {}; this program reads version {VERSION}", settings.version)));
        }
        TranslucencySettings::read(Options::new(settings.translucency.clone()))
            .map_err(|e| wrong(format!("{} {}; {}", e.what, e.why, e.hint)))?;
        Ok(Some(settings))
    }
}

/// Returns the folder of screenshots that is set, if there is one. A damaged file has been told of where its keys were read.
#[cfg(feature = "window")]
pub(crate) fn screenshots() -> Option<PathBuf> {
    Settings::read(&file()?).ok()??.screenshots
}

/// Gives overlays that have no settings of the scene those of the user. A damaged file has been told of where its keys were read.
pub fn of_user(mut overlays: Vec<Overlay>) -> Vec<Overlay> {
    let own = |o: &&mut Overlay| o.name == translucency::OVERLAY.name && o.options.is_empty();
    if let Some(overlay) = overlays.iter_mut().find(own)
        && let Some(settings) = file().and_then(|path| Settings::read(&path).ok()?)
    {
        overlay.options = Options::new(settings.translucency);
    }
    overlays
}

/// Returns how a scan opens. A damaged file has been told of where its keys were read.
#[cfg(feature = "window")]
pub(crate) fn opens() -> Opens {
    file().and_then(|path| Settings::read(&path).ok()?).map_or(Opens::default(), |s| s.opens)
}

/// Returns the path of the settings file; `None` on a system that defines no folder for it.
pub fn file() -> Option<PathBuf> {
    Folder::Configuration.file("settings.toml")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_settings_file_is_told_and_left_as_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("settings.toml");
        assert!(Settings::read(&path).unwrap().is_none());
        std::fs::write(&path, "version = 1\n[keys]\nreverse = [\"Z\"]\n").unwrap();
        let read = Settings::read(&path).unwrap().unwrap();
        assert_eq!((&read.keys["reverse"][..], read.screenshots), (&["Z".to_owned()][..], None));
        std::fs::write(&path, "version = 1\nscreenshots = \"shots\"\n").unwrap();
        assert_eq!(Settings::read(&path).unwrap().unwrap().screenshots, Some(PathBuf::from("shots")));
        assert_eq!(Settings::read(&path).unwrap().unwrap().opens, Opens::Flight);
        std::fs::write(&path, "version = 1\nopens = \"whole\"\n").unwrap();
        assert_eq!(Settings::read(&path).unwrap().unwrap().opens, Opens::Whole);
        std::fs::write(&path, "version = 1\n[translucency]\ndepth_mm = 3\n").unwrap();
        assert_eq!(Settings::read(&path).unwrap().unwrap().translucency["depth_mm"].as_integer(), Some(3));
        let archive = "version = 1\n[archive.a]\nhost = \"h\"\nport = 104\ntitle = \"T\"\n";
        std::fs::write(&path, format!("{archive}[archive.a.tls]\nca = \"ca.pem\"\n")).unwrap();
        let read = Settings::read(&path).unwrap().unwrap();
        assert_eq!((&*read.archives["a"].host, read.archives["a"].port), ("h", 104));
        assert_eq!(read.archives["a"].tls.as_ref().unwrap().ca, PathBuf::from("ca.pem"));
        for (text, word) in [
            (&*format!("{archive}password = \"x\""), "password"),
            ("version = 1\n[archive.a]\nhost = \"h\"", "line 2"),
            ("version = 1\nopens = \"half\"", "line 2"),
            ("version = 2", "version 2"),
            ("", "version"),
            ("version = 1\n[keys]\nreverse = 3", "line 3"),
            ("version = 1\ncolour = 1", "colour"),
            ("version = 1\n[translucency]\ndepth_mm = 0", "translucency.depth_mm is 0; give a number above 0"),
            ("version = 1\n[translucency]\ndeep_mm = 1", "deep_mm"),
            ("\u{0}\u{1}", "line 1"),
        ] {
            std::fs::write(&path, text).unwrap();
            let e = Settings::read(&path).unwrap_err();
            assert!(e.to_string().contains(word) && !e.to_string().contains('\n'), "{e}");
            assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
        }
        std::fs::write(&path, [0xff, 0xfe]).unwrap();
        assert!(Settings::read(&path).is_err());
        assert!(Settings::read(dir.path()).is_err(), "a folder");
    }
}
