//! Two scans that are read together: whether they are one patient's, and which series of a study belong together.

use std::path::PathBuf;

use crate::cli::args::{Global, SeriesChoice};
use crate::cli::prepare;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::io::identity::{self, Identity};
use crate::volume::io::{identity as identity_of, study};

/// A scan, and the one that is opened beside it as the same patient's other position.
pub(crate) struct Pair {
    /// The first, and the number of its series if that was asked for.
    pub(crate) first: (PathBuf, Option<usize>),
    pub(crate) second: PathBuf,
}

impl Pair {
    /// Returns the number of the series of a study in which the patient of its open series lies otherwise; `None` if the second scan is
    /// not of the same study.
    ///
    /// # Errors
    /// Returns status 3 if the study has none.
    pub(crate) fn paired(&self, global: &Global) -> Result<Option<usize>> {
        let (first, open) = &self.first;
        if *first != self.second {
            return Ok(None);
        }
        let study = study(first, 0, &Progress::new())?;
        let open = open.or(global.series_number()).or(study.usual.map(|k| k + 1));
        let Some(open) = open.and_then(|n| study.series.get(n.checked_sub(1)?)) else { return Ok(None) };
        let usable = open.pair.iter().find(|n| study.series.get(**n - 1).is_some_and(|s| s.why.is_none()));
        let missing = || {
            let why = "has no series of this patient in another position";
            Error::file(first, why, "give the other position's file or folder as --second")
        };
        usable.copied().map(Some).ok_or_else(missing)
    }

    /// Refuses the scan of another patient. Only DICOM tells; two scans of which one does not tell are taken for one patient's. `global`
    /// has the options of the second scan.
    ///
    /// # Errors
    /// Returns status 3 if the patients differ or a header cannot be read, 4 if cancelled.
    pub(crate) fn check(&self, global: &Global, progress: &Progress) -> Result<()> {
        let (first, series) = &self.first;
        let of_first = Global { series: series.map(SeriesChoice::Number), ..global.clone() };
        let told = |path, global: &Global| identity_of(path, &prepare::load_options(global), progress);
        let (Some(a), Some(b)) = (told(first, &of_first)?, told(&self.second, global)?) else { return Ok(()) };
        let differs = [identity::PATIENT_ID, identity::BIRTH_DATE, identity::SEX].into_iter().any(|tag| {
            let value = |of: &Identity| of.values.get(&tag).filter(|v| !v.is_empty()).cloned();
            value(&a).zip(value(&b)).is_some_and(|(a, b)| a != b)
        });
        if !differs {
            return Ok(());
        }
        let why = format!("is the scan of another patient than {}", first.display());
        Err(Error::file(&self.second, why, "give the same patient's other position, or add --force"))
    }
}
