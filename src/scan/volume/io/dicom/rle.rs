//! RLE Lossless (PS3.5, annex G). Implemented here because the segment count in a frame's header cannot be trusted.

/// Size of the header, bytes: the number of segments, then the offset of each of at most 15.
const HEADER: usize = 64;

/// Unpacks a frame of `voxels` samples of one or two bytes to little-endian. Fails with a short description if the packed bytes are
/// invalid.
pub(crate) fn unpack(packed: &[u8], voxels: usize, sample: usize) -> Result<Vec<u8>, String> {
    let word = |k: usize| {
        let bytes: Option<[u8; 4]> = packed.get(4 * k..4 * k + 4).and_then(|b| b.try_into().ok());
        bytes.map(|b| u32::from_le_bytes(b) as usize).ok_or("has no header")
    };
    if word(0)? != sample {
        return Err(format!("has {} segments where {sample} are needed", word(0)?));
    }
    let mut out = vec![0; voxels * sample];
    for segment in 0..sample {
        let begin = word(1 + segment)?;
        let end = if segment + 1 < sample { word(2 + segment)? } else { packed.len() };
        let bytes = packed.get(begin..end).filter(|_| begin >= HEADER).ok_or("has segments beyond its end")?;
        // The most significant bytes come first.
        expand(bytes, out[sample - 1 - segment..].iter_mut().step_by(sample))?;
    }
    Ok(out)
}

/// Expands PackBits: a length byte n, then n + 1 literal bytes, or (n < 0) one byte repeated 1 − n times; −128 is a no-op.
fn expand<'a>(packed: &[u8], mut out: impl ExactSizeIterator<Item = &'a mut u8>) -> Result<(), String> {
    let mut packed = packed.iter();
    while out.len() > 0 {
        let short = || format!("ends {} samples early", out.len());
        let n = packed.next().ok_or_else(short)?.cast_signed();
        if n >= 0 {
            for b in packed.by_ref().take(n as usize + 1) {
                if let Some(o) = out.next() {
                    *o = *b;
                }
            }
        } else if n > i8::MIN {
            let b = packed.next().ok_or_else(short)?;
            out.by_ref().take(1 + usize::from(n.unsigned_abs())).for_each(|o| *o = *b);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(segments: &[&[u8]]) -> Vec<u8> {
        let mut out = (segments.len() as u32).to_le_bytes().to_vec();
        let mut at = HEADER;
        for s in segments {
            out.extend((at as u32).to_le_bytes());
            at += s.len();
        }
        out.resize(HEADER, 0);
        segments.iter().for_each(|s| out.extend(*s));
        out
    }

    #[test]
    fn runs_and_literals() {
        // High bytes: five times 1. Low bytes: 7 8 9 and twice 4.
        let packed = frame(&[&[0xFC, 1], &[2, 7, 8, 9, 0x80, 0xFF, 4]]);
        assert_eq!(unpack(&packed, 5, 2).unwrap(), [7, 1, 8, 1, 9, 1, 4, 1, 4, 1]);
    }

    #[test]
    fn lies_are_refused() {
        let good = frame(&[&[0xFC, 1]]);
        assert!(unpack(&good, 5, 1).is_ok());
        assert!(unpack(&good, 6, 1).is_err(), "too few");
        assert!(unpack(&good, 5, 2).is_err(), "one segment for two bytes");
        let short = frame(&[&[0xFD, 1], &[0xFC, 2]]);
        assert!(unpack(&short, 4, 2).is_ok());
        assert!(unpack(&short, 5, 2).is_err(), "a segment ends where the next one begins");
        let mut many = good.clone();
        many[..4].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(unpack(&many, 5, 1).is_err());
        let mut far = good;
        far[4..8].copy_from_slice(&1000u32.to_le_bytes());
        assert!(unpack(&far, 5, 1).is_err());
        assert!(unpack(&[], 5, 1).is_err());
    }
}
