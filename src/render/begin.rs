//! Where a ray begins to look, and what is kept of it for the next picture.

use super::march::Ray;

/// Tells each ray how much of it need not be looked at. It may only leave out samples whose opacity is 0, so that the
/// picture is the same bit for bit with any of them.
pub trait Begin: Sync {
    /// What is kept of a pixel; its default where no ray of the pixel meets the volume.
    type Kept: Copy + Default + Send + Sync;

    /// The first sample that may be seen of a ray through pixel (`x`, `y`); whether an earlier picture told it.
    fn begin(&self, x: usize, y: usize, ray: &Ray, kept: &mut Self::Kept) -> (u32, bool);

    /// Hears the first sample that was not empty (the ray's count if none was); whether the ray had been misled: told
    /// of a bound that lies behind that sample.
    fn seen(&self, _x: usize, _y: usize, _ray: &Ray, _first: u32, _kept: &mut Self::Kept) -> bool {
        false
    }
}

/// Every ray is traced anew, and nothing is kept.
pub struct FromScratch;

impl Begin for FromScratch {
    type Kept = ();

    #[inline(always)]
    fn begin(&self, _: usize, _: usize, _: &Ray, (): &mut ()) -> (u32, bool) {
        (0, false)
    }
}
