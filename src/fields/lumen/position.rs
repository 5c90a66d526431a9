//! The patient's position on the table, from the levels of fluid and from the table itself.

use super::frame::{AxisDirection, Frame};
use super::kinds::Landmarks;

/// Position of the patient on the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PatientPosition {
    /// On the back.
    Supine,
    /// On the belly.
    Prone,
    /// On the left side.
    Left,
    /// On the right side.
    Right,
}

impl PatientPosition {
    /// Returns its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Supine => "supine",
            Self::Prone => "prone",
            Self::Left => "left decubitus",
            Self::Right => "right decubitus",
        }
    }

    /// Returns the position in which `down` is down.
    pub(super) fn with_down(frame: Frame, down: AxisDirection) -> Option<Self> {
        let sides = [
            (frame.posterior, Self::Supine),
            (frame.posterior.back(), Self::Prone),
            (frame.left, Self::Left),
            (frame.left.back(), Self::Right),
        ];
        sides.into_iter().find(|s| s.0 == down).map(|s| s.1)
    }

    /// Returns the position that a DICOM header names (Patient Position, 0018,5100), such as `HFS`; `None` for a value that says
    /// nothing about which side is down.
    pub fn of_header(value: &str) -> Option<Self> {
        let value = value.trim().to_ascii_uppercase();
        let value = value.strip_prefix("HF").or(value.strip_prefix("FF"))?;
        match value {
            "S" => Some(Self::Supine),
            "P" => Some(Self::Prone),
            "DL" => Some(Self::Left),
            "DR" => Some(Self::Right),
            _ => None,
        }
    }
}

/// A position with what tells it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Lying {
    /// The position.
    pub position: PatientPosition,
    /// True if levels of fluid tell it, false if only the table does.
    pub by_levels: bool,
}

/// Returns the position that levels of fluid tell, else the one that the table tells.
pub(super) fn lying(frame: Frame, levels: Option<AxisDirection>, body: Option<&Landmarks>) -> Option<Lying> {
    let by_levels = levels.and_then(|down| PatientPosition::with_down(frame, down));
    let by_table = || body.and_then(|b| b.table);
    by_levels
        .map(|position| Lying { position, by_levels: true })
        .or_else(|| by_table().map(|position| Lying { position, by_levels: false }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_name_positions_however_the_patient_enters() {
        use PatientPosition::{Left, Prone, Right, Supine};
        for (value, expected) in [
            ("HFS", Some(Supine)),
            ("FFS ", Some(Supine)),
            ("hfp", Some(Prone)),
            ("FFP", Some(Prone)),
            ("HFDL", Some(Left)),
            ("FFDR", Some(Right)),
            ("SITTING", None),
            ("", None),
            ("HF", None),
        ] {
            assert_eq!(PatientPosition::of_header(value), expected, "{value:?}");
        }
    }
}
