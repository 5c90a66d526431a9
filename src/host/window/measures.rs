//! Measured distances: pairs of points, stored for the next time that the scan is opened.

use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::folders;
use crate::error::{Error, Result};

/// The current version of the file format.
const VERSION: u32 = 1;
/// Consequence of an invalid file, for messages.
const HINT: &str = "it is left as it is, and nothing is kept";
/// Maximum number of stored measures.
const MOST: usize = 500;
/// Maximum number of changes that can be undone.
const UNDONE: usize = 100;

/// A distance between two points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Measure {
    /// World, mm.
    pub from: DVec3,
    /// World, mm.
    pub to: DVec3,
}

impl Measure {
    /// Returns its length, mm.
    pub(crate) fn mm(self) -> f64 {
        self.from.distance(self.to)
    }

    /// Returns its length as displayed.
    pub(crate) fn text(self) -> String {
        format!("{:.1} mm", self.mm())
    }
}

/// The file format.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    version: u32,
    /// The ends of each, world mm.
    measures: Vec<[[f64; 3]; 2]>,
}

impl folders::Kept for Kept {
    const VERSION: u32 = VERSION;

    fn version(&self) -> u32 {
        self.version
    }
}

/// The measures of a scan.
#[derive(Debug, Default)]
pub(crate) struct Measures {
    list: Vec<Measure>,
    /// True if clicks measure.
    on: bool,
    /// The first clicked end, until the second one is clicked.
    begun: Option<DVec3>,
    before: Vec<Vec<Measure>>,
    /// Number of changes ever made.
    made: u64,
    /// The file for them; `None` if they are not stored.
    file: Option<PathBuf>,
    /// True if they are not stored for the time being.
    is_held: bool,
}

impl Measures {
    /// Reads the measures stored in a file, with the error if the file is invalid. In that case there are none and the file is
    /// not overwritten.
    pub(crate) fn open(file: Option<PathBuf>) -> (Self, Option<Error>) {
        let read = file.as_deref().map_or(Ok(Vec::new()), read);
        match read {
            Ok(list) => (Self { list, file, ..Self::default() }, None),
            Err(e) => (Self::default(), Some(e)),
        }
    }

    /// Returns all measures, in the order in which they were made.
    pub(crate) fn list(&self) -> &[Measure] {
        &self.list
    }

    /// Returns the first clicked end, until the second one is clicked.
    pub(crate) fn begun(&self) -> Option<DVec3> {
        self.begun
    }

    /// True if clicks measure.
    pub(crate) fn is_on(&self) -> bool {
        self.on
    }

    /// Switches measuring by clicks on or off. An incomplete measure is discarded.
    pub(crate) fn switch(&mut self) {
        (self.on, self.begun) = (!self.on, None);
    }

    /// Handles a click while measuring: the first one sets an end, the second one completes and returns the measure.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be stored. The measure exists nevertheless, and the existing file stays unchanged.
    pub(crate) fn click(&mut self, at: DVec3) -> Result<Option<Measure>> {
        let Some(from) = self.begun.take().filter(|_| at.is_finite()) else {
            self.begun = Some(at).filter(|a| a.is_finite());
            return Ok(None);
        };
        let made = Measure { from, to: at };
        self.change(|list| {
            list.push(made);
            let more = list.len().saturating_sub(MOST);
            list.drain(..more);
        })?;
        Ok(Some(made))
    }

    /// Deletes a measure by its number.
    ///
    /// # Errors
    /// Returns the errors of [`Measures::click`].
    pub(crate) fn delete(&mut self, number: usize) -> Result<()> {
        if number < self.list.len() {
            self.change(|list| {
                list.remove(number);
            })?;
        }
        Ok(())
    }

    /// Deletes the last measure.
    ///
    /// # Errors
    /// Returns the errors of [`Measures::click`].
    pub(crate) fn delete_last(&mut self) -> Result<()> {
        self.delete(self.list.len().wrapping_sub(1))
    }

    /// Returns the number of changes that were ever made; undoing counts as none.
    pub(crate) fn changes_made(&self) -> u64 {
        self.made
    }

    /// True if a change can be undone.
    pub(crate) fn may_undo(&self) -> bool {
        !self.before.is_empty()
    }

    /// Discards an incomplete measure. Returns true if there was one.
    pub(crate) fn discard_begun(&mut self) -> bool {
        self.begun.take().is_some()
    }

    /// Undoes the last change.
    ///
    /// # Errors
    /// Returns the errors of [`Measures::click`].
    pub(crate) fn undo(&mut self) -> Result<()> {
        let Some(before) = self.before.pop() else { return Ok(()) };
        self.list = before;
        self.keep()
    }

    fn change(&mut self, change: impl FnOnce(&mut Vec<Measure>)) -> Result<()> {
        self.made += 1;
        self.before.push(self.list.clone());
        let more = self.before.len().saturating_sub(UNDONE);
        self.before.drain(..more);
        change(&mut self.list);
        self.keep()
    }

    /// Stores them from now on, with those that were made until now, or not for the time being.
    ///
    /// # Errors
    /// Returns status 5 if they cannot be stored.
    pub(crate) fn keep_now(&mut self, keeps: bool) -> Result<()> {
        self.is_held = !keeps;
        if self.made > 0 { self.keep() } else { Ok(()) }
    }

    fn keep(&self) -> Result<()> {
        let Some(path) = self.file.as_ref().filter(|_| !self.is_held) else { return Ok(()) };
        let measures = self.list.iter().map(|m| [m.from, m.to].map(|p| p.to_array())).collect();
        folders::keep(path, &Kept { version: VERSION, measures })
    }
}

fn read(path: &Path) -> Result<Vec<Measure>> {
    let kept: Option<Kept> = folders::read_kept(path, HINT)?;
    let measures = kept.into_iter().flat_map(|k| k.measures).map(|m| m.map(DVec3::from_array));
    Ok(measures.take(MOST).map(|[from, to]| Measure { from, to }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_clicks_are_a_distance_that_is_kept() {
        let dir = tempfile::tempdir().unwrap();
        let file = Some(dir.path().join("a").join("m.json"));
        let (mut m, error) = Measures::open(file.clone());
        assert!(error.is_none());
        m.switch();
        assert_eq!(m.click(DVec3::NAN).unwrap(), None);
        assert_eq!(m.click(DVec3::ZERO).unwrap(), None);
        assert_eq!(m.click(DVec3::new(3.0, 4.0, 0.0)).unwrap().unwrap().text(), "5.0 mm");
        m.click(DVec3::X).unwrap();
        assert!(m.discard_begun() && !m.discard_begun());
        assert!(m.begun().is_none() && m.list().len() == 1, "an end without another is no change");
        for x in [1.0, 2.0] {
            m.click(DVec3::X * x).unwrap();
            m.click(DVec3::Y * x).unwrap();
        }
        m.delete(0).unwrap();
        m.undo().unwrap();
        m.delete_last().unwrap();
        m.delete(77).unwrap();
        let (again, error) = Measures::open(file);
        assert!(error.is_none() && again.list() == m.list() && again.list().len() == 2);
    }

    #[test]
    fn what_is_damaged_is_left_and_what_cannot_be_kept_is_told() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("m.json");
        for text in
            ["", "{\"version\": 1}", "{\"version\": 2, \"measures\": []}", "{\"version\": 1, \"measures\": [[[1]]]}"]
        {
            std::fs::write(&path, text).unwrap();
            let (mut m, error) = Measures::open(Some(path.clone()));
            assert!(error.is_some(), "{text}");
            m.click(DVec3::ZERO).unwrap();
            m.click(DVec3::X).unwrap();
            assert_eq!((m.list().len(), std::fs::read_to_string(&path).unwrap().as_str()), (1, text));
        }
        // The folder is a file: the measure cannot be stored, but it exists.
        let (mut m, _) = Measures::open(Some(path.join("below").join("m.json")));
        m.file = Some(path.join("below").join("m.json"));
        m.click(DVec3::ZERO).unwrap();
        assert_eq!(m.click(DVec3::X).unwrap_err().kind as i32, 5);
        assert_eq!(m.list().len(), 1);
    }
}
