//! How well each segment of the colon can be read: from the measure along it and from its lumen.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::Deserialize;

use super::Quality;
use crate::error::{Error, Result};
use crate::fields::lumen::Residue;
use crate::fields::{Along, Lumen};

/// Caliber from which the colon is distended, mm.
pub const DISTENDED_MM: f64 = 10.0;
/// The rules that come with colvis.
const RULES: &str = include_str!("../../../assets/rules/quality.toml");

/// What makes a segment inadequate.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QualityRule {
    /// The quantity that it compares.
    pub quantity: String,
    /// The segment is inadequate below it.
    pub least: Option<f64>,
    /// The segment is inadequate above it.
    pub most: Option<f64>,
    /// The reason, after the segment's name: "is collapsed".
    pub says: String,
    /// Where the number comes from.
    pub source: String,
}

/// The file of rules.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Rules {
    rule: Vec<QualityRule>,
}

/// Returns the rules that come with colvis.
///
/// # Errors
/// Returns status 1 if they are damaged.
pub fn quality_rules() -> Result<Vec<QualityRule>> {
    let damaged = |e: toml::de::Error| Error::fault("quality.toml", e.message(), "report it").caused_by(e);
    toml::from_str::<Rules>(RULES).map(|rules| rules.rule).map_err(damaged)
}

/// What is known of a segment beside its [`Quality`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SegmentFacts {
    /// Its length without gas or fluid, mm: the line there is a guess.
    pub collapsed_mm: f64,
    /// Tissue or untagged stool in it that touches no wall, ml; `None` if that was not looked for.
    pub residue_ml: Option<f64>,
    /// Why it is inadequate; empty if it is not.
    pub why: String,
}

/// Returns the quality of each segment along a colon, from the rectum, with what else is known of it; nothing if its segments are not
/// known. `was_tag` is true for a voxel of `lumen`, by its indices, that was tag before it was cleansed. Coverage and seconds are those of a
/// reading, which this does not know.
///
/// # Errors
/// Returns status 1 if the rules are damaged.
pub fn quality(
    along: &Along,
    lumen: &Lumen,
    residue: Option<&Residue>,
    was_tag: impl Fn([usize; 3]) -> bool + Sync,
) -> Result<Vec<(Quality, SegmentFacts)>> {
    let parts = along.parts();
    let at = |place: DVec3| {
        let name = along.of(place)?.part?;
        parts.iter().position(|p| p.name == name)
    };
    let areas = lumen.wall_areas(parts.len(), at, was_tag);
    let mut residues = vec![0.0; parts.len()];
    for remnant in residue.iter().flat_map(|r| r.islands.iter().chain(&r.bridges)) {
        if let Some(n) = at(remnant.at) {
            residues[n] += remnant.ml;
        }
    }
    let calibers: Vec<[f64; 2]> = along.calibers().collect();
    let rules = quality_rules()?;
    let all = parts.iter().zip(areas).zip(residues).map(|((part, area), residue_ml)| {
        let within = |mm: f64| part.from_mm < mm && mm <= part.to_mm;
        let own: Vec<f64> = calibers.iter().filter(|c| within(c[0])).map(|c| c[1]).collect();
        let length_mm = part.to_mm - part.from_mm;
        let guessed = along.guessed().iter().map(|g| (g[1].min(part.to_mm) - g[0].max(part.from_mm)).max(0.0));
        let collapsed_mm: f64 = guessed.sum();
        let wide = own.iter().filter(|mm| **mm >= DISTENDED_MM).count() as f64 / own.len().max(1) as f64;
        // A stretch without gas is not distended.
        let gas = ((length_mm - collapsed_mm) / length_mm.max(1e-9)).clamp(0.0, 1.0);
        let mut quality = Quality {
            segment: part.name.to_owned(),
            length_mm,
            distended: wide * gas,
            least_caliber_mm: if collapsed_mm > 0.0 {
                0.0
            } else {
                own.iter().copied().reduce(f64::min).unwrap_or(0.0)
            },
            fluid: area.share_tagged(),
            ..Quality::default()
        };
        let residue_ml = residue.map(|_| residue_ml);
        let mut facts = SegmentFacts { collapsed_mm, residue_ml, why: String::new() };
        facts.why = judge(&quality, &facts, &rules).unwrap_or_default();
        quality.adequate = facts.why.is_empty();
        (quality, facts)
    });
    Ok(all.collect())
}

/// Returns why a segment is inadequate, by the first rule that it fails.
pub fn judge(quality: &Quality, facts: &SegmentFacts, rules: &[QualityRule]) -> Option<String> {
    let value = |quantity: &str| match quantity {
        "distended" => Some(quality.distended),
        "least_caliber_mm" => Some(quality.least_caliber_mm),
        "fluid" => Some(quality.fluid),
        "collapsed_mm" => Some(facts.collapsed_mm),
        "residue_ml" => facts.residue_ml,
        _ => None,
    };
    let fails = |rule: &&QualityRule| {
        value(&rule.quantity)
            .is_some_and(|x| rule.least.is_some_and(|least| x < least) || rule.most.is_some_and(|most| x > most))
    };
    rules.iter().find(fails).map(|rule| format!("{} {}", quality.segment, rule.says))
}

/// Adds the seconds that each segment was looked at.
pub fn add_seconds(list: &mut [Quality], seconds: &BTreeMap<String, f64>) {
    for quality in list {
        quality.seconds = seconds.get(&quality.segment).copied().unwrap_or(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::lumen::{self, NAMES};
    use crate::phantom::PhantomSettings;
    use crate::progress::Progress;
    use crate::shared::shared;

    fn of(settings: &PhantomSettings) -> Vec<(Quality, SegmentFacts)> {
        let (_, volume) = shared(settings);
        let progress = Progress::new();
        let found = lumen::find(&volume, &progress).unwrap();
        let along = found.along(&volume, &progress).unwrap();
        quality(&along, &found, None, |_| false).unwrap()
    }

    #[test]
    fn a_phantom_is_distended_and_its_fluid_is_found_in_its_segments() {
        let dry = of(&PhantomSettings::embedded(1));
        let names: Vec<&str> = dry.iter().map(|(q, _)| q.segment.as_str()).collect();
        assert_eq!(names, NAMES);
        for (q, facts) in &dry {
            assert!(q.length_mm > 10.0 && q.fluid == 0.0 && facts.collapsed_mm == 0.0, "{q:?} {facts:?}");
            assert!((0.0..=1.0).contains(&q.distended) && q.least_caliber_mm > 2.0, "{q:?}");
        }
        let wide = dry.iter().filter(|(q, _)| q.adequate).count();
        assert!(wide >= 6, "{dry:?}");
        let wet = of(&PhantomSettings { fluid: true, ..PhantomSettings::embedded(1) });
        let fluid: Vec<f64> = wet.iter().map(|(q, _)| q.fluid).collect();
        assert!(fluid.iter().any(|f| *f > 0.05) && fluid.iter().all(|f| *f < 0.9), "{fluid:?}");
    }

    #[test]
    fn a_segment_that_is_collapsed_is_inadequate_and_the_rule_says_why() {
        let rules = quality_rules().unwrap();
        assert!(rules.iter().all(|r| !r.source.is_empty() && (r.least.is_some() != r.most.is_some())));
        let good =
            Quality { segment: "cecum".to_owned(), distended: 0.99, least_caliber_mm: 20.0, ..Quality::default() };
        let none = SegmentFacts::default();
        assert_eq!(judge(&good, &none, &rules), None);
        let collapsed = SegmentFacts { collapsed_mm: 60.0, ..none.clone() };
        assert_eq!(judge(&good, &collapsed, &rules).unwrap(), "cecum is collapsed");
        let narrow = Quality { distended: 0.5, ..good.clone() };
        assert_eq!(judge(&narrow, &none, &rules).unwrap(), "cecum is poorly distended");
        let stool = SegmentFacts { residue_ml: Some(5.0), ..none };
        assert!(judge(&good, &stool, &rules).unwrap().contains("untagged residue"));
        let collapsed = of(&PhantomSettings { collapsed: true, ..PhantomSettings::embedded(1) });
        let bad: Vec<&str> =
            collapsed.iter().filter(|(_, f)| f.collapsed_mm > 20.0).map(|(q, _)| q.segment.as_str()).collect();
        assert!(!bad.is_empty(), "{collapsed:?}");
        assert!(collapsed.iter().all(|(q, f)| q.adequate == f.why.is_empty()));
    }
}
