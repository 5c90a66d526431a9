//! What a position is in, and a body of gas: the colon, other gut, a lung, or the air outside.

use serde::{Deserialize, Serialize};

/// What a body of gas is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[non_exhaustive]
pub enum BodyKind {
    /// A segment of the colon.
    #[serde(rename = "colon")]
    Colon,
    /// A piece of small bowel.
    #[serde(rename = "small bowel")]
    SmallBowel,
    /// The stomach.
    #[serde(rename = "stomach")]
    Stomach,
    /// A lung.
    #[serde(rename = "lung")]
    Lung,
}

/// What a position is in. A boundary is the middle of a wall's blur, where gas ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Content {
    /// Tissue, fat or bone, or the table.
    Tissue,
    /// The colon's lumen: gas, fluid or tag. It ends at the mouth of the ileocecal valve.
    Colon,
    /// The lumen of small bowel; the passage of the ileocecal valve, too.
    SmallBowel,
    /// The stomach's lumen: gas or fluid.
    Stomach,
    /// A lung, with its vessels and airways.
    Lung,
    /// The air around the patient.
    Outside,
}

impl Content {
    /// Returns the value in a mask of labels: 0 nothing, 1 colon, 2 small bowel, 3 stomach, 4 lung, 5 outside air.
    pub fn label(self) -> u8 {
        match self {
            Self::Tissue => 0,
            Self::Colon => 1,
            Self::SmallBowel => 2,
            Self::Stomach => 3,
            Self::Lung => 4,
            Self::Outside => 5,
        }
    }
}
