//! The first sample of a ray to look at, and what is kept of the ray for the next picture.

use super::march::Ray;

/// Determines how much of each ray can be left out.
///
/// An implementation may only leave out samples whose opacity is 0, so all of them produce the same picture bit for bit.
pub trait Begin: Sync {
    /// The data kept for a pixel. It is the default where no ray of the pixel meets the volume.
    type Kept: Copy + Default + Send + Sync;

    /// Returns the first sample that may be visible on a ray through pixel (`x`, `y`), and true if that bound comes
    /// from an earlier picture.
    fn begin(&self, x: usize, y: usize, ray: &Ray, kept: &mut Self::Kept) -> (u32, bool);

    /// Records the first sample that was not empty (the ray's count if there was none). Returns true if the ray was
    /// misled: its bound was behind that sample.
    fn seen(&self, _x: usize, _y: usize, _ray: &Ray, _first: u32, _kept: &mut Self::Kept) -> bool {
        false
    }
}

/// Traces every ray from scratch and keeps nothing.
pub struct FromScratch;

impl Begin for FromScratch {
    type Kept = ();

    #[inline(always)]
    fn begin(&self, _: usize, _: usize, _: &Ray, (): &mut ()) -> (u32, bool) {
        (0, false)
    }
}
