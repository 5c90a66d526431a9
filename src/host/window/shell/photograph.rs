//! Takes a screenshot of all views of the window.

use std::time::Instant;

use super::Shell;
use super::open_scan::Stage;
use crate::host::window::contract::Context;
use crate::host::window::photograph::Photograph;

impl Shell {
    /// Takes the views as they are laid out.
    pub(super) fn photograph(&mut self, now: Instant) {
        let size = self.window_size();
        let Stage::Flying(controller) = &mut self.scan.stage else { return };
        let hud = controller.hud(now);
        let beside = self.other.as_mut().and_then(|other| other.content(None, now));
        let context = Context::new(&**controller, &self.actions, self.recent.scans(), &hud);
        let other = self.other.as_ref().zip(beside.as_ref()).map(|(other, content)| other.beside(content));
        let context = context.of_scan(self.scan.input.as_deref(), self.scan.series).beside(other, true, &self.pairing);
        let views = Photograph::take(&context, size, &self.scan.placed.views);
        controller.photograph(views, now);
    }
}
