//! Archives that refuse, die, keep silent or send nonsense.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::thread::JoinHandle;
use std::time::Instant;

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_ul::Pdu;
use dicom_ul::pdu::{
    AssociationAC, AssociationRJ, AssociationRJResult, AssociationRJServiceUserReason, AssociationRJSource, PDataValue,
    PDataValueType, PresentationContextResult, PresentationContextResultReason, UserVariableItem, read_pdu, write_pdu,
};

use super::elements::{Elements, put_implicit, text};
use super::*;

const SERIES: &str = "1.2.7";
const CT: &str = uids::CT_IMAGE_STORAGE;
const NO_DATA: [u8; 2] = [1, 1];

/// The other end of a connection.
struct Peer(TcpStream);

/// A command with its data set.
struct Message {
    context: u8,
    command: Vec<(Tag, Vec<u8>)>,
    data: Vec<u8>,
}

impl Message {
    fn get(&self, tag: Tag) -> &[u8] {
        self.command.iter().find(|e| e.0 == tag).map_or(&[], |e| &e.1)
    }

    fn field(&self) -> u16 {
        u16::from_le_bytes(self.get(tags::COMMAND_FIELD).try_into().unwrap())
    }
}

impl Peer {
    fn pdu(&mut self) -> Option<Pdu> {
        let mut bytes = vec![0; 6];
        self.0.read_exact(&mut bytes).ok()?;
        let length = u32::from_be_bytes(bytes[2..6].try_into().unwrap()) as usize;
        bytes.resize(6 + length, 0);
        self.0.read_exact(&mut bytes[6..]).ok()?;
        read_pdu(&bytes[..], 1 << 20, true).unwrap()
    }

    fn send(&mut self, pdu: &Pdu) {
        let mut bytes = Vec::new();
        write_pdu(&mut bytes, pdu).unwrap();
        // The other end may have gone.
        let _ = self.0.write_all(&bytes);
    }

    /// Accepts everything that is proposed.
    fn accept(&mut self) {
        let Some(Pdu::AssociationRQ(asked)) = self.pdu() else { return };
        let accepted = |c: &dicom_ul::pdu::PresentationContextProposed| PresentationContextResult {
            id: c.id,
            reason: PresentationContextResultReason::Acceptance,
            transfer_syntax: c.transfer_syntaxes[0].clone(),
        };
        self.send(&Pdu::AssociationAC(AssociationAC {
            protocol_version: 1,
            called_ae_title: asked.called_ae_title,
            calling_ae_title: asked.calling_ae_title,
            application_context_name: asked.application_context_name,
            presentation_contexts: asked.presentation_contexts.iter().map(accepted).collect(),
            user_variables: vec![UserVariableItem::MaxLength(4096)],
        }));
    }

    /// Receives the next message; `None` if the association ends.
    fn message(&mut self) -> Option<Message> {
        let mut message = Message { context: 0, command: Vec::new(), data: Vec::new() };
        let (mut command, mut wants_data) = (Vec::new(), false);
        loop {
            match self.pdu()? {
                Pdu::PData { data } => {
                    for value in data {
                        message.context = value.presentation_context_id;
                        if value.value_type == PDataValueType::Data {
                            message.data.extend(value.data);
                            if value.is_last {
                                return Some(message);
                            }
                            continue;
                        }
                        command.extend(value.data);
                        if value.is_last {
                            message.command = Elements::implicit(&command).map(|(t, v)| (t, v.to_vec())).collect();
                            wants_data = message.get(tags::COMMAND_DATA_SET_TYPE) != NO_DATA;
                        }
                    }
                    if !message.command.is_empty() && !wants_data {
                        return Some(message);
                    }
                }
                Pdu::ReleaseRQ => {
                    self.send(&Pdu::ReleaseRP);
                    return None;
                }
                _ => return None,
            }
        }
    }

    fn values(&mut self, context: u8, command: &[(Tag, &[u8])], data: Option<&[u8]>) {
        let mut bytes = Vec::new();
        command.iter().for_each(|(tag, value)| put_implicit(&mut bytes, *tag, value, 0));
        let value = |value_type, data: &[u8]| PDataValue {
            presentation_context_id: context,
            value_type,
            is_last: true,
            data: data.to_vec(),
        };
        let command = value(PDataValueType::Command, &bytes);
        let data = data.map(|d| value(PDataValueType::Data, d));
        self.send(&Pdu::PData { data: std::iter::once(command).chain(data).collect() });
    }

    /// Answers a command.
    fn answer(&mut self, asked: &Message, status: u16, data: Option<&[u8]>) {
        let field = (asked.field() | 0x8000).to_le_bytes();
        let has_data = if data.is_some() { [0, 0] } else { NO_DATA };
        let command: [(Tag, &[u8]); 4] = [
            (tags::COMMAND_FIELD, &field),
            (tags::MESSAGE_ID_BEING_RESPONDED_TO, asked.get(tags::MESSAGE_ID)),
            (tags::COMMAND_DATA_SET_TYPE, &has_data),
            (tags::STATUS, &status.to_le_bytes()),
        ];
        self.values(asked.context, &command, data);
    }

    /// Sends an object on the second context: the first one is the question's.
    fn store(&mut self, instance: &str) {
        let command: [(Tag, &[u8]); 5] = [
            (tags::AFFECTED_SOP_CLASS_UID, CT.as_bytes()),
            (tags::COMMAND_FIELD, &[1, 0]),
            (tags::MESSAGE_ID, &[9, 0]),
            (tags::COMMAND_DATA_SET_TYPE, &[0, 0]),
            (tags::AFFECTED_SOP_INSTANCE_UID, instance.as_bytes()),
        ];
        self.values(3, &command, Some(b"\x08\0\x60\0CS\x02\0CT"));
    }

    /// Answers questions about a study with a series of three instances until the association ends. Returns what else is asked.
    fn questions(&mut self) -> Option<Message> {
        loop {
            let asked = self.message()?;
            if asked.field() != 0x0020 {
                return Some(asked);
            }
            let keys: Vec<_> = Elements::implicit(&asked.data).map(|(t, v)| (t, text(v))).collect();
            let level = keys.iter().find(|k| k.0 == tags::QUERY_RETRIEVE_LEVEL).unwrap().1.clone();
            let instances = if level == "IMAGE" { 3 } else { 1 };
            for n in 1..=instances {
                let mut data = Vec::new();
                let uid = format!("1.2.7.{n}");
                let values: [(Tag, &str); 6] = [
                    (tags::SOP_CLASS_UID, CT),
                    (tags::SOP_INSTANCE_UID, &uid),
                    (tags::STUDY_DATE, "20250131"),
                    (tags::MODALITY, "CT"),
                    (tags::STUDY_INSTANCE_UID, "1.2"),
                    (tags::SERIES_INSTANCE_UID, SERIES),
                ];
                values.iter().for_each(|(tag, value)| put_implicit(&mut data, *tag, value.as_bytes(), 0));
                self.answer(&asked, 0xFF00, Some(&data));
            }
            self.answer(&asked, 0, None);
        }
    }
}

/// Starts an archive that does `work` on each connection, `connections` of them.
fn served(connections: usize, work: impl Fn(usize, Peer) + Send + 'static) -> (Archive, JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut archive = Archive::new("test", "127.0.0.1", listener.local_addr().unwrap().port(), "THERE");
    archive.answer_timeout = Duration::from_millis(300);
    let thread = std::thread::spawn(move || {
        for n in 0..connections {
            work(n, Peer(listener.accept().unwrap().0));
        }
    });
    (archive, thread)
}

/// What an archive's `echo` says that does `work` on its connection.
fn told(work: impl Fn(Peer) + Send + 'static) -> String {
    let (archive, thread) = served(1, move |_, peer| work(peer));
    let start = Instant::now();
    let e = archive.echo(&Progress::new()).unwrap_err();
    assert!(start.elapsed() < Duration::from_secs(2), "{e}");
    assert!(e.kind as u8 == 3 && e.what.starts_with("archive test (127.0.0.1:"), "{e}");
    thread.join().unwrap();
    e.to_string()
}

#[test]
fn an_archive_answers_or_the_error_says_why_not() {
    let (archive, thread) = served(1, |_, mut peer| {
        peer.accept();
        let asked = peer.message().unwrap();
        peer.answer(&asked, 0, None);
        assert!(peer.message().is_none());
    });
    archive.echo(&Progress::new()).unwrap();
    thread.join().unwrap();
    // Nobody listens there any more.
    let e = archive.echo(&Progress::new()).unwrap_err();
    assert!(e.why.starts_with("cannot be reached (") && e.kind as u8 == 3, "{e}");
    let e = Archive::new("a", "no host", 104, "A").echo(&Progress::new()).unwrap_err();
    assert!(e.why.starts_with("cannot be reached (") && e.kind as u8 == 3, "{e}");
    for (reason, word) in [
        (AssociationRJServiceUserReason::CalledAETitleNotRecognized, "its title is not THERE"),
        (AssociationRJServiceUserReason::CallingAETitleNotRecognized, "does not know COLVIS"),
        (AssociationRJServiceUserReason::NoReasonGiven, "no reason given"),
    ] {
        let refusal = Pdu::AssociationRJ(AssociationRJ {
            result: AssociationRJResult::Permanent,
            source: AssociationRJSource::ServiceUser(reason),
        });
        let said = told(move |mut peer| {
            peer.pdu();
            peer.send(&refusal);
        });
        assert!(said.contains("refuses the association") && said.contains(word), "{said}");
    }
    let said = told(|mut peer| {
        peer.accept();
        let asked = peer.message().unwrap();
        peer.answer(&asked, 0x0122, None);
    });
    assert!(said.contains("status 0122"), "{said}");
}

#[test]
fn silence_nonsense_and_endings_are_told() {
    for (word, work) in [
        ("has not answered for 0.3 s", (|mut peer| while peer.pdu().is_some() {}) as fn(Peer)),
        ("closed the connection", |mut peer| drop(peer.pdu())),
        ("something else than DICOM", |mut peer| {
            peer.pdu();
            peer.0.write_all(b"HTTP/1.1 400 Bad Request\r\n\r\n").unwrap();
        }),
        ("a PDU of 4294967295 bytes", |mut peer| {
            peer.pdu();
            peer.0.write_all(b"\x02\0\xff\xff\xff\xff").unwrap();
        }),
        ("a damaged acceptance", |mut peer| {
            peer.pdu();
            peer.0.write_all(b"\x02\0\0\0\0\x03abc").unwrap();
        }),
        ("does not support C-ECHO", |mut peer| {
            peer.pdu();
            let mut refused = vec![0; 68];
            refused.extend(b"\x21\0\0\x04\x01\0\x03\0");
            peer.0.write_all(&[&b"\x02\0\0\0\0\x4c"[..], &refused].concat()).unwrap();
        }),
        ("aborted the association", |mut peer| {
            peer.accept();
            peer.message();
            peer.0.write_all(b"\x07\0\0\0\0\x04\0\0\x02\0").unwrap();
        }),
        ("a damaged command", |mut peer| {
            peer.accept();
            peer.message();
            peer.0.write_all(b"\x04\0\0\0\0\x09\0\0\0\x05\x01\x03abc").unwrap();
        }),
        ("an answer to another question", |mut peer| {
            peer.accept();
            let mut asked = peer.message().unwrap();
            asked.command.retain(|e| e.0 != tags::MESSAGE_ID);
            peer.answer(&asked, 0, None);
        }),
        ("nothing but empty pieces", |mut peer| {
            peer.accept();
            peer.message();
            // The other end hangs up first.
            while peer.0.write_all(&b"\x04\0\0\0\0\0\x04\0\0\0\0\x06\0\0\0\x02\x01\x01".repeat(100)).is_ok() {}
        }),
    ] {
        let said = told(work);
        assert!(said.contains(word), "{said}");
    }
}

#[test]
fn drawn_bytes_are_errors_at_every_place() {
    let mut state = 1u64;
    let mut draw = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as u8
    };
    let folder = tempfile::tempdir().unwrap();
    for n in 0..60 {
        let head = if n % 2 == 0 { vec![4, 0, 0, 0, 0, 60, 0, 0, 0, 56, 1] } else { vec![4, 0, 0, 0, 0, 60] };
        let bytes: Vec<u8> = head.into_iter().chain((0..56 + 4 * (n % 3)).map(|_| draw())).collect();
        let (archive, thread) = served(1, move |_, mut peer| {
            peer.accept();
            if n % 4 == 0 {
                let _ = peer.message();
            }
            let _ = peer.0.write_all(&bytes);
        });
        let e = match n % 3 {
            0 => archive.echo(&Progress::new()).unwrap_err(),
            1 => archive.find(&Query::default(), 9, &Progress::new()).unwrap_err(),
            _ => archive.get(SERIES, folder.path(), &Progress::new()).unwrap_err(),
        };
        assert_eq!(e.kind as u8, 3, "{e}");
        drop(thread);
    }
    assert_eq!(names(folder.path()).len(), 0);
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn studies_are_listed_up_to_the_limit() {
    let (archive, thread) = served(1, |_, mut peer| {
        peer.accept();
        assert!(peer.questions().is_none());
    });
    let query = Query { patient: Some("doe".to_owned()), ..Query::default() };
    let found = archive.find(&query, 5, &Progress::new()).unwrap();
    thread.join().unwrap();
    assert!(!found.has_more && found.studies.len() == 1);
    let study = &found.studies[0];
    assert_eq!((&*study.uid, &*study.date, &*study.series[0].uid), ("1.2", "20250131", SERIES));
    // An archive that never stops.
    let (archive, thread) = served(2, |n, mut peer| {
        peer.accept();
        if n == 1 {
            assert!(peer.questions().is_none());
            return;
        }
        let asked = peer.message().unwrap();
        for n in 0..5000 {
            let mut data = Vec::new();
            put_implicit(&mut data, tags::STUDY_INSTANCE_UID, format!("1.2.{n}").as_bytes(), 0);
            peer.answer(&asked, 0xFF00, Some(&data));
        }
    });
    let found = archive.find(&Query::default(), 5, &Progress::new()).unwrap();
    assert!(found.has_more && found.studies.len() == 5);
    thread.join().unwrap();
    for bad in ["", "a\\b", "a\nb"] {
        let query = Query { patient: Some(bad.to_owned()), ..Query::default() };
        assert_eq!(archive.find(&query, 5, &Progress::new()).unwrap_err().kind as u8, 2);
    }
}

#[test]
fn an_archive_that_dies_halfway_is_gone_on_with() {
    let folder = tempfile::tempdir().unwrap();
    // Questions come on the connections with even numbers.
    let (archive, thread) = served(4, |n, mut peer| {
        peer.accept();
        let Some(asked) = peer.questions() else { return };
        let keys: Vec<_> = Elements::implicit(&asked.data).map(|(t, v)| (t, text(v))).collect();
        let list = keys.iter().find(|k| k.0 == tags::SOP_INSTANCE_UID).map(|k| k.1.clone());
        if n == 1 {
            assert_eq!(list, None, "all of the series");
            peer.store("1.2.7.1");
            peer.message();
            // Half an object.
            peer.0.write_all(b"\x04\0\0\0\0\xff\0\0").unwrap();
            return;
        }
        assert_eq!(list.as_deref(), Some("1.2.7.2\\1.2.7.3"), "only what is missing");
        for instance in ["1.2.7.2", "1.2.7.3", "1.2.7.99"] {
            peer.store(instance);
            assert_eq!(peer.message().unwrap().get(tags::STATUS), [0, 0]);
        }
        peer.answer(&asked, 0, None);
        assert!(peer.message().is_none());
    });
    let e = archive.get(SERIES, folder.path(), &Progress::new()).unwrap_err();
    assert!(e.kind as u8 == 3 && e.why.contains("1 of 3 instances are there"), "{e}");
    assert!(e.hint.contains("the same command goes on"), "{e}");
    assert_eq!(names(folder.path()), ["1.2.7.1.dcm"]);
    let progress = Progress::new();
    let got = archive.get(SERIES, folder.path(), &progress).unwrap();
    assert_eq!((got.instances, got.before), (3, 1));
    assert_eq!(progress.snapshot(), ("getting".to_owned(), 3, 3));
    assert_eq!(names(folder.path()), ["1.2.7.1.dcm", "1.2.7.2.dcm", "1.2.7.3.dcm"]);
    thread.join().unwrap();
}

#[test]
fn what_the_archive_does_not_send_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let (archive, thread) = served(2, |_, mut peer| {
        peer.accept();
        while let Some(asked) = peer.questions() {
            peer.answer(&asked, 0xA702, None);
        }
    });
    let e = archive.get(SERIES, folder.path(), &Progress::new()).unwrap_err();
    assert!(e.why.contains("0 of 3 instances") && e.why.contains("status A702, out of resources"), "{e}");
    thread.join().unwrap();
    // A name from the network is never a path.
    for bad in ["../../evil", "/tmp/evil", "", "..", "1.2\\3"] {
        let (archive, thread) = served(2, move |_, mut peer| {
            peer.accept();
            if peer.questions().is_some() {
                peer.store(bad);
            }
        });
        let e = archive.get(SERIES, folder.path(), &Progress::new()).unwrap_err();
        assert!(e.why.contains("an object without an identifier"), "{e}");
        thread.join().unwrap();
    }
    assert_eq!(names(folder.path()).len(), 0);
    assert_eq!(archive.get("../x", folder.path(), &Progress::new()).unwrap_err().kind as u8, 2);
}

#[test]
fn a_cancellation_ends_the_association_within_a_second() {
    let folder = tempfile::tempdir().unwrap();
    let (mut archive, thread) = served(2, |_, mut peer| {
        peer.accept();
        if peer.questions().is_some() {
            peer.store("1.2.7.1");
            peer.message();
            // It goes on with nothing until the association ends, properly.
            assert!(matches!(peer.pdu(), Some(Pdu::AbortRQ { .. })));
        }
    });
    archive.answer_timeout = Duration::from_secs(30);
    let progress = Progress::new();
    let worker = {
        let (archive, folder, progress) = (archive, folder.path().to_owned(), progress.clone());
        std::thread::spawn(move || archive.get(SERIES, &folder, &progress))
    };
    while progress.snapshot() != ("getting".to_owned(), 1, 3) {
        std::thread::sleep(Duration::from_millis(5));
    }
    let start = Instant::now();
    progress.cancel();
    let e = worker.join().unwrap().unwrap_err();
    assert!(start.elapsed() < Duration::from_secs(1) && e.kind as u8 == 4, "{e}");
    assert!(e.why.contains("interrupted; 1 of 3 instances are there"), "{e}");
    thread.join().unwrap();
}

/// Writes a file with an object of this number.
fn object(folder: &Path, n: usize) -> PathBuf {
    let path = folder.join(format!("{n}.dcm"));
    let head = file::Head {
        class: CT.to_owned(),
        instance: format!("1.2.7.{n}"),
        syntax: uids::EXPLICIT_VR_LITTLE_ENDIAN.to_owned(),
        data_at: 0,
    };
    let mut bytes = Vec::new();
    head.write("HERE", &mut bytes).unwrap();
    bytes.extend(b"\x08\0\x60\0CS\x02\0CT\xe0\x7f\x10\0OW\0\0");
    bytes.extend(20_000u32.to_le_bytes());
    bytes.resize(bytes.len() + 20_000, n as u8);
    std::fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn files_are_sent_and_those_that_are_not_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let files: Vec<PathBuf> = (0..4).map(|n| object(folder.path(), n)).collect();
    let answering = |statuses: [u16; 4]| {
        served(1, move |_, mut peer| {
            peer.accept();
            for status in statuses {
                let Some(asked) = peer.message() else { return };
                assert_eq!(asked.data.len(), 22 + 20_000, "as it is in the file, without its head");
                if status == 0xDEAD {
                    return;
                }
                peer.answer(&asked, status, None);
            }
            assert!(peer.message().is_none());
        })
    };
    let (archive, thread) = answering([0, 0, 0xB000, 0x0111]);
    let sent = archive.send(&files, &Progress::new()).unwrap();
    assert!(sent.stored == 4 && sent.remarks.len() == 1 && sent.remarks[0].contains("status B000"), "{sent:?}");
    thread.join().unwrap();
    let (archive, thread) = answering([0, 0xA700, 0, 0xDEAD]);
    let e = archive.send(&[folder.path().to_owned()], &Progress::new()).unwrap_err();
    assert!(e.kind as u8 == 5 && e.why.contains("closed the connection; 2 of 4 files are stored, not "), "{e}");
    assert!(e.why.contains("1.dcm (status A700, out of resources), 3.dcm") && e.hint.contains("it is safe"), "{e}");
    thread.join().unwrap();
    let note = folder.path().join("note.txt");
    std::fs::write(&note, "no DICOM").unwrap();
    for bad in [note, folder.path().join("none.dcm")] {
        let e = archive.send(&[files[0].clone(), bad], &Progress::new()).unwrap_err();
        assert_eq!(e.kind as u8, 3, "{e}");
    }
    assert_eq!(archive.send(&files, &Progress::new()).unwrap_err().kind as u8, 5, "nobody is there");
}

#[test]
fn uncompressed_files_are_sent_in_the_form_that_the_archive_takes() {
    let folder = tempfile::tempdir().unwrap();
    let path = object(folder.path(), 1);
    let (archive, thread) = served(1, |_, mut peer| {
        let Some(Pdu::AssociationRQ(asked)) = peer.pdu() else { return };
        let mut body = vec![0; 68];
        for context in asked.presentation_contexts {
            let syntax = uids::IMPLICIT_VR_LITTLE_ENDIAN;
            let refused = u8::from(context.transfer_syntaxes != [syntax]);
            body.extend([
                0x21,
                0,
                0,
                8 + syntax.len() as u8,
                context.id,
                0,
                refused,
                0,
                0x40,
                0,
                0,
                syntax.len() as u8,
            ]);
            body.extend(syntax.as_bytes());
        }
        let head = [&[2, 0][..], &(body.len() as u32).to_be_bytes()].concat();
        peer.0.write_all(&[head, body].concat()).unwrap();
        let asked = peer.message().unwrap();
        let elements: Vec<_> = Elements::implicit(&asked.data).collect();
        assert_eq!(elements[0], (tags::MODALITY, &b"CT"[..]));
        assert_eq!((elements[1].0, elements[1].1), (tags::PIXEL_DATA, &[1; 20_000][..]));
        peer.answer(&asked, 0, None);
        assert!(peer.message().is_none());
    });
    assert_eq!(archive.send(&[path], &Progress::new()).unwrap().stored, 1);
    thread.join().unwrap();
}
