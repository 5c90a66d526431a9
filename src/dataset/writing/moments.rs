//! The scan at the moments of frames.

use std::sync::Arc;

use super::Source;
use crate::error::Result;
use crate::progress::Progress;
use crate::render::leap::Crossings;
use crate::space::PreparedVolume;

/// A frame needs its own, that before, and that after.
const KEPT: usize = 3;

/// The scan at a moment.
pub(super) struct Moment {
    seconds: f64,
    pub volume: PreparedVolume,
    pub rays: Crossings,
}

/// The scan at the moments asked for last.
pub(super) struct Moments<'a> {
    source: &'a Source<'a>,
    known: Vec<Arc<Moment>>,
}

impl<'a> Moments<'a> {
    /// Creates those of a source whose own rays are known.
    pub(super) fn new(source: &'a Source<'a>, rays: &Crossings) -> Self {
        let own = Moment { seconds: 0.0, volume: source.volume.clone(), rays: rays.clone() };
        Self { source, known: vec![Arc::new(own)] }
    }

    /// Returns the scan at a time, s.
    pub(super) fn at(&mut self, seconds: f64, progress: &Progress) -> Result<Arc<Moment>> {
        let Some(deformation) = self.source.deformation else { return Ok(Arc::clone(&self.known[0])) };
        if let Some(known) = self.known.iter().find(|m| m.seconds == seconds) {
            return Ok(Arc::clone(known));
        }
        let volume = deformation.volume(self.source.volume, seconds, progress)?;
        let made = Arc::new(Moment { seconds, rays: Crossings::new(&volume, progress)?, volume });
        self.known.push(Arc::clone(&made));
        if self.known.len() > KEPT {
            self.known.remove(0);
        }
        Ok(made)
    }
}
