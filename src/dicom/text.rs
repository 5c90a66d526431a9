//! Texts in the character sets of DICOM (PS3.3, C.12.1.1.2; PS3.5, 6.1.2.5), also with escape sequences between several, and UIDs.

use dicom_encoding::text::{SpecificCharacterSet, TextCodec};

/// Bytes that begin an escape sequence.
const ESC: u8 = 0x1B;

/// A character set that bytes are in.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Set {
    /// ASCII, and bytes above it of nothing that is known.
    Ascii,
    /// UTF-8.
    Utf8,
    /// JIS X 0201: ASCII with a yen, and katakana above it.
    Katakana,
    /// JIS X 0208 or JIS X 0212, with their escape sequence.
    Japanese(&'static [u8]),
    /// One that a table of another crate has.
    Table(&'static str),
}

/// Escape sequences, and the sets that they switch to.
const ESCAPES: [(&[u8], Set); 17] = [
    (b"(B", Set::Ascii),
    (b"(J", Set::Katakana),
    (b")I", Set::Katakana),
    (b"$(D", Set::Japanese(b"\x1b$(D")),
    (b"$B", Set::Japanese(b"\x1b$B")),
    (b"$)C", Set::Table("ISO_IR 149")),
    (b"$)A", Set::Table("GBK")),
    (b"-A", Set::Table("ISO_IR 100")),
    (b"-B", Set::Table("ISO_IR 101")),
    (b"-C", Set::Table("ISO_IR 109")),
    (b"-D", Set::Table("ISO_IR 110")),
    (b"-L", Set::Table("ISO_IR 144")),
    (b"-G", Set::Table("ISO_IR 127")),
    (b"-F", Set::Table("ISO_IR 126")),
    (b"-H", Set::Table("ISO_IR 138")),
    (b"-M", Set::Table("ISO_IR 148")),
    (b"-T", Set::Table("ISO_IR 166")),
];

/// Returns the set of a defined term.
fn named(term: &str) -> Option<Set> {
    let term = term.trim().replace('_', " ");
    Some(match term.trim_start_matches("ISO 2022 ").trim_start_matches("ISO ") {
        "" | "IR 6" => Set::Ascii,
        "IR 13" => Set::Katakana,
        "IR 192" => Set::Utf8,
        "IR 100" => Set::Table("ISO_IR 100"),
        "IR 101" => Set::Table("ISO_IR 101"),
        "IR 109" => Set::Table("ISO_IR 109"),
        "IR 110" => Set::Table("ISO_IR 110"),
        "IR 126" => Set::Table("ISO_IR 126"),
        "IR 127" => Set::Table("ISO_IR 127"),
        "IR 138" => Set::Table("ISO_IR 138"),
        "IR 144" => Set::Table("ISO_IR 144"),
        "IR 148" => Set::Table("ISO_IR 148"),
        "IR 149" => Set::Table("ISO_IR 149"),
        "IR 166" => Set::Table("ISO_IR 166"),
        "IR 58" => Set::Table("GBK"),
        // What a text begins with before the first escape sequence of these.
        "IR 87" | "IR 159" => Set::Ascii,
        "GB18030" => Set::Table("GB18030"),
        "GBK" | "GB2312" => Set::Table("GBK"),
        _ => return None,
    })
}

/// Decodes a value with the Specific Character Set of its data set. What is in no known set becomes a replacement character, and padding
/// goes.
pub(crate) fn decode(value: &[u8], sets: &str) -> String {
    let mut terms = sets.split('\\');
    let first = terms.next().and_then(named);
    // Without the first of several, a text begins in ASCII; an unknown one may be UTF-8, which many writers use without saying so.
    let first =
        if first == Some(Set::Ascii) && sets.trim().is_empty() { Set::Utf8 } else { first.unwrap_or(Set::Utf8) };
    // One set for the whole text, as some writers name it.
    let first = match (first, terms.next().and_then(named)) {
        (Set::Ascii, Some(second)) if !value.contains(&ESC) => second,
        _ => first,
    };
    let mut out = String::new();
    let (mut set, mut rest) = (first, value);
    while !rest.is_empty() {
        if rest[0] == ESC {
            let switch = ESCAPES.iter().find(|(sequence, _)| rest[1..].starts_with(sequence));
            match switch {
                Some((sequence, next)) => (set, rest) = (*next, &rest[1 + sequence.len()..]),
                None => rest = &rest[1..],
            }
            continue;
        }
        let end = rest.iter().position(|b| *b == ESC).unwrap_or(rest.len());
        // Delimiters of a name and of lines switch back to the first set. Within codes of two bytes they are no delimiters.
        let is_delimiter = |b: &u8| matches!(b, b'^' | b'=' | b'\r' | b'\n');
        let reset = if matches!(set, Set::Japanese(_)) || set == first {
            None
        } else {
            rest[..end].iter().position(is_delimiter)
        };
        let (part, next) = rest.split_at(reset.map_or(end, |n| n + 1));
        out.push_str(&in_set(part, set));
        if reset.is_some() {
            set = first;
        }
        rest = next;
    }
    out.trim_matches(['\0', ' ']).to_owned()
}

/// Decodes bytes of one set.
fn in_set(bytes: &[u8], set: Set) -> String {
    let lossy = || String::from_utf8_lossy(bytes).into_owned();
    // The tables are those of another crate, and the bytes are anybody's.
    let table = |code: &str, bytes: &[u8]| {
        let set = SpecificCharacterSet::from_code(code)?;
        colvis_scan::panics::catch(|| set.decode(bytes).ok()).ok().flatten()
    };
    match set {
        Set::Ascii | Set::Utf8 => lossy(),
        Set::Katakana => bytes
            .iter()
            .map(|b| match b {
                0xA1..=0xDF => char::from_u32(0xFF61 + u32::from(b - 0xA1)).unwrap_or('\u{fffd}'),
                b'\\' => '¥',
                b'~' => '‾',
                0..=0x7F => char::from(*b),
                _ => '\u{fffd}',
            })
            .collect(),
        Set::Japanese(sequence) => {
            let whole = [sequence, bytes, b"\x1b(B"].concat();
            table("ISO_IR 87", &whole).unwrap_or_else(|| "\u{fffd}".repeat(bytes.len().div_ceil(2)))
        }
        Set::Table(code) => {
            // A byte that the table lacks would come as an octal number.
            let text = table(code, bytes).filter(|text| !text.contains('\\') || bytes.contains(&b'\\'));
            text.unwrap_or_else(lossy)
        }
    }
}

/// True for a UID: numbers with dots between them, 64 characters at most. It is a safe name of a file.
pub fn is_uid(text: &str) -> bool {
    let is_number = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
    text.len() <= 64 && text.split('.').all(is_number)
}

/// Returns a name as people write it; `Doe^Jane` is "Doe, Jane".
pub fn person(name: &str) -> String {
    let form = name.split('=').find(|form| !form.is_empty()).unwrap_or_default();
    form.split('^').map(str::trim).filter(|p| !p.is_empty()).collect::<Vec<_>>().join(", ")
}

/// Returns a day as "2026-01-31".
pub fn day(date: &str) -> String {
    match (date.get(..4), date.get(4..6), date.get(6..8)) {
        (Some(year), Some(month), Some(day)) => format!("{year}-{month}-{day}"),
        _ => date.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_any_character_set_become_unicode() {
        for (set, bytes, text) in [
            ("ISO_IR 100", &b"M\xfcller^J\xf6rg "[..], "Müller^Jörg"),
            ("ISO_IR 192", "Müller".as_bytes(), "Müller"),
            ("", b"Miller\0", "Miller"),
            ("ISO_IR 144", b"\xbb\xee\xda", "Люк"),
            ("GB18030", b"\xcd\xf5^\xd0\xa1\xb6\xab", "王^小东"),
            ("\\ISO 2022 IR 87", b"Yamada^Tarou=\x1b$B;3ED\x1b(B^\x1b$BB@O:\x1b(B", "Yamada^Tarou=山田^太郎"),
            (
                "ISO 2022 IR 13\\ISO 2022 IR 87",
                b"\xd4\xcf\xc0\xde^\xc0\xdb\xb3=\x1b$B;3ED\x1b(J^\x1b$BB@O:\x1b(J",
                "ﾔﾏﾀﾞ^ﾀﾛｳ=山田^太郎",
            ),
            (
                "\\ISO 2022 IR 149",
                b"Hong^Gildong=\x1b$)C\xfb\xf3^\x1b$)C\xd1\xce\xd4\xd7=\x1b$)C\xc8\xab^\x1b$)C\xb1\xe6\xb5\xbf",
                "Hong^Gildong=洪^吉洞=홍^길동",
            ),
            ("\\ISO 2022 IR 58", b"Zhang^XiaoDong=\x1b$)A\xd5\xc5^\x1b$)A\xd0\xa1\xb6\xab=", "Zhang^XiaoDong=张^小东="),
            ("ISO 2022 IR 6\\ISO 2022 IR 100\\ISO 2022 IR 126", b"Dionysios=\x1b-F\xc4\xe9\xef", "Dionysios=Διο"),
            ("\\ISO 2022 IR 100", b"\xbb\xb3", "\u{bb}\u{b3}"),
            ("unheard of", b"\xff\xfe", "\u{fffd}\u{fffd}"),
            ("ISO_IR 100", b"\x1b\x1b", ""),
        ] {
            assert_eq!(decode(bytes, set), text, "{set}");
        }
    }

    #[test]
    fn any_bytes_in_any_set_are_a_text_without_escapes() {
        let sets = ESCAPES.iter().map(|(sequence, _)| [&[ESC], *sequence].concat());
        let bytes: Vec<u8> = sets.flat_map(|escape| [&escape[..], &[b'a', 0x80, 0xFF, b'^', b'\\']].concat()).collect();
        for from in 0..bytes.len() {
            for set in ["", "ISO_IR 100", "\\ISO 2022 IR 87", "GB18030", "ISO_IR 13", "?"] {
                assert!(!decode(&bytes[from..], set).contains('\u{1b}'), "{from} {set}");
            }
        }
    }

    #[test]
    fn uids_are_numbers_and_dots() {
        for (uid, good) in
            [("1.2.840", true), ("1..2", false), ("", false), ("..", false), ("1.2/3", false), ("a.b", false)]
        {
            assert_eq!(is_uid(uid), good, "{uid}");
        }
        assert!(is_uid(&"1".repeat(64)) && !is_uid(&"1".repeat(65)));
    }

    #[test]
    fn names_and_days_are_written_as_people_do() {
        assert_eq!(
            (person("Doe^Jane^^Dr="), person("=山田^太郎")),
            ("Doe, Jane, Dr".to_owned(), "山田, 太郎".to_owned())
        );
        assert_eq!((day("20260131"), day("?")), ("2026-01-31".to_owned(), "?".to_owned()));
    }
}
