//! What lies behind the wall, shown in the camera's picture.

use std::sync::Arc;

use super::FlightApp;
use crate::boxed::boxed;
use crate::components::translucent::Translucent;
use crate::error::Result;
use crate::render::translucency::TranslucencySettings;
use crate::render::wall_paint::PaintedArea;
use crate::schedule::Slot;
use crate::systems;
use crate::volume::Volume;

impl FlightApp {
    /// Colours the wall in the camera's picture by what lies behind it, or stops that.
    ///
    /// # Errors
    /// Returns the errors of any change of the schedule.
    pub fn show_translucency(&mut self, settings: Option<TranslucencySettings>) -> Result<()> {
        match settings {
            Some(settings) => {
                let translucent = Translucent::new(settings, self.scanned());
                self.app.camera().insert(translucent);
                if !self.app.is_filled(Slot::Translucency) {
                    systems::translucency::plugin(&mut self.app)?;
                    self.app.build()?;
                }
            }
            None => {
                drop(self.app.camera().take::<Translucent>());
                // Unless another shows it.
                self.scanned.take_if(|scanned| Arc::strong_count(scanned) == 1);
            }
        }
        self.mark_picture();
        Ok(())
    }

    /// Sets the part of the picture that shows what lies behind the wall, if any does.
    pub fn look_through(&mut self, area: PaintedArea) {
        let changes =
            self.camera_mut::<Translucent>().is_some_and(|mut t| std::mem::replace(&mut t.area, area) != area);
        if changes {
            self.mark_picture();
        }
    }

    /// Sets the values as scanned around the colon, of a flight through a cleansed scan, so that they need not be kept twice.
    #[doc(hidden)]
    pub fn keep_scanned(&mut self, scanned: Arc<Volume>) {
        if let Some(mut translucent) = self.camera_mut::<Translucent>() {
            translucent.scanned = Arc::clone(&scanned);
        }
        self.scanned = Some(scanned);
    }

    /// Returns what [`FlightApp::keep_scanned`] has set, or translucency has made.
    #[doc(hidden)]
    pub fn kept_scanned(&self) -> Option<Arc<Volume>> {
        self.scanned.clone()
    }

    /// Keeps the values as scanned no longer, unless translucency shows them.
    #[doc(hidden)]
    pub fn forget_scanned(&mut self) {
        if self.camera::<Translucent>().is_none() {
            self.scanned = None;
        }
    }

    /// Returns the scan as scanned, or of a cleansed one the part around the colon.
    fn scanned(&mut self) -> Arc<Volume> {
        let setup = &self.setup;
        match setup.cleansed.as_ref().filter(|c| !c.changes.is_empty()) {
            Some(cleansed) => {
                let part = || Arc::new(boxed(setup.volume.voxels(), &setup.lumen, &cleansed.changes));
                Arc::clone(self.scanned.get_or_insert_with(part))
            }
            None => setup.volume.shared_voxels(),
        }
    }
}
