//! The score of a lesion: the probability of a logistic model whose terms are listed, so that each can be read.
//!
//! The weights were fitted to the candidates of six phantoms and of one CT with 180 lesions put in (`phantom --into`, three seeds), of which
//! every other 100 mm of the centerline taught nothing (`report candidates --scan` measures on those), by logistic regression with a
//! penalty of the squared weights of the standardised terms (van Ravesteijn 2010 ranks by such a model of three features). They know no
//! patient. Plaques, which are seen at a coarser scale (see `broad`), have a model of their own.

use super::{Candidate, Lesion};

/// What the score is known from: what a reader should be told beside it.
pub const EVIDENCE: &str = "measured on phantoms and on lesions put into one scan, and not on patients";

/// No candidate is lower than this, mm, nor than so many times the roughness of the scan's wall.
const LEAST_MM: f64 = 0.8;
const LEAST_ROUGHNESS: f64 = 4.0;

/// Returns the candidates that are higher than what the noise of the scan makes of a wall. The wall's roughness is that of the smoothest
/// quarter of the candidates' surroundings.
pub(super) fn above_noise(found: Vec<Candidate>) -> Vec<Candidate> {
    let rough = |c: &Candidate| c.lesion.as_ref().map(|l| l.feature("wall_rms_mm"));
    let mut all: Vec<f64> = found.iter().filter_map(rough).collect();
    all.sort_by(f64::total_cmp);
    let roughness = all.get(all.len() / 4).copied().unwrap_or(0.0);
    let least = LEAST_MM.max(LEAST_ROUGHNESS * roughness);
    found.into_iter().filter(|c| c.lesion.as_ref().is_none_or(|l| l.height_mm >= least)).collect()
}

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

/// A model: its terms, each bounded, so that no single one decides, and the score without any.
struct Model {
    terms: &'static [Term],
    bias: f64,
}

/// The model of lesions.
const LESION: Model = Model {
    terms: &[
        term(
            "hu_median",
            "inside is as bright as tissue",
            |l| (l.feature("hu_median") - 25.0).abs().min(200.0) / 100.0,
            -1.815,
        ),
        term("hu_spread", "inside is even", |l| l.feature("hu_spread").min(150.0) / 100.0, -0.253),
        term("air", "no gas inside, as in stool", |l| l.feature("share_air").min(0.3), -10.206),
        term("fat", "no fat inside, as in the ileocecal valve", |l| l.feature("share_fat").min(0.6), -3.208),
        term("tag", "no tag inside, as in stool", |l| l.feature("share_tag").min(0.3), -3.802),
        term("shape_index", "a cap, not a ridge", |l| l.feature("shape_index"), 25.144),
        term("k2_peak", "a top that is sharply curved both ways", |l| l.feature("k2_peak").max(0.02).ln(), 1.680),
        term("elongation", "as wide as long", |l| l.feature("elongation").min(3.0), -1.016),
        term("fit", "an ellipsoid fits", |l| l.feature("fit_rms_mm").min(0.2), -6.752),
        term("overlap", "its normals meet in one point", |l| l.feature("normal_overlap").min(0.6), 4.279),
        term("diameter", "large", |l| l.feature("diameter_mm").clamp(2.0, 20.0).ln(), 0.046),
        term("fold", "no edge of a fold near", |l| l.feature("fold_mm").min(8.0), 0.268),
        term("height", "it stands out", |l| l.feature("height_mm").clamp(0.5, 4.0).ln(), 0.748),
    ],
    bias: -18.730,
};

/// The model of plaques.
const PLAQUE: Model = Model {
    terms: &[
        term("hu_spread", "inside is even", |l| l.feature("hu_spread").min(150.0) / 100.0, -3.534),
        term(
            "hu_median",
            "inside is as bright as tissue",
            |l| (l.feature("hu_median") - 25.0).abs().min(200.0) / 100.0,
            -2.430,
        ),
        term("air", "no gas inside, as in stool", |l| l.feature("share_air").min(0.3), -24.952),
        term("k2_peak", "curved more than the bowel", |l| l.feature("k2_peak").max(0.02).ln(), 2.651),
        term("elongation", "as wide as long", |l| l.feature("elongation").min(3.0), -1.035),
        term("fit", "an ellipsoid fits", |l| l.feature("fit_rms_mm").min(0.3), 0.160),
        term("extent", "no wider than a plaque", |l| l.feature("extent_mm").clamp(5.0, 40.0).ln(), -1.057),
        term("height", "it stands out", |l| l.feature("height_mm").clamp(0.5, 3.0).ln(), 1.460),
        term("rough", "the wall around is smooth", |l| l.feature("wall_rms_mm").min(2.0), -1.359),
        term("facing", "no rim of a fold, but a top", |l| l.feature("facing").max(0.4), -7.461),
    ],
    bias: 19.726,
};

/// Returns the model that judges a lesion.
fn model(lesion: &Lesion) -> &'static Model {
    if lesion.feature("broad") > 0.5 { &PLAQUE } else { &LESION }
}

/// Returns the terms of a lesion's score and what each adds.
pub fn terms(lesion: &Lesion) -> impl Iterator<Item = (&'static Term, f64)> {
    model(lesion).terms.iter().map(|t| (t, t.weight * (t.of)(lesion)))
}

/// Returns the score, 0 to 1.
pub fn score(lesion: &Lesion) -> f64 {
    let sum: f64 = terms(lesion).map(|t| t.1).sum();
    1.0 / (1.0 + (-model(lesion).bias - sum).exp())
}
