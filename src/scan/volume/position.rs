//! The patient's position on the table.

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
