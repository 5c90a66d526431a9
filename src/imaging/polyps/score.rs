//! The score of a lesion: the probability of a logistic model whose terms are listed, so that each can be read.
//!
//! The weights were fitted to candidates of phantoms (seeds 1 to 30 of `report candidates`) and, as examples of a wall that bulges
//! a little everywhere, to those of one CT none of which is known to be a polyp, by logistic regression with a penalty of twice the
//! squared weights of the standardised terms (van Ravesteijn 2010 ranks by such a model of three features). They know no patient.

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

/// The terms. Each is bounded, so that no single one decides.
pub const TERMS: [Term; 13] = [
    term(
        "hu_mean",
        "inside is as bright as tissue",
        |l| (l.feature("hu_mean") - 25.0).abs().min(200.0) / 100.0,
        -1.203,
    ),
    term("hu_sd", "inside is even", |l| l.feature("hu_sd").min(150.0) / 100.0, -1.647),
    term("air", "no gas inside, as in stool", |l| l.feature("share_air").min(0.3), -1.688),
    term("fat", "no fat inside, as in the ileocecal valve", |l| l.feature("share_fat").min(0.6), -1.680),
    term("tag", "no tag inside, as in stool", |l| l.feature("share_tag").min(0.3), -8.064),
    term("shape_index", "a cap, not a ridge", |l| l.feature("shape_index"), 15.065),
    term("k2_peak", "a top that is sharply curved both ways", |l| l.feature("k2_peak").max(0.02).ln(), 1.459),
    term("elongation", "as wide as long", |l| l.feature("elongation").min(3.0), -0.593),
    term("fit", "an ellipsoid fits", |l| l.feature("fit_rms_mm").min(0.2), -0.890),
    term("overlap", "its normals meet in one point", |l| l.feature("normal_overlap").min(0.6), 2.535),
    term("diameter", "large", |l| l.feature("diameter_mm").clamp(2.0, 20.0).ln(), 0.626),
    term("fold", "no edge of a fold near", |l| l.feature("fold_mm").min(8.0), 0.159),
    term("height", "it stands out", |l| 1.0 - (-l.feature("height_mm").max(0.0)).exp(), 0.649),
];
/// The score without any term.
const BIAS: f64 = -11.002;

/// Returns what each term adds, in the order of [`TERMS`].
pub fn terms(lesion: &Lesion) -> [f64; TERMS.len()] {
    TERMS.map(|t| t.weight * (t.of)(lesion))
}

/// Returns the score, 0 to 1.
pub fn score(lesion: &Lesion) -> f64 {
    1.0 / (1.0 + (-BIAS - terms(lesion).iter().sum::<f64>()).exp())
}
