//! Two scans of one patient in two positions: which place of one colon is which of the other.
//!
//! Fluid and stool move, and the colon lies elsewhere, is stretched, and turns about its line; its folds, its caliber and its polyps stay.
//! So the walls are compared row by row and paired in order, each pair with the probability of being wrong.

mod align;
mod image;
mod place;

use std::f64::consts::TAU;

use super::{Along, Lumen};
use crate::error::Result;
use crate::progress::Progress;
use align::{Paired, align};
use image::{STEP_MM, WallImage};
pub use place::{Match, Posed, Side};

/// Distance between the pairs of [`Matching::pairs`], mm.
const PAIRS_MM: f64 = 4.0;

/// Places of one colon and those of another that belong together. `A` is the first, `B` the second.
#[derive(Clone, Debug)]
pub struct Matching {
    walls: [WallImage; 2],
    /// For each row of `A`.
    paired: Vec<Paired>,
    lengths_mm: [f64; 2],
    /// Stretches of each that are collapsed (from, to; mm along).
    gaps: [Vec<[f64; 2]>; 2],
    /// True if the line of `B` runs from the cecum: its wall is from the rectum all the same.
    is_reversed: bool,
}

impl Matching {
    /// Matches two colons, each with its measure from the rectum to the cecum. `None` if one of them has no line that leads there.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn new(a: (&Lumen, &Along), b: (&Lumen, &Along), progress: &Progress) -> Result<Option<Self>> {
        progress.stage("comparing walls", 0);
        let image = |(lumen, along): (&Lumen, &Along)| WallImage::new(lumen, along, false);
        let (Some(first), Some(second)) = (image(a), image(b)) else { return Ok(None) };
        progress.check()?;
        let (mut paired, evidence) = align(&first, &second);
        progress.check()?;
        let (mut second, mut is_reversed) = (second, false);
        // Where the parts have no names, the rectum may have been taken for the cecum.
        if !a.1.is_whole() || !b.1.is_whole() {
            if let Some(other) = WallImage::new(b.0, b.1, true) {
                let (pairs, better) = align(&first, &other);
                if better > evidence {
                    (second, paired, is_reversed) = (other, pairs, true);
                }
            }
            progress.check()?;
        }
        let gaps = [a.1, b.1].map(|along| along.guessed().to_vec());
        let lengths_mm = [&first, &second].map(|i| (i.rows().max(1) - 1) as f64 * STEP_MM);
        Ok(Some(Self { walls: [first, second], paired, lengths_mm, gaps, is_reversed }))
    }

    /// Returns distances along `A` and `B` that belong together, with the uncertainty of the second, mm. Both grow from pair to
    /// pair, unless [`Matching::is_reversed`].
    pub fn pairs(&self) -> Vec<[f64; 3]> {
        let count = (self.lengths_mm[0] / PAIRS_MM).floor() as usize + 1;
        (0..count)
            .map(|n| {
                let mm = n as f64 * PAIRS_MM;
                let pair = self.paired_at(mm);
                [mm, self.own(self.in_second(pair.row)), pair.uncertain * STEP_MM]
            })
            .collect()
    }

    /// Returns the turn of `B` against `A` for the pairs, with its sureness from 0 to 1: degrees between frames that do not turn about
    /// either line and begin with angle 0 towards the patient's front.
    pub fn turns(&self) -> Vec<[f64; 3]> {
        let count = (self.lengths_mm[0] / PAIRS_MM).floor() as usize + 1;
        (0..count)
            .map(|n| {
                let pair = self.paired_at(n as f64 * PAIRS_MM);
                [n as f64 * PAIRS_MM, pair.turn.to_degrees(), pair.sure]
            })
            .collect()
    }

    /// True if one of the lines was found to run from the cecum to the rectum: distances along `B` then shrink.
    pub fn is_reversed(&self) -> bool {
        self.is_reversed
    }

    /// Returns a distance along `B`'s line from one from its rectal end, mm.
    fn own(&self, mm: f64) -> f64 {
        if self.is_reversed { self.lengths_mm[1] - mm } else { mm }
    }

    /// Lengths of both lines, mm.
    pub fn lengths_mm(&self) -> [f64; 2] {
        self.lengths_mm
    }

    /// Collapsed stretches of both (from, to; mm along).
    pub fn gaps(&self) -> [&[[f64; 2]]; 2] {
        [&self.gaps[0], &self.gaps[1]]
    }

    /// Returns the pair of a distance along `A`, mm.
    fn paired_at(&self, mm: f64) -> Paired {
        let none = Paired { row: 0.0, uncertain: 0.0, turn: 0.0, sure: 0.0 };
        let Some(last) = self.paired.len().checked_sub(1) else { return none };
        let row = (mm / STEP_MM).clamp(0.0, last as f64);
        let (low, high) = (row.floor() as usize, row.ceil() as usize);
        let (a, b, share) = (self.paired[low], self.paired[high], row - row.floor());
        let turned = b.turn - a.turn;
        let turned = turned - TAU * (turned / TAU).round();
        let mix = |a: f64, b: f64| a + (b - a) * share;
        Paired {
            row: mix(a.row, b.row),
            uncertain: mix(a.uncertain, b.uncertain),
            turn: a.turn + turned * share,
            sure: mix(a.sure, b.sure),
        }
    }

    fn in_second(&self, row: f64) -> f64 {
        (row * STEP_MM).clamp(0.0, self.lengths_mm[1])
    }
}

/// True if one line leads through a colon from the rectum to the cecum, so that it can be matched.
pub fn has_line(lumen: &Lumen, along: &Along) -> bool {
    lumen.ordered && along.only_line().is_some()
}
