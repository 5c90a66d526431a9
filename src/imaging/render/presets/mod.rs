//! The presets of this crate. Each is one file and a line in [`BUILT_IN`].

pub mod colvis;
pub mod lean;
pub mod standard;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::preset::Preset;

/// Every preset of this crate.
pub const BUILT_IN: [Preset; 3] = [standard::PRESET, colvis::PRESET, lean::PRESET];

/// Their names.
const NAMES: &[&str] = &[standard::PRESET.name, colvis::PRESET.name, lean::PRESET.name];

impl Preset {
    /// Returns the preset of this crate with that name.
    pub fn named(name: &str) -> Option<Self> {
        BUILT_IN.into_iter().find(|p| p.name == name)
    }
}

impl Default for Preset {
    fn default() -> Self {
        standard::PRESET
    }
}

/// Serialises as its name.
impl Serialize for Preset {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name)
    }
}

/// Deserialises from the name of one of [`BUILT_IN`].
impl<'de> Deserialize<'de> for Preset {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        Self::named(&name).ok_or_else(|| D::Error::unknown_variant(&name, NAMES))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_found_by_their_names() {
        for preset in BUILT_IN {
            assert_eq!(Preset::named(preset.name), Some(preset));
        }
        assert_eq!(NAMES, BUILT_IN.map(|p| p.name));
        assert_eq!(Preset::named("best"), None);
        assert_eq!(serde_json::from_str::<Preset>("\"lean\"").unwrap(), lean::PRESET);
        assert_eq!(serde_json::to_string(&Preset::default()).unwrap(), "\"default\"");
        assert!(serde_json::from_str::<Preset>("\"best\"").is_err());
    }
}
