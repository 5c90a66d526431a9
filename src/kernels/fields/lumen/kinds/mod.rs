//! The kind of each body of gas: colon, small bowel, stomach, lung, airway, air outside.
//!
//! Gas that is certainly not colon by position and texture alone is excluded first (`choose`). Of the others, the
//! largest, `features` measures shape, place and connections against the patient's `landmarks`; the table of `rules` weighs them;
//! and the cheapest chain from rectum to cecum (`order`) tells which of them the colon needs. A body that narrow passages divide is
//! classified in parts (`necks`).

pub(super) mod features;
pub(super) mod landmarks;
pub(super) mod necks;
pub(super) mod rules;

pub use features::Features;
pub use landmarks::Landmarks;
pub use rules::{Chain, RULES, Rule, judge};

/// The kind of a body of gas.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum GasKind {
    /// Colon.
    #[serde(rename = "colon")]
    Colon,
    /// Small bowel.
    #[serde(rename = "small bowel")]
    SmallBowel,
    /// Stomach.
    #[serde(rename = "stomach")]
    Stomach,
    /// Lung with its airways.
    #[serde(rename = "lung")]
    Lung,
    /// Trachea, main bronchus or another airway apart from the lung.
    #[serde(rename = "trachea")]
    Trachea,
    /// Air outside the patient, in the table or in clothes.
    #[serde(rename = "outside")]
    Outside,
    /// It may be colon, or something else.
    #[serde(rename = "unknown")]
    Unknown,
}

impl GasKind {
    /// All kinds, in the order of [`GasKind::number`].
    pub const ALL: [Self; 7] =
        [Self::Colon, Self::SmallBowel, Self::Stomach, Self::Lung, Self::Trachea, Self::Outside, Self::Unknown];

    /// Returns its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Colon => "colon",
            Self::SmallBowel => "small bowel",
            Self::Stomach => "stomach",
            Self::Lung => "lung",
            Self::Trachea => "trachea",
            Self::Outside => "outside",
            Self::Unknown => "unknown",
        }
    }

    /// Returns its place in [`GasKind::ALL`].
    pub fn number(self) -> usize {
        self as usize
    }
}

/// A kind with the reason for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judged {
    /// The kind.
    pub kind: GasKind,
    /// The reason, in words.
    pub why: &'static str,
    /// True if it belongs to the colon, or may.
    pub is_lumen: bool,
}

/// A body of gas, or a part of one, that the rules weighed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Considered {
    /// Its measures.
    pub features: Features,
    /// Its place in the chain from rectum to cecum.
    pub chain: Chain,
    /// Its automatic kind.
    pub judged: Judged,
}

#[cfg(test)]
mod tests;
