//! The file of what was looked at in a scan: the views that were shown until it was closed, without those that show nothing new.
//!
//! It lies beside the session and is named like it. A session is removed once the flight has arrived; what was seen stays. Views are
//! kept and not the wall, so that they hold for each wall of the scan: with its tag and without, and with other kinds of gas.

use std::collections::BTreeSet;
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::app::FlightApp;
use crate::components::still::{StillView, StillViews};
use crate::components::trail::Trail;
use crate::dynamics::Attitude;
use crate::error::{Error, Result};
use crate::host::folders;
use crate::render::camera::Perspective;
use crate::volume::Volume;

/// The current version of the file format.
const VERSION: u32 = 1;
/// Consequence of an invalid file, for messages.
const HINT: &str = "the file is left unchanged; coverage starts from zero";
/// Maximum number of views.
const MOST: usize = 12_000;
/// Of views nearer to each other than this, mm, whose directions differ by less than this share of their length, one is kept.
const NEAR_MM: f64 = 1.5;
const NEAR_TURN: f64 = 0.12;
/// The view angle that a picture counts with which is wider than a flat one can be, degrees.
const USUAL_DEGREES: f64 = 90.0;
/// Parts of a millimetre, of a unit and of a degree in the file.
const PER_MM: f64 = 100.0;
const PER_UNIT: f64 = 10_000.0;
const PER_DEGREE: f64 = 10.0;

/// The file format.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    version: u32,
    /// Each view as 8 whole numbers: position, world, 0.01 mm; turn as a quaternion, 0.0001; view angle, 0.1 degrees.
    views: Vec<String>,
}

impl folders::Kept for Kept {
    const VERSION: u32 = VERSION;

    fn version(&self) -> u32 {
        self.version
    }
}

/// Reads the views of a file; none if it does not exist. Views whose angle is that of no flat picture are skipped.
///
/// # Errors
/// Returns status 3 if it is no file of views, or if they are not of this scan.
pub(crate) fn read(path: &Path, scan: &Volume) -> Result<Vec<StillView>> {
    let Some(kept) = folders::read_kept::<Kept>(path, HINT)? else { return Ok(Vec::new()) };
    let bad = |why: &str| Error::file(path, why, HINT);
    let views: Option<Vec<StillView>> = kept.views.iter().take(MOST).map(|text| view(text)).collect();
    let mut views = views.ok_or_else(|| bad("has an invalid view"))?;
    if !views.iter().all(|v| is_inside(v, scan)) {
        return Err(bad("has views outside of this scan"));
    }
    views.retain(|v| Perspective::new(v.fov_degrees).is_ok());
    Ok(views)
}

/// True if a view is in the scan, or at its edge.
fn is_inside(v: &StillView, scan: &Volume) -> bool {
    let grid = scan.grid();
    let (at, last) = (grid.voxel(v.position), DVec3::from_array(grid.dims().map(|d| d as f64)));
    at.cmpge(DVec3::NEG_ONE).all() && at.cmple(last).all()
}

/// Writes views to a file. Without any, an existing file is left as it is.
///
/// # Errors
/// Returns status 5 if it cannot be written.
pub(crate) fn keep(path: &Path, views: &[StillView]) -> Result<()> {
    if views.is_empty() {
        return Ok(());
    }
    let views = thinned(views).iter().map(text).collect();
    folders::keep(path, &Kept { version: VERSION, views })
}

/// Returns what was looked at in a flight: before it, at rest, and on its way. None of it is a view that [`read`] refuses.
pub(crate) fn of(flight: &FlightApp) -> Vec<StillView> {
    let fov_degrees = flight.setup().scene.image.fov_degrees;
    let still = flight.camera::<StillViews>().map_or(&[][..], StillViews::views);
    let trail = flight.survey().trail().map_or(&[][..], Trail::views);
    let flown = trail.iter().map(|&(position, attitude)| StillView { position, attitude, fov_degrees });
    let scan = flight.setup().volume.voxels();
    let is_one = |v: &StillView| view(&text(v)).is_some_and(|read| is_inside(&read, scan));
    still.iter().copied().chain(flown).map(flat).filter(is_one).collect()
}

/// A picture that is wider than a flat one can be counts with the usual angle.
fn flat(v: StillView) -> StillView {
    let is_flat = Perspective::new(v.fov_degrees).is_ok();
    if is_flat { v } else { StillView { fov_degrees: USUAL_DEGREES, ..v } }
}

/// Returns the views without those that are about the same as one before, and farther apart the more there are.
fn thinned(views: &[StillView]) -> Vec<StillView> {
    let mut apart = 1.0;
    loop {
        let mut known = BTreeSet::new();
        let cell = |v: DVec3, side: f64| (v / (side * apart)).floor().as_i64vec3().to_array();
        let about = |v: &StillView| {
            let turns = [v.attitude.forward, v.attitude.up].map(|axis| cell(axis, NEAR_TURN));
            (cell(v.position, NEAR_MM), turns, (v.fov_degrees * PER_DEGREE) as i64)
        };
        let kept: Vec<StillView> = views.iter().filter(|v| known.insert(about(v))).copied().collect();
        // Of countless view angles the last ones are kept.
        if kept.len() <= MOST || apart > 100.0 {
            return kept[kept.len().saturating_sub(MOST)..].to_vec();
        }
        apart *= 1.25;
    }
}

fn text(v: &StillView) -> String {
    let Attitude { forward, up } = v.attitude;
    let turn = DQuat::from_mat3(&DMat3::from_cols(forward.cross(up), forward, up));
    let numbers = v.position.to_array().map(|mm| mm * PER_MM).into_iter();
    let numbers = numbers.chain(turn.to_array().map(|q| q * PER_UNIT)).chain([v.fov_degrees * PER_DEGREE]);
    numbers.map(|n| format!("{:.0}", n.round())).collect::<Vec<_>>().join(" ")
}

/// Returns the view of a text; `None` if it is none.
fn view(text: &str) -> Option<StillView> {
    let numbers: Option<Vec<i32>> = text.split(' ').map(|n| n.parse().ok()).collect();
    let [x, y, z, a, b, c, d, fov] = <[i32; 8]>::try_from(numbers?).ok()?.map(f64::from);
    let turn = DQuat::from_xyzw(a, b, c, d);
    let is_valid = turn.length() > 0.5 * PER_UNIT && fov > 0.0;
    let turn = DMat3::from_quat(turn.normalize());
    let attitude = Attitude::new(turn.y_axis, turn.z_axis);
    let position = DVec3::new(x, y, z) / PER_MM;
    is_valid.then_some(StillView { position, attitude, fov_degrees: fov / PER_DEGREE })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Grid;

    fn scan() -> Volume {
        let grid = Grid::new([60; 3], DVec3::ONE, DVec3::splat(-10.0), DMat3::IDENTITY).unwrap();
        Volume::new(grid.clone(), vec![0; grid.len()])
    }

    fn views(count: usize) -> Vec<StillView> {
        let view = |n: usize| {
            let t = n as f64 * 0.37;
            let attitude = Attitude::new(DVec3::new(t.cos(), t.sin(), (0.3 * t).sin()), DVec3::Z);
            let position = DVec3::new(20.0 * t.sin(), 20.0 * (0.7 * t).cos(), 0.0003 * n as f64) + 15.0;
            StillView { position, attitude, fov_degrees: 60.0 + (n % 3) as f64 * 30.0 }
        };
        (0..count).map(view).collect()
    }

    #[test]
    fn what_is_kept_is_read_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("seen").join("a.json");
        assert!(read(&path, &scan()).unwrap().is_empty());
        keep(&path, &[]).unwrap();
        assert!(!path.exists());
        let all = views(400);
        keep(&path, &all).unwrap();
        let again = read(&path, &scan()).unwrap();
        let kept = thinned(&all);
        assert!(kept.len() > 300 && again.len() == kept.len());
        for (a, b) in kept.iter().zip(&again) {
            assert!(a.position.distance(b.position) < 0.01 && a.fov_degrees == b.fov_degrees);
            assert!(
                a.attitude.forward.distance(b.attitude.forward) < 1e-3 && a.attitude.up.distance(b.attitude.up) < 1e-3
            );
        }
        // Kept again, it does not grow.
        keep(&path, &[&again[..], &again[..]].concat()).unwrap();
        assert_eq!(read(&path, &scan()).unwrap().len(), thinned(&again).len());
    }

    /// Fails if one view that is not read makes the file useless, so that nothing is kept of the scan any more.
    #[test]
    fn what_a_flight_keeps_can_be_read() {
        let mut flight = crate::host::window::controller::tests::flight("tentacles");
        flight.fly(0.5).unwrap();
        let here = views(1)[0];
        let strange = [
            StillView { fov_degrees: 220.0, ..here },
            StillView { fov_degrees: 0.0, ..here },
            StillView { fov_degrees: f64::NAN, ..here },
            StillView { position: DVec3::splat(1e5), ..here },
            StillView { attitude: Attitude { forward: DVec3::ZERO, up: DVec3::ZERO }, ..here },
        ];
        let still: StillViews = strange.into_iter().collect();
        flight.app_mut().camera().insert(still);
        let (dir, volume) = (tempfile::tempdir().unwrap(), flight.setup().volume.voxels().clone());
        let path = dir.path().join("a.json");
        keep(&path, &of(&flight)).unwrap();
        let read = read(&path, &volume).unwrap();
        assert!(read.len() > 1 && read.len() == thinned(&of(&flight)).len(), "{}", read.len());
        assert!(read.iter().all(|v| v.fov_degrees == USUAL_DEGREES), "as its pictures count: {read:?}");
    }

    #[test]
    fn its_size_is_bounded() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        keep(&path, &views(100_000)).unwrap();
        assert!(std::fs::metadata(&path).unwrap().len() < 1 << 20, "larger than the program reads");
        let count = read(&path, &scan()).unwrap().len();
        assert!(count > MOST / 4 && count <= MOST, "{count}");
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        for bad in [
            "",
            "[]",
            "{\"version\": 1}",
            "{\"version\": 2, \"views\": []}",
            "{\"version\": 1, \"views\": [\"1 2\"]}",
            "{\"version\": 1, \"views\": [\"1 2 3 0 0 0 0 900\"]}",
            "{\"version\": 1, \"views\": [\"1 2 3 0 0 0 10000 0\"]}",
        ] {
            std::fs::write(&path, bad).unwrap();
            assert!(read(&path, &scan()).is_err(), "{bad}");
        }
        // What a picture that is not flat has left is skipped.
        let text = "{\"version\": 1, \"views\": [\"1 2 3 0 0 0 10000 2200\", \"1 2 3 0 0 0 10000 900\"]}";
        std::fs::write(&path, text).unwrap();
        assert_eq!(read(&path, &scan()).unwrap().len(), 1);
        let far = StillView { position: DVec3::splat(500.0), ..views(1)[0] };
        keep(&path, &[views(1)[0], far]).unwrap();
        let e = read(&path, &scan()).unwrap_err().to_string();
        assert!(e.contains("views outside of this scan") && e.contains("coverage starts from zero"), "{e}");
    }
}
