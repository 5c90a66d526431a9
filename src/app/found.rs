//! What is found in a scan, for several that use the same scan one after the other.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::Result;
use crate::fields::Lumen;
use crate::fields::cleanse::Cleansed;

/// The lumen of one scan, what cleansing removes from it, and the lumen after that: each found when it is first asked for.
///
/// It is of a scan as read, with the rules alone: not with a point or with kinds that a reader gave. Of a scan whose lumen has septa
/// nothing is kept, because commands differ in when they close those.
#[derive(Debug, Default)]
#[doc(hidden)]
pub struct Found {
    /// False for a single use: what is found is then handed over and not kept.
    keeps: AtomicBool,
    lumen: Slot<Lumen>,
    cleansed: Slot<Cleansed>,
    cleansed_lumen: Slot<Lumen>,
}

impl Found {
    /// Creates one that keeps what is found.
    pub fn keeping() -> Self {
        Self { keeps: AtomicBool::new(true), ..Self::default() }
    }

    /// Returns the lumen, which `find` finds if it is not known.
    ///
    /// # Errors
    /// Returns that of `find`.
    pub fn lumen(&self, find: impl FnOnce() -> Result<Lumen>) -> Result<Arc<Lumen>> {
        let lumen = self.lumen.get(self.keeps(), find)?;
        if !lumen.septa().is_empty() {
            self.keeps.store(false, Ordering::Relaxed);
        }
        Ok(lumen)
    }

    /// Returns what cleansing removes.
    ///
    /// # Errors
    /// As [`Found::lumen`].
    pub fn cleansed(&self, find: impl FnOnce() -> Result<Cleansed>) -> Result<Arc<Cleansed>> {
        self.cleansed.get(self.keeps(), find)
    }

    /// Returns the lumen of the cleansed scan, as the rules find it.
    ///
    /// # Errors
    /// As [`Found::lumen`].
    pub fn cleansed_lumen(&self, find: impl FnOnce() -> Result<Lumen>) -> Result<Arc<Lumen>> {
        self.cleansed_lumen.get(self.keeps(), find)
    }

    fn keeps(&self) -> bool {
        self.keeps.load(Ordering::Relaxed)
    }
}

/// Something that is found once.
#[derive(Debug)]
struct Slot<T>(Mutex<Option<Arc<T>>>);

impl<T> Default for Slot<T> {
    fn default() -> Self {
        Self(Mutex::new(None))
    }
}

impl<T> Slot<T> {
    fn get(&self, keeps: bool, find: impl FnOnce() -> Result<T>) -> Result<Arc<T>> {
        if !keeps {
            return find().map(Arc::new);
        }
        // What is in it is whole: a panic while something was sought has left nothing.
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match &*known {
            Some(known) => Ok(Arc::clone(known)),
            None => Ok(Arc::clone(known.insert(Arc::new(find()?)))),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::error::Error;
    use crate::volume::Grid;

    #[test]
    fn what_is_found_is_found_once_and_only_if_it_is_kept() {
        let grid = Grid::new([4; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        for (found, times) in [(Found::keeping(), 1), (Found::default(), 3)] {
            let mut sought = 0;
            for _ in 0..3 {
                found
                    .lumen(|| {
                        sought += 1;
                        Ok(Lumen::none(&grid))
                    })
                    .unwrap();
            }
            assert_eq!(sought, times);
            assert!(found.cleansed_lumen(|| Err(Error::incomplete("volume", "none", "none"))).is_err());
            found.cleansed_lumen(|| Ok(Lumen::none(&grid))).unwrap();
        }
    }
}
