//! Saves screenshots: their folder, and names that are free.

use std::path::{Path, PathBuf};

use serde_json::json;

use crate::components::camera::Pose;
use crate::error::{Error, Result};
use crate::output::{self, AtomicFile};
use crate::render::{CameraModel, Frame};

/// Maximum number of screenshot names in one folder.
const NAMES: u32 = 10_000;
/// What to do about a folder that cannot be written to.
const HINT: &str = "set `screenshots` in settings.toml to a folder that you may write to";

/// Saves an image in `folder` under an unused name, and creates the folder. Returns its path. The file appears complete or not at all.
///
/// # Errors
/// Returns status 5 if it cannot be written, or no name is left.
pub(crate) fn save(frame: &Frame, folder: &Path) -> Result<PathBuf> {
    output::make_folder(folder)?;
    let first = free_name(folder)?;
    let mut file = AtomicFile::create(&first).map_err(|e| {
        let why = format!("no screenshot can be written there ({})", e.why);
        Error::output(folder, why, HINT).caused_by(e)
    })?;
    frame.encode_png(&mut file).map_err(|e| output::cannot(&first, e))?;
    // Meanwhile another window may have taken the name.
    let is_past = |path: &PathBuf| *path != first;
    file.finish_as(names(folder).skip_while(is_past))?.ok_or_else(|| full(folder))
}

/// Returns the first unused name.
fn free_name(folder: &Path) -> Result<PathBuf> {
    let is_free = |path: &PathBuf| std::fs::symlink_metadata(path).is_err();
    names(folder).find(is_free).ok_or_else(|| full(folder))
}

/// Returns the names of screenshots, in their order.
fn names(folder: &Path) -> impl Iterator<Item = PathBuf> {
    (1..NAMES).map(move |n| folder.join(format!("colvis-{n:04}.png")))
}

fn full(folder: &Path) -> Error {
    Error::output(folder, "is full of screenshots", "move them elsewhere")
}

/// Returns the folder of screenshots: the one that is `set`, or else `colvis` in the platform's folder for pictures.
///
/// # Errors
/// Returns status 5 if the system has no such folder.
pub(crate) fn folder(set: Option<&Path>) -> Result<PathBuf> {
    let home = || std::env::home_dir().filter(|h| h.is_absolute());
    if let Some(set) = set {
        let of_home = set.strip_prefix("~").ok().and_then(|rest| Some(home()?.join(rest)));
        return Ok(of_home.unwrap_or_else(|| set.to_owned()));
    }
    let home = home().ok_or_else(|| Error::output(Path::new("screenshots"), "have no folder on this system", HINT))?;
    let named = pictures_file(&home).and_then(|file| std::fs::read_to_string(file).ok());
    let named = named.and_then(|text| named_pictures(&text, &home));
    Ok(named.unwrap_or_else(|| home.join("Pictures")).join("colvis"))
}

/// Returns the file in which a desktop names its folders.
fn pictures_file(home: &Path) -> Option<PathBuf> {
    if cfg!(any(windows, target_os = "macos")) {
        return None;
    }
    let set = std::env::var_os("XDG_CONFIG_HOME").map(PathBuf::from).filter(|p| p.is_absolute());
    Some(set.unwrap_or_else(|| home.join(".config")).join("user-dirs.dirs"))
}

/// Finds the folder for pictures in the text of that file: `XDG_PICTURES_DIR="$HOME/Bilder"`.
fn named_pictures(text: &str, home: &Path) -> Option<PathBuf> {
    let set = text.lines().rev().find_map(|line| line.trim().strip_prefix("XDG_PICTURES_DIR="))?;
    let path = set.trim().trim_matches('"');
    let path = match path.strip_prefix("$HOME") {
        Some(rest) => home.join(rest.trim_start_matches('/')),
        None => PathBuf::from(path),
    };
    path.is_absolute().then_some(path)
}

/// Formats a pose on one line, as input for `render --poses`.
///
/// A camera other than the perspective one is named.
pub(crate) fn pose_json(pose: &Pose, camera: CameraModel, fov_degrees: f64) -> String {
    let one = json!({
        "position": pose.position.to_array(),
        "forward": pose.attitude.forward.to_array(),
        "up": pose.attitude.up.to_array(),
    });
    let mut all = json!({ "fov_degrees": fov_degrees, "poses": [one] });
    if camera != CameraModel::default() {
        all["camera"] = json!(camera.name);
    }
    all.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_free() {
        let dir = tempfile::tempdir().unwrap();
        let first = free_name(dir.path()).unwrap();
        std::fs::write(&first, "x").unwrap();
        std::fs::create_dir(dir.path().join("colvis-0003.png")).unwrap();
        let second = free_name(dir.path()).unwrap();
        assert_ne!(first, second);
        assert!(second.ends_with("colvis-0002.png"));
    }
    #[test]
    fn what_is_saved_takes_the_place_of_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("a/b");
        let frame = Frame::new(4, 3);
        let paths = [(); 3].map(|()| save(&frame, &folder).unwrap());
        assert!(paths.iter().all(|p| p.is_file()) && paths[0] != paths[1] && paths[1] != paths[2]);
        // A file that another window writes at the same time gets the next name.
        let before = std::fs::read(&paths[0]).unwrap();
        let threads: Vec<_> = (0..4)
            .map(|_| {
                std::thread::spawn({
                    let (frame, folder) = (frame.clone(), folder.clone());
                    move || (0..8).map(|_| save(&frame, &folder).unwrap()).collect::<Vec<_>>()
                })
            })
            .collect();
        let saved: std::collections::BTreeSet<_> = threads.into_iter().flat_map(|t| t.join().unwrap()).collect();
        assert!(saved.len() == 32 && saved.iter().all(|p| std::fs::read(p).unwrap() == before));
        // What fails leaves nothing.
        assert!(save(&Frame::default(), &folder).is_err());
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 35);
        std::fs::write(dir.path().join("file"), "x").unwrap();
        assert_eq!(save(&frame, &dir.path().join("file")).unwrap_err().kind as u8, 5);
    }

    #[test]
    fn pictures_are_where_the_desktop_has_them() {
        let home = Path::new("/home/me");
        let at = |text: &str| named_pictures(text, home);
        assert_eq!(at("# x\nXDG_PICTURES_DIR=\"$HOME/Bilder\"\n"), Some(PathBuf::from("/home/me/Bilder")));
        assert_eq!(at("XDG_PICTURES_DIR=\"/data/pictures\""), Some(PathBuf::from("/data/pictures")));
        assert_eq!((at(""), at("XDG_PICTURES_DIR=\"pictures\""), at("XDG_MUSIC_DIR=\"/m\"")), (None, None, None));
        assert_eq!(folder(Some(Path::new("/x/y"))).unwrap(), Path::new("/x/y"));
        assert!(!folder(Some(Path::new("~/shots"))).unwrap().starts_with("~"));
        assert!(folder(None).unwrap().ends_with("colvis"));
    }
}
