//! The patient's position on the table, from the levels of fluid and from the table itself.

use super::frame::{AxisDirection, Frame};
use super::kinds::Landmarks;
use crate::volume::PatientPosition;

/// Returns the position in which `down` is down.
fn with_down(frame: Frame, down: AxisDirection) -> Option<PatientPosition> {
    use PatientPosition::{Left, Prone, Right, Supine};
    let sides =
        [(frame.posterior, Supine), (frame.posterior.back(), Prone), (frame.left, Left), (frame.left.back(), Right)];
    sides.into_iter().find(|s| s.0 == down).map(|s| s.1)
}

/// A position with its evidence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Lying {
    /// The position.
    pub position: PatientPosition,
    /// True if levels of fluid show it, false if only the table does.
    pub by_levels: bool,
    /// The position that the scan's header names.
    pub header: Option<PatientPosition>,
}

impl Lying {
    /// Describes the conflict of header and scan, if there is one.
    pub fn conflict(&self) -> Option<String> {
        let header = self.header.filter(|&h| h != self.position)?;
        let by = if self.by_levels { "levels of fluid show" } else { "the table shows" };
        let found = self.position.name();
        Some(format!(
            "the header says that the patient is {}, but {by} {found}: left and right may be wrong",
            header.name()
        ))
    }
}

/// Returns the position that levels of fluid show, else the one that the table shows.
pub(super) fn lying(
    frame: Frame,
    levels: Option<AxisDirection>,
    body: Option<&Landmarks>,
    header: Option<PatientPosition>,
) -> Option<Lying> {
    let by_levels = levels.and_then(|down| with_down(frame, down));
    let by_table = || body.and_then(|b| b.table);
    by_levels
        .map(|position| Lying { position, by_levels: true, header })
        .or_else(|| by_table().map(|position| Lying { position, by_levels: false, header }))
}
