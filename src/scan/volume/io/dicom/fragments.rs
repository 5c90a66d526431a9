//! The fragments of encapsulated pixel data (PS3.5, A.4).

use super::dataset::{EXPLICIT, Fault, ITEM, SEQUENCE_END};
use super::walk::Walk;

/// Returns the fragments of encapsulated pixel data, without the preceding offset table.
///
/// The delimiter after the last fragment may be missing, or zeros in its place, if the fragments are whole. Returns
/// [`Fault::Short`] if the data ends inside a fragment.
pub(crate) fn fragments(bytes: &[u8], offset: usize) -> Result<Vec<&[u8]>, Fault> {
    let mut walk = Walk::new(bytes, offset, EXPLICIT);
    let mut out = Vec::new();
    loop {
        let rest = bytes.get(walk.at..).unwrap_or_default();
        // A file that ends early is like one that ends in zeros. A sound fragment is recognised by its first byte.
        if rest.iter().all(|b| *b == 0) {
            if out.last().is_some_and(|last| out.len() > 1 && is_end(out[1], last)) {
                break;
            }
            return Err(Fault::Short);
        }
        match walk.tag()? {
            ITEM => {
                let length = walk.u32()?;
                out.push(walk.take(length as usize)?);
            }
            SEQUENCE_END => break,
            // What follows pixel data: padding, signatures.
            (0xFFFA | 0xFFFC, _) if out.last().is_some_and(|last| out.len() > 1 && is_end(out[1], last)) => break,
            _ => return Err(Fault::Bad("has no fragment where one is expected".to_owned())),
        }
    }
    if out.is_empty() {
        return Err(Fault::Bad("has no offset table before its fragments".to_owned()));
    }
    out.remove(0);
    Ok(out)
}

/// True if `last` ends the code stream that `first` begins. Run lengths contain their own number.
fn is_end(first: &[u8], last: &[u8]) -> bool {
    if !begins(first) && !first.starts_with(b"\0\0\0\x0cjP") {
        return true;
    }
    let last = last.strip_suffix(&[0]).unwrap_or(last);
    last.ends_with(&[0xFF, 0xD9])
}

/// True if a code stream of the JPEG family begins here.
fn begins(fragment: &[u8]) -> bool {
    fragment.starts_with(&[0xFF, 0xD8, 0xFF]) || fragment.starts_with(&[0xFF, 0x4F, 0xFF, 0x51])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(bytes: &[u8]) -> Vec<u8> {
        [b"\xfe\xff\x00\xe0".as_slice(), &(bytes.len() as u32).to_le_bytes(), bytes].concat()
    }

    #[test]
    fn the_last_delimiter_may_be_missing_after_a_whole_code_stream() {
        let (whole, cut) = (b"\xff\xd8\xff\xc3xx\xff\xd9".as_slice(), b"\xff\xd8\xff\xc3xxxx".as_slice());
        for (end, fails) in [(&b"\xfe\xff\xdd\xe0\0\0\0\0"[..], false), (b"", true), (&[0; 8], true), (&[0; 2], true)] {
            let read = |f: &[u8]| {
                let bytes = [item(b""), item(f), end.to_vec()].concat();
                fragments(&bytes, 0).map(|parts| parts.concat())
            };
            assert_eq!(read(whole), Ok(whole.to_vec()));
            assert_eq!(read(cut).is_err(), fails, "{end:?}");
        }
        assert!(fragments(&item(b""), 0).is_err(), "no fragment");
        assert!(fragments(&[item(b""), item(whole), b"\x08\0\x10\0abcd".to_vec()].concat(), 0).is_err());
    }
}
