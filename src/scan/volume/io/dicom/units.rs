//! What stored values are: HU, or something else (Rescale Type and Modality LUT Type, PS3.3, C.11.1.1.2).

/// What the values of a slice are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Units {
    /// HU, as declared, or as CT has them where a rescale has no type.
    Hu,
    /// Nothing turns the stored values into HU.
    Missing,
    /// An uninformative type: "US" (unspecified), which common writers give every image, or a term that is not defined.
    Unspecified(String),
    /// Something else, in words.
    Other(String),
}

impl Units {
    /// Returns what a term of the attribute `name` means.
    pub(super) fn of(name: &str, term: &str) -> Self {
        let term: String = term.chars().map(|c| if c.is_control() || c == ';' { ' ' } else { c }).take(40).collect();
        let what = match term.to_ascii_uppercase().trim() {
            "HU" | "HU_MOD" | "HOUNSFIELD" | "HOUNSFIELD UNIT" | "HOUNSFIELD UNITS" => return Self::Hu,
            "OD" => "optical densities",
            "MGML" => "densities in mg/ml",
            "Z_EFF" => "effective atomic numbers",
            "ED" => "electron densities",
            "EDW" => "electron densities relative to water",
            "PCT" => "percentages",
            "US" => return Self::Unspecified(format!("{name} is {term} (unspecified)")),
            _ => return Self::Unspecified(format!("{name} is {term}, an unknown term")),
        };
        Self::Other(format!("{what} ({name} {term}), not HU"))
    }

    /// Returns why nothing in the header says that the values are HU; `None` if it does, or if they are something else.
    pub(crate) fn doubt(&self) -> Option<&str> {
        match self {
            Self::Missing => Some("has no RescaleSlope and RescaleIntercept"),
            Self::Unspecified(why) => Some(why),
            Self::Hu | Self::Other(_) => None,
        }
    }
}
