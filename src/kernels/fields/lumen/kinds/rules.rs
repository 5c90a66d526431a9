//! The rules that classify a body of gas: one table, each with its reason.
//!
//! Each rule that holds for a body adds its weight to a kind. The kind with the most is the body's, if it leads by a margin; else it
//! is unknown. Weights are in units of evidence: 1 is a hint, 2 a reason, 4 nearly certain.

use super::features::Features;
use super::{GasKind, Judged};

/// Lead of the first kind over the second for a decision.
const MARGIN: f64 = 1.0;

/// A rule.
pub struct Rule {
    /// The kind that it speaks for.
    pub kind: GasKind,
    /// Its weight.
    pub weight: f64,
    /// The reason, as a sentence about the body.
    pub why: &'static str,
    /// True where it holds.
    pub holds: fn(&Features, Chain) -> bool,
}

/// The place of a body in the cheapest chain from rectum to cecum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Chain {
    /// The chain is not known.
    #[default]
    Unknown,
    /// The chain leads through it.
    Link,
    /// The chain is complete without it.
    Spare,
}

const fn rule(kind: GasKind, weight: f64, why: &'static str, holds: fn(&Features, Chain) -> bool) -> Rule {
    Rule { kind, weight, why, holds }
}

/// The rules. Lengths are an adult's, in mm.
pub const RULES: &[Rule] = {
    use GasKind::{Colon, Lung, Outside, SmallBowel, Stomach, Trachea};
    &[
        rule(Colon, 4.0, "the path from rectum to cecum runs through it", |_, c| c == Chain::Link),
        rule(Colon, 1.5, "it lies behind in the pelvis", |f, _| f.height < 0.25 && f.aside.abs() < 0.3 && f.back > 0.5),
        rule(Colon, 1.5, "it lies low on the right and is as wide as the cecum", |f, _| {
            f.aside < -0.35 && f.height < 0.5 && f.caliber_mm >= 27.0
        }),
        rule(Colon, 1.0, "it is the largest body of gas", |f, _| f.share >= 1.0 && f.ml > 150.0),
        rule(Colon, 1.0, "it is as wide as a colon", |f, _| (27.0..60.0).contains(&f.caliber_mm)),
        rule(Colon, 1.0, "it is long", |f, _| f.length_mm >= 450.0 && f.caliber_mm >= 22.0),
        rule(Colon, 1.0, "it lies in a flank", |f, _| f.aside.abs() > 0.5 && f.along_mm > 60.0),
        rule(Colon, 1.0, "it spans the abdomen", |f, _| f.across > 0.55 || f.along_mm > 200.0),
        rule(Colon, 1.0, "tagged fluid joins it to a larger body", |f, _| f.joined),
        rule(Colon, -3.0, "the colon is complete without it", |_, c| c == Chain::Spare),
        rule(SmallBowel, 1.0, "the colon is complete without it", |f, c| c == Chain::Spare && f.length_mm > 60.0),
        rule(SmallBowel, 1.0, "it is as narrow as small bowel", |f, _| f.caliber_mm < 20.0 && f.length_mm > 60.0),
        rule(SmallBowel, 0.5, "it is narrower than a colon", |f, _| f.caliber_mm < 26.0 && f.length_mm > 60.0),
        rule(SmallBowel, 0.5, "it lies in the middle of the abdomen", |f, _| {
            f.aside.abs() < 0.45 && f.height > 0.2 && f.length_mm > 60.0
        }),
        rule(Stomach, 2.0, "it is short, wide and on the upper left", |f, _| {
            f.caliber_mm > 36.0 && f.length_mm < 4.0 * f.caliber_mm && (-0.1..0.65).contains(&f.aside) && f.height > 0.6
        }),
        rule(Stomach, 2.5, "it lies high, below the left lung", |f, _| {
            f.ml > 20.0
                && (-0.15..0.7).contains(&f.aside)
                && f.across < 0.4
                && f.along_mm < 160.0
                && f.below_lungs_mm.is_some_and(|mm| mm < 60.0)
        }),
        rule(Trachea, 5.0, "it is a narrow tube in the chest", |f, _| {
            is_airway(f) && f.lung_beside > 0.12 && f.below_lungs_mm.is_some_and(|mm| mm < 0.0)
        }),
        rule(Lung, 7.0, "it is not a tube and lies in the chest", |f, _| {
            is_no_tube(f) && is_within(f) && f.lung_beside > 0.12 && f.below_lungs_mm.is_some_and(|mm| mm < 0.0)
        }),
        rule(Outside, 6.0, "it is a crevice, not a tube", |f, _| is_no_tube(f)),
    ]
};

/// True for a narrow tube along the body, in its middle.
fn is_airway(f: &Features) -> bool {
    f.caliber_mm < 30.0 && f.along_mm > 2.5 * f.caliber_mm && f.aside.abs() < 0.3 && (0.3..0.8).contains(&f.back)
}

/// True for what the body's skin can hold: not the air in a blanket around it, or on it.
fn is_within(f: &Features) -> bool {
    f.across < 1.0 && f.aside.abs() < 1.0 && (0.0..1.0).contains(&f.back)
}

/// True if the largest ball in it is much narrower than a tube of its volume and length: vessels or walls run through it.
fn is_no_tube(f: &Features) -> bool {
    f.ml > 60.0 && f.fluid < 0.2 && f.widest_mm < 0.4 * f.caliber_mm
}

/// Returns the weight of each kind, in the order of [`GasKind::ALL`].
pub(crate) fn weigh(f: &Features, chain: Chain, without: Option<usize>) -> [f64; 7] {
    let mut sums = [0.0; 7];
    for (n, r) in RULES.iter().enumerate() {
        if Some(n) != without && (r.holds)(f, chain) {
            sums[r.kind.number()] += r.weight;
        }
    }
    sums
}

/// Returns how much more speaks for colon than for anything else.
pub(crate) fn for_colon(f: &Features) -> f64 {
    let sums = weigh(f, Chain::Unknown, None);
    let other = (1..sums.len()).map(|n| sums[n]).fold(0.0, f64::max);
    sums[0] - other
}

/// Judges a body; rule number `without` is left out.
pub fn judge(f: &Features, chain: Chain, without: Option<usize>) -> Judged {
    let sums = weigh(f, chain, without);
    let best = (0..sums.len()).fold(0, |b, n| if sums[n] > sums[b] { n } else { b });
    let second = (0..sums.len()).filter(|&n| n != best).map(|n| sums[n]).fold(0.0, f64::max);
    let kind = GasKind::ALL[best];
    let strongest = |kind: GasKind| {
        let mut holding =
            RULES.iter().enumerate().filter(|(n, r)| Some(*n) != without && r.kind == kind && (r.holds)(f, chain));
        let first = holding.next().map(|r| r.1);
        holding.map(|r| r.1).fold(first, |b, r| if b.is_none_or(|b| r.weight > b.weight) { Some(r) } else { b })
    };
    let why = strongest(kind).map_or("no rule applies", |r| r.why);
    if sums[best] - second >= MARGIN {
        return Judged { kind, why, is_lumen: kind == GasKind::Colon };
    }
    // It may be colon unless more speaks for something else.
    Judged { kind: GasKind::Unknown, why, is_lumen: sums[0] + MARGIN > sums[best] && chain != Chain::Spare }
}
