//! The archives of the user's settings.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::settings::{self, ArchiveSettings, Settings, TlsSettings};
use crate::dicom::archive::{Archive, OwnCertificate, Tls};
#[cfg(feature = "window")]
use crate::error::Kind;
use crate::error::{Error, Result};
#[cfg(feature = "window")]
use crate::output;

/// Longest limit for a connection or an answer, seconds.
const MOST_S: f64 = 3600.0;
/// Longest title of an application entity.
const MOST_TITLE: usize = 16;

/// Returns the settings file and its archives.
///
/// # Errors
/// Returns status 2 if the system has no settings file or an archive cannot be used, 3 if the file cannot be read.
pub fn known() -> Result<(PathBuf, Vec<Archive>)> {
    let Some(file) = settings::file() else {
        let why = "this system defines no folder for them";
        return Err(Error::usage("settings", why, "set XDG_CONFIG_HOME, or HOME, to a folder"));
    };
    let read = Settings::read(&file).map_err(|e| Error::new(e.kind, e.what, e.why, "fix it"))?.unwrap_or_default();
    let folder = file.parent().unwrap_or(Path::new("."));
    let archives = read.archives.iter().map(|(name, set)| archive(name, set, folder));
    let archives =
        archives.collect::<Result<_>>().map_err(|e| e.named(|what| format!("{}: {what}", file.display())))?;
    Ok((file, archives))
}

/// Returns the archives of the settings for a window. An archive that cannot be used is told of; a damaged file is told of where its keys
/// are read.
#[cfg(feature = "window")]
pub(crate) fn known_or_told() -> Vec<Archive> {
    match known() {
        Ok((_, known)) => known,
        Err(e) => {
            if e.kind == Kind::Usage && settings::file().is_some() {
                output::to_stderr(format_args!("note: {e}"));
            }
            Vec::new()
        }
    }
}

/// Returns an archive of the settings, whose paths are relative to `folder`.
fn archive(name: &str, set: &ArchiveSettings, folder: &Path) -> Result<Archive> {
    let bad = |key: &str, why: &str, hint: &str| Err(Error::usage(format!("archive.{name}.{key}"), why, hint));
    let own_title = set.own_title.as_deref().unwrap_or("COLVIS");
    for (key, title) in [("title", set.title.as_str()), ("own_title", own_title)] {
        let is_plain = title.bytes().all(|b| (b' '..=b'~').contains(&b) && b != b'\\');
        if title.trim().is_empty() || title.len() > MOST_TITLE || !is_plain {
            return bad(key, "is no title", "give up to 16 letters, digits, spaces and signs");
        }
    }
    if set.host.trim().is_empty() {
        return bad("host", "is empty", "give a name or an address");
    }
    if set.port == 0 {
        return bad("port", "is 0", "give the port of the archive, often 104 or 11112");
    }
    let mut archive = Archive::new(name, &set.host, set.port, &set.title);
    own_title.clone_into(&mut archive.own_title);
    for (key, seconds, limit) in [
        ("connect_s", set.connect_s, &mut archive.connect_timeout),
        ("answer_s", set.answer_s, &mut archive.answer_timeout),
    ] {
        let Some(seconds) = seconds else { continue };
        if !(seconds > 0.0 && seconds <= MOST_S) {
            return bad(key, "is not between 0 and 3600 s", "give seconds");
        }
        *limit = Duration::from_secs_f64(seconds);
    }
    archive.tls = match &set.tls {
        None => None,
        Some(TlsSettings { ca, cert, key, name }) => Some(Tls {
            ca: folder.join(ca),
            own: match (cert, key) {
                (None, None) => None,
                (Some(cert), Some(key)) => {
                    Some(OwnCertificate { certificate: folder.join(cert), key: folder.join(key) })
                }
                _ => return bad("tls", "has one of cert and key", "give both, or none of them"),
            },
            name: name.clone(),
        }),
    };
    Ok(archive)
}
