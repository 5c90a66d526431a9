//! Changes to distances, answers and kinds: noted in the order in which they are made, and undone; and the report of what was found.

use std::time::Instant;

use super::FlightController;
use super::saving::PATH_MESSAGE;
use crate::app::findings::Findings;
#[cfg(test)]
use crate::app::findings::Quality;
use crate::error::Result;
use crate::host::window::document::{Document, Part};
use crate::host::window::quality::time_text;

impl FlightController {
    /// Begins with what was found when the scan was open before.
    pub(crate) fn set_document(&mut self, document: Document) {
        self.document = document;
        let found = self.document.found();
        self.measures.restore(&found.distances);
        found.kinds.iter().for_each(|told| self.kinds.adopt(told));
        self.quality.restore(&found.quality);
        self.document.begin_with(self.kinds.told());
    }

    /// Keeps what is made from now on, with what was made until now, or nothing for the time being.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be stored.
    pub(crate) fn keep_files(&mut self, keeps: bool) -> Result<()> {
        if keeps {
            self.unkept = None;
        }
        self.document.keep_now(keeps)
    }

    /// Tells why what is made is not kept, in a sentence.
    pub(crate) fn set_unkept(&mut self, why: impl Into<String>) {
        self.unkept = Some(why.into());
    }

    /// True if something was made that is not kept.
    pub(crate) fn has_unkept(&self) -> bool {
        self.document.has_unkept()
    }

    /// Lets the clock of the segments go on, and takes what was computed of their quality.
    pub(super) fn take_quality(&mut self, now: Instant) {
        if !self.rests() {
            self.quality.stir(now);
        }
        self.quality.tick(self.place.part(), now);
        if self.quality.advance(&self.flight, self.place.along(), &self.background, now) {
            self.attention = true;
        }
    }

    /// Adds to a place in words how long the segment was looked at.
    pub(super) fn with_time(&self, place: String) -> String {
        let seconds = self.place.part().map_or(0.0, |part| self.quality.seconds_in(part));
        if seconds < 1.0 { place } else { format!("{place}; {} in this segment", time_text(seconds)) }
    }

    /// Sets how long segments were looked at.
    #[cfg(test)]
    pub(crate) fn set_seconds(&mut self, list: &[(&str, f64)]) {
        let quality = |(segment, seconds): &(&str, f64)| Quality {
            segment: (*segment).to_owned(),
            seconds: *seconds,
            ..Quality::default()
        };
        self.quality.restore(&list.iter().map(quality).collect::<Vec<_>>());
    }

    /// Begins the report of this reading.
    pub(super) fn write_report(&mut self, now: Instant) {
        let found = self.found_now();
        self.reporting.write(found, self.screenshots.as_deref(), &self.background, now);
        self.say("making the report ...", now);
    }

    /// Begins the report of this reading that is sent to the archive with this number.
    pub(super) fn send_report(&mut self, archive: usize, now: Instant) {
        #[cfg(feature = "dicom")]
        {
            let found = self.found_now();
            self.reporting.send(found, archive, &self.background, now);
            self.say("making the report ...", now);
        }
        let _ = (archive, now);
    }

    /// Returns what is found until now.
    fn found_now(&self) -> Findings {
        let mut found = self.document.found().clone();
        found.quality = self.quality.stored(&self.flight, &found.quality);
        found
    }

    /// Tells of a report that is done.
    pub(super) fn take_report(&mut self, now: Instant) {
        if let Some(told) = self.reporting.take(now) {
            self.message = Some((told, now + PATH_MESSAGE));
            self.attention = true;
        }
    }

    /// Stores the times and the quality of the segments, when the scan is closed.
    ///
    /// # Errors
    /// Returns status 5 if they cannot be stored.
    pub(crate) fn keep_quality(&mut self) -> Result<()> {
        let list = self.quality.stored(&self.flight, &self.document.found().quality);
        self.document.set_quality(list)
    }

    /// Notes what was changed. Call it after each change, so that the order is that of the changes.
    pub(super) fn note_changes(&mut self, now: Instant) {
        let reading = self.assistant.as_ref().filter(|a| a.found().is_some()).map(|a| a.reading());
        let kept = self.document.note(self.measures.list(), reading, self.kinds.told());
        self.report_kept(kept, now);
    }

    /// Reports that something could not be stored and is kept for this session only.
    pub(super) fn report_kept(&mut self, kept: Result<()>, now: Instant) {
        let Err(e) = kept else { return };
        let told = format!("not saved: {}: {}", e.what, e.why);
        if let Some(assistant) = &mut self.assistant {
            assistant.tell(told.clone());
        }
        self.say(told, now);
    }

    /// Undoes the last change to answers, and goes back to the candidate that it was about.
    pub(super) fn undo_answer(&mut self, now: Instant) {
        if let Some(part) = self.document.undo_answers() {
            self.restore(part, now);
        }
    }

    /// Undoes the last change to distances, answers or kinds, or discards the first end of a distance if nothing was changed since.
    pub(super) fn undo(&mut self, now: Instant) {
        if self.document.is_as_begun() && self.measures.discard_begun() {
            return;
        }
        if let Some(part) = self.document.undo() {
            self.restore(part, now);
        }
    }

    fn restore(&mut self, part: Part, now: Instant) {
        match part {
            Part::Distances(list) => self.measures.restore(&list),
            Part::Kinds(told) => {
                self.kinds.restore(told, &self.flight, &self.background, now);
                self.colour_slices();
                self.say("kind undone: updating the lumen ...", now);
            }
            Part::Findings(_) | Part::Outside(_) => self.say("finding: the last change is undone", now),
            Part::Answers(said) => {
                if let Some(assistant) = &mut self.assistant {
                    assistant.tell(String::new());
                    let before = assistant.reading().current();
                    // Not to the first of many.
                    if let Some(n) = assistant.reading_mut().restore(said) {
                        self.return_to(n, before, now);
                    }
                }
                // With its text, for the file.
                return self.note_changes(now);
            }
        }
        let kept = self.document.keep();
        self.report_kept(kept, now);
    }
}
