//! A series of an archive, into a folder.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};

use colvis_scan::error::{Error, Kind as Failure, Result};
use colvis_scan::output::{self, AtomicFile};
use colvis_scan::progress::Progress;
use dicom_dictionary_std::{tags, uids};

use super::connection::{Association, MOST_CONTEXTS, Proposal};
use super::file::{Head, has_whole};
use super::find::{Instance, Keys, Questions};
use super::message::{Command, Exchange, Kind, Status};
use super::{Archive, proposal};
use crate::text::is_uid;

/// The service that is asked.
const MODEL: &str = uids::STUDY_ROOT_QUERY_RETRIEVE_INFORMATION_MODEL_GET;
/// Instances that are asked for at once.
const BATCH: usize = 64;
/// Largest instance, bytes.
const MOST_BYTES: u64 = 8 << 30;
/// Most messages one after the other that bring nothing that is missing.
const MOST_IDLE: usize = 200_000;
/// What a series may hold, where the archive does not tell it.
const CLASSES: [&str; 5] = [
    uids::CT_IMAGE_STORAGE,
    uids::ENHANCED_CT_IMAGE_STORAGE,
    uids::LEGACY_CONVERTED_ENHANCED_CT_IMAGE_STORAGE,
    uids::SECONDARY_CAPTURE_IMAGE_STORAGE,
    uids::SEGMENTATION_STORAGE,
];
/// The forms in which objects are stored, those first that an archive most likely has. Each is a context of its own, so that the
/// archive can send what it has as it is.
const SYNTAXES: [&str; 13] = [
    uids::EXPLICIT_VR_LITTLE_ENDIAN,
    uids::IMPLICIT_VR_LITTLE_ENDIAN,
    uids::JPEG_LOSSLESS_SV1,
    uids::JPEG2000_LOSSLESS,
    uids::JPEGLS_LOSSLESS,
    uids::RLE_LOSSLESS,
    uids::JPEG_LOSSLESS,
    uids::JPEG2000,
    uids::JPEGLS_NEAR_LOSSLESS,
    uids::JPEG_EXTENDED12_BIT,
    uids::JPEG_BASELINE8_BIT,
    uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN,
    "1.2.840.10008.1.2.2",
];

/// What was fetched.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Got {
    /// Instances of the series.
    pub instances: usize,
    /// Those that were there before.
    pub before: usize,
}

impl Archive {
    /// Fetches a series into a folder: a file for each instance, `DIR/<instance>.dcm`, in the form in which the archive has it. A file has
    /// its name only once it is whole, so the folder can be opened at any time. Instances that are there are not asked for again.
    ///
    /// # Errors
    /// Returns status 2 if `series` is no identifier or the settings cannot be used, 3 if the archive cannot be reached, refuses or
    /// does not send everything, 4 if interrupted, 5 if a file cannot be written. What was fetched is there, and the same call goes on.
    pub fn get(&self, series: &str, folder: &Path, progress: &Progress) -> Result<Got> {
        if !is_uid(series) {
            let why = "is not the identifier of a series: numbers with dots between them";
            return Err(Error::usage(format!("--series {series:?}"), why, "take it from what `archive find` lists"));
        }
        output::make_folder(folder)?;
        progress.stage("asking the archive", 0);
        let mut questions = Questions::new(self, progress)?;
        let study = questions.study_of(series)?;
        let instances = study.as_ref().map_or(Ok(Vec::new()), |study| questions.instances(study, series))?;
        questions.end();
        let Some(study) = study.filter(|_| !instances.is_empty()) else {
            let why = format!("has no series {series}");
            return Err(Error::input(self.what(), why, "`archive find` lists what it has"));
        };
        progress.stage("looking at what is there", instances.len() as u64);
        let mut missing = Vec::new();
        for instance in &instances {
            if !has_whole(&place(folder, &instance.uid), &instance.uid) {
                missing.push(instance.clone());
            }
            progress.advance(1)?;
        }
        let before = instances.len() - missing.len();
        progress.stage("getting", instances.len() as u64);
        progress.advance(before as u64)?;
        let mut got = Getting { folder, study: &study, series, missing: BTreeSet::new(), told: None };
        got.missing = missing.iter().map(|i| i.uid.clone()).collect();
        let outcome = if missing.is_empty() { Ok(()) } else { got.all(self, &missing, instances.len(), progress) };
        let left = got.missing.len();
        let count = format!("{} of {} instances are there", instances.len() - left, instances.len());
        let hint = "the same command goes on with the others";
        match outcome {
            Err(e) if matches!(e.kind, Failure::Input | Failure::Incomplete | Failure::Output) => {
                // Where nothing came, the same command may not help.
                let hint = match e.kind {
                    Failure::Input if left == missing.len() => e.hint.clone(),
                    Failure::Output => format!("{}; {hint}", e.hint),
                    _ => hint.to_owned(),
                };
                let mut all = Error::new(e.kind, e.what, format!("{}; {count}", e.why), hint);
                all.cause = e.cause;
                Err(all)
            }
            Err(e) => Err(e),
            Ok(()) if left > 0 => {
                let told = got.told.map_or_else(|| "it sent no others".to_owned(), |told| format!("it says: {told}"));
                Err(Error::input(self.what(), format!("{count}: {told}"), hint))
            }
            Ok(()) => Ok(Got { instances: instances.len(), before }),
        }
    }
}

fn place(folder: &Path, instance: &str) -> PathBuf {
    folder.join(format!("{instance}.dcm"))
}

/// A series that is being fetched.
struct Getting<'a> {
    folder: &'a Path,
    study: &'a str,
    series: &'a str,
    /// Instances that are not there yet.
    missing: BTreeSet<String>,
    /// What the archive told about those that it did not send.
    told: Option<String>,
}

impl Getting<'_> {
    /// Fetches the missing instances of a series of `count`.
    fn all(&mut self, archive: &Archive, missing: &[Instance], count: usize, progress: &Progress) -> Result<()> {
        let association = Association::open(archive, &proposals(missing), progress)?;
        let mut exchange = Exchange::new(association);
        if exchange.association.context(MODEL).is_none() {
            let hint = "name another archive: colvis does not ask for a transfer to a third place (C-MOVE)";
            return Err(Error::input(archive.what(), "does not support C-GET", hint));
        }
        if missing.len() == count {
            self.ask(&mut exchange, &[])?;
        }
        // An archive may not know lists of identifiers, so the last attempt names them one by one.
        for batch in [BATCH, 1] {
            let left: Vec<String> = self.missing.iter().cloned().collect();
            for uids in left.chunks(batch) {
                self.ask(&mut exchange, uids)?;
            }
        }
        exchange.association.release();
        Ok(())
    }

    /// Asks for instances, or the whole series.
    fn ask(&mut self, exchange: &mut Exchange<'_>, instances: &[String]) -> Result<()> {
        let list = instances.join("\\");
        let mut keys = vec![(tags::STUDY_INSTANCE_UID, self.study), (tags::SERIES_INSTANCE_UID, self.series)];
        let level = if instances.is_empty() {
            "SERIES"
        } else {
            keys.push((tags::SOP_INSTANCE_UID, &list));
            "IMAGE"
        };
        let context = exchange.service(MODEL, "C-GET")?;
        let id = exchange.next_id();
        exchange.send(&Command::new(Kind::Get, &context, id, true))?;
        exchange.send_data(context.id, &mut Keys::at_level(level, &keys).bytes().as_slice())?;
        let (mut idle, mut missing) = (0, self.missing.len());
        loop {
            idle = if self.missing.len() < missing { 0 } else { idle + 1 };
            missing = self.missing.len();
            if idle > MOST_IDLE {
                return Err(exchange.association.garbled("nothing that was asked for"));
            }
            let command = exchange.receive()?;
            if command.field() == Kind::Store as u16 {
                self.store(exchange, &command)?;
                continue;
            }
            if command.field() != Kind::Get.answer() {
                return Err(exchange.association.garbled("an answer to another question"));
            }
            if command.has_data() {
                exchange.receive_small()?;
            }
            let status = command.status();
            if !status.is_pending() {
                if status != Status(0) {
                    self.told = Some(command.told());
                }
                return Ok(());
            }
        }
    }

    /// Writes an instance that the archive sends.
    fn store(&mut self, exchange: &mut Exchange<'_>, command: &Command) -> Result<()> {
        let instance = command.get_text(tags::AFFECTED_SOP_INSTANCE_UID);
        let class = command.get_text(tags::AFFECTED_SOP_CLASS_UID);
        let context = exchange.association.contexts().iter().find(|c| c.id == command.context && c.class != MODEL);
        let Some(syntax) = context.map(|c| c.syntax.clone()) else {
            return Err(exchange.association.garbled("an object that was not agreed on"));
        };
        if !is_uid(&instance) || !is_uid(&class) || !command.has_data() {
            return Err(exchange.association.garbled("an object without an identifier"));
        }
        if self.missing.contains(&instance) {
            let path = place(self.folder, &instance);
            let mut file = AtomicFile::create(&path)?;
            let head = Head { class, instance: instance.clone(), syntax, data_at: 0 };
            head.write(&exchange.association.archive().title, &mut file).map_err(|e| output::cannot(&path, e))?;
            let too_large = exchange.association.garbled("an endless object");
            let mut bytes = 0;
            exchange.receive_data(|piece| {
                bytes += piece.len() as u64;
                if bytes > MOST_BYTES {
                    return Err(too_large.clone());
                }
                file.write_all(piece).map_err(|e| output::cannot(&path, e))
            })?;
            file.finish()?;
            self.missing.remove(&instance);
            exchange.association.progress().advance(1)?;
        } else {
            // It is there already, or was not asked for.
            exchange.receive_data(|_| Ok(()))?;
        }
        exchange.send(&Command::answer_to(command, Kind::Store, 0))
    }
}

/// Returns what is proposed for objects of the classes of these instances: the archive's own forms.
fn proposals(instances: &[Instance]) -> Vec<Proposal> {
    let mut classes: BTreeSet<&str> = instances.iter().map(|i| i.class.as_str()).filter(|c| !c.is_empty()).collect();
    if instances.iter().any(|i| i.class.is_empty()) {
        classes.extend(CLASSES);
    }
    let object = |class: &str, syntax: &str| Proposal {
        class: class.to_owned(),
        syntaxes: vec![syntax.to_owned()],
        receives: true,
    };
    let objects = SYNTAXES.iter().flat_map(|s| classes.iter().map(|c| object(c, s)));
    std::iter::once(proposal(MODEL)).chain(objects).take(MOST_CONTEXTS).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_of_every_class_is_proposed() {
        let unknown = [Instance { uid: "1.2".to_owned(), class: String::new() }];
        let all = proposals(&unknown);
        assert_eq!(all.len(), 1 + CLASSES.len() * SYNTAXES.len());
        assert!(all.len() <= MOST_CONTEXTS && all.iter().filter(|p| !p.receives).count() == 1);
        let known = [Instance { uid: "1.2".to_owned(), class: "1.3".to_owned() }];
        assert_eq!(proposals(&known).len(), 1 + SYNTAXES.len());
    }
}
