//! Sessions: the last state of a flight, so that a scan that is opened again continues from there.
//!
//! A session is a small JSON file in the platform's folder for application state. Its name is a hash of the scan's grid and
//! voxels. Neither the name nor the contents identify the patient.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::Resume;
use crate::app::FlightApp;
use crate::components::flight::State;
use crate::components::input::{FlightCommand, Hand, HandCommand};
use crate::error::Result;
use crate::host::folders::{self, Folder};
use crate::math::hash;
use crate::output;
use crate::volume::{Volume, content_hash, content_origin};

/// Number of evenly spread voxels that represent the whole volume in the hash.
const SAMPLED: usize = 1 << 16;
/// The current version of the file format.
const VERSION: u32 = 1;
/// Consequence of an invalid file, for messages.
const HINT: &str = "it is not used; the flight starts from the beginning";

/// The last state of a flight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Session {
    version: u32,
    /// World, mm.
    position: [f64; 3],
    /// Unit view direction.
    forward: [f64; 3],
    /// Unit up direction.
    up: [f64; 3],
    /// Segment of the lumen.
    segment: usize,
    /// True if it was flown towards its rectal end.
    reversed: bool,
    /// Name of the guide.
    guide: String,
    /// Multiple of the cruise speed.
    speed: f64,
    /// Position along the path, mm.
    along_mm: f64,
    /// True if it was paused.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    paused: bool,
    /// True if it was a flight through the whole colon, cleansed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    whole: bool,
}

impl folders::Kept for Session {
    const VERSION: u32 = VERSION;

    fn version(&self) -> u32 {
        self.version
    }
}

impl Session {
    /// Captures the state of an unfinished flight. A flight that has arrived, or that flies outside the colon, is not resumed.
    ///
    /// `whole` is true if it reads the whole colon.
    pub(crate) fn of(flight: &FlightApp, whole: bool) -> Option<Self> {
        let (share, length_mm) = flight.survey().progress();
        let segment = flight.setup().plan.segment?;
        if flight.flight().state == State::Arrived {
            return None;
        }
        let pose = flight.pose();
        Some(Self {
            version: VERSION,
            position: pose.position.to_array(),
            forward: pose.attitude.forward.to_array(),
            up: pose.attitude.up.to_array(),
            segment,
            reversed: flight.setup().is_reversed(),
            guide: flight.setup().scene.guide_name().to_owned(),
            speed: flight.camera::<Hand>().map_or(1.0, |h| h.speed),
            along_mm: share * length_mm,
            paused: flight.camera::<Hand>().is_some_and(|h| h.paused),
            whole,
        })
    }

    /// True if the flight read the whole colon.
    pub(crate) fn is_whole(&self) -> bool {
        self.whole
    }

    /// Restores this state in a flight that has just begun, with [`Resume::Everything`] including the guide. Returns the position
    /// along the path, mm; `None` if the camera cannot be there (for example with another `--wall`), in which case the flight
    /// starts from its beginning.
    ///
    /// # Errors
    /// Returns an error if the flight refuses a segment or guide. It is then in its initial state.
    pub(crate) fn resume(&self, flight: &mut FlightApp, what: Resume) -> Result<Option<f64>> {
        let (start, segment, reversed) = (flight.pose(), flight.setup().plan.segment, flight.setup().is_reversed());
        let taken = self.follow(flight, what);
        if taken.is_err() {
            // Return to the flight's previous state, which was valid. Only the refusal is reported.
            if let Some(n) = segment.filter(|_| flight.setup().plan.segment != segment) {
                let _ = flight.act(FlightCommand::Segment(n));
            }
            if flight.setup().is_reversed() != reversed {
                let _ = flight.act(FlightCommand::Reverse);
            }
            flight.place(start.position, start.attitude.forward, start.attitude.up);
        }
        taken
    }

    fn follow(&self, flight: &mut FlightApp, what: Resume) -> Result<Option<f64>> {
        let [position, forward, up] = [self.position, self.forward, self.up].map(DVec3::from_array);
        if !flight.place(position, forward, up) {
            return Ok(None);
        }
        // Segments are numbered differently in a scan whose fluid counts as free, so the position determines the segment.
        let segment = flight.setup().lumen.segment_at(position).unwrap_or(self.segment);
        if flight.setup().plan.segment != Some(segment) {
            flight.act(FlightCommand::Segment(segment))?;
        }
        if flight.setup().is_reversed() != self.reversed {
            flight.act(FlightCommand::Reverse)?;
        }
        if what == Resume::Everything && flight.setup().scene.guide_name() != self.guide {
            flight.act(FlightCommand::Guide(self.guide.clone()))?;
        }
        flight.act(HandCommand::Speed(self.speed))?;
        if self.paused {
            flight.act(HandCommand::Pause(true))?;
        }
        // Another segment starts at its end.
        flight.place(position, forward, up);
        flight.stands_at(self.along_mm);
        Ok(Some(self.along_mm))
    }

    /// Reads a session; `None` if the file does not exist.
    ///
    /// # Errors
    /// Returns status 3 if the file is invalid.
    pub(crate) fn read(path: &Path) -> Result<Option<Self>> {
        folders::read_kept(path, HINT)
    }

    /// Writes the session of a flight. If the flight has none, removes an existing session.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be written.
    pub(crate) fn keep(session: Option<&Self>, path: &Path) -> Result<()> {
        let Some(session) = session else {
            return match std::fs::remove_file(path) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(output::cannot(path, e)),
                _ => Ok(()),
            };
        };
        folders::keep(path, session)
    }
}

/// Returns the session file of a scan as loaded; `None` on a system that defines no folder for it.
pub(crate) fn file(volume: &Volume) -> Option<PathBuf> {
    Folder::State.file(Path::new("sessions").join(format!("{:016x}.json", key(volume))))
}

/// The identity of a scan, whatever file it is read from.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Content {
    /// Its hash.
    pub(crate) hash: String,
    /// Where it lies, world mm.
    pub(crate) origin: DVec3,
}

impl Content {
    /// Returns that of a scan as loaded.
    pub(crate) fn of(volume: &Volume) -> Self {
        Self { hash: content_hash(volume), origin: content_origin(volume.grid()) }
    }

    /// Returns the name of its file of findings.
    fn file_name(&self) -> String {
        format!("{}.json", self.hash.rsplit(':').next().unwrap_or_default())
    }
}

/// What is kept of a scan beside its session: files in folders of their own. Findings are named by the scan's content, since they
/// belong to it in whatever form it comes; the others like the session.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ScanFiles {
    /// The scan that they are of.
    pub(crate) content: Content,
    /// What the reader found.
    pub(crate) findings: Option<PathBuf>,
    /// The files in which earlier versions kept all of that,
    pub(crate) earlier: Option<PathBuf>,
    /// distances,
    pub(crate) measures: Option<PathBuf>,
    /// answers
    pub(crate) answers: Option<PathBuf>,
    /// and kinds.
    pub(crate) kinds: Option<PathBuf>,
    /// What was looked at.
    pub(crate) looked: Option<PathBuf>,
    /// An empty file that the window which keeps the others has locked.
    pub(crate) lock: Option<PathBuf>,
}

impl ScanFiles {
    /// Those of the scan with this session file. A flight that repeats another has none: it takes nothing of what was kept, and must
    /// not overwrite it.
    pub(crate) fn of(session: Option<&Path>, content: &Content, resume: Resume) -> Self {
        let name = session.and_then(Path::file_name).filter(|_| resume != Resume::Never);
        let Some(name) = name.and_then(OsStr::to_str) else { return Self::default() };
        Self::named(name, content.clone(), |file| Folder::State.file(file))
    }

    /// Those in a folder, of a scan with this name as its hash.
    #[cfg(test)]
    pub(crate) fn below(folder: &Path, name: &str) -> Self {
        let content = Content { hash: format!("sha256:{}", name.trim_end_matches(".json")), origin: DVec3::ZERO };
        let earlier = format!("earlier-{name}");
        Self {
            earlier: Some(folder.join("findings").join(earlier)),
            ..Self::named(name, content, |file| Some(folder.join(file)))
        }
    }

    /// Returns those that findings are read from.
    pub(crate) fn all(&self) -> impl Iterator<Item = &PathBuf> {
        [&self.findings, &self.earlier, &self.measures, &self.answers, &self.kinds].into_iter().flatten()
    }

    /// Those of a session with this name, where `file` returns a path in the folder of all.
    fn named(name: &str, content: Content, file: impl Fn(PathBuf) -> Option<PathBuf>) -> Self {
        let like_session = |folder: &str| file(Path::new(folder).join(name));
        let by_content = |folder: &str| file(Path::new(folder).join(content.file_name()));
        Self {
            findings: by_content("findings"),
            earlier: like_session("findings"),
            measures: like_session("measures"),
            answers: like_session("answers"),
            kinds: like_session("kinds"),
            looked: like_session("seen"),
            lock: by_content("locks"),
            content,
        }
    }
}

/// Computes a hash of the grid and of voxels spread over the volume.
fn key(volume: &Volume) -> u64 {
    let (grid, data) = (volume.grid(), volume.data());
    let [nx, ny, nz] = grid.dims().map(|d| d as u64);
    let geometry = grid.to_world().to_cols_array().map(f64::to_bits);
    let stride = data.len().div_ceil(SAMPLED).max(1);
    // Each number is mixed with all previous ones.
    let mut key = 0;
    for n in [nx, ny, nz].into_iter().chain(geometry).chain(data.iter().step_by(stride).map(|&v| v as u64)) {
        key = hash::bits(key, n);
    }
    key
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::flight::Flight;
    use crate::volume::Grid;
    use glam::DMat3;

    fn session() -> Session {
        Session {
            version: VERSION,
            position: [1.5, -2.25, 1e-3],
            forward: [0.0, 1.0, 0.0],
            up: [0.0, 0.0, 1.0],
            segment: 2,
            reversed: true,
            guide: "manual".to_owned(),
            speed: 1.25,
            along_mm: 310.5,
            paused: true,
            whole: false,
        }
    }

    #[test]
    fn what_is_kept_is_read_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a").join("b.json");
        assert_eq!(Session::read(&path).unwrap(), None);
        Session::keep(Some(&session()), &path).unwrap();
        assert_eq!(Session::read(&path).unwrap(), Some(session()));
        Session::keep(None, &path).unwrap();
        Session::keep(None, &path).unwrap();
        assert_eq!(Session::read(&path).unwrap(), None);
    }

    #[test]
    fn what_the_flight_refuses_leaves_it_at_its_start() {
        let tube = || crate::host::window::controller::tests::flight("tentacles");
        let start = tube().pose();
        let inside = Session { position: [16.0, 40.0, 16.0], reversed: false, guide: "none".to_owned(), ..session() };
        let mut flight = tube();
        let e = inside.resume(&mut flight, Resume::Everything).unwrap_err();
        assert!(e.why.contains("none"), "{e}");
        assert_eq!((flight.pose(), flight.setup().scene.guide_name()), (start, "tentacles"));
        flight.step().unwrap();
        // Without that guide the rest is resumed; an invalid camera position is not.
        let mut flight = tube();
        assert_eq!(inside.resume(&mut flight, Resume::Place).unwrap(), Some(310.5));
        assert_eq!(flight.pose().position, DVec3::new(16.0, 40.0, 16.0));
        let mut flight = tube();
        let within = Session { position: [1.0; 3], ..inside };
        assert_eq!(within.resume(&mut flight, Resume::Place).unwrap(), None);
        assert_eq!(flight.pose(), start);
    }

    #[test]
    fn what_is_no_session_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.json");
        for text in ["", "{", "[]", "{\"version\": 1}", "null"] {
            std::fs::write(&path, text).unwrap();
            assert!(Session::read(&path).is_err(), "{text}");
        }
        let other = Session { version: 99, ..session() };
        Session::keep(Some(&other), &path).unwrap();
        assert!(Session::read(&path).is_err());
        assert!(Session::read(dir.path()).is_err(), "a folder");
    }

    #[test]
    fn a_scan_has_a_key_of_its_own() {
        let volume = |origin: f64, changed: i16| {
            let grid = Grid::new([8, 8, 8], DVec3::ONE, DVec3::new(origin, 0.0, 0.0), DMat3::IDENTITY).unwrap();
            let mut data = vec![-1000; 512];
            data[77] = changed;
            Volume::new(grid, data)
        };
        assert_eq!(key(&volume(0.0, 5)), key(&volume(0.0, 5)));
        assert_ne!(key(&volume(0.0, 5)), key(&volume(0.0, -5)));
        assert_ne!(key(&volume(0.0, 5)), key(&volume(1.0, 5)));
    }

    #[test]
    fn an_unfinished_flight_is_kept_with_its_place_on_the_path() {
        let mut flight = crate::host::window::controller::tests::flight("tentacles");
        assert_eq!(Session::of(&flight, false), None, "outside the colon's segments");
        flight.act(FlightCommand::Segment(0)).unwrap();
        let length_mm = flight.setup().plan.length_mm;
        assert!(length_mm > 30.0, "{length_mm}");
        flight.stands_at(0.25 * length_mm);
        let kept = Session::of(&flight, false).unwrap();
        assert!((kept.along_mm - 0.25 * length_mm).abs() < 1e-9, "{} of {length_mm} mm", kept.along_mm);
        assert_eq!((kept.position, kept.segment), (flight.pose().position.to_array(), 0));
        assert_eq!((kept.guide.as_str(), kept.speed, kept.reversed), ("tentacles", 1.0, false));
        // It stands there in another flight, too.
        let mut other = crate::host::window::controller::tests::flight("tentacles");
        kept.resume(&mut other, Resume::Everything).unwrap();
        let again = Session::of(&other, false).unwrap();
        assert_eq!((again.position, again.segment, again.along_mm), (kept.position, kept.segment, kept.along_mm));
    }

    #[test]
    fn a_scan_has_a_file_of_its_own() {
        let volume = |hu: i16| {
            let grid = Grid::new([4; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
            Volume::new(grid, vec![hu; 64])
        };
        // A system may define no folder for it.
        let Some(path) = file(&volume(1)) else { return };
        assert!(path.parent().unwrap().ends_with("sessions"), "{}", path.display());
        assert_eq!(path.extension().unwrap(), "json");
        assert_eq!(file(&volume(1)), Some(path.clone()));
        assert_ne!(file(&volume(2)), Some(path));
    }

    #[test]
    fn a_flight_that_repeats_another_has_none_of_the_files_of_its_scan() {
        let (session, content) =
            (Path::new("sessions/00ff.json"), Content { hash: "sha256:beef".to_owned(), origin: DVec3::ZERO });
        for resume in [Resume::Everything, Resume::Place, Resume::Nothing] {
            let files = ScanFiles::of(Some(session), &content, resume);
            for (file, name) in [
                (files.findings, "findings/beef.json"),
                (files.lock, "locks/beef.json"),
                (files.earlier, "findings/00ff.json"),
                (files.measures, "measures/00ff.json"),
                (files.answers, "answers/00ff.json"),
                (files.kinds, "kinds/00ff.json"),
                (files.looked, "seen/00ff.json"),
            ] {
                // A system may define no folder for it.
                let Some(file) = file else { continue };
                assert!(file.ends_with(name), "{}", file.display());
            }
        }
        assert_eq!(ScanFiles::of(Some(session), &content, Resume::Never), ScanFiles::default());
        assert_eq!(ScanFiles::of(None, &content, Resume::Everything), ScanFiles::default());
    }

    #[test]
    fn a_flight_that_has_arrived_is_not_kept() {
        let mut flight = crate::host::window::controller::tests::flight("tentacles");
        flight.act(FlightCommand::Segment(0)).unwrap();
        assert!(Session::of(&flight, false).is_some());
        flight.camera_mut::<Flight>().unwrap().state = State::Arrived;
        assert_eq!(Session::of(&flight, false), None);
    }
}
