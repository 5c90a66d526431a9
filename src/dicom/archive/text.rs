//! Text in the character set of an answer.

use dicom_encoding::text::{SpecificCharacterSet, TextCodec};

use super::elements::text;

/// Decodes a value with the SpecificCharacterSet that its data set names.
///
/// Escape sequences between several sets are not followed: the first set that is known decodes the value.
pub(super) fn decode(value: &[u8], sets: &str) -> String {
    let known = sets.split('\\').map(str::trim).find(|s| !s.is_empty()).and_then(SpecificCharacterSet::from_code);
    if value.is_ascii() || known.is_none() {
        return text(value);
    }
    // The tables are those of another crate, and the bytes come from the network.
    let decoded = colvis_scan::panics::catch(|| known.and_then(|set| set.decode(value).ok()));
    decoded.ok().flatten().map_or_else(|| text(value), |d| text(d.as_bytes()))
}

/// True if a text matches a pattern: `*` stands for any characters, `?` for one. Upper and lower case are the same.
pub(super) fn matches(text: &str, pattern: &str) -> bool {
    let lower = |s: &str| s.to_lowercase().chars().collect::<Vec<_>>();
    let (text, pattern) = (lower(text), lower(pattern));
    let (mut t, mut p) = (0, 0);
    // Where the last star stands, and how far the text was when it was met.
    let mut star: Option<(usize, usize)> = None;
    while t < text.len() {
        match pattern.get(p) {
            Some('*') => {
                star = Some((p, t));
                p += 1;
            }
            Some(c) if *c == '?' || *c == text[t] => {
                t += 1;
                p += 1;
            }
            _ => {
                let Some((at, met)) = star else { return false };
                star = Some((at, met + 1));
                (p, t) = (at + 1, met + 1);
            }
        }
    }
    pattern[p..].iter().all(|c| *c == '*')
}

/// Returns a pattern: a word without wildcards is looked for anywhere.
pub(super) fn pattern(word: &str) -> String {
    if word.contains(['*', '?']) { word.to_owned() } else { format!("*{word}*") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_decoded_as_their_set_says() {
        assert_eq!(decode("Äneas^Ö".as_bytes(), "ISO_IR 192"), "Äneas^Ö");
        assert_eq!(decode(b"\xc4neas ", "ISO_IR 100"), "Äneas");
        assert_eq!(decode(b"Jane\0", ""), "Jane");
        assert_eq!(decode(b"\xc4neas", "NOBODY KNOWS"), "\u{fffd}neas");
        assert_eq!(decode(b"\xc4neas", ""), "\u{fffd}neas");
        assert_eq!(decode(b"\xbb\xb3", "\\ISO 2022 IR 100"), "\u{bb}\u{b3}");
    }

    #[test]
    fn wildcards_match_as_in_an_archive() {
        for (text, pattern, hit) in [
            ("CT Abdomen", "*abdo*", true),
            ("CT Abdomen", "ct*men", true),
            ("CT Abdomen", "?T*", true),
            ("CT Abdomen", "T*", false),
            ("", "*", true),
            ("", "?", false),
            ("aaaab", "*a*ab", true),
            ("aaaac", "*a*ab", false),
        ] {
            assert_eq!(matches(text, pattern), hit, "{text} {pattern}");
        }
        assert_eq!((pattern("Doe"), pattern("D?e")), ("*Doe*".to_owned(), "D?e".to_owned()));
    }
}
