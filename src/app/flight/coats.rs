//! Coated spots of the wall: found, and shown in the camera's picture.

use std::sync::Arc;

use super::FlightApp;
use crate::coats::{COAT, find};
use crate::components::coats::CoatPaint;
use crate::error::Result;
use crate::polyps::CoatedPlaces;
use crate::render::wall_paint::SpotPaint;
use crate::schedule::Slot;
use crate::systems;

impl FlightApp {
    /// Paints coated spots in the camera's picture, once they are [known](FlightApp::keep_coats), or stops that.
    ///
    /// # Errors
    /// Returns the errors of any change of the schedule.
    pub fn show_coats(&mut self, shown: bool) -> Result<()> {
        let known = self.coats.clone().filter(|_| shown);
        match known {
            Some(coats) => {
                let paint = CoatPaint(SpotPaint::new(Arc::clone(&coats.places), COAT));
                self.app.camera().insert(paint);
                if !self.app.is_filled(Slot::Coats) {
                    systems::coats::plugin(&mut self.app)?;
                    self.app.build()?;
                }
            }
            None => drop(self.app.camera().take::<CoatPaint>()),
        }
        self.mark_picture();
        Ok(())
    }

    /// Takes the coated spots of the scan.
    pub fn keep_coats(&mut self, coats: Arc<CoatedPlaces>) {
        self.coats = Some(coats);
    }

    /// Returns the coated spots of the scan, if they are known.
    pub fn coats(&self) -> Option<&CoatedPlaces> {
        self.coats.as_deref()
    }

    /// Finds the coated spots of the scan, unless they are known. It takes as long as cleansing and extracting the wall.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn find_coats(&mut self) -> Result<()> {
        if self.coats.is_none() {
            let setup = &self.setup;
            let (cleansed, told) = (setup.cleansed.as_deref(), &setup.told);
            self.coats = Some(Arc::new(find(&setup.volume, &setup.lumen, cleansed, told, &self.progress)?));
        }
        Ok(())
    }
}
