//! Files, to an archive.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use colvis_scan::error::{Error, Kind as Failure, Result};
use colvis_scan::output::plain;
use colvis_scan::panics;
use colvis_scan::progress::Progress;
use dicom_dictionary_std::{tags, uids};
use dicom_encoding::transfer_syntax::TransferSyntaxIndex;
use dicom_transfer_syntax_registry::TransferSyntaxRegistry;

use super::Archive;
use super::connection::{Association, MOST_CONTEXTS, Proposal};
use super::file::Head;
use super::message::{Command, Exchange, Kind, Status};

/// Files that an error names.
const MOST_NAMED: usize = 5;
/// The status of an object that the archive has already.
const HAS_IT: Status = Status(0x0111);

/// What was sent.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Sent {
    /// Files that the archive has stored.
    pub stored: usize,
    /// Remarks about some of them.
    pub remarks: Vec<String>,
}

/// A file to send.
struct Item {
    path: PathBuf,
    head: Head,
}

impl Archive {
    /// Sends DICOM files, and those in folders, as they are. The archive keeps one of each, so sending again is safe.
    ///
    /// # Errors
    /// Returns status 2 if the settings cannot be used, 3 if a file is no DICOM file (then nothing is sent), 4 if interrupted, 5 if the
    /// archive cannot be reached or does not store every file.
    pub fn send(&self, files: &[PathBuf], progress: &Progress) -> Result<Sent> {
        progress.stage("reading", 0);
        let items = items(files, progress)?;
        progress.stage("sending", items.len() as u64);
        let mut sending = Sending { stored: 0, failed: Vec::new(), remarks: Vec::new(), next: 0 };
        let mut outcome = Ok(());
        while outcome.is_ok() && sending.next < items.len() {
            outcome = sending.some(self, &items, progress);
        }
        let left = items[sending.next..].iter().map(|i| name(&i.path));
        let mut failed: Vec<String> = std::mem::take(&mut sending.failed).into_iter().chain(left).collect();
        let count = format!("{} of {} files are stored", sending.stored, items.len());
        let others = failed.len().saturating_sub(MOST_NAMED);
        failed.truncate(MOST_NAMED);
        let others = if others > 0 { format!(" and {others} more") } else { String::new() };
        let count = if failed.is_empty() { count } else { format!("{count}, not {}{others}", failed.join(", ")) };
        let hint = "send them again: it is safe, the archive keeps one of each";
        match outcome {
            Err(e) if e.kind == Failure::Usage || e.kind == Failure::Fault => Err(e),
            Err(e) => {
                let kind = if e.kind == Failure::Incomplete { e.kind } else { Failure::Output };
                let hint =
                    if sending.stored == 0 && kind == Failure::Output { e.hint.clone() } else { hint.to_owned() };
                let mut all = Error::new(kind, e.what, format!("{}; {count}", e.why), hint);
                all.cause = e.cause;
                Err(all)
            }
            Ok(()) if !failed.is_empty() => Err(Error::new(Failure::Output, self.what(), count, hint)),
            Ok(()) => Ok(Sent { stored: sending.stored, remarks: sending.remarks }),
        }
    }
}

/// Returns the files to send, with their heads. Files in folders that are no DICOM files are left out.
fn items(paths: &[PathBuf], progress: &Progress) -> Result<Vec<Item>> {
    let mut items = Vec::new();
    for path in paths {
        progress.check()?;
        let cannot = |e: std::io::Error| {
            Error::file(path, format!("cannot be read ({})", plain(&e)), "name files that can be read").caused_by(e)
        };
        if path.is_dir() {
            let before = items.len();
            let mut within: Vec<PathBuf> = Vec::new();
            for entry in std::fs::read_dir(path).map_err(cannot)? {
                within.push(entry.map_err(cannot)?.path());
            }
            within.sort();
            for path in within.into_iter().filter(|p| p.is_file()) {
                let head = File::open(&path).and_then(|mut f| Head::read(&mut f)).map_err(cannot)?;
                items.extend(head.map(|head| Item { path, head }));
            }
            if items.len() == before {
                return Err(Error::file(path, "has no DICOM file", "name a folder of DICOM files"));
            }
        } else {
            let head = File::open(path).and_then(|mut f| Head::read(&mut f)).map_err(cannot)?;
            let Some(head) = head else {
                return Err(Error::file(path, "is no DICOM file", "leave it out: nothing was sent"));
            };
            items.push(Item { path: path.clone(), head });
        }
    }
    Ok(items)
}

/// Returns the name of a file for messages.
fn name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// The other form of uncompressed objects, for an archive that takes only one.
fn other_form(syntax: &str) -> Option<&'static str> {
    match syntax {
        uids::EXPLICIT_VR_LITTLE_ENDIAN => Some(uids::IMPLICIT_VR_LITTLE_ENDIAN),
        uids::IMPLICIT_VR_LITTLE_ENDIAN => Some(uids::EXPLICIT_VR_LITTLE_ENDIAN),
        _ => None,
    }
}

/// Files that are being sent.
struct Sending {
    stored: usize,
    /// Files that were not stored, with the reason.
    failed: Vec<String>,
    remarks: Vec<String>,
    /// The first file that was not tried.
    next: usize,
}

impl Sending {
    /// Sends as many files as one association has contexts for.
    fn some(&mut self, archive: &Archive, items: &[Item], progress: &Progress) -> Result<()> {
        let mut contexts = BTreeSet::new();
        let mut end = self.next;
        for item in &items[self.next..] {
            let mut with = contexts.clone();
            with.insert((item.head.class.as_str(), item.head.syntax.as_str()));
            with.extend(other_form(&item.head.syntax).map(|other| (item.head.class.as_str(), other)));
            if with.len() > MOST_CONTEXTS {
                break;
            }
            (contexts, end) = (with, end + 1);
        }
        let proposals: Vec<Proposal> = contexts
            .into_iter()
            .map(|(class, syntax)| Proposal {
                class: class.to_owned(),
                syntaxes: vec![syntax.to_owned()],
                receives: false,
            })
            .collect();
        let mut exchange = Exchange::new(Association::open(archive, &proposals, progress)?);
        while self.next < end {
            let item = &items[self.next];
            let answer = one(&mut exchange, item)?;
            self.next += 1;
            let name = name(&item.path);
            match answer {
                Err(why) => self.failed.push(format!("{name} ({why})")),
                Ok(answer) => {
                    let status = answer.status();
                    if status.is_success() || status.is_warning() || status == HAS_IT {
                        self.stored += 1;
                        if status.is_warning() {
                            self.remarks.push(format!("{name}: the archive has stored it with {}", answer.told()));
                        }
                    } else {
                        self.failed.push(format!("{name} ({})", answer.told()));
                    }
                }
            }
            progress.advance(1)?;
        }
        exchange.association.release();
        Ok(())
    }
}

/// Sends a file. Returns the archive's answer, or why the file was not sent.
fn one(exchange: &mut Exchange<'_>, item: &Item) -> Result<std::result::Result<Command, String>> {
    let Head { class, instance, syntax, data_at } = &item.head;
    let of = |syntax: &str| exchange.association.contexts().iter().find(|c| c.class == *class && c.syntax == syntax);
    let (context, mut data): (_, Box<dyn Read>) = if let Some(context) = of(syntax) {
        let file = File::open(&item.path).and_then(|mut f| f.seek(SeekFrom::Start(*data_at)).map(|_| f));
        match file {
            Ok(file) => (context.clone(), Box::new(file)),
            Err(e) => return Ok(Err(format!("cannot be read: {}", plain(&e)))),
        }
    } else if let Some(context) = other_form(syntax).and_then(of) {
        match converted(&item.path, &context.syntax) {
            Ok(bytes) => (context.clone(), Box::new(std::io::Cursor::new(bytes))),
            Err(why) => return Ok(Err(why)),
        }
    } else {
        let entry = TransferSyntaxRegistry.get(syntax).map_or(syntax.as_str(), |t| t.name());
        return Ok(Err(format!("the archive takes no objects of class {class} as {entry}")));
    };
    let id = exchange.next_id();
    let command = Command::new(Kind::Store, &context, id, true).text(tags::AFFECTED_SOP_INSTANCE_UID, instance);
    exchange.send(&command)?;
    exchange.send_data(context.id, &mut data)?;
    let answer = exchange.answer(Kind::Store, id)?;
    if answer.has_data() {
        exchange.receive_small()?;
    }
    Ok(Ok(answer))
}

/// Returns the data set of an uncompressed file in another form.
fn converted(path: &Path, syntax: &str) -> std::result::Result<Vec<u8>, String> {
    let syntax = TransferSyntaxRegistry.get(syntax).ok_or("unknown transfer syntax")?;
    let convert = || {
        let object = dicom_object::open_file(path).map_err(|e| e.to_string())?;
        let mut bytes = Vec::new();
        object.write_dataset_with_ts(&mut bytes, syntax).map_err(|e| e.to_string())?;
        Ok(bytes)
    };
    panics::catch(convert).and_then(|done| done).map_err(|why: String| format!("cannot be converted: {why}"))
}
