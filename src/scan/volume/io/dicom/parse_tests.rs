use super::*;
use crate::volume::io::dicom::dataset::PixelPlace;

fn file(syntax: &str, body: &[u8]) -> Vec<u8> {
    let mut uid = syntax.as_bytes().to_vec();
    uid.resize(uid.len().next_multiple_of(2), 0);
    let mut f = vec![0; 128];
    f.extend(b"DICM\x02\0\x10\0UI");
    f.extend((uid.len() as u16).to_le_bytes());
    f.extend(uid);
    f.extend(body);
    f
}

#[test]
fn a_length_beyond_the_file_is_short_and_allocates_nothing() {
    for length in [5u32, 1 << 20, u32::MAX - 1] {
        let mut body = b"\x08\0\x05\0UN\0\0".to_vec();
        body.extend(length.to_le_bytes());
        body.extend(b"abcd");
        assert_eq!(parse(&file("1.2.840.10008.1.2.1", &body)).unwrap_err(), Fault::Short);
    }
}

#[test]
fn nested_sequences_of_both_lengths() {
    // SQ (0008,1140) of undefined length with an item of undefined length that holds a value and another SQ of defined length.
    let mut body = b"\x08\0\x40\x11SQ\0\0\xff\xff\xff\xff\xfe\xff\x00\xe0\xff\xff\xff\xff".to_vec();
    body.extend(b"\x28\0\x10\0US\x02\0\x07\0");
    body.extend(b"\x08\0\x41\x11SQ\0\0\x10\0\0\0\xfe\xff\x00\xe0\x08\0\0\0\x10\0\x10\0LO\0\0");
    body.extend(b"\xfe\xff\x0d\xe0\0\0\0\0\xfe\xff\xdd\xe0\0\0\0\0");
    body.extend(b"\xe0\x7f\x10\0OW\0\0\x02\0\0\0ab");
    let bytes = file("1.2.840.10008.1.2.1", &body);
    let (set, _) = parse(&bytes).unwrap();
    let items = set.root.items((0x0008, 0x1140));
    assert_eq!(items[0].short((0x0028, 0x0010)), Some(7));
    assert_eq!(items[0].items((0x0008, 0x1141)).len(), 1);
    assert_eq!(set.pixels, Some(PixelPlace { offset: bytes.len() - 2, length: Some(2), is_float: false }));
}

#[test]
fn deep_nesting_is_refused() {
    let mut body = Vec::new();
    for _ in 0..100 {
        body.extend(b"\x08\0\x40\x11SQ\0\0\xff\xff\xff\xff\xfe\xff\x00\xe0\xff\xff\xff\xff");
    }
    assert!(matches!(parse(&file("1.2.840.10008.1.2.1", &body)), Err(Fault::Bad(_))));
}

/// A sequence of unknown representation is in implicit form, and what follows it is not (PS3.5, 6.2.2).
#[test]
fn an_unknown_sequence_leaves_the_explicit_form_as_it_was() {
    let mut body = b"\x08\0\x40\x11UN\0\0\xff\xff\xff\xff\xfe\xff\x00\xe0\x0a\0\0\0".to_vec();
    body.extend(b"\x28\0\x10\0\x02\0\0\0\x07\0\xfe\xff\xdd\xe0\0\0\0\0");
    body.extend(b"\x28\0\x11\0US\x02\0\x09\0");
    body.extend(b"\xe0\x7f\x10\0OW\0\0\x02\0\0\0ab");
    let bytes = file("1.2.840.10008.1.2.1", &body);
    let (set, _) = parse(&bytes).unwrap();
    assert_eq!(set.root.items((0x0008, 0x1140))[0].short((0x0028, 0x0010)), Some(7));
    assert_eq!(set.root.short((0x0028, 0x0011)), Some(9));
    assert_eq!(set.pixels, Some(PixelPlace { offset: bytes.len() - 2, length: Some(2), is_float: false }));
}

#[test]
fn the_implicit_form_tells_values_from_sequences_by_their_bytes() {
    let mut body = b"\x28\0\x11\0\x02\0\0\0\x09\0\x08\0\x40\x11\x12\0\0\0".to_vec();
    body.extend(b"\xfe\xff\x00\xe0\x0a\0\0\0\x28\0\x10\0\x02\0\0\0\x07\0");
    body.extend(b"\x18\0\x50\0\x0a\0\0\x000.62500000\xe0\x7f\x10\0\x02\0\0\0ab");
    let bytes = file("1.2.840.10008.1.2", &body);
    let (set, _) = parse(&bytes).unwrap();
    assert_eq!(set.root.short((0x0028, 0x0011)), Some(9));
    assert_eq!(set.root.items((0x0008, 0x1140))[0].short((0x0028, 0x0010)), Some(7));
    assert_eq!(set.root.decimal((0x0018, 0x0050)), Some(0.625), "ten bytes that do not begin as an item does");
    assert_eq!(set.pixels, Some(PixelPlace { offset: bytes.len() - 2, length: Some(2), is_float: false }));
}

#[test]
fn a_decimal_is_the_first_number_of_a_value() {
    let mut body = b"\x18\0\x50\0DS\x04\x002.5 \x20\0\x11\0IS\x02\0x ".to_vec();
    body.extend(b"\x28\0\x30\0DS\x08\x000.7\\0.8 ");
    let bytes = file("1.2.840.10008.1.2.1", &body);
    let root = parse(&bytes).unwrap().0.root;
    assert_eq!(root.decimal((0x0018, 0x0050)), Some(2.5));
    assert_eq!(root.decimal((0x0028, 0x0030)), Some(0.7));
    assert_eq!(root.decimals((0x0028, 0x0030)), Some(vec![0.7, 0.8]));
    assert_eq!(root.decimal((0x0020, 0x0011)), None, "no number");
    assert_eq!(root.decimal((0x0018, 0x0088)), None, "not there");
}

/// A private sequence of undefined length whose items are explicit, and an icon of compressed pixels: both are skipped.
#[test]
fn what_is_not_needed_is_passed_over() {
    let rows = b"\x28\0\x10\0US\x02\0\x07\0".as_slice();
    let end = b"\xe0\x7f\x10\0OW\0\0\x02\0\0\0ab".as_slice();
    let unknown = b"\x09\0\x10\x10UN\0\0\xff\xff\xff\xff\xfe\xff\x00\xe0\xff\xff\xff\xff\x28\0\x10\0US\x02\0\x09\0\
        \xfe\xff\x0d\xe0\0\0\0\0\xfe\xff\xdd\xe0\0\0\0\0";
    let private = b"\x09\0\x10\x10SQ\0\0\x12\0\0\0\xfe\xff\x00\xe0\x0a\0\0\0\x28\0\x10\0\x02\0\0\0\x07\0";
    let icon =
        b"\x88\0\0\x02SQ\0\0\xff\xff\xff\xff\xfe\xff\x00\xe0\xff\xff\xff\xff\xe0\x7f\x10\0OB\0\0\xff\xff\xff\xff\
        \xfe\xff\x00\xe0\0\0\0\0\xfe\xff\x00\xe0\x04\0\0\0abcd\xfe\xff\xdd\xe0\0\0\0\0\xfe\xff\x0d\xe0\0\0\0\0\
        \xfe\xff\xdd\xe0\0\0\0\0";
    for parts in [[unknown.as_slice(), rows, end], [private, rows, end], [rows, icon, end]] {
        let bytes = file("1.2.840.10008.1.2.1", &parts.concat());
        let (set, _) = parse(&bytes).unwrap();
        assert_eq!(set.root.short((0x0028, 0x0010)), Some(7));
        assert_eq!(set.pixels.map(|p| p.offset), Some(bytes.len() - 2));
        assert!(!set.oddities.damage);
    }
}

/// Damage is skipped if nothing that is needed can be lost with it, and only in a whole file.
#[test]
fn damage_is_passed_over_where_it_harms_nothing() {
    let rows = b"\x28\0\x10\0US\x02\0\x07\0".as_slice();
    let end = b"\xe0\x7f\x10\0OW\0\0\x02\0\0\0ab".as_slice();
    let modality = b"\x08\0\x60\0CS\x02\0CT".as_slice();
    let cases: [(&str, &[u8]); 5] = [
        ("a length beyond the file", b"\x08\0\x70\0LO\xf0\xffabcd"),
        ("a length too short", b"\x08\0\x70\0LO\x02\0abcdef"),
        ("a length too long", b"\x08\0\x70\0LO\x08\0abcd"),
        ("no representation", b"\x08\0\x70\0\xab\xcd\x04\0abcd"),
        ("no item", b"\x08\0\x40\x11SQ\0\0\xff\xff\xff\xffabcdefgh"),
    ];
    for (name, bad) in cases {
        // Between two needed elements, with others between.
        let lost = file("1.2.840.10008.1.2.1", &[modality, bad, rows, end].concat());
        assert!(parse(&lost).is_err(), "{name}");
        // Where nothing is needed.
        let bad = [b"\x40\0\x75\x02", &bad[4..]].concat();
        let bytes = file("1.2.840.10008.1.2.1", &[modality, rows, &bad, end].concat());
        let (set, _) = parse(&bytes).unwrap_or_else(|e| panic!("{name}: {e:?}"));
        assert_eq!(set.root.short((0x0028, 0x0010)), Some(7), "{name}");
        assert!(set.oddities.damage && set.pixels.is_some(), "{name}");
        assert!(parse_first(&bytes).is_err(), "{name}");
    }
}

#[test]
fn the_bytes_tell_the_form() {
    let explicit = b"\x08\0\x60\0CS\x02\0CT\x28\0\x10\0US\x02\0\x07\0\xe0\x7f\x10\0OW\0\0\x02\0\0\0ab".as_slice();
    let implicit = b"\x08\0\x60\0\x02\0\0\0CT\x28\0\x10\0\x02\0\0\0\x07\0\xe0\x7f\x10\0\x02\0\0\0ab".as_slice();
    let big = b"\0\x08\0\x60CS\0\x02CT\0\x28\0\x10US\0\x02\0\x07\x7f\xe0\0\x10OW\0\0\0\0\0\x02ab".as_slice();
    for (body, syntax) in
        [(explicit, "1.2.840.10008.1.2.1"), (implicit, "1.2.840.10008.1.2"), (big, "1.2.840.10008.1.2.2")]
    {
        let (set, _) = parse(body).unwrap();
        assert_eq!(set.syntax, syntax);
        assert!(set.oddities.no_syntax && super::super::begins_bare(body));
        assert_eq!(set.root.short((0x0028, 0x0010)), Some(7), "{syntax}");
    }
    for (body, syntax) in [(explicit, "1.2.840.10008.1.2"), (implicit, "1.2.840.10008.1.2.1")] {
        let bytes = file(syntax, body);
        let (set, _) = parse(&bytes).unwrap();
        assert!(set.oddities.other_form, "{syntax}");
        assert_eq!(set.root.short((0x0028, 0x0010)), Some(7), "{syntax}");
    }
    for text in ["", "hello, this is a text", "\x08\0\x60\0"] {
        assert!(!super::super::begins_bare(text.as_bytes()), "{text:?}");
    }
}
