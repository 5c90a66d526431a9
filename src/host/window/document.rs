//! What a reader finds in a scan, with one history: stored at once for the next time, and the last change is undone first.

use std::path::PathBuf;

use glam::DVec3;

use super::assistant::{Reading, Said};
use super::findings;
use super::measures::Measure;
use super::session::ScanFiles;
use crate::app::findings::{Finding, Findings, Outside, Quality};
use crate::error::{Error, Result};
use crate::fields::lumen::Told;

/// Maximum number of changes that can be undone.
const UNDONE: usize = 300;

/// What a change was made to, as it was before.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Part {
    Distances(Vec<[DVec3; 2]>),
    Answers(Vec<Said>),
    Kinds(Vec<Told>),
    Findings(Vec<Finding>),
    Outside(Vec<Outside>),
}

/// What is being written or dragged: its small changes are one, until something else is changed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Stroke {
    /// The note of a candidate, by its number.
    CandidateNote(usize),
    /// The note of a finding, by its id.
    Note(String),
    /// The ends of a finding's diameter.
    Ends(String),
    /// How sure the reader is of a finding.
    Confidence(String),
    /// The category or text of a finding outside the colon, by its number.
    Outside(usize),
}

/// The findings of a scan as they were noted last, and those before.
#[derive(Debug, Default)]
pub(crate) struct Document {
    /// Their answers are those of the file until a list of candidates is known.
    found: Findings,
    /// What is said of each candidate, once there is a list.
    said: Vec<Said>,
    history: Vec<Part>,
    /// What is being written. Letter by letter, that is one change.
    writing: Option<Stroke>,
    /// Number of changes before the first end of a distance was clicked.
    begun: usize,
    /// True once something was changed.
    has_changes: bool,
    /// The file of the findings; `None` if they are not stored.
    file: Option<PathBuf>,
    /// True if they are not stored for the time being.
    is_held: bool,
}

impl Document {
    /// Reads what was found in the scan with these files. If one of them is damaged, returns its error too: there is what the others
    /// say, and nothing is stored until [`keep_now`](Self::keep_now).
    pub(crate) fn open(files: &ScanFiles) -> (Self, Option<Error>) {
        let (found, damaged) = findings::read(files);
        let file = files.findings.clone();
        (Self { found, file, is_held: damaged.is_some(), ..Self::default() }, damaged)
    }

    /// Returns the findings.
    pub(crate) fn found(&self) -> &Findings {
        &self.found
    }

    /// Sets the kinds that the flight began with, if no file tells others.
    pub(crate) fn begin_with(&mut self, kinds: &[Told]) {
        self.found.kinds.get_or_insert_with(|| kinds.to_vec());
    }

    /// Begins with a list of candidates, to which the stored answers were given. Changes of another list cannot be undone.
    pub(crate) fn begin_list(&mut self, reading: &Reading) {
        (self.said, self.found.answers) = (reading.all().to_vec(), reading.answers());
        self.history.retain(|part| !matches!(part, Part::Answers(_)));
        self.begun = self.begun.min(self.history.len());
    }

    /// Notes what has changed since the last call, and stores it. Call it after each change, so that the order is that of the changes.
    /// `reading` is `None` before there is a list.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be stored. The change is noted nevertheless.
    pub(crate) fn note(&mut self, distances: &[Measure], reading: Option<&Reading>, kinds: &[Told]) -> Result<()> {
        let mut is_new = false;
        if !distances.iter().map(|m| <[DVec3; 2]>::from(*m)).eq(self.found.distances.iter().copied()) {
            let now = distances.iter().map(|m| (*m).into()).collect();
            let before = std::mem::replace(&mut self.found.distances, now);
            (self.writing, is_new) = (None, true);
            self.history.push(Part::Distances(before));
        }
        if self.found.kinds.as_deref() != Some(kinds) {
            let before = self.found.kinds.replace(kinds.to_vec()).unwrap_or_default();
            (self.writing, is_new) = (None, true);
            self.history.push(Part::Kinds(before));
        }
        if let Some(reading) = reading.filter(|r| r.all() != self.said) {
            let note = note_only(&self.said, reading.all()).map(Stroke::CandidateNote);
            let before = std::mem::replace(&mut self.said, reading.all().to_vec());
            if note.is_none() || note != self.writing {
                self.history.push(Part::Answers(before));
            }
            (self.writing, is_new) = (note, true);
        }
        self.shorten();
        let answers = reading.map(Reading::answers);
        if let Some(answers) = answers.filter(|answers| is_new || *answers != self.found.answers) {
            (self.found.answers, is_new) = (answers, true);
        }
        if !is_new {
            return Ok(());
        }
        self.has_changes = true;
        self.keep()
    }

    fn shorten(&mut self) {
        let more = self.history.len().saturating_sub(UNDONE);
        self.history.drain(..more);
        self.begun = self.begun.saturating_sub(more);
    }

    /// Changes the findings of the colon, and stores them. What belongs to one `stroke` is undone together.
    ///
    /// # Errors
    /// Returns status 5 if they cannot be stored. The change is made nevertheless.
    pub(crate) fn change_findings(
        &mut self,
        stroke: Option<Stroke>,
        change: impl FnOnce(&mut Vec<Finding>),
    ) -> Result<()> {
        self.change(|found| &mut found.findings, Part::Findings, stroke, change)
    }

    /// Changes the findings outside the colon, and stores them. What belongs to one `stroke` is undone together.
    ///
    /// # Errors
    /// Returns status 5 if they cannot be stored. The change is made nevertheless.
    pub(crate) fn change_outside(
        &mut self,
        stroke: Option<Stroke>,
        change: impl FnOnce(&mut Vec<Outside>),
    ) -> Result<()> {
        self.change(|found| &mut found.outside, Part::Outside, stroke, change)
    }

    fn change<T: Clone + PartialEq>(
        &mut self,
        list: fn(&mut Findings) -> &mut Vec<T>,
        part: fn(Vec<T>) -> Part,
        stroke: Option<Stroke>,
        change: impl FnOnce(&mut Vec<T>),
    ) -> Result<()> {
        let before = list(&mut self.found).clone();
        change(list(&mut self.found));
        if *list(&mut self.found) == before {
            return Ok(());
        }
        if stroke.is_none() || stroke != self.writing {
            self.history.push(part(before));
            self.shorten();
        }
        self.writing = stroke;
        self.has_changes = true;
        self.keep()
    }

    /// Returns the findings as they were before a stroke that goes on; `None` if it does not.
    pub(crate) fn before(&self, stroke: &Stroke) -> Option<&[Finding]> {
        match self.history.last() {
            Some(Part::Findings(list)) if self.writing.as_ref() == Some(stroke) => Some(list),
            _ => None,
        }
    }

    /// Adds to a finding what the program knows of it, without a step of the history: an undo of what came before or after does not take
    /// it back. The place tells it from one that was deleted, whose id may be given again.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be stored.
    pub(crate) fn complete(&mut self, id: &str, place: DVec3, add: impl Fn(&mut Finding)) -> Result<()> {
        let lists = self.history.iter_mut().filter_map(|part| match part {
            Part::Findings(list) => Some(list),
            _ => None,
        });
        lists.chain([&mut self.found.findings]).flatten().filter(|f| f.is_at(id, place)).for_each(add);
        self.keep()
    }

    /// Notes where a finding is in the other position, whose scan has this hash, without a step of the history; `None` parts them.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be stored.
    pub(crate) fn pair(&mut self, id: &str, place: DVec3, other: Option<DVec3>, second: &str) -> Result<()> {
        self.found.second = Some(second.to_owned());
        self.complete(id, place, |f| f.other = other)
    }

    /// Stores the quality of the segments, which is no change of the reader's.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be stored.
    pub(crate) fn set_quality(&mut self, list: Vec<Quality>) -> Result<()> {
        if self.found.quality == list {
            return Ok(());
        }
        self.found.quality = list;
        self.keep()
    }

    /// True if something was made that is not stored.
    pub(crate) fn has_unkept(&self) -> bool {
        self.is_held && self.has_changes
    }

    /// True if a change of answers can be undone.
    pub(crate) fn may_undo_answers(&self) -> bool {
        self.history.iter().any(|part| matches!(part, Part::Answers(_)))
    }

    /// Notes that the first end of a distance was clicked.
    pub(crate) fn note_begun(&mut self) {
        self.begun = self.history.len();
    }

    /// True if nothing was changed since the first end of a distance was clicked.
    pub(crate) fn is_as_begun(&self) -> bool {
        self.history.len() <= self.begun
    }

    /// Takes back the last change. Returns what is to be restored.
    pub(crate) fn undo(&mut self) -> Option<Part> {
        let last = self.history.len().checked_sub(1)?;
        Some(self.take_back(last))
    }

    /// Takes back the last change of answers. Returns what is to be restored.
    pub(crate) fn undo_answers(&mut self) -> Option<Part> {
        let last = self.history.iter().rposition(|part| matches!(part, Part::Answers(_)))?;
        Some(self.take_back(last))
    }

    fn take_back(&mut self, n: usize) -> Part {
        let part = self.history.remove(n);
        self.begun -= usize::from(n < self.begun);
        self.writing = None;
        match &part {
            Part::Distances(list) => self.found.distances.clone_from(list),
            Part::Answers(said) => self.said.clone_from(said),
            Part::Kinds(kinds) => self.found.kinds = Some(kinds.clone()),
            Part::Findings(list) => self.found.findings.clone_from(list),
            Part::Outside(list) => self.found.outside.clone_from(list),
        }
        part
    }

    /// Stores the findings from now on, with those that were made until now, or not for the time being.
    ///
    /// # Errors
    /// Returns status 5 if they cannot be stored.
    pub(crate) fn keep_now(&mut self, keeps: bool) -> Result<()> {
        self.is_held = !keeps;
        if self.has_changes { self.keep() } else { Ok(()) }
    }

    /// Stores the findings, in one piece.
    ///
    /// # Errors
    /// Returns status 5 if they cannot be stored.
    pub(crate) fn keep(&self) -> Result<()> {
        let file = self.file.as_deref().filter(|_| !self.is_held);
        file.map_or(Ok(()), |file| findings::keep(file, &self.found))
    }
}

/// Returns the candidate whose note alone differs.
fn note_only(before: &[Said], now: &[Said]) -> Option<usize> {
    let mut changed = before.iter().zip(now).enumerate().filter(|(_, (a, b))| a != b);
    let (n, (a, b)) = changed.next()?;
    (changed.next().is_none() && before.len() == now.len() && a.answer == b.answer).then_some(n)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::fields::lumen::GasKind;
    use crate::math::hash;
    use crate::polyps::answers::Answer;

    fn places() -> Vec<DVec3> {
        [0.0, 10.0, 20.0].map(|x| DVec3::new(x, -5.0, 1.5)).to_vec()
    }

    fn opened(files: &ScanFiles) -> (Document, Reading) {
        let (mut document, e) = Document::open(files);
        assert!(e.is_none(), "{e:?}");
        let reading = Reading::open(places(), &document.found().answers);
        document.begin_list(&reading);
        document.begin_with(&[]);
        (document, reading)
    }

    fn distance(x: f64) -> Measure {
        Measure { from: DVec3::ZERO, to: DVec3::X * x }
    }

    #[test]
    fn answers_and_notes_survive_and_are_undone() {
        let dir = tempfile::tempdir().unwrap();
        let files = ScanFiles::below(dir.path(), "00ff.json");
        let file = files.findings.clone().unwrap();
        let (mut document, mut r) = opened(&files);
        let note = |document: &mut Document, r: &Reading| document.note(&[], Some(r), &[]).unwrap();
        r.answer(Answer::Yes);
        note(&mut document, &r);
        assert!(!file.exists(), "no candidate is looked at");
        r.select(1);
        for answer in [Answer::Yes, Answer::No] {
            r.answer(answer);
            note(&mut document, &r);
        }
        for text in ["a", "a fo", "a fold"] {
            r.note(1, text.to_owned());
            note(&mut document, &r);
        }
        r.note(9, "nowhere".to_owned());
        note(&mut document, &r);
        let (_, again) = opened(&files);
        assert_eq!(again.all(), r.all());
        assert_eq!((again.said(1).unwrap().note.as_str(), again.answered()), ("a fold", 1));
        // A note is one change, however many letters it has.
        let undo = |document: &mut Document, r: &mut Reading| {
            let Some(Part::Answers(said)) = document.undo() else { return None };
            let only = r.restore(said);
            document.note(&[], Some(r), &[]).unwrap();
            only
        };
        assert_eq!(undo(&mut document, &mut r), Some(1));
        assert_eq!(*r.said(1).unwrap(), Said { answer: Some(Answer::No), note: String::new() });
        undo(&mut document, &mut r);
        assert_eq!(r.said(1).unwrap().answer, Some(Answer::Yes));
        undo(&mut document, &mut r);
        assert!(!document.may_undo_answers() && undo(&mut document, &mut r).is_none());
        assert_eq!(opened(&files).1.answered(), 0, "what was undone is stored too");
    }

    #[test]
    fn answers_of_a_panel_are_undone_before_later_distances() {
        let dir = tempfile::tempdir().unwrap();
        let (mut document, mut r) = opened(&ScanFiles::below(dir.path(), "a.json"));
        r.select(0);
        r.answer(Answer::Yes);
        document.note(&[], Some(&r), &[]).unwrap();
        document.note(&[distance(1.0)], Some(&r), &[]).unwrap();
        document.note_begun();
        let Some(Part::Answers(said)) = document.undo_answers() else { panic!("an answer") };
        r.restore(said);
        document.note(&[distance(1.0)], Some(&r), &[]).unwrap();
        assert!(document.is_as_begun() && r.answered() == 0);
        assert_eq!(document.undo(), Some(Part::Distances(Vec::new())));
        assert_eq!(document.undo(), None);
    }

    /// Whatever is changed in whatever order, undoing takes back the last change, and the file has what is left.
    #[test]
    fn changes_are_undone_in_the_order_in_which_they_were_made() {
        let dir = tempfile::tempdir().unwrap();
        for seed in 0..20 {
            let files = ScanFiles::below(dir.path(), &format!("{seed}.json"));
            let (mut document, mut r) = opened(&files);
            let (mut distances, mut kinds, mut before) = (Vec::new(), Vec::new(), Vec::new());
            for step in 0..60 {
                let former = (distances.clone(), r.all().to_vec(), kinds.clone());
                // A file keeps a place to the last digit but one.
                let x = (hash::uniform(seed, step) * 700.0).floor();
                match x as usize / 100 {
                    0 => distances.push(distance(x)),
                    1 => _ = distances.pop(),
                    2 => kinds.push((DVec3::X * x, GasKind::ALL[step as usize % 7])),
                    n @ (3 | 4) => {
                        r.select(n - 3);
                        r.answer([Answer::Yes, Answer::No, Answer::Unsure][step as usize % 3]);
                    }
                    5 => {
                        match document.undo() {
                            Some(Part::Distances(list)) => distances = list.into_iter().map(Measure::from).collect(),
                            Some(Part::Findings(_) | Part::Outside(_)) => {}
                            Some(Part::Kinds(told)) => kinds = told,
                            Some(Part::Answers(said)) => _ = r.restore(said),
                            None => {}
                        }
                        document.note(&distances, Some(&r), &kinds).and(document.keep()).unwrap();
                        let now = (distances.clone(), r.all().to_vec(), kinds.clone());
                        assert_eq!(now, before.pop().unwrap_or(former), "{seed}, {step}");
                        continue;
                    }
                    _ => {}
                }
                document.note(&distances, Some(&r), &kinds).unwrap();
                if (&distances, r.all(), &kinds) != (&former.0, &former.1[..], &former.2) {
                    before.push(former);
                }
            }
            let (again, read) = opened(&files);
            assert_eq!(again.found().distances, distances.iter().map(|m| <[DVec3; 2]>::from(*m)).collect::<Vec<_>>());
            assert_eq!((read.all(), again.found().kinds.as_deref()), (r.all(), Some(&kinds[..])));
        }
    }

    #[test]
    fn what_is_damaged_is_left_and_what_cannot_be_stored_is_told() {
        let dir = tempfile::tempdir().unwrap();
        let files = ScanFiles::below(dir.path(), "a.json");
        for path in [&files.answers, &files.measures, &files.findings] {
            let path = path.as_deref().unwrap();
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "{\"colvis\": \"answers\"").unwrap();
            let (mut document, e) = Document::open(&files);
            assert!(!e.unwrap().to_string().contains('\n'));
            assert!(!document.has_unkept());
            document.note(&[distance(1.0)], None, &[]).unwrap();
            assert_eq!(document.found().distances.len(), 1);
            assert!(document.has_unkept());
            assert_eq!(std::fs::read_to_string(path).unwrap(), "{\"colvis\": \"answers\"");
            assert!(path == files.findings.as_deref().unwrap() || !files.findings.as_deref().unwrap().exists());
            std::fs::remove_file(path).unwrap();
        }
        // The folder is a file.
        let (mut document, _) = Document::open(&ScanFiles::below(&dir.path().join("a"), "b.json"));
        std::fs::write(dir.path().join("a"), "").unwrap();
        assert_eq!(document.note(&[distance(1.0)], None, &[]).unwrap_err().kind as i32, 5);
        assert_eq!(document.found().distances.len(), 1);
    }
}
