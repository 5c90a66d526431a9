//! What a guide needs of the lumen, built on a thread of its own while the flight goes on.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use crate::app::FlightApp;
use crate::app::fields::Fields;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::schedule::GuideEntry;

/// Fields under way.
pub struct Planning {
    guide: &'static str,
    built: Receiver<Result<Fields>>,
    progress: Arc<Progress>,
}

impl Planning {
    /// Begins to build what `guide` needs for the flight as it is; none where it needs nothing that is not there.
    pub fn begin(flight: &FlightApp, guide: &GuideEntry) -> Option<Result<Self>> {
        let (wanted, guide) = (guide.needs, guide.name);
        let mut fields = flight.fields().clone();
        if fields.has(wanted, flight.plan()) || flight.scene().play().is_some() {
            return None;
        }
        let (volume, lumen, plan) = (flight.volume().shared_volume(), flight.shared_lumen(), flight.plan().clone());
        let radius_mm = flight.scene().body.radius_mm;
        let progress = Arc::new(Progress::new());
        let (done, built) = channel();
        let own = Arc::clone(&progress);
        let thread = std::thread::Builder::new().name("planning".to_owned()).spawn(move || {
            let result = fields.build(wanted, &volume, &lumen, &plan, radius_mm, &own);
            // Whoever asked may have thought better of it.
            let _ = done.send(result.map(|()| fields));
        });
        Some(match thread {
            Ok(_) => Ok(Self { guide, built, progress }),
            Err(e) => Err(Error::fault("planning", e.to_string(), "close other programs")),
        })
    }

    /// What was built, and for whom, when it is there.
    pub fn take(&mut self) -> Option<(&'static str, Result<Fields>)> {
        match self.built.try_recv() {
            Ok(built) => Some((self.guide, built)),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                Some((self.guide, Err(Error::fault("planning", "it broke off", "report it"))))
            }
        }
    }
}

impl Drop for Planning {
    fn drop(&mut self) {
        self.progress.cancel();
    }
}
