//! What an archive has: studies and series of CT.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use colvis_scan::error::{Error, Result};
use colvis_scan::progress::Progress;
use dicom_core::Tag;
use dicom_dictionary_std::{tags, uids};

use super::connection::Association;
use super::elements::{Elements, put_implicit, text as plain_text};
use super::message::{Command, Exchange, Kind};
use super::{Archive, proposal, text};
use crate::text::{decode, is_uid};

/// The service that is asked: studies, their series, their instances.
const MODEL: &str = uids::STUDY_ROOT_QUERY_RETRIEVE_INFORMATION_MODEL_FIND;
/// Most series of a study.
const MOST_SERIES: usize = 2000;
/// Most instances of a series.
const MOST_INSTANCES: usize = 100_000;
/// Most studies whose series are looked through for a description.
const MOST_LOOKED_AT: usize = 5000;

/// What to look for. Everything that is given must hold.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Query {
    /// Name or identifier of the patient. `*` stands for any characters, `?` for one; a word without them may stand anywhere in the
    /// name, or be the whole identifier.
    pub patient: Option<String>,
    /// Days of the study.
    pub date: Option<DateRange>,
    /// Words in the description of the study or of the series, as in a name.
    pub description: Option<String>,
}

/// A range of days, its ends included: `20250101-20250331`, `20250101-`, `-20250331`, `20250101`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DateRange(String);

impl FromStr for DateRange {
    type Err = String;

    fn from_str(s: &str) -> std::result::Result<Self, String> {
        let is_day = |d: &str| {
            let part = |range: std::ops::Range<usize>| d.get(range).and_then(|n| n.parse::<u32>().ok()).unwrap_or(0);
            d.len() == 8
                && d.bytes().all(|b| b.is_ascii_digit())
                && (1..=12).contains(&part(4..6))
                && (1..=31).contains(&part(6..8))
        };
        let good = match s.split_once('-') {
            None => is_day(s),
            Some(("", "")) => false,
            Some((from, "")) => is_day(from),
            Some(("", to)) => is_day(to),
            Some((from, to)) => is_day(from) && is_day(to) && from <= to,
        };
        let wanted = "expected a day such as 20250131, or two such as 20250101-20250331 of which one may be left out";
        if good { Ok(Self(s.to_owned())) } else { Err(wanted.to_owned()) }
    }
}

impl fmt::Display for DateRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// What an archive has.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Found {
    /// The studies that match, latest first; those of one day by their identifiers.
    pub studies: Vec<Study>,
    /// True if the archive has more.
    pub has_more: bool,
}

/// A study with its series of CT.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Study {
    /// Its identifier.
    pub uid: String,
    /// Name of the patient, as the archive has it.
    pub patient_name: String,
    /// Identifier of the patient.
    pub patient_id: String,
    /// Its day, as `20250131`; empty if unknown.
    pub date: String,
    /// Its description.
    pub description: String,
    /// Its series, by number and identifier.
    pub series: Vec<Series>,
}

/// A series of CT.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Series {
    /// Its identifier, for [`Archive::get`].
    pub uid: String,
    /// Its number in the study.
    pub number: Option<i64>,
    /// Its description.
    pub description: String,
    /// Its modality.
    pub modality: String,
    /// Number of its instances, where the archive tells it.
    pub instances: Option<u64>,
}

impl Archive {
    /// Looks for studies that have series of CT: at most `most` studies.
    ///
    /// # Errors
    /// Returns status 2 if the query or the settings cannot be used, 3 if the archive cannot be reached or refuses, 4 if interrupted.
    pub fn find(&self, query: &Query, most: usize, progress: &Progress) -> Result<Found> {
        for (what, value) in [("--patient", &query.patient), ("--description", &query.description)] {
            if value.as_ref().is_some_and(|v| v.is_empty() || v.contains(|c: char| c == '\\' || c.is_control())) {
                return Err(Error::usage(what, "is empty, or has a backslash or a control character", "give a word"));
            }
        }
        progress.stage("asking the archive", 0);
        let mut questions = Questions::new(self, progress)?;
        let date = query.date.as_ref().map(ToString::to_string).unwrap_or_default();
        let name = query.patient.as_deref().map(text::pattern).unwrap_or_default();
        let most_asked = if query.description.is_some() { most.max(MOST_LOOKED_AT) } else { most };
        let mut studies = BTreeMap::new();
        let mut has_more = questions.studies(&[(tags::PATIENT_NAME, &name)], &date, most_asked, &mut studies)?;
        if let Some(patient) = &query.patient {
            has_more |= questions.studies(&[(tags::PATIENT_ID, patient)], &date, most_asked, &mut studies)?;
        }
        let mut studies: Vec<Study> = studies.into_values().collect();
        studies.sort_by(|a, b| b.date.cmp(&a.date).then_with(|| a.uid.cmp(&b.uid)));
        progress.stage("listing series", studies.len() as u64);
        let words = query.description.as_deref().map(text::pattern);
        let mut found = Found { studies: Vec::new(), has_more };
        for mut study in studies {
            if found.studies.len() == most {
                found.has_more = true;
                break;
            }
            let is_described = |description: &str| words.as_ref().is_none_or(|w| text::matches(description, w));
            let of_study = is_described(&study.description);
            let mut series = questions.series(&study.uid)?;
            series.retain(|s| of_study || is_described(&s.description));
            progress.advance(1)?;
            if !series.is_empty() {
                study.series = series;
                found.studies.push(study);
            }
        }
        questions.exchange.association.release();
        Ok(found)
    }
}

/// An instance of a series.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Instance {
    pub uid: String,
    /// Its class; empty if the archive does not tell it.
    pub class: String,
}

/// An answer to a question: its values, decoded.
type Answer = BTreeMap<Tag, String>;

/// Questions to an archive, one after the other.
pub(super) struct Questions<'a> {
    archive: &'a Archive,
    progress: &'a Progress,
    exchange: Exchange<'a>,
}

impl<'a> Questions<'a> {
    pub(super) fn new(archive: &'a Archive, progress: &'a Progress) -> Result<Self> {
        Ok(Self { archive, progress, exchange: Self::open(archive, progress)? })
    }

    fn open(archive: &'a Archive, progress: &'a Progress) -> Result<Exchange<'a>> {
        Association::open(archive, &[proposal(MODEL)], progress).map(Exchange::new)
    }

    /// Ends the questions.
    pub(super) fn end(self) {
        self.exchange.association.release();
    }

    /// Adds the studies that match, and returns whether there are more.
    fn studies(
        &mut self,
        keys: &[(Tag, &str)],
        date: &str,
        most: usize,
        found: &mut BTreeMap<String, Study>,
    ) -> Result<bool> {
        let wanted = [
            (tags::STUDY_INSTANCE_UID, ""),
            (tags::PATIENT_NAME, ""),
            (tags::PATIENT_ID, ""),
            (tags::STUDY_DATE, date),
            (tags::STUDY_DESCRIPTION, ""),
        ];
        let mut asked = Keys::at_level("STUDY", &wanted);
        keys.iter().for_each(|(tag, value)| asked.set(*tag, value));
        let mut of_ct = asked.clone();
        of_ct.set(tags::MODALITIES_IN_STUDY, "CT");
        let answers = match self.ask(&of_ct, most)? {
            Asked::Answered(answers) => Ok(answers),
            // The key is optional. Without it the series tell.
            Asked::Failed(_) => self.ask(&asked, most)?.answered(self.archive),
        }?;
        for answer in &answers.list {
            let of = |tag| answer.get(&tag).cloned().unwrap_or_default();
            let uid = of(tags::STUDY_INSTANCE_UID);
            if is_uid(&uid) {
                let study = Study {
                    uid: uid.clone(),
                    patient_name: of(tags::PATIENT_NAME),
                    patient_id: of(tags::PATIENT_ID),
                    date: of(tags::STUDY_DATE),
                    description: of(tags::STUDY_DESCRIPTION),
                    series: Vec::new(),
                };
                found.insert(uid, study);
            }
        }
        Ok(answers.has_more)
    }

    /// Returns the series of CT of a study.
    fn series(&mut self, study: &str) -> Result<Vec<Series>> {
        let wanted = [
            (tags::STUDY_INSTANCE_UID, study),
            (tags::SERIES_INSTANCE_UID, ""),
            (tags::SERIES_NUMBER, ""),
            (tags::SERIES_DESCRIPTION, ""),
            (tags::MODALITY, "CT"),
            (tags::NUMBER_OF_SERIES_RELATED_INSTANCES, ""),
        ];
        let answers = self.ask(&Keys::at_level("SERIES", &wanted), MOST_SERIES)?.answered(self.archive)?;
        let mut all: Vec<Series> = answers
            .list
            .iter()
            .filter_map(|answer| {
                let of = |tag| answer.get(&tag).cloned().unwrap_or_default();
                let series = Series {
                    uid: of(tags::SERIES_INSTANCE_UID),
                    number: of(tags::SERIES_NUMBER).parse().ok(),
                    description: of(tags::SERIES_DESCRIPTION),
                    modality: of(tags::MODALITY),
                    instances: of(tags::NUMBER_OF_SERIES_RELATED_INSTANCES).parse().ok(),
                };
                (is_uid(&series.uid) && series.modality == "CT").then_some(series)
            })
            .collect();
        all.sort_by(|a, b| (a.number, &a.uid).cmp(&(b.number, &b.uid)));
        all.dedup_by(|a, b| a.uid == b.uid);
        Ok(all)
    }

    /// Returns the study of a series, if the archive has the series.
    pub(super) fn study_of(&mut self, series: &str) -> Result<Option<String>> {
        let wanted = [(tags::STUDY_INSTANCE_UID, ""), (tags::SERIES_INSTANCE_UID, series)];
        // The standard asks for the study, too. Most archives do without.
        if let Asked::Answered(answers) = self.ask(&Keys::at_level("SERIES", &wanted), MOST_SERIES)? {
            let of_series =
                answers.list.iter().filter(|a| a.get(&tags::SERIES_INSTANCE_UID).is_some_and(|u| u == series));
            let study = of_series.filter_map(|a| a.get(&tags::STUDY_INSTANCE_UID)).find(|u| is_uid(u));
            if let Some(study) = study {
                return Ok(Some(study.clone()));
            }
        }
        let mut studies = BTreeMap::new();
        self.studies(&[], "", MOST_LOOKED_AT, &mut studies)?;
        self.progress.stage("looking for the series", studies.len() as u64);
        for study in studies.into_keys() {
            self.progress.advance(1)?;
            if self.series(&study)?.iter().any(|s| s.uid == series) {
                return Ok(Some(study));
            }
        }
        Ok(None)
    }

    /// Returns the instances of a series, sorted.
    pub(super) fn instances(&mut self, study: &str, series: &str) -> Result<Vec<Instance>> {
        let wanted = [
            (tags::STUDY_INSTANCE_UID, study),
            (tags::SERIES_INSTANCE_UID, series),
            (tags::SOP_INSTANCE_UID, ""),
            (tags::SOP_CLASS_UID, ""),
        ];
        let answers = self.ask(&Keys::at_level("IMAGE", &wanted), MOST_INSTANCES)?.answered(self.archive)?;
        if answers.has_more {
            let why = format!("its series {series} has more than {MOST_INSTANCES} instances");
            return Err(Error::input(self.archive.what(), why, "get another series"));
        }
        let mut all = Vec::new();
        for answer in &answers.list {
            let of = |tag| answer.get(&tag).cloned().unwrap_or_default();
            let (uid, class) = (of(tags::SOP_INSTANCE_UID), of(tags::SOP_CLASS_UID));
            if !is_uid(&uid) {
                return Err(self.exchange.association.garbled(&format!("{uid:?} as the identifier of an instance")));
            }
            all.push(Instance { uid, class: Some(class).filter(|c| is_uid(c)).unwrap_or_default() });
        }
        all.sort();
        all.dedup_by(|a, b| a.uid == b.uid);
        Ok(all)
    }

    /// Asks the archive, and takes at most `most` answers.
    fn ask(&mut self, keys: &Keys, most: usize) -> Result<Asked> {
        let context = self.exchange.service(MODEL, "C-FIND")?;
        let id = self.exchange.next_id();
        self.exchange.send(&Command::new(Kind::Find, &context, id, true))?;
        self.exchange.send_data(context.id, &mut keys.bytes().as_slice())?;
        let mut answers = Answers::default();
        loop {
            let answer = self.exchange.answer(Kind::Find, id)?;
            let data = if answer.has_data() { self.exchange.receive_small()? } else { Vec::new() };
            let status = answer.status();
            if !status.is_pending() {
                let done = status.is_success() || status.is_warning();
                return Ok(if done { Asked::Answered(answers) } else { Asked::Failed(answer.told()) });
            }
            if answers.list.len() == most {
                answers.has_more = true;
                // What is left is not waited for: an archive need not stop when it is asked to.
                self.exchange = Self::open(self.archive, self.progress)?;
                return Ok(Asked::Answered(answers));
            }
            answers.list.push(self.decoded(&data)?);
        }
    }

    fn decoded(&self, data: &[u8]) -> Result<Answer> {
        let elements = Elements::implicit(data);
        if !elements.clone().are_whole() {
            return Err(self.exchange.association.garbled("a damaged data set"));
        }
        let sets = elements.clone().find(|e| e.0 == tags::SPECIFIC_CHARACTER_SET);
        let sets = sets.map(|e| plain_text(e.1)).unwrap_or_default();
        Ok(elements.map(|(tag, value)| (tag, decode(value, &sets))).collect())
    }
}

/// The keys of a question.
#[derive(Clone)]
pub(super) struct Keys(BTreeMap<Tag, String>);

impl Keys {
    pub(super) fn at_level(level: &str, keys: &[(Tag, &str)]) -> Self {
        let mut all = Self(BTreeMap::new());
        all.set(tags::QUERY_RETRIEVE_LEVEL, level);
        keys.iter().for_each(|(tag, value)| all.set(*tag, value));
        all
    }

    fn set(&mut self, tag: Tag, value: &str) {
        self.0.insert(tag, value.to_owned());
    }

    /// The data set, in UTF-8, without representations.
    pub(super) fn bytes(&self) -> Vec<u8> {
        let mut all = Vec::new();
        put_implicit(&mut all, tags::SPECIFIC_CHARACTER_SET, b"ISO_IR 192", b' ');
        for (tag, value) in &self.0 {
            // Identifiers are padded with zeros, texts with spaces.
            let pad = if value.split('\\').all(is_uid) { 0 } else { b' ' };
            put_implicit(&mut all, *tag, value.as_bytes(), pad);
        }
        all
    }
}

#[derive(Default)]
struct Answers {
    list: Vec<Answer>,
    has_more: bool,
}

enum Asked {
    Answered(Answers),
    /// The archive could not answer, and told this.
    Failed(String),
}

impl Asked {
    fn answered(self, archive: &Archive) -> Result<Answers> {
        match self {
            Self::Answered(answers) => Ok(answers),
            Self::Failed(why) => Err(Error::input(
                archive.what(),
                format!("cannot answer ({why})"),
                "ask for something else; its log tells why",
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_days_or_ranges() {
        for good in ["20250131", "20250101-20250331", "20250101-", "-20250331"] {
            assert_eq!(good.parse::<DateRange>().unwrap().to_string(), good);
        }
        for bad in ["", "-", "2025", "20251301", "20250132", "20250331-20250101", "2025-01-01", "20250101-x", "*"] {
            assert!(bad.parse::<DateRange>().is_err(), "{bad}");
        }
    }
}
