//! Conversion of bytes of any element type to Hounsfield units.

use rayon::prelude::*;

use crate::volume::AIR_HU;

/// The type of one stored voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Element {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl Element {
    /// Returns the size of one voxel, bytes.
    pub(crate) fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

/// Byte order of a number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum ByteOrder {
    /// Least significant byte first.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

/// Counts of voxels that are not whole numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    /// Not finite.
    pub strange: usize,
    /// Finite, with a fraction, within the range of `i16`.
    pub fractions: usize,
}

impl Counts {
    /// Counts a value.
    #[inline]
    pub(crate) fn add(&mut self, hu: f64) {
        self.strange += usize::from(!hu.is_finite());
        // The cast saturates, and is zero for NaN.
        let whole = f64::from(hu as i32) == hu;
        self.fractions += usize::from(hu.abs() < 32768.0 && !whole);
    }
}

impl std::iter::Sum for Counts {
    fn sum<I: Iterator<Item = Self>>(parts: I) -> Self {
        let mut all = Self::default();
        parts.for_each(|c| all += c);
        all
    }
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.strange += other.strange;
        self.fractions += other.fractions;
    }
}

/// Conversion of stored voxels to HU: `HU = slope · stored + intercept`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Encoding {
    /// Type of a stored voxel.
    pub element: Element,
    /// Order of its bytes.
    pub order: ByteOrder,
    /// HU per stored unit.
    pub slope: f64,
    /// HU of a stored zero.
    pub intercept: f64,
}

/// Voxels that one task converts; small enough to distribute one buffer among threads.
const PIECE: usize = 1 << 16;

impl Encoding {
    /// Returns the encoding of voxels that are stored as HU.
    pub(crate) fn plain(element: Element, order: ByteOrder) -> Self {
        Self { element, order, slope: 1.0, intercept: 0.0 }
    }

    /// Converts voxels until `out` is full and counts those that are not whole numbers. Values are rounded to the nearest HU
    /// (halves away from zero) and clamped to `i16`; values that are not finite become [`AIR_HU`].
    pub(crate) fn convert(&self, bytes: &[u8], out: &mut [i16]) -> Counts {
        let size = self.element.size();
        // Copying two-byte integers is as fast as memory; only other conversions are worth distributing.
        let cheap = size <= 2 && self.is_identity();
        if cheap || out.len() <= PIECE {
            return self.convert_piece(bytes, out);
        }
        // The sum of counts does not depend on the order in which threads finish.
        bytes.par_chunks(PIECE * size).zip(out.par_chunks_mut(PIECE)).map(|(b, o)| self.convert_piece(b, o)).sum()
    }

    fn is_identity(&self) -> bool {
        self.slope == 1.0 && self.intercept == 0.0
    }

    fn convert_piece(&self, bytes: &[u8], out: &mut [i16]) -> Counts {
        macro_rules! integer {
            ($t:ty, $wide:expr) => {{
                let clamp = |v: $t| i16::try_from(v).unwrap_or(if v > 0 { i16::MAX } else { i16::MIN });
                match (self.is_identity(), self.order) {
                    (true, ByteOrder::Little) => each(bytes, out, |b| clamp(<$t>::from_le_bytes(b))),
                    (true, ByteOrder::Big) => each(bytes, out, |b| clamp(<$t>::from_be_bytes(b))),
                    (false, ByteOrder::Little) => self.scaled(bytes, out, |b| $wide(<$t>::from_le_bytes(b))),
                    (false, ByteOrder::Big) => self.scaled(bytes, out, |b| $wide(<$t>::from_be_bytes(b))),
                }
            }};
        }
        macro_rules! float {
            ($t:ty) => {
                match self.order {
                    ByteOrder::Little => self.scaled(bytes, out, |b| f64::from(<$t>::from_le_bytes(b))),
                    ByteOrder::Big => self.scaled(bytes, out, |b| f64::from(<$t>::from_be_bytes(b))),
                }
            };
        }
        match self.element {
            Element::U8 => integer!(u8, f64::from),
            Element::I8 => integer!(i8, f64::from),
            Element::U16 => integer!(u16, f64::from),
            Element::I16 => integer!(i16, f64::from),
            Element::U32 => integer!(u32, f64::from),
            Element::I32 => integer!(i32, f64::from),
            Element::U64 => integer!(u64, |v: u64| v as f64),
            Element::I64 => integer!(i64, |v: i64| v as f64),
            Element::F32 => float!(f32),
            Element::F64 => float!(f64),
        }
    }

    fn scaled<const N: usize>(&self, bytes: &[u8], out: &mut [i16], value: impl Fn([u8; N]) -> f64) -> Counts {
        let mut counts = Counts::default();
        for (o, b) in out.iter_mut().zip(bytes.as_chunks::<N>().0) {
            let hu = value(*b) * self.slope + self.intercept;
            counts.add(hu);
            *o = to_hu(hu);
        }
        counts
    }
}

/// Returns the nearest `i16` HU, or [`AIR_HU`] for values that are not finite.
#[inline]
pub(crate) fn to_hu(hu: f64) -> i16 {
    // A float-to-integer cast saturates, which is the clamp.
    if hu.is_finite() { (hu + 0.5f64.copysign(hu)) as i16 } else { AIR_HU }
}

fn each<const N: usize>(bytes: &[u8], out: &mut [i16], value: impl Fn([u8; N]) -> i16) -> Counts {
    for (o, b) in out.iter_mut().zip(bytes.as_chunks::<N>().0) {
        *o = value(*b);
    }
    Counts::default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn one(element: Element, bytes: &[u8], slope: f64, intercept: f64) -> (i16, usize) {
        let mut out = [0];
        let le = Encoding { element, order: ByteOrder::Little, slope, intercept };
        let n = le.convert(bytes, &mut out).strange;
        let mut reversed = bytes.to_vec();
        reversed.reverse();
        let mut other = [0];
        let be = Encoding { order: ByteOrder::Big, ..le };
        assert_eq!(be.convert(&reversed, &mut other).strange, n);
        assert_eq!(out, other, "both byte orders must agree");
        (out[0], n)
    }

    #[test]
    fn every_type_clamps_and_rounds() {
        assert_eq!(one(Element::U8, &[200], 1.0, 0.0).0, 200);
        assert_eq!(one(Element::I8, &[200], 1.0, 0.0).0, -56);
        assert_eq!(one(Element::U16, &65000u16.to_le_bytes(), 1.0, 0.0).0, i16::MAX);
        assert_eq!(one(Element::U16, &1000u16.to_le_bytes(), 1.0, -1024.0).0, -24);
        assert_eq!(one(Element::I32, &(-70000i32).to_le_bytes(), 1.0, 0.0).0, i16::MIN);
        assert_eq!(one(Element::U32, &u32::MAX.to_le_bytes(), 1.0, 0.0).0, i16::MAX);
        assert_eq!(one(Element::I64, &i64::MIN.to_le_bytes(), 1.0, 0.0).0, i16::MIN);
        assert_eq!(one(Element::U64, &u64::MAX.to_le_bytes(), 1.0, 0.0).0, i16::MAX);
        assert_eq!(one(Element::F32, &(-2.5f32).to_le_bytes(), 1.0, 0.0).0, -3);
        assert_eq!(one(Element::F64, &1e300f64.to_le_bytes(), 1.0, 0.0).0, i16::MAX);
        assert_eq!(one(Element::F64, &3.0f64.to_le_bytes(), 0.5, 0.25).0, 2);
    }

    #[test]
    fn what_is_not_finite_is_air_and_counted() {
        for v in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(one(Element::F32, &v.to_le_bytes(), 1.0, 0.0), (AIR_HU, 1));
        }
        assert_eq!(one(Element::U64, &u64::MAX.to_le_bytes(), 1e300, 0.0), (AIR_HU, 1), "overflow of the scale");
    }

    proptest! {
        #[test]
        fn pieces_do_not_show(values in proptest::collection::vec(-40000i32..40000, 1..200), slope in 0.1f64..4.0) {
            let e = Encoding { element: Element::I32, order: ByteOrder::Little, slope, intercept: -7.0 };
            let many: Vec<i32> = values.iter().copied().cycle().take(PIECE * 2 + 77).collect();
            let bytes: Vec<u8> = many.iter().flat_map(|v| v.to_le_bytes()).collect();
            let mut out = vec![0; many.len()];
            prop_assert_eq!(e.convert(&bytes, &mut out).strange, 0);
            for (v, o) in many.iter().zip(&out) {
                let hu = f64::from(*v) * slope - 7.0;
                prop_assert!((f64::from(*o) - hu.clamp(-32768.0, 32767.0)).abs() <= 0.5 + 1e-9);
            }
        }
    }
}
