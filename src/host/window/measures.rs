//! Distances that were measured: pairs of places, kept for the next time that the scan is open.

use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::folders;
use crate::error::{Error, Result};

/// The present form of the file.
const VERSION: u32 = 1;
/// What comes of a file that is none.
const MEND: &str = "it is left as it is, and nothing is kept";
/// No more than so many are kept.
const MOST: usize = 500;
/// So many changes can be undone.
const UNDONE: usize = 100;

/// A distance between two places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measure {
    /// World, mm.
    pub from: DVec3,
    /// World, mm.
    pub to: DVec3,
}

impl Measure {
    /// How long it is, mm.
    pub fn mm(self) -> f64 {
        self.from.distance(self.to)
    }

    /// Its length as it is shown.
    pub fn text(self) -> String {
        format!("{:.1} mm", self.mm())
    }
}

/// The file's form.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    version: u32,
    /// World, mm: the ends of each.
    measures: Vec<[[f64; 3]; 2]>,
}

impl folders::Kept for Kept {
    const VERSION: u32 = VERSION;

    fn version(&self) -> u32 {
        self.version
    }
}

/// What was measured in a scan.
#[derive(Debug, Default)]
pub struct Measures {
    list: Vec<Measure>,
    /// Whether clicks measure.
    on: bool,
    /// The end that was clicked first, while the other one is to come.
    begun: Option<DVec3>,
    before: Vec<Vec<Measure>>,
    /// Where they are kept; none where they are not.
    file: Option<PathBuf>,
}

impl Measures {
    /// Those that were kept in a file, and what is wrong with it: then there are none, and it is not written.
    pub fn open(file: Option<PathBuf>) -> (Self, Option<Error>) {
        let read = file.as_deref().map_or(Ok(Vec::new()), read);
        match read {
            Ok(list) => (Self { list, file, ..Self::default() }, None),
            Err(e) => (Self::default(), Some(e)),
        }
    }

    /// All, in the order in which they were made.
    pub fn list(&self) -> &[Measure] {
        &self.list
    }

    /// The end that was clicked first, while the other one is to come.
    pub fn begun(&self) -> Option<DVec3> {
        self.begun
    }

    /// Whether clicks measure.
    pub fn is_on(&self) -> bool {
        self.on
    }

    /// Has clicks measure, or not. An end without another is forgotten.
    pub fn switch(&mut self) {
        (self.on, self.begun) = (!self.on, None);
    }

    /// A click while clicks measure: the first end, or the second, with the measure that it makes.
    ///
    /// # Errors
    /// Status 5 when it cannot be kept; it is there all the same, and what was kept before is as it was.
    pub fn click(&mut self, at: DVec3) -> Result<Option<Measure>> {
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

    /// Takes one away, by its number.
    ///
    /// # Errors
    /// As for a click.
    pub fn delete(&mut self, number: usize) -> Result<()> {
        if number < self.list.len() {
            self.change(|list| {
                list.remove(number);
            })?;
        }
        Ok(())
    }

    /// Takes the last one away.
    ///
    /// # Errors
    /// As for a click.
    pub fn delete_last(&mut self) -> Result<()> {
        self.delete(self.list.len().wrapping_sub(1))
    }

    /// Takes the last change back, or forgets an end without another.
    ///
    /// # Errors
    /// As for a click.
    pub fn undo(&mut self) -> Result<()> {
        if self.begun.take().is_some() {
            return Ok(());
        }
        let Some(before) = self.before.pop() else { return Ok(()) };
        self.list = before;
        self.keep()
    }

    fn change(&mut self, change: impl FnOnce(&mut Vec<Measure>)) -> Result<()> {
        self.before.push(self.list.clone());
        let more = self.before.len().saturating_sub(UNDONE);
        self.before.drain(..more);
        change(&mut self.list);
        self.keep()
    }

    fn keep(&self) -> Result<()> {
        let Some(path) = &self.file else { return Ok(()) };
        let measures = self.list.iter().map(|m| [m.from, m.to].map(|p| p.to_array())).collect();
        folders::keep(path, &Kept { version: VERSION, measures })
    }
}

fn read(path: &Path) -> Result<Vec<Measure>> {
    let kept: Option<Kept> = folders::read_kept(path, MEND)?;
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
        m.undo().unwrap();
        assert!(m.begun().is_none() && m.list().len() == 1, "an end without another is undone first");
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
        // A folder that is a file: it cannot be kept, and it is measured all the same.
        let (mut m, _) = Measures::open(Some(path.join("below").join("m.json")));
        m.file = Some(path.join("below").join("m.json"));
        m.click(DVec3::ZERO).unwrap();
        assert_eq!(m.click(DVec3::X).unwrap_err().kind as i32, 5);
        assert_eq!(m.list().len(), 1);
    }
}
