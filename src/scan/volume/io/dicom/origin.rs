//! Where a slice comes from: patient, study and description. Identities are kept as hashes only.

use super::dataset::{Item, Tag};

const SOP_CLASS: Tag = (0x0008, 0x0016);
const IMAGE_TYPE: Tag = (0x0008, 0x0008);
const MODALITY: Tag = (0x0008, 0x0060);
const DESCRIPTION: Tag = (0x0008, 0x103E);
const PATIENT_NAME: Tag = (0x0010, 0x0010);
const PATIENT_ID: Tag = (0x0010, 0x0020);
const BIRTH_DATE: Tag = (0x0010, 0x0030);
const ACCESSION: Tag = (0x0008, 0x0050);
const STUDY_UID: Tag = (0x0020, 0x000D);
const FRAME_OF_REFERENCE: Tag = (0x0020, 0x0052);
/// SOP class of a secondary capture; those of its multi-frame forms continue it.
const CAPTURE: &str = "1.2.840.10008.5.1.4.1.1.7";
/// Maximum number of characters of a description.
const MOST_CHARACTERS: usize = 40;
/// Shorter parts of a name are found in other words too.
const LEAST_OF_NAME: usize = 3;

/// What a series holds. Series are ordered by it where number and UID agree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Kind {
    /// Slices.
    Slices,
    /// Localizers (scout views).
    Localizer,
    /// Secondary captures: pictures of a screen.
    Capture,
    /// No image: reports, structures, presentation states.
    NoImage,
}

/// The facts that the slices of a series share.
#[derive(Clone, Debug)]
pub(crate) struct Origin {
    /// Hash of the patient's identity; without one, of the study.
    pub patient: u64,
    /// True if the patient's identity is known. Some writers give no identity, and put each slice into its own study.
    pub has_identity: bool,
    /// Hash of the study's UID.
    pub study: u64,
    /// Hash of the UID of the frame of reference.
    pub frame_of_reference: Option<u64>,
    /// Series Description, cleaned.
    pub description: String,
    /// What the series holds.
    pub kind: Kind,
}

impl Origin {
    /// Reads the facts from a data set, with or without an `image`.
    pub(crate) fn of(root: &Item, image: bool) -> Self {
        let text = |tag: Tag| root.text(tag).unwrap_or_default();
        let (name, id, study) = (text(PATIENT_NAME), text(PATIENT_ID), text(STUDY_UID));
        let patient = match (name.is_empty(), id.is_empty()) {
            // Without an identity, each study counts as a patient.
            (true, true) => hash(&["study", &study]),
            _ => hash(&["patient", &id, &name]),
        };
        let has_identity = !(name.is_empty() && id.is_empty());
        let image_type = text(IMAGE_TYPE);
        let is_type = |wanted: &str| image_type.split('\\').any(|t| t.trim() == wanted);
        let class = text(SOP_CLASS);
        let captured = class == CAPTURE || class.strip_prefix(CAPTURE).is_some_and(|rest| rest.starts_with('.'));
        let kind = if !image {
            Kind::NoImage
        } else if captured || ["SC", "OT"].contains(&&*text(MODALITY)) || is_type("SCREEN SAVE") {
            Kind::Capture
        } else if is_type("LOCALIZER") {
            Kind::Localizer
        } else {
            Kind::Slices
        };
        Self {
            patient,
            has_identity,
            study: hash(&["of", &study]),
            frame_of_reference: root.text(FRAME_OF_REFERENCE).map(|uid| hash(&["frame", &uid])),
            description: shortened(&clean(&text(DESCRIPTION), &name, &id)),
            kind,
        }
    }
}

/// FNV-1a of texts. It only has to distinguish the patients of one folder.
pub(super) fn hash(parts: &[&str]) -> u64 {
    let bytes = parts.iter().flat_map(|p| p.bytes().chain([0]));
    bytes.fold(0xCBF2_9CE4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01B3))
}

/// Cleans a text of the header of `root` as a description is cleaned, at full length.
pub(super) fn cleaned(root: &Item, text: &str) -> String {
    let of = |tag: Tag| root.text(tag).unwrap_or_default();
    let mut text = text.to_owned();
    for secret in [BIRTH_DATE, ACCESSION].map(of).iter().filter(|s| s.chars().count() >= LEAST_OF_NAME) {
        text = text.replace(secret.as_str(), "…");
    }
    clean(&text, &of(PATIENT_NAME), &of(PATIENT_ID))
}

/// Returns at most 40 characters of a text.
pub(super) fn shortened(text: &str) -> String {
    text.chars().take(MOST_CHARACTERS).collect::<String>().trim_end().to_owned()
}

/// Cleans a description: no control characters, no semicolon (it separates the parts of a message), and `…` for words of the
/// patient's name and for the identifier.
fn clean(description: &str, name: &str, id: &str) -> String {
    let lower = |s: &str| s.to_lowercase();
    let words = |s: &str| s.split(|c: char| !c.is_alphanumeric()).map(lower).collect::<Vec<_>>();
    let mut secret = words(name);
    // Names in other writing are short, and no space parts them from what follows.
    let run_on: Vec<String> = secret.iter().filter(|w| !w.is_ascii() && w.chars().count() >= 2).cloned().collect();
    secret.retain(|w| w.chars().count() >= LEAST_OF_NAME);
    let id = if id.chars().count() >= LEAST_OF_NAME { id } else { "\0" };
    let text: String = description.replace(id, "…").chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let mut out = String::new();
    let mut word = String::new();
    for c in text.replace(';', ",").chars().chain([' ']) {
        if c.is_alphanumeric() {
            word.push(c);
            continue;
        }
        let is_secret = secret.contains(&lower(&word)) || run_on.iter().any(|s| lower(&word).contains(s));
        out.push_str(if is_secret { "…" } else { &word });
        word.clear();
        out.push(c);
    }
    out.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_description_is_short_and_names_nobody() {
        let cleaned = |text: &str| shortened(&clean(text, "Doe^Jane=ドウ", "SECRET7"));
        assert_eq!(cleaned("  Colon\t1.0;  B30f\n"), "Colon 1.0, B30f");
        assert_eq!(cleaned("JANE doe SECRET7-prone, does"), "… … …-prone, does");
        assert_eq!(cleaned(&"ä".repeat(99)).chars().count(), 40);
        assert_eq!(cleaned("\u{1b}[31mred"), "[31mred");
        assert_eq!(clean("CT of X Y", "X^Y", "1"), "CT of X Y", "letters are no names");
        assert_eq!(clean("", "", ""), "");
    }

    #[test]
    fn hashes_tell_texts_apart() {
        let all = [&["a", "bc"][..], &["ab", "c"], &["abc"], &["a", "", "bc"]].map(hash);
        assert!((1..4).all(|k| !all[..k].contains(&all[k])), "{all:?}");
    }
}
