//! The interfaces that systems plug into: the order of everything that is scheduled, the world it runs on, and the
//! description of a navigation method.
//!
//! - [`FlightSystems`]: the order of a simulation step and of a frame.
//! - [`App`]: a world with a scan entity, a camera entity and the two schedules.
//! - [`Plugin`]: an extension from another crate that adds systems and components and stays for the whole flight.
//! - [`Guide`] and [`Guides`]: a navigation method with its settings, and the table of guides available to a flight.

mod app;
mod guide;
mod inspect;
mod ledger;
mod look;
mod own;
mod parts;
mod plugin;
mod sets;

pub use app::{App, LeftOut, Main, Slot};
pub use guide::{Guide, GuideEntry, Guides, Needs};
pub use inspect::Inspector;
#[doc(hidden)]
pub use ledger::{AtHome, at_home};
pub use ledger::{PluginTime, book_time, note, report_fault};
pub use look::Look;
pub use plugin::{Plugin, Plugins};
pub use sets::{FlightSystems, Phase};
