//! From stored samples to HU: sign, unused bits, rescale and padding.

use super::lut::Lut;
use super::slice::{Bits, FileHead, Slice};
use crate::volume::AIR_HU;
use crate::volume::io::raw::{ByteOrder, Element, Encoding, to_hu};

/// HU at or below which a padding value is not tissue …
const BELOW_TISSUE: i16 = -900;
/// … and above which it is not: the largest value of 12 bits.
const ABOVE_TISSUE: i16 = 3071;

/// Where in a sample its value lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    /// Bytes of a sample: 1 or 2.
    sample: usize,
    /// Order of its bytes.
    order: ByteOrder,
    /// Bits below the value.
    shift: u32,
    /// Bits of the value, 1 to 16.
    width: u32,
    /// True if the value is signed.
    signed: bool,
}

impl Layout {
    /// The layout that a header describes.
    pub(super) fn native(bits: Bits, order: ByteOrder) -> Self {
        Self {
            sample: usize::from(bits.allocated / 8),
            order,
            shift: u32::from(bits.high + 1 - bits.stored),
            width: bits.stored.into(),
            signed: bits.signed,
        }
    }

    /// The layout of decoded `bytes`, in samples of `sample` bytes, of a code stream of `width` bits.
    ///
    /// The header says whether values are signed: a code stream mostly cannot, or is wrong. But a value has the sign bit of what
    /// was coded, which may be narrower than the header says.
    pub(super) fn of_stream(file: &FileHead, width: u32, signed: bool, sample: usize, bytes: &[u8]) -> Self {
        let (bits, stored) = (file.bits, u32::from(file.bits.stored));
        let plain = Self { sample, order: ByteOrder::Little, shift: 0, width, signed: bits.signed };
        if width <= stored {
            return plain;
        }
        let narrow = Self { width: stored, ..plain };
        if width > bits.high.into() && bits.high + 1 > bits.stored {
            return Self { shift: u32::from(bits.high + 1 - bits.stored), ..narrow };
        }
        if file.has_overlays {
            return narrow;
        }
        // Wider than the header says: two's complement either of all the bits or of the stored ones, with zeros above.
        let wide = !bits.signed || signed || {
            let top = 1 << (width - 1);
            match sample {
                1 => bytes.iter().any(|b| u32::from(*b) & top != 0),
                _ => bytes.as_chunks().0.iter().any(|b| u32::from(u16::from_le_bytes(*b)) & top != 0),
            }
        };
        if wide { plain } else { narrow }
    }

    /// Calls `put` with each voxel of `out` and its sample.
    #[inline(always)]
    fn each(self, bytes: &[u8], out: &mut [i16], mut put: impl FnMut(&mut i16, u16)) {
        match (self.sample, self.order) {
            (1, _) => out.iter_mut().zip(bytes).for_each(|(o, b)| put(o, (*b).into())),
            (_, ByteOrder::Little) => {
                out.iter_mut().zip(bytes.as_chunks().0).for_each(|(o, b)| put(o, u16::from_le_bytes(*b)));
            }
            (_, ByteOrder::Big) => {
                out.iter_mut().zip(bytes.as_chunks().0).for_each(|(o, b)| put(o, u16::from_be_bytes(*b)));
            }
        }
    }

    #[inline(always)]
    fn value(self, raw: u16) -> i32 {
        // Shift the value to the top of the word and back. This removes the bits above it (overlays) and extends the sign.
        let unused = 32 - self.width;
        let top = (u32::from(raw) >> self.shift) << unused;
        if self.signed { (top as i32) >> unused } else { (top >> unused) as i32 }
    }

    fn raw(self, bytes: &[u8], at: usize) -> u16 {
        match (self.sample, self.order) {
            (1, _) => bytes[at].into(),
            (_, ByteOrder::Little) => u16::from_le_bytes([bytes[2 * at], bytes[2 * at + 1]]),
            (_, ByteOrder::Big) => u16::from_be_bytes([bytes[2 * at], bytes[2 * at + 1]]),
        }
    }
}

/// Voxels whose value is declared as padding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Padded {
    /// Number of voxels that became air.
    pub air: usize,
    /// Number of voxels that were kept: inside the slice, the value is one that tissue has.
    pub kept: usize,
    /// Number of voxels that are not finite and became air.
    pub strange: usize,
}

impl std::iter::Sum for Padded {
    fn sum<I: Iterator<Item = Self>>(parts: I) -> Self {
        parts.fold(Self::default(), |a, b| Self {
            air: a.air + b.air,
            kept: a.kept + b.kept,
            strange: a.strange + b.strange,
        })
    }
}

/// A declared range of padding.
#[derive(Clone, Copy)]
struct Padding {
    layout: Layout,
    /// Minimum and maximum, within the bits of a value.
    values: (i32, i32),
    /// The same of the whole words, if they do not fit into those bits. Such words are padding without doubt.
    words: Option<(i32, i32)>,
}

impl Padding {
    fn of(ends: [u16; 2], layout: Layout) -> Self {
        let range = |[a, b]: [i32; 2]| (a.min(b), a.max(b));
        let unshifted = Layout { shift: 0, ..layout };
        let values = ends.map(|w| unshifted.value(w));
        let words = ends.map(|w| Self::word(layout.signed, w));
        let beyond = layout.sample == 2 && layout.shift == 0 && values != words;
        Self { layout, values: range(values), words: beyond.then(|| range(words)) }
    }

    fn word(signed: bool, raw: u16) -> i32 {
        if signed { raw.cast_signed().into() } else { raw.into() }
    }

    fn contains(&self, value: i32) -> bool {
        // If the ends of the range lose bits, it is no longer a range.
        let whole = self.words.is_none() || self.values.0 == self.values.1;
        whole && (self.values.0..=self.values.1).contains(&value)
    }

    fn contains_word(&self, raw: u16) -> bool {
        self.words.is_some_and(|(low, high)| (low..=high).contains(&Self::word(self.layout.signed, raw)))
    }
}

/// Converts stored samples to HU and counts those of padding.
///
/// A declared value of padding becomes air where no tissue has it: at most −900 HU, or above 3071 HU. Between them it becomes air
/// only outside the round field of view: in the region that is connected with the corners of the slice, at least three of which
/// hold it.
pub(super) fn to_hus(slice: &Slice, bytes: &[u8], layout: Layout, lut: Option<&Lut>, out: &mut [i16]) -> Padded {
    let (slope, intercept) = (slice.slope, slice.intercept);
    let cols = usize::from(slice.file.cols);
    let padding = slice.file.padding.map(|ends| Padding::of(ends, layout));
    // The usual cases have loops of their own: most of the time of opening is spent here.
    match (lut, padding) {
        (Some(lut), _) => convert(cols, layout, bytes, out, padding, |value| lut.hu(value)),
        (None, None) if slope == 1.0 && intercept.fract() == 0.0 && intercept.abs() < 1e6 => {
            let intercept = intercept as i32;
            let clamp = |v: i32| v.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
            layout.each(bytes, out, |o, raw| *o = clamp(layout.value(raw) + intercept));
            Padded::default()
        }
        (None, None) => {
            layout.each(bytes, out, |o, raw| *o = to_hu(f64::from(layout.value(raw)) * slope + intercept));
            Padded::default()
        }
        (None, Some(_)) => {
            convert(cols, layout, bytes, out, padding, |value| to_hu(f64::from(value) * slope + intercept))
        }
    }
}

/// Converts samples one by one, with padding.
fn convert(
    cols: usize,
    layout: Layout,
    bytes: &[u8],
    out: &mut [i16],
    padding: Option<Padding>,
    hu: impl Fn(i32) -> i16,
) -> Padded {
    let mut padded = Padded::default();
    layout.each(bytes, out, |o, raw| {
        let value = layout.value(raw);
        *o = hu(value);
        let Some(padding) = &padding else { return };
        let certain = padding.contains_word(raw);
        if !certain && !padding.contains(value) {
            return;
        }
        if certain || *o <= BELOW_TISSUE || *o > ABOVE_TISSUE {
            *o = AIR_HU;
            padded.air += 1;
        } else {
            padded.kept += 1;
        }
    });
    if let Some(padding) = padding.filter(|_| padded.kept > 0) {
        let is_padding = |at: usize| padding.contains(layout.value(layout.raw(bytes, at)));
        let outside = flood(cols, out, is_padding);
        padded = Padded { air: padded.air + outside, kept: padded.kept - outside, ..padded };
    }
    padded
}

/// Converts samples that are floats to HU.
pub(super) fn floats_to_hus(slice: &Slice, bytes: &[u8], order: ByteOrder, out: &mut [i16]) -> Padded {
    let element = if slice.file.bits.allocated == 32 { Element::F32 } else { Element::F64 };
    let encoding = Encoding { element, order, slope: slice.slope, intercept: slice.intercept };
    Padded { strange: encoding.convert(bytes, out).strange, ..Padded::default() }
}

/// Turns the padding that is connected with the corners of a slice of `cols` columns into air, if at least three corners hold it.
/// Returns the number of voxels, which is at most that of padding voxels that are not air yet.
fn flood(cols: usize, out: &mut [i16], is_padding: impl Fn(usize) -> bool) -> usize {
    let corners = [0, cols - 1, out.len() - cols, out.len() - 1];
    let mut front: Vec<usize> = corners.into_iter().filter(|at| is_padding(*at)).collect();
    if front.len() < 3 {
        return 0;
    }
    let mut seen = vec![false; out.len()];
    let mut count = 0;
    while let Some(at) = front.pop() {
        if seen[at] || !is_padding(at) {
            continue;
        }
        seen[at] = true;
        if out[at] != AIR_HU {
            out[at] = AIR_HU;
            count += 1;
        }
        let column = at % cols;
        let beside = [
            (column > 0).then(|| at.wrapping_sub(1)),
            (column + 1 < cols).then_some(at + 1),
            at.checked_sub(cols),
            Some(at + cols).filter(|n| *n < out.len()),
        ];
        front.extend(beside.into_iter().flatten().filter(|n| !seen[*n]));
    }
    count
}
