//! Category schemes: which category findings have, by rules in a data file.

use std::path::Path;

use serde::Deserialize;

use super::{Finding, Morphology, Outside, Quality, Tissue};
use crate::error::{Error, Result};
use crate::output;

/// The schemes that come with colvis; the first is the default.
const BUILT_IN: [(&str, &str); 2] = [
    ("c-rads-2023", include_str!("../../../assets/rules/c-rads-2023.toml")),
    ("england", include_str!("../../../assets/rules/england.toml")),
];
const HINT: &str = "see assets/rules/c-rads-2023.toml for what a scheme holds";

/// A category scheme.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scheme {
    /// Its name on the command line.
    pub name: String,
    /// Its title in reports.
    pub title: String,
    /// Where it is published.
    pub source: String,
    /// Categories of findings outside the colon, the gravest first.
    pub outside: Vec<OutsideCategory>,
    /// The rules, in order.
    #[serde(rename = "rule")]
    pub rules: Vec<SchemeRule>,
}

/// A category of findings outside the colon.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutsideCategory {
    /// Its name.
    pub name: String,
    /// Other names of it.
    #[serde(default)]
    pub also: Vec<String>,
    /// What it means.
    pub says: String,
}

/// A rule of a scheme.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SchemeRule {
    /// The category that it gives.
    pub category: String,
    /// Why.
    pub says: String,
    /// What the scheme advises; may be empty.
    pub advice: String,
    /// Minimum number of polyps; 1 if left out.
    pub least: Option<usize>,
    /// Maximum number of polyps.
    pub most: Option<usize>,
    /// Minimum diameter of the polyps that count, mm.
    pub least_mm: Option<f64>,
    /// The diameters of the polyps that count are smaller than this, mm.
    pub below_mm: Option<f64>,
    /// At least one of them has this diameter, mm.
    pub with_mm: Option<f64>,
    /// Forms that count.
    pub morphology: Option<Vec<Morphology>>,
    /// Words of which a note of the reader has one.
    pub words: Option<Vec<String>>,
    /// True if a segment cannot be read well enough.
    pub inadequate: bool,
    /// True if it is met always.
    pub always: bool,
}

/// The category of findings, which is a draft for the reader.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Draft {
    /// The category.
    pub category: String,
    /// The rule that led to it, as a sentence.
    pub because: String,
    /// What the scheme advises; may be empty.
    pub advice: String,
    /// Ids of findings that do not count because they have no diameter.
    pub unmeasured: Vec<String>,
}

impl Scheme {
    /// True if colvis comes with a scheme of this name.
    pub fn is_built_in(name: &str) -> bool {
        BUILT_IN.iter().any(|b| b.0 == name)
    }

    /// Returns the scheme of this name, or that of a file.
    ///
    /// # Errors
    /// Returns status 2 for an unknown name, 3 if the file cannot be read or is not a scheme.
    pub fn named(name: &str) -> Result<Self> {
        if let Some((name, text)) = BUILT_IN.iter().find(|b| b.0 == name) {
            return Self::parse(text, Path::new(name));
        }
        if !name.ends_with(".toml") {
            let names = BUILT_IN.map(|b| b.0).join(" or ");
            return Err(Error::usage(
                "--scheme",
                format!("{name:?} is not known"),
                format!("give {names}, or a .toml file"),
            ));
        }
        let path = Path::new(name);
        Self::parse(&output::read_text(path, HINT)?, path)
    }

    fn parse(text: &str, path: &Path) -> Result<Self> {
        let wrong = |why: String| Error::file(path, why, HINT);
        let scheme: Self = toml::from_str(text).map_err(|e| wrong(e.message().to_owned()).caused_by(e))?;
        for (n, rule) in scheme.rules.iter().enumerate() {
            let counts = rule.least_mm.is_some() || rule.below_mm.is_some() || rule.morphology.is_some();
            let kinds = [counts, rule.words.is_some(), rule.inadequate, rule.always];
            if rule.category.is_empty() || kinds.iter().filter(|k| **k).count() != 1 {
                return Err(wrong(format!("rule {} must have a category, and one kind of condition", n + 1)));
            }
        }
        match scheme.rules.last() {
            Some(last) if last.always => Ok(scheme),
            _ => Err(wrong("the last rule must have always = true, so that all findings have a category".to_owned())),
        }
    }

    /// Returns the category of what a reader has found.
    pub fn draft(&self, findings: &[Finding], quality: &[Quality]) -> Draft {
        let is_polyp = |f: &&Finding| f.tissue != Some(Tissue::Fat);
        let unmeasured = findings.iter().filter(is_polyp).filter(|f| f.diameter_mm.is_none());
        let unmeasured = unmeasured.map(|f| f.id.clone()).collect();
        for rule in &self.rules {
            if let Some(because) = rule.met_by(findings, quality) {
                let (category, advice) = (rule.category.clone(), rule.advice.clone());
                return Draft { category, because, advice, unmeasured };
            }
        }
        // The last rule is met always.
        Draft { category: String::new(), because: String::new(), advice: String::new(), unmeasured }
    }

    /// Returns the gravest category of the findings outside the colon, and what it means; `None` if the reader gave none that the scheme
    /// knows.
    pub fn outside(&self, outside: &[Outside]) -> Option<&OutsideCategory> {
        let is_given = |c: &&OutsideCategory| {
            let names = || std::iter::once(&c.name).chain(&c.also);
            outside.iter().any(|o| names().any(|name| name.eq_ignore_ascii_case(o.category.trim())))
        };
        self.outside.iter().find(is_given)
    }
}

impl SchemeRule {
    /// Returns why the rule is met, with the findings or segments that it is met by; `None` if it is not.
    fn met_by(&self, findings: &[Finding], quality: &[Quality]) -> Option<String> {
        let with = |what: &str, names: Vec<String>| match names.len() {
            0 => self.says.clone(),
            1 => format!("{} ({what} {})", self.says, names[0]),
            _ => format!("{} ({what}s {})", self.says, names.join(", ")),
        };
        if self.always {
            return Some(self.says.clone());
        }
        if self.inadequate {
            let bad: Vec<String> = quality.iter().filter(|q| !q.adequate).map(|q| q.segment.clone()).collect();
            return (!bad.is_empty()).then(|| with("segment", bad));
        }
        if let Some(words) = &self.words {
            let has = |note: &str| words.iter().any(|w| note.to_lowercase().contains(&w.to_lowercase()));
            let noted: Vec<String> = findings.iter().filter(|f| has(&f.note)).map(|f| f.id.clone()).collect();
            return (!noted.is_empty()).then(|| with("finding", noted));
        }
        let mm = |f: &Finding| f.diameter_mm.map(f64::round);
        let counts = |f: &&Finding| {
            let is_form = self.morphology.as_ref().is_none_or(|forms| f.morphology.is_some_and(|m| forms.contains(&m)));
            let is_size = match mm(f) {
                Some(mm) => self.least_mm.is_none_or(|l| mm >= l) && self.below_mm.is_none_or(|b| mm < b),
                // A form may be known without a diameter.
                None => self.least_mm.is_none() && self.below_mm.is_none(),
            };
            f.tissue != Some(Tissue::Fat) && is_form && is_size
        };
        let own: Vec<&Finding> = findings.iter().filter(counts).collect();
        let is_number = own.len() >= self.least.unwrap_or(1) && self.most.is_none_or(|most| own.len() <= most);
        let has_large = self.with_mm.is_none_or(|least| own.iter().any(|f| mm(f).is_some_and(|mm| mm >= least)));
        (is_number && has_large).then(|| with("finding", own.iter().map(|f| f.id.clone()).collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Kind;

    fn finding(n: usize, mm: f64) -> Finding {
        let morphology = Some(if mm >= 30.0 { Morphology::Mass } else { Morphology::Sessile });
        Finding { id: n.to_string(), diameter_mm: Some(mm), morphology, ..Finding::default() }
    }

    fn of(sizes: &[f64]) -> Vec<Finding> {
        sizes.iter().enumerate().map(|(n, mm)| finding(n + 1, *mm)).collect()
    }

    fn noted(note: &str) -> Vec<Finding> {
        vec![Finding { note: note.to_owned(), ..finding(1, 4.0) }]
    }

    fn quality(adequate: bool) -> Vec<Quality> {
        vec![Quality { segment: "sigmoid".to_owned(), adequate, ..Quality::default() }]
    }

    #[test]
    fn every_category_of_both_schemes_is_reached_with_its_rule() {
        let [crads, england] = BUILT_IN.map(|b| Scheme::named(b.0).unwrap());
        let fat = |mm| vec![Finding { tissue: Some(Tissue::Fat), ..finding(1, mm) }];
        let cases: Vec<(Vec<Finding>, bool, &str, &str, &str)> = vec![
            (of(&[]), true, "C1", "C1", "no polyp of 6 mm or more"),
            (of(&[5.4, 3.0]), true, "C1", "C1", "no polyp of 6 mm or more"),
            (fat(40.0), true, "C1", "C1", "no polyp of 6 mm or more"),
            (of(&[5.5]), true, "C2a", "C2", "one or two polyps of 6 to 9 mm (finding 1)"),
            (of(&[6.0, 9.4]), true, "C2a", "C2", "one or two polyps of 6 to 9 mm (findings 1, 2)"),
            (of(&[6.0, 9.4, 2.0]), true, "C2a", "C3a", "one or two polyps of 6 to 9 mm (findings 1, 2)"),
            (of(&[6.0, 9.0, 7.0]), true, "C3", "C3a", "three or more polyps of 6 to 9 mm (findings 1, 2, 3)"),
            (
                of(&[6.0, 9.0, 7.0, 8.0, 4.0]),
                true,
                "C3",
                "C4a",
                "three or more polyps of 6 to 9 mm (findings 1, 2, 3, 4)",
            ),
            (of(&[9.5]), true, "C3", "C3b", "a polyp of 10 mm or more (finding 1)"),
            (of(&[12.0, 6.0, 3.0]), false, "C3", "C4b", "a polyp of 10 mm or more (finding 1)"),
            (of(&[31.0]), true, "C4", "C5a", "a mass (finding 1)"),
            (noted("Narrows the lumen by half"), true, "C4", "C1", "a lesion that narrows the lumen"),
            (noted("mass-like diverticular stricture"), true, "C2b", "C3c", "a mass-like diverticular finding"),
            (noted("known cancer; no additional tumour"), true, "C1", "C5b", "no polyp"),
            (of(&[7.0]), false, "C0", "Cx", "lesions of 10 mm or more cannot be excluded (segment sigmoid)"),
        ];
        for (findings, adequate, c, e, because) in &cases {
            let draft = crads.draft(findings, &quality(*adequate));
            assert_eq!(draft.category, *c, "{draft:?}");
            assert!(draft.because.starts_with(because) && !draft.advice.is_empty(), "{because}: {draft:?}");
            assert_eq!(england.draft(findings, &quality(*adequate)).category, *e, "{findings:?}");
        }
        for (scheme, n) in [(&crads, 2), (&england, 3)] {
            for rule in &scheme.rules {
                let is_reached = cases.iter().any(|case| [case.2, case.3][n - 2] == rule.category);
                assert!(is_reached, "{} {}", scheme.name, rule.category);
            }
        }
        // A finding without a diameter does not count, and is told.
        let unmeasured = Finding { diameter_mm: None, ..finding(1, 4.0) };
        assert_eq!(crads.draft(&[unmeasured], &[]).unmeasured, ["1"]);
    }

    #[test]
    fn the_gravest_finding_outside_counts_and_nothing_is_made_up() {
        let scheme = Scheme::named("c-rads-2023").unwrap();
        let outside =
            |category: &str| Outside { place: glam::DVec3::ZERO, category: category.to_owned(), text: String::new() };
        let gravest = |list: &[&str]| {
            scheme.outside(&list.iter().map(|c| outside(c)).collect::<Vec<_>>()).map(|c| c.name.clone())
        };
        assert_eq!(gravest(&["E2", "e3 ", ""]), Some("E3".to_owned()));
        assert_eq!(gravest(&["E1"]), Some("E1/E2".to_owned()));
        assert_eq!(gravest(&["", "E9"]), None);
        assert_eq!(gravest(&[]), None);
    }

    #[test]
    fn a_scheme_of_a_file_is_read_and_a_damaged_one_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("own.toml");
        let good = "name = 'own'\ntitle = 'Own'\nsource = 'us'\noutside = []\n[[rule]]\ncategory = 'A'\nleast_mm = 3.0\nsays = 'large'\n[[rule]]\ncategory = 'B'\nalways = true\n";
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            Scheme::named(path.to_str().unwrap())
        };
        assert_eq!(read(good).unwrap().draft(&of(&[4.0]), &[]).category, "A");
        for bad in [
            good.replace("always = true", "always = false"),
            good.replace("least_mm = 3.0", "least_mm = 3.0\nwords = ['a']"),
            good.replace("says = 'large'", "why = 'large'"),
            good.replace("category = 'A'", ""),
            "[".to_owned(),
            String::new(),
        ] {
            assert_eq!(read(&bad).unwrap_err().kind, Kind::Input, "{bad}");
        }
        assert_eq!(Scheme::named("mine").unwrap_err().kind, Kind::Usage);
        assert_eq!(Scheme::named("none.toml").unwrap_err().kind, Kind::Input);
    }
}
