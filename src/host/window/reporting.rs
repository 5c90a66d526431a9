//! The report of a reading, made in the background while the reading goes on.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use super::background::{Background, BackgroundTask};
use super::screenshot;
use crate::app::findings::Findings;
#[cfg(feature = "dicom")]
use crate::dicom::archive::Archive;
use crate::error::{Error, Result};
use crate::output;
use crate::progress::Progress;

/// A report that is asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub struct ReportOrder {
    /// Path of the scan.
    pub input: PathBuf,
    /// A series in a folder that holds several.
    pub series: Option<usize>,
    /// The scan of the patient's other position, if the findings name it.
    pub second: Option<PathBuf>,
    /// The file of the findings.
    pub findings: PathBuf,
    /// The folder that the report is written to.
    pub out: PathBuf,
    /// True if an archive gets it: with DICOM objects, which tell whose scan it is.
    pub for_archive: bool,
}

/// Makes a report. Called on another thread.
#[doc(hidden)]
pub type MakeReport = Arc<dyn Fn(&ReportOrder, &Arc<Progress>) -> Result<()> + Send + Sync>;

/// The open scan, of which reports are made.
pub(crate) struct Reported {
    pub(crate) make: MakeReport,
    pub(crate) input: PathBuf,
    pub(crate) series: Option<usize>,
    /// The scan of the patient's other position, and its hash.
    pub(crate) second: Option<(PathBuf, String)>,
}

impl Reported {
    /// Returns the scan of the other position, if the findings name it or none.
    fn second(&self, found: &Findings) -> Option<PathBuf> {
        let (path, hash) = self.second.as_ref()?;
        found.second.as_ref().is_none_or(|named| named == hash).then(|| path.clone())
    }
}

/// Makes reports, one at a time.
pub(crate) struct Reporting {
    /// `None` if the scan is no file.
    of: Option<Reported>,
    task: BackgroundTask<String>,
    /// What has become of the last one.
    told: Option<String>,
    /// Where reports can be sent.
    #[cfg(feature = "dicom")]
    archives: Vec<Archive>,
}

impl Reporting {
    pub(crate) fn new(now: Instant) -> Self {
        Self {
            of: None,
            task: BackgroundTask::new(now),
            told: None,
            #[cfg(feature = "dicom")]
            archives: Vec::new(),
        }
    }

    /// Sets of what reports are made.
    pub(crate) fn set(&mut self, of: Option<Reported>) {
        self.of = of;
    }

    /// Sets the scan of the patient's other position, and its hash.
    pub(crate) fn set_second(&mut self, second: Option<(PathBuf, String)>) {
        if let Some(of) = &mut self.of {
            of.second = second;
        }
    }

    /// Sets where reports can be sent.
    #[cfg(feature = "dicom")]
    pub(crate) fn set_archives(&mut self, archives: Vec<Archive>) {
        self.archives = archives;
    }

    /// Returns the names of the archives that reports can be sent to.
    pub(crate) fn archives(&self) -> impl Iterator<Item = &str> {
        #[cfg(feature = "dicom")]
        let names = self.archives.iter().map(|a| a.name.as_str());
        #[cfg(not(feature = "dicom"))]
        let names = std::iter::empty();
        names
    }

    /// Returns why no report can be sent to the archive with this number now; `None` if one can.
    pub(crate) fn why_not_sent(&self, archive: usize) -> Option<&'static str> {
        match self.archives().nth(archive) {
            None => Some("the settings name no archive"),
            Some(_) => self.why_not(),
        }
    }

    /// Returns why no report can be made now; `None` if one can.
    pub(crate) fn why_not(&self) -> Option<&'static str> {
        match &self.of {
            None => Some("only the scan of a file has a report"),
            Some(_) if self.is_working() => Some("a report is being made"),
            Some(_) => None,
        }
    }

    /// True while one is made.
    pub(crate) fn is_working(&self) -> bool {
        self.task.is_working()
    }

    /// Begins a report of these findings in a folder below `folder`, which is that of screenshots.
    pub(crate) fn write(&mut self, found: Findings, folder: Option<&Path>, background: &Background, now: Instant) {
        let Some(of) = &self.of else { return };
        let (make, input, series) = (Arc::clone(&of.make), of.input.clone(), of.series);
        let second = of.second(&found);
        let folder = screenshot::folder(folder);
        let job = background.start_apart("report", move |progress| {
            // One folder for each scan, in which a later report takes the place of an earlier one.
            let scan: String = found.scan.rsplit(':').next().unwrap_or_default().chars().take(12).collect();
            let out = folder?.join(format!("report-{scan}"));
            let given = tempfile::tempdir().map_err(|e| output::cannot(&std::env::temp_dir(), e))?;
            let findings = given.path().join("findings.json");
            found.write(&findings)?;
            make(&ReportOrder { input, series, second, findings, out: out.clone(), for_archive: false }, progress)?;
            Ok(format!("the report is {}", out.join("report.html").display()))
        });
        self.go_over(job, now);
    }

    /// Begins a report of these findings that is sent to the archive with this number.
    #[cfg(feature = "dicom")]
    pub(crate) fn send(&mut self, found: Findings, archive: usize, background: &Background, now: Instant) {
        let (Some(of), Some(archive)) = (&self.of, self.archives.get(archive).cloned()) else { return };
        let (make, input, series) = (Arc::clone(&of.make), of.input.clone(), of.series);
        let second = of.second(&found);
        let job = background.start_apart("report", move |progress| {
            let made = tempfile::tempdir().map_err(|e| output::cannot(&std::env::temp_dir(), e))?;
            let (findings, out) = (made.path().join("findings.json"), made.path().join("report"));
            found.write(&findings)?;
            make(&ReportOrder { input, series, second, findings, out: out.clone(), for_archive: true }, progress)?;
            let entries = std::fs::read_dir(&out).map_err(|e| output::cannot(&out, e))?;
            let mut files: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
            files.retain(|path| path.extension().is_some_and(|e| e == "dcm"));
            files.sort();
            let sent = archive.send(&files, progress)?;
            sent.remarks.iter().for_each(|remark| output::to_stderr(format_args!("note: {remark}")));
            Ok(format!("the report is in {}, as {} objects", archive.name, sent.stored))
        });
        self.go_over(job, now);
    }

    fn go_over(&mut self, job: Result<super::job::Job<String>>, now: Instant) {
        self.told = None;
        self.task.go_over(job, now);
    }

    /// Cancels what is under way. Nothing of it is left.
    pub(crate) fn cancel(&mut self) {
        if self.is_working() {
            self.task.stop();
            self.told = Some("the report was cancelled".to_owned());
        }
    }

    /// Returns what to say if a report is done or has failed.
    pub(crate) fn take(&mut self, now: Instant) -> Option<String> {
        let told = match self.task.take(now)? {
            Ok((told, _)) => told,
            Err(e) => told_error(&e),
        };
        self.told = Some(told.clone());
        Some(told)
    }

    /// Returns when the progress has to be looked at.
    pub(crate) fn next(&self) -> Option<Instant> {
        self.task.next()
    }

    /// Returns what is done or was done last, in words, and the share of it that is done.
    pub(crate) fn state(&self) -> Option<(String, Option<f32>)> {
        let Some(progress) = self.task.progress() else { return Some((self.told.clone()?, None)) };
        let (stage, done, total) = progress.snapshot();
        let share = (total > 0).then(|| done.min(total) as f32 / total as f32);
        Some((format!("making the report: {stage}"), share))
    }
}

fn told_error(e: &Error) -> String {
    format!("no report: {e}")
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn until_told(reporting: &mut Reporting) -> String {
        let begun = Instant::now();
        loop {
            if let Some(told) = reporting.take(Instant::now()) {
                return told;
            }
            assert!(begun.elapsed() < Duration::from_secs(20));
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn reporting(make: MakeReport) -> Reporting {
        let mut reporting = Reporting::new(Instant::now());
        reporting.set(Some(Reported { make, input: PathBuf::from("scan.nii"), series: Some(2), second: None }));
        reporting
    }

    #[test]
    fn a_report_is_made_of_what_is_found_now_and_told() {
        let dir = tempfile::tempdir().unwrap();
        let background = Background::new(Arc::new(|| {}));
        let found = Findings { scan: format!("sha256:{}", "ab".repeat(32)), ..Findings::default() };
        let make: MakeReport = Arc::new(|order, _| {
            assert_eq!((order.input.to_str(), order.series, order.for_archive), (Some("scan.nii"), Some(2), false));
            let text = std::fs::read_to_string(&order.findings).unwrap();
            assert!(text.contains("abab"));
            Err(Error::input("scan", if order.out.ends_with("report-abababababab") { "read" } else { "?" }, "mend"))
        });
        let mut reporting = reporting(make);
        assert_eq!(reporting.why_not(), None);
        reporting.write(found.clone(), Some(dir.path()), &background, Instant::now());
        assert_eq!(until_told(&mut reporting), "no report: scan: read; mend");
        let mut reporting = self::reporting(Arc::new(|_, _| Ok(())));
        reporting.write(found, Some(dir.path()), &background, Instant::now());
        assert!(reporting.why_not().is_some());
        let told = until_told(&mut reporting);
        assert!(told.ends_with("report-abababababab/report.html"), "{told}");
        assert_eq!(reporting.state(), Some((told, None)));
    }

    #[test]
    fn a_cancelled_report_ends_and_says_nothing_more() {
        let background = Background::new(Arc::new(|| {}));
        let mut reporting = reporting(Arc::new(|_, progress| {
            loop {
                progress.check()?;
                std::thread::yield_now();
            }
        }));
        reporting.write(Findings::default(), Some(Path::new("/nowhere")), &background, Instant::now());
        assert!(reporting.is_working() && reporting.state().is_some());
        reporting.cancel();
        assert!(reporting.take(Instant::now()).is_none() && reporting.why_not().is_none());
        assert_eq!(reporting.state().unwrap().0, "the report was cancelled");
        assert!(Reporting::new(Instant::now()).why_not().is_some());
    }
}
