//! What is kept of the open scan, and which window keeps it.
//!
//! The first window that opens a scan locks it, and keeps what is made there. Others show what was kept until they opened it, and keep
//! nothing: whoever wrote last would overwrite the others. Once the first is closed, the next takes over, unless the first has changed
//! what is kept: then what was made here would overwrite that. The system gives the lock of a program that has crashed free.

use std::fs::{File, TryLockError};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use super::Resume;
use super::controller::FlightController;
use super::document::Document;
use super::loading::SessionFile;
use super::looked;
use super::session::{ScanFiles, Session};
use crate::app::FlightApp;
use crate::components::still::StillViews;
use crate::error::Error;
use crate::output;

/// Time between two tries to take over.
const TRIES: Duration = Duration::from_secs(1);

/// What is said when another window has the scan.
pub(crate) const ELSEWHERE: &str =
    "This case is open in another window. What you make here is not kept until that window is closed.";
/// What is said when this window keeps the scan from now on.
const TAKEN_OVER: &str = "the other window is closed: what you make here is kept";
/// What is said when it cannot.
const CHANGED: &str = "The other window has changed what is kept of this case, so what you make here is not saved. Open the scan again to continue.";

/// Why what was made is not kept, for the question whether to close the window.
const IS_ELSEWHERE: &str = "The case is open in another window.";
const HAS_CHANGED: &str = "Another window has changed what is kept of this case.";

/// Whether this window keeps the scan.
enum Hold {
    /// It does, with the lock, if the system has one.
    Ours(#[expect(dead_code, reason = "it is locked while it is open")] Option<File>),
    /// Another one does. The files of the scan as they were when they were read, and when the lock was tried.
    Theirs(File, Vec<(PathBuf, Option<Vec<u8>>)>, Instant),
    /// Nobody does: this one could not take over.
    Nobody,
}

/// What became of a try to take over.
pub(crate) enum Turn {
    /// This window keeps the scan now.
    TakenOver,
    /// It cannot, because what is kept has changed.
    Changed,
    /// It cannot, because a file of the scan is damaged.
    Damaged(Error),
    /// It cannot, because what was made until now could not be stored.
    Failed(Error),
}

impl Turn {
    /// Returns what the reader is told.
    pub(crate) fn said(&self) -> String {
        match self {
            Self::TakenOver => TAKEN_OVER.to_owned(),
            Self::Changed => CHANGED.to_owned(),
            Self::Damaged(e) => format!("The other window is closed, but what you make here is not kept: {e}."),
            Self::Failed(e) => {
                format!(
                    "The other window is closed, but what you make here is not kept: {e}. Then open the scan again."
                )
            }
        }
    }

    /// Returns what the reader must know from now on.
    pub(crate) fn warning(&self) -> Option<String> {
        (!matches!(self, Self::TakenOver)).then(|| self.said())
    }
}

/// What is kept of the open scan.
pub(crate) struct Keeping {
    /// The file of the session; its name identifies the scan. `None` if the position of the flight is not kept.
    session: Option<PathBuf>,
    files: ScanFiles,
    hold: Hold,
    /// True if the flight reads the whole colon.
    is_whole: bool,
    /// The error of a file that is damaged.
    damaged: Option<Error>,
}

impl Keeping {
    /// Begins to keep the scan with this session file, unless another window does.
    pub(crate) fn of(session: SessionFile, resume: Resume, is_guided: bool, now: Instant) -> Self {
        let files = ScanFiles::of(session.path.as_deref(), &session.content, resume);
        let session = session.path.filter(|_| resume != Resume::Never);
        let hold = hold(&files, now);
        // Without a guide there is no position from which another flight could continue.
        Self { session: session.filter(|_| is_guided), files, hold, is_whole: false, damaged: None }
    }

    /// Sets whether the flight reads the whole colon: the scan then opens with such a flight the next time, too.
    pub(crate) fn reads_whole(&mut self, is_whole: bool) {
        self.is_whole = is_whole;
    }

    /// Lets a flight that has just begun go on where the last one was left. Returns the position along the path, mm, if it does.
    pub(crate) fn resume(&mut self, flight: &mut FlightApp, resume: Resume) -> Option<f64> {
        if let Some(path) = &self.files.looked {
            match looked::read(path, flight.setup().volume.voxels()) {
                Ok(views) if views.is_empty() => {}
                Ok(views) => _ = flight.app_mut().camera().insert(StillViews::from_iter(views)),
                Err(e) => {
                    output::to_stderr(format_args!("note: earlier coverage is unknown: {e}"));
                    self.files.looked = None;
                }
            }
        }
        let path = self.session.as_deref().filter(|_| matches!(resume, Resume::Everything | Resume::Place))?;
        let left = Session::read(path).unwrap_or_else(|e| {
            output::to_stderr(format_args!("note: {e}"));
            None
        })?;
        // A session that cannot be restored must not prevent the scan from opening.
        left.resume(flight, resume).unwrap_or_else(|e| {
            output::to_stderr(format_args!("note: the flight does not resume where you left it: {e}"));
            None
        })
    }

    /// Gives a window what was kept, and the files to keep it in. Where one of them is damaged, nothing is kept: it would take the
    /// damaged one's place.
    pub(crate) fn equip(&mut self, controller: &mut FlightController) {
        let (document, damaged) = Document::open(&self.files);
        controller.set_document(document);
        self.damaged = damaged;
        _ = controller.keep_files(self.is_ours() && self.damaged.is_none());
        if !self.is_ours() {
            controller.set_unkept(IS_ELSEWHERE);
        } else if let Some(e) = &self.damaged {
            controller.set_unkept(format!("{}: {}.", e.what, e.why));
        }
    }

    /// True if what is made is stored: by this window, in files that are sound, and on a system that has a folder for them.
    pub(crate) fn keeps(&self) -> bool {
        self.is_ours() && self.damaged.is_none() && self.files.findings.is_some()
    }

    /// True if this window keeps what is made.
    pub(crate) fn is_ours(&self) -> bool {
        matches!(self.hold, Hold::Ours(_))
    }

    /// Returns what the reader must know about it.
    pub(crate) fn warning(&self) -> Option<String> {
        if !self.is_ours() {
            return Some(ELSEWHERE.to_owned());
        }
        self.damaged.as_ref().map(|e| format!("What you make here is not kept: {e}."))
    }

    /// Takes over once the other window is closed. Returns what became of it, if anything did.
    pub(crate) fn take_over(&mut self, controller: &mut FlightController, now: Instant) -> Option<Turn> {
        let Hold::Theirs(lock, before, tried) = &mut self.hold else { return None };
        if now.saturating_duration_since(*tried) < TRIES {
            return None;
        }
        *tried = now;
        if lock.try_lock().is_err() {
            return None;
        }
        let is_as_read = before.iter().all(|(path, bytes)| std::fs::read(path).ok() == *bytes);
        let Hold::Theirs(lock, ..) = std::mem::replace(&mut self.hold, Hold::Nobody) else { return None };
        if let Some(e) = &self.damaged {
            controller.set_unkept(format!("{}: {}.", e.what, e.why));
            return Some(Turn::Damaged(e.clone()));
        }
        if !is_as_read {
            controller.set_unkept(HAS_CHANGED);
            return Some(Turn::Changed);
        }
        if let Err(e) = controller.keep_files(true) {
            output::to_stderr(format_args!("note: {e}"));
            _ = controller.keep_files(false);
            controller.set_unkept(format!("{}: {}.", e.what, e.why));
            return Some(Turn::Failed(e));
        }
        self.hold = Hold::Ours(Some(lock));
        Some(Turn::TakenOver)
    }

    /// Returns when the next try to take over is due.
    pub(crate) fn next(&self) -> Option<Instant> {
        if let Hold::Theirs(.., tried) = &self.hold { Some(*tried + TRIES) } else { None }
    }

    /// Keeps where the flight is and what was looked at, when the scan is closed.
    pub(crate) fn close(&self, flight: &FlightApp) {
        if !self.is_ours() {
            return;
        }
        if let Some(path) = &self.session
            && let Err(e) = Session::keep(Session::of(flight, self.is_whole).as_ref(), path)
        {
            output::to_stderr(format_args!("note: the position of this flight was not saved: {e}"));
        }
        // Another window may have kept what was looked at there: nothing of it is lost.
        if let Some(path) = &self.files.looked
            && let Err(e) = looked::read(path, flight.setup().volume.voxels())
                .and_then(|before| looked::keep(path, &[before, looked::of(flight)].concat()))
        {
            output::to_stderr(format_args!("note: coverage was not saved: {e}"));
        }
    }
}

/// Locks the scan with these files, unless another window has.
fn hold(files: &ScanFiles, now: Instant) -> Hold {
    let Some(path) = &files.lock else { return Hold::Ours(None) };
    let folder = path.parent().map_or(Ok(()), output::make_folder);
    let open = || File::options().create(true).truncate(false).write(true).open(path);
    let Some(lock) = folder.ok().and_then(|()| open().ok()) else { return Hold::Ours(None) };
    match lock.try_lock() {
        Ok(()) => Hold::Ours(Some(lock)),
        Err(TryLockError::WouldBlock) => {
            let all = files.all();
            Hold::Theirs(lock, all.map(|path| (path.clone(), std::fs::read(path).ok())).collect(), now)
        }
        // A file system without locks.
        Err(TryLockError::Error(_)) => Hold::Ours(None),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::time::Duration;

    use glam::DVec3;

    use super::*;
    use crate::app::{FlightRequest, ImageSettings, OpenOptions, Scan, Scene};
    use crate::components::input::{FlightCommand, Hand, HandCommand};
    use crate::coverage::LiveCoverage;
    use crate::host::window::contract::WindowView;
    use crate::host::window::controller::tests::{cockpit_of, flight, trace};

    /// What a window keeps in a folder, as it is when it opens a scan.
    fn opened(folder: &Path, now: Instant) -> Keeping {
        let files = ScanFiles::below(folder, "a.json");
        Keeping {
            hold: hold(&files, now),
            session: Some(folder.join("sessions").join("a.json")),
            files,
            is_whole: false,
            damaged: None,
        }
    }

    /// A window that shows a flight with what was kept.
    fn window(keeping: &mut Keeping) -> FlightController {
        let mut flight = flight("tentacles");
        keeping.resume(&mut flight, Resume::Everything);
        let mut c = cockpit_of(flight, 0.0, Vec::new());
        keeping.equip(&mut c);
        c
    }

    fn measure(c: &mut FlightController, to: DVec3) {
        c.measure_between(DVec3::ZERO, to);
    }

    fn kept(folder: &Path) -> usize {
        Document::open(&ScanFiles::below(folder, "a.json")).0.found().distances.len()
    }

    /// Fails if the second window writes: the distance of the first, or its own, would be gone.
    #[test]
    fn a_second_window_keeps_nothing_until_the_first_is_closed() {
        let (dir, mut now) = (tempfile::tempdir().unwrap(), Instant::now());
        let mut first = opened(dir.path(), now);
        let mut a = window(&mut first);
        measure(&mut a, DVec3::X);
        let mut second = opened(dir.path(), now);
        assert!(first.warning().is_none() && second.warning().unwrap().contains("open in another window"));
        let mut b = window(&mut second);
        measure(&mut b, DVec3::Y);
        assert_eq!((b.measures().list().len(), kept(dir.path())), (2, 1), "it shows what was kept, and keeps nothing");
        assert!(b.unfinished().unwrap().contains("open in another window. What you made here is not kept"));
        assert!(a.unfinished().is_none());
        now += Duration::from_secs(2);
        assert!(second.take_over(&mut b, now).is_none() && second.next().is_some());
        first.close(a.flight());
        drop(first);
        assert!(second.take_over(&mut b, now).is_none(), "not tried again at once");
        now += Duration::from_secs(2);
        assert!(matches!(second.take_over(&mut b, now), Some(Turn::TakenOver)));
        assert!(second.is_ours() && second.next().is_none() && b.unfinished().is_none());
        assert_eq!(kept(dir.path()), 2);
        measure(&mut b, DVec3::Z);
        assert_eq!(kept(dir.path()), 3);
        // The next one finds it locked in turn.
        assert!(!opened(dir.path(), now).is_ours());
        second.close(b.flight());
        drop(second);
        assert!(opened(dir.path(), now).is_ours());
    }

    #[test]
    fn what_the_first_window_has_changed_meanwhile_is_not_overwritten() {
        let (dir, mut now) = (tempfile::tempdir().unwrap(), Instant::now());
        let mut first = opened(dir.path(), now);
        let mut a = window(&mut first);
        let mut second = opened(dir.path(), now);
        let mut b = window(&mut second);
        measure(&mut b, DVec3::Y);
        measure(&mut a, DVec3::X);
        measure(&mut a, DVec3::Z);
        first.close(a.flight());
        drop(first);
        now += Duration::from_secs(2);
        assert!(matches!(second.take_over(&mut b, now), Some(Turn::Changed)));
        assert!(!second.is_ours() && second.next().is_none());
        let told = b.unfinished().unwrap();
        assert!(told.contains("has changed") && told.contains("not kept") && !told.contains("is open in"), "{told}");
        measure(&mut b, DVec3::Y);
        second.close(b.flight());
        assert_eq!(kept(dir.path()), 2);
    }

    #[test]
    fn a_window_that_cannot_store_does_not_say_that_it_keeps() {
        let (dir, mut now) = (tempfile::tempdir().unwrap(), Instant::now());
        let mut first = opened(dir.path(), now);
        let a = window(&mut first);
        let mut second = opened(dir.path(), now);
        let mut b = window(&mut second);
        measure(&mut b, DVec3::Y);
        first.close(a.flight());
        drop(first);
        // A file where the folder of the distances would be.
        std::fs::write(dir.path().join("findings"), "").unwrap();
        now += Duration::from_secs(2);
        let turn = second.take_over(&mut b, now).unwrap();
        assert!(matches!(&turn, Turn::Failed(_)) && turn.warning() == Some(turn.said()));
        assert!(turn.said().contains("is not kept: ") && turn.said().contains("findings"), "{}", turn.said());
        assert!(!second.is_ours() && second.next().is_none());
        let told = b.unfinished().unwrap();
        assert!(told.contains("findings") && told.ends_with("What you made here is not kept."), "{told}");
        // Another window may keep the scan.
        assert!(opened(dir.path(), now).is_ours());
        second.close(b.flight());
    }

    /// Fails if the sound files are not shown, if a file is written over them, or if the window closes without a question.
    #[test]
    fn where_a_file_is_damaged_the_others_are_shown_and_nothing_is_kept() {
        let (dir, mut now) = (tempfile::tempdir().unwrap(), Instant::now());
        let write = |kind: &str, text: &str| {
            std::fs::create_dir_all(dir.path().join(kind)).unwrap();
            std::fs::write(dir.path().join(kind).join("a.json"), text).unwrap();
        };
        write("measures", r#"{"version": 1, "measures": [[[1.0, 0.0, 0.0], [3.0, 4.0, 0.1]]]}"#);
        write("answers", "{\"colvis\": \"answers\"");
        let mut first = opened(dir.path(), now);
        let mut a = window(&mut first);
        assert_eq!(a.unfinished(), None);
        assert!(!first.keeps() && first.is_ours());
        let told = first.warning().unwrap();
        assert!(told.contains("answers") && told.contains("move it away"), "{told}");
        let mut second = opened(dir.path(), now);
        let mut b = window(&mut second);
        measure(&mut a, DVec3::Y);
        assert_eq!(a.measures().list().len(), 2);
        let told = a.unfinished().unwrap();
        assert!(told.contains("answers") && told.ends_with("What you made here is not kept."), "{told}");
        first.close(a.flight());
        drop(first);
        now += Duration::from_secs(2);
        let turn = second.take_over(&mut b, now).unwrap();
        assert!(matches!(turn, Turn::Damaged(_)) && turn.said().contains("answers"), "{}", turn.said());
        measure(&mut b, DVec3::Y);
        assert!(b.has_unkept() && !dir.path().join("findings").exists());
        // Without the damaged file, what is made is kept with what was read.
        std::fs::remove_file(dir.path().join("answers").join("a.json")).unwrap();
        drop(second);
        let mut third = opened(dir.path(), now);
        let mut c = window(&mut third);
        assert!(third.keeps() && third.warning().is_none());
        measure(&mut c, DVec3::Y);
        assert!(!c.has_unkept());
        assert_eq!(kept(dir.path()), 2);
    }

    /// Fails if what was seen is lost when a scan is closed.
    #[test]
    #[ignore = "slow: coverage of a phantom, opened again and again"]
    fn what_was_seen_is_there_when_the_scan_is_opened_again() {
        let dir = tempfile::tempdir().unwrap();
        let now = Instant::now();
        let open = || {
            let image = ImageSettings { width: 64, height: 48, ..ImageSettings::default() };
            let scene = Scene { picture: true, operator: true, image, ..Scene::guided_by("tentacles") };
            let mut scan = Scan::phantom_with(1, &OpenOptions::default()).unwrap();
            scan.flight(scene, &FlightRequest::default()).unwrap()
        };
        let share = |mut flight: FlightApp| {
            // Nothing more is seen meanwhile.
            flight.act(HandCommand::Pause(true)).unwrap();
            let mut c = cockpit_of(flight, 0.0, Vec::new());
            let mut now = Instant::now();
            trace(&mut c, now);
            c.show_seen(true, now);
            let begun = Instant::now();
            while c.seen().list().is_none() || c.cleansing().is_under_way() {
                assert!(begun.elapsed() < Duration::from_secs(100), "{:?}", c.seen().state());
                now += Duration::from_millis(1);
                c.advance(now).unwrap();
                std::thread::sleep(Duration::from_millis(2));
            }
            c.flight().camera::<LiveCoverage>().unwrap().share()
        };
        let mut flown = open();
        flown.fly(6.0).unwrap();
        opened(dir.path(), now).close(&flown);
        let mut again = open();
        let mut keeping = opened(dir.path(), now);
        assert!(keeping.resume(&mut again, Resume::Nothing).is_none());
        let [nothing, before, then] = [open(), flown, again].map(share);
        assert!(before > nothing + 0.02 && then > before - 0.005, "{nothing}, {before}, and then {then}");
        // It stays when nothing more is seen, and a damaged file is left as it is.
        let path = keeping.files.looked.clone().unwrap();
        keeping.close(&open());
        assert!(std::fs::metadata(&path).unwrap().len() > 1000);
        std::fs::write(&path, "damaged").unwrap();
        let mut keeping = opened(dir.path(), now);
        keeping.resume(&mut open(), Resume::Nothing);
        keeping.close(&open());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "damaged");
    }

    #[test]
    fn a_case_that_was_left_paused_opens_paused() {
        let dir = tempfile::tempdir().unwrap();
        for (is_paused, state) in [(false, "flying"), (true, "paused")] {
            let mut left = flight("tentacles");
            left.act(FlightCommand::Segment(0)).unwrap();
            left.act(HandCommand::Pause(is_paused)).unwrap();
            left.fly(0.1).unwrap();
            assert_eq!(left.camera::<Hand>().unwrap().paused, is_paused);
            opened(dir.path(), Instant::now()).close(&left);
            let mut keeping = opened(dir.path(), Instant::now());
            let mut c = window(&mut keeping);
            let (start, mut now) = (c.flight().pose().position, Instant::now());
            for _ in 0..40 {
                now += Duration::from_millis(25);
                c.advance(now).unwrap();
            }
            let hud = c.hud(now);
            assert_eq!(hud.state, state);
            assert_eq!(hud.more.iter().any(|m| m == "Space flies on."), is_paused, "{:?}", hud.more);
            let mm = c.flight().pose().position.distance(start);
            assert!(if is_paused { mm < 0.5 } else { mm > 1.0 }, "{mm} mm");
            keeping.close(c.flight());
        }
    }
}
