//! `colvis archive`: against the archives of others, on this machine.

use std::fs;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::support::archives::{self, Running};
use crate::support::program::colvis;

/// Side of a slice, pixels.
const SIDE: usize = 64;

/// A folder with settings, files to send and files that were fetched.
struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Returns the path of a folder, which exists.
    fn folder(&self, name: &str) -> PathBuf {
        fs::create_dir_all(self.path(name)).unwrap();
        self.path(name)
    }

    /// Writes the settings: a name, a port and a title for each archive.
    fn settings(&self, archives: &[(&str, u16, &str)]) {
        let tables = archives.iter().map(|(name, port, title)| {
            format!("[archive.{name}]\nhost = \"127.0.0.1\"\nport = {port}\ntitle = \"{title}\"\nanswer_s = 20\n")
        });
        self.write_settings(&tables.collect::<String>());
    }

    fn write_settings(&self, text: &str) {
        fs::write(self.folder("colvis").join("settings.toml"), format!("version = 1\n{text}")).unwrap();
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = colvis();
        command.arg("archive").args(args).current_dir(self.0.path()).env("XDG_CONFIG_HOME", self.0.path());
        command
    }

    /// Runs the command. Every failure is one line, which is returned after what it printed.
    fn run(&self, args: &[&str], status: i32) -> (String, String) {
        judged(&self.command(args).output().unwrap(), status)
    }

    fn found(&self, args: &[&str]) -> Vec<Value> {
        let (out, _) = self.run(&[&["find"], args].concat(), 0);
        serde_json::from_str::<Value>(&out).unwrap()["studies"].as_array().unwrap().clone()
    }
}

fn judged(out: &Output, status: i32) -> (String, String) {
    let [printed, said] = [&out.stdout, &out.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
    assert_eq!(out.status.code(), Some(status), "{said}");
    let errors = said.lines().filter(|l| l.starts_with("error: ")).count();
    assert!(errors == usize::from(status != 0) && said.lines().all(|l| !l.contains("panicked")), "{said}");
    (printed, said)
}

/// A series to send.
#[derive(Clone, Copy)]
struct Sent {
    study: &'static str,
    series: &'static str,
    /// Name, in Latin 1, and identifier of the patient.
    patient: [&'static [u8]; 2],
    date: &'static str,
    description: [&'static str; 2],
    modality: &'static str,
    count: usize,
}

const FIRST: Sent = Sent {
    study: "1.2.9.1",
    series: "1.2.9.1.1",
    patient: [b"M\xfcller^Jane", b"ID7"],
    date: "20250131",
    description: ["CT Colon", "supine thin"],
    modality: "CT",
    count: 6,
};
const SECOND: Sent = Sent {
    study: "1.2.9.2",
    series: "1.2.9.2.1",
    patient: [b"Roe^Rick", b"ID8"],
    date: "20240131",
    description: ["CT Abdomen", "prone"],
    modality: "CT",
    count: 2,
};
/// Not CT: it is not listed.
const OTHER: Sent = Sent { study: "1.2.9.3", series: "1.2.9.3.1", modality: "MR", count: 1, ..SECOND };

impl Sent {
    fn uid(&self, n: usize) -> String {
        format!("{}.{}", self.series, n + 1)
    }

    fn pixels(n: usize) -> Vec<u8> {
        (0..SIDE * SIDE * 2).map(|i| (i * (n + 3) % 251) as u8).collect()
    }

    /// Writes the series into a folder, a file a slice.
    fn write(&self, folder: &Path) {
        const CLASS: &str = "1.2.840.10008.5.1.4.1.1.2";
        for n in 0..self.count {
            let uid = self.uid(n);
            let mut meta = Vec::new();
            put(&mut meta, 0x0002_0001, b"OB", &[0, 1]);
            put(&mut meta, 0x0002_0002, b"UI", CLASS.as_bytes());
            put(&mut meta, 0x0002_0003, b"UI", uid.as_bytes());
            put(&mut meta, 0x0002_0010, b"UI", b"1.2.840.10008.1.2.1");
            let mut file = vec![0; 128];
            file.extend(b"DICM");
            put(&mut file, 0x0002_0000, b"UL", &(meta.len() as u32).to_le_bytes());
            file.extend(meta);
            let (position, number) = (format!("0\\0\\{n}"), (n + 1).to_string());
            let side = (SIDE as u16).to_le_bytes();
            let elements: [(u32, &[u8; 2], &[u8]); 29] = [
                (0x0008_0005, b"CS", b"ISO_IR 100"),
                (0x0008_0016, b"UI", CLASS.as_bytes()),
                (0x0008_0018, b"UI", uid.as_bytes()),
                (0x0008_0020, b"DA", self.date.as_bytes()),
                (0x0008_0060, b"CS", self.modality.as_bytes()),
                (0x0008_1030, b"LO", self.description[0].as_bytes()),
                (0x0008_103E, b"LO", self.description[1].as_bytes()),
                (0x0010_0010, b"PN", self.patient[0]),
                (0x0010_0020, b"LO", self.patient[1]),
                (0x0018_0050, b"DS", b"1"),
                (0x0018_5100, b"CS", b"HFS"),
                (0x0020_000D, b"UI", self.study.as_bytes()),
                (0x0020_000E, b"UI", self.series.as_bytes()),
                (0x0020_0010, b"SH", b"1"),
                (0x0020_0011, b"IS", b"3"),
                (0x0020_0013, b"IS", number.as_bytes()),
                (0x0020_0032, b"DS", position.as_bytes()),
                (0x0020_0037, b"DS", b"1\\0\\0\\0\\1\\0"),
                (0x0028_0002, b"US", &[1, 0]),
                (0x0028_0004, b"CS", b"MONOCHROME2"),
                (0x0028_0010, b"US", &side),
                (0x0028_0011, b"US", &side),
                (0x0028_0030, b"DS", b"0.7\\0.7"),
                (0x0028_0100, b"US", &[16, 0]),
                (0x0028_0101, b"US", &[16, 0]),
                (0x0028_0102, b"US", &[15, 0]),
                (0x0028_0103, b"US", &[1, 0]),
                (0x0028_1052, b"DS", b"-1024"),
                (0x0028_1053, b"DS", b"1"),
            ];
            elements.iter().for_each(|(tag, vr, value)| put(&mut file, *tag, vr, value));
            put(&mut file, 0x7FE0_0010, b"OW", &Self::pixels(n));
            fs::write(folder.join(format!("{n}.dcm")), file).unwrap();
        }
    }

    /// Checks that a folder has the series, and nothing else, with the pixels that were sent.
    fn check_in(&self, folder: &Path) {
        let mut names: Vec<String> = (0..self.count).map(|n| format!("{}.dcm", self.uid(n))).collect();
        names.sort();
        assert_eq!(written(folder).into_iter().map(|f| f.0).collect::<Vec<_>>(), names);
        for n in 0..self.count {
            self.check(n, &folder.join(format!("{}.dcm", self.uid(n))));
        }
    }

    /// Checks a file with a slice: its pixels stand at the end.
    fn check(&self, n: usize, path: &Path) {
        let bytes = fs::read(path).unwrap();
        assert!(bytes.ends_with(&Self::pixels(n)), "{}", path.display());
    }
}

/// Writes an element with its representation.
fn put(out: &mut Vec<u8>, tag: u32, vr: &[u8; 2], value: &[u8]) {
    let length = value.len().next_multiple_of(2);
    out.extend(((tag >> 16) as u16).to_le_bytes());
    out.extend((tag as u16).to_le_bytes());
    out.extend(vr);
    if matches!(vr, b"OB" | b"OW") {
        out.extend([0, 0]);
        out.extend((length as u32).to_le_bytes());
    } else {
        out.extend((length as u16).to_le_bytes());
    }
    out.extend(value);
    out.resize(out.len() + length - value.len(), if vr == b"UI" { 0 } else { b' ' });
}

/// Name, inode and time of a file, ns: one that is written again has others.
type Written = (String, u64, i64);

/// The files of a folder.
fn written(folder: &Path) -> Vec<Written> {
    let facts = |e: fs::DirEntry| {
        let data = e.metadata().unwrap();
        (e.file_name().to_string_lossy().into_owned(), data.ino(), 1_000_000_000 * data.mtime() + data.mtime_nsec())
    };
    let mut all: Vec<Written> = fs::read_dir(folder).unwrap().map(|e| facts(e.unwrap())).collect();
    all.sort();
    all
}

#[test]
fn the_settings_name_the_archive_or_the_error_says_how() {
    let place = Place::new();
    let (_, said) = place.run(&["echo"], 2);
    assert!(said.contains("settings.toml") && said.contains("`archive --help` shows how"), "{said}");
    assert!(place.run(&["--help"], 0).0.contains("[archive.hospital]"));
    place.settings(&[("one", 1, "A"), ("two", 1, "B")]);
    for (args, status, word) in [
        (&["echo"][..], 2, "name one of one, two"),
        (&["echo", "three"], 2, "name one of one, two"),
        (&["echo", "one", "two"], 2, "a second name"),
        (&["echo", "one"], 3, "archive one (127.0.0.1:1): cannot be reached (connection refused"),
        (&["find", "two", "--date", "2025"], 2, "--date 2025"),
        (&["find", "two", "--patient", ""], 2, "--patient"),
        (&["find", "two", "--out", "x/"], 2, "--out: belongs to `archive get`"),
        (&["echo", "two", "--patient", "x"], 2, "--patient: belongs to `archive find`"),
        (&["get", "two", "--out", "x/"], 2, "--series is missing"),
        (&["get", "two", "--series", "1.2"], 2, "--out is missing"),
        (&["get", "two", "--series", "1..2", "--out", "x/"], 2, "is not the identifier of a series"),
        (&["send", "two"], 2, "no file is named"),
        (&["send", "two", "none.dcm"], 3, "none.dcm: cannot be read"),
        (&["send", "two", "colvis/settings.toml"], 3, "is no DICOM file"),
        (&["send", "two", "colvis"], 3, "has no DICOM file"),
        (&["warp"], 2, "warp"),
    ] {
        let (_, said) = place.run(args, status);
        assert!(said.contains(word), "{args:?}: {said}");
    }
    FIRST.write(&place.folder("first"));
    let (_, said) = place.run(&["send", "two", "first"], 5);
    assert!(said.contains("cannot be reached") && said.contains("0 of 6 files are stored"), "{said}");
    for (settings, status, word) in [
        ("[archive.a]\nhost = \"h\"", 3, "line 2: missing field `port`"),
        ("[archive.a]\nhost = \"h\"\nport = 104\ntitle = \"T\"\npassword = \"p\"", 3, "password"),
        ("[archive.a]\nhost = \"h\"\nport = 0\ntitle = \"T\"", 2, "archive.a.port: is 0"),
        ("[archive.a]\nhost = \"h\"\nport = 104\ntitle = \"LONGER THAN SIXTEEN\"", 2, "archive.a.title"),
        ("[archive.a]\nhost = \"h\"\nport = 104\ntitle = \"T\"\nanswer_s = -1", 2, "archive.a.answer_s"),
        (
            "[archive.a]\nhost = \"h\"\nport = 104\ntitle = \"T\"\ntls = { ca = \"none.pem\" }",
            2,
            "none.pem: cannot be read",
        ),
        ("[archive.a]\nhost = \"h\"\nport = 104\ntitle = \"T\"\ntls = { ca = \"settings.toml\" }", 2, "no certificate"),
        (
            "[archive.a]\nhost = \"h\"\nport = 104\ntitle = \"T\"\ntls = { ca = \"a\", key = \"b\" }",
            2,
            "one of cert and key",
        ),
    ] {
        place.write_settings(settings);
        let (_, said) = place.run(&["echo"], status);
        assert!(said.contains(word), "{settings}: {said}");
    }
}

#[test]
fn studies_are_found_in_orthanc_by_patient_date_and_description() {
    let Some(program) = archives::program("Orthanc") else { return };
    let place = Place::new();
    let running = archives::orthanc(&program, &place.folder("storage"), &json!({}));
    place.settings(&[("it", running.port, "ORTHANC"), ("wrong", running.port, "NOBODY")]);
    assert_eq!(place.run(&["echo", "it"], 0).0, format!("it answers as ORTHANC at 127.0.0.1:{}\n", running.port));
    let (_, said) = place.run(&["echo", "wrong"], 3);
    assert!(said.contains("called AE title not recognized") && said.contains("correct `title`"), "{said}");
    assert_eq!(place.found(&["it"]).len(), 0);
    for (name, sent) in [("first", FIRST), ("second", SECOND), ("other", OTHER)] {
        sent.write(&place.folder(name));
    }
    assert_eq!(place.run(&["send", "it", "first", "second", "other"], 0).0, "9 files are in it\n");
    let all = place.found(&["it"]);
    let series = |s: &Sent| json!([{ "series": s.series, "number": 3, "description": s.description[1], "modality": "CT", "instances": s.count }]);
    let first = json!({
        "study": FIRST.study, "patient_name": "Müller^Jane", "patient_id": "ID7", "date": "20250131", "description": "CT Colon",
        "series": series(&FIRST),
    });
    assert_eq!((all.len(), &all[0], &all[1]["series"]), (2, &first, &series(&SECOND)), "latest first");
    for (args, studies) in [
        (&["--patient", "müller"][..], &[FIRST.study][..]),
        (&["--patient", "*R*"], &[FIRST.study, SECOND.study]),
        (&["--patient", "ID8"], &[SECOND.study]),
        (&["--patient", "nobody"], &[]),
        (&["--date", "20250101-"], &[FIRST.study]),
        (&["--date", "-20241231"], &[SECOND.study]),
        (&["--date", "20240131-20250131"], &[FIRST.study, SECOND.study]),
        (&["--date", "20240130"], &[]),
        (&["--description", "colon"], &[FIRST.study]),
        (&["--description", "pron?"], &[SECOND.study]),
        (&["--description", "ct*", "--patient", "roe"], &[SECOND.study]),
    ] {
        let found: Vec<Value> = place.found(&[&["it"], args].concat()).iter().map(|s| s["study"].clone()).collect();
        assert_eq!(found, studies, "{args:?}");
    }
    let (_, said) = place.run(&["find", "it", "--max", "1"], 0);
    assert!(said.contains("note: it has more studies"), "{said}");
    place.run(&["send", "it", "first", "second/0.dcm"], 0);
    assert_eq!(place.found(&["it"])[0], first, "sending again is safe");
}

#[test]
fn a_series_is_fetched_from_orthanc_and_only_what_is_missing() {
    let Some(program) = archives::program("Orthanc") else { return };
    let place = Place::new();
    let running = archives::orthanc(&program, &place.folder("storage"), &json!({}));
    place.settings(&[("it", running.port, "ORTHANC")]);
    FIRST.write(&place.folder("first"));
    place.run(&["send", "it", "first"], 0);
    let get = ["get", "it", "--series", FIRST.series, "--out", "got/"];
    assert_eq!(place.run(&get, 0).0, "6 instances are in got/\n");
    let got = place.path("got");
    FIRST.check_in(&got);
    let info = colvis().arg("info").arg(&got).output().unwrap();
    let info: Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!(info["dims"], json!([SIDE, SIDE, 6]), "the folder opens");
    // What is there is not asked for again; what is missing or damaged is.
    let before = written(&got);
    assert_eq!(place.run(&get, 0).0, "6 instances are in got/, 6 of them before\n");
    assert_eq!(written(&got), before);
    fs::remove_file(got.join(format!("{}.dcm", FIRST.uid(1)))).unwrap();
    let damaged = got.join(format!("{}.dcm", FIRST.uid(4)));
    let bytes = fs::read(&damaged).unwrap();
    fs::write(&damaged, &bytes[..bytes.len() - 9]).unwrap();
    assert_eq!(place.run(&get, 0).0, "6 instances are in got/, 4 of them before\n");
    FIRST.check_in(&got);
    let same = written(&got).into_iter().filter(|f| before.contains(f)).count();
    assert_eq!(same, 4);
    let (_, said) = place.run(&["get", "it", "--series", "1.2.3", "--out", "none/"], 3);
    assert!(said.contains("has no series 1.2.3"), "{said}");
}

/// What stands between the program and an archive, and lets only so many bytes through.
struct Relay {
    port: u16,
    /// Bytes that the archive may still send.
    budget: Arc<AtomicI64>,
    /// True once connections are cut.
    is_cut: Arc<AtomicBool>,
}

impl Relay {
    fn to(port: u16, budget: i64) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let relay = Self {
            port: listener.local_addr().unwrap().port(),
            budget: Arc::new(AtomicI64::new(budget)),
            is_cut: Arc::default(),
        };
        let (budget, is_cut) = (Arc::clone(&relay.budget), Arc::clone(&relay.is_cut));
        std::thread::spawn(move || {
            for here in listener.incoming().map_while(Result::ok) {
                let Ok(there) = TcpStream::connect(("127.0.0.1", port)) else { continue };
                let (mut asked, mut asking) = (there.try_clone().unwrap(), here.try_clone().unwrap());
                std::thread::spawn(move || {
                    let _ = std::io::copy(&mut asking, &mut asked);
                    let _ = asked.shutdown(Shutdown::Both);
                });
                let (budget, is_cut) = (Arc::clone(&budget), Arc::clone(&is_cut));
                std::thread::spawn(move || pass(there, here, &budget, &is_cut));
            }
        });
        relay
    }
}

fn pass(mut from: TcpStream, mut to: TcpStream, budget: &AtomicI64, is_cut: &AtomicBool) {
    let mut bytes = [0; 4096];
    while let Ok(n @ 1..) = from.read(&mut bytes) {
        while budget.load(Ordering::Relaxed) < n as i64 && !is_cut.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(2));
        }
        budget.fetch_sub(n as i64, Ordering::Relaxed);
        if is_cut.load(Ordering::Relaxed) || to.write_all(&bytes[..n]).is_err() {
            break;
        }
    }
    let _ = to.shutdown(Shutdown::Both);
    let _ = from.shutdown(Shutdown::Both);
}

/// An Orthanc with the first series, behind a relay that stalls halfway through it.
fn halfway(place: &Place, program: &Path) -> (Running, Relay) {
    let running = archives::orthanc(program, &place.folder("storage"), &json!({}));
    place.settings(&[("it", running.port, "ORTHANC")]);
    FIRST.write(&place.folder("first"));
    place.run(&["send", "first"], 0);
    // Three slices and a half, and what is said about them.
    let relay = Relay::to(running.port, 3 * 10_000);
    place.settings(&[("it", relay.port, "ORTHANC")]);
    (running, relay)
}

/// Waits until a folder has some whole slices and no more come.
fn wait_for_some(folder: &Path) -> Vec<Written> {
    let start = Instant::now();
    let mut before = Vec::new();
    loop {
        assert!(start.elapsed() < Duration::from_secs(20));
        std::thread::sleep(Duration::from_millis(100));
        let all = if folder.is_dir() { written(folder) } else { Vec::new() };
        let whole: Vec<_> = all.into_iter().filter(|f| f.0.ends_with(".dcm")).collect();
        if whole.len() >= 2 && whole == before {
            return whole;
        }
        before = whole;
    }
}

const GET: [&str; 5] = ["get", "--series", FIRST.series, "--out", "got/"];

#[test]
fn a_killed_transfer_is_gone_on_with() {
    let Some(program) = archives::program("Orthanc") else { return };
    let place = Place::new();
    let (running, relay) = halfway(&place, &program);
    let mut child = place.command(&GET).stdout(Stdio::null()).spawn().unwrap();
    let before = wait_for_some(&place.path("got"));
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(before.len() < FIRST.count);
    // What is half there has no slice's name, so the folder opens.
    let info = colvis().arg("info").arg(place.path("got")).output().unwrap();
    let info: Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!(info["dims"][2], before.len());
    relay.budget.store(i64::MAX / 2, Ordering::Relaxed);
    let told = place.run(&GET, 0).0;
    assert_eq!(told, format!("6 instances are in got/, {} of them before\n", before.len()));
    FIRST.check_in(&place.path("got"));
    let after = written(&place.path("got"));
    assert!(before.iter().all(|f| after.contains(f)), "only the missing ones have come");
    drop(running);
}

#[test]
fn an_archive_that_is_killed_halfway_is_one_line_and_the_same_command_goes_on() {
    let Some(program) = archives::program("Orthanc") else { return };
    let place = Place::new();
    let (mut running, relay) = halfway(&place, &program);
    let child = place.command(&GET).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let before = wait_for_some(&place.path("got"));
    running.kill();
    relay.is_cut.store(true, Ordering::Relaxed);
    let (_, said) = judged(&child.wait_with_output().unwrap(), 3);
    assert!(said.contains(&format!("{} of 6 instances are there", before.len())), "{said}");
    assert!(said.contains("the same command goes on"), "{said}");
    assert_eq!(written(&place.path("got")), before, "no half file is left");
    let running = archives::orthanc(&program, &place.folder("storage"), &json!({}));
    place.settings(&[("it", running.port, "ORTHANC")]);
    place.run(&GET, 0);
    FIRST.check_in(&place.path("got"));
    let after = written(&place.path("got"));
    assert!(before.iter().all(|f| after.contains(f)));
}

#[test]
fn an_interrupted_transfer_ends_with_its_own_status() {
    let Some(program) = archives::program("Orthanc") else { return };
    let place = Place::new();
    let (_running, _relay) = halfway(&place, &program);
    let child = place.command(&GET).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let before = wait_for_some(&place.path("got"));
    let start = Instant::now();
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let (_, said) = judged(&child.wait_with_output().unwrap(), 4);
    assert!(start.elapsed() < Duration::from_secs(1), "{:?}", start.elapsed());
    assert!(said.contains(&format!("interrupted; {} of 6 instances are there", before.len())), "{said}");
    assert_eq!(written(&place.path("got")), before);
}

#[test]
fn storescp_is_sent_to_in_the_form_that_it_takes() {
    let Some(storescp) = archives::program("storescp") else { return };
    let place = Place::new();
    FIRST.write(&place.folder("first"));
    // It takes one form only: the files are in the other.
    for (name, more) in [("as-sent", &["+xe"][..]), ("implicit", &["+xi"])] {
        let folder = place.folder(name);
        let running = archives::storescp(&storescp, &folder, more);
        place.settings(&[("scp", running.port, "ANY")]);
        place.run(&["echo"], 0);
        assert_eq!(place.run(&["send", "first"], 0).0, "6 files are in scp\n");
        for n in 0..FIRST.count {
            FIRST.check(n, &folder.join(format!("CT.{}", FIRST.uid(n))));
        }
        let (_, said) = place.run(&["find"], 3);
        assert!(said.contains("does not support C-FIND"), "{said}");
    }
}

#[test]
fn dcmqrscp_is_asked_read_and_sent_to() {
    let Some(dcmqrscp) = archives::program("dcmqrscp") else { return };
    let place = Place::new();
    FIRST.write(&place.folder("first"));
    SECOND.write(&place.folder("second"));
    let running = archives::dcmqrscp(&dcmqrscp, &place.folder("qr"));
    place.settings(&[("qr", running.port, "QRSCP")]);
    place.run(&["send", "first", "second"], 0);
    assert_eq!(place.found(&[]).len(), 2);
    assert_eq!(place.found(&["--patient", "Roe"])[0]["study"], SECOND.study);
    place.run(&GET, 0);
    FIRST.check_in(&place.path("got"));
    let before = written(&place.path("got"));
    fs::remove_file(place.path("got").join(format!("{}.dcm", FIRST.uid(2)))).unwrap();
    place.run(&GET, 0);
    FIRST.check_in(&place.path("got"));
    assert_eq!(written(&place.path("got")).iter().filter(|f| before.contains(f)).count(), 5);
}

#[test]
fn a_connection_is_encrypted_and_both_ends_are_known() {
    let [Some(program), Some(openssl)] = ["Orthanc", "openssl"].map(archives::program) else { return };
    let place = Place::new();
    let folder = place.folder("colvis");
    let make = |args: &[&str]| {
        let out = Command::new(&openssl).args(args).current_dir(&folder).output().unwrap();
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    };
    let key = ["req", "-x509", "-nodes", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-days", "2"];
    for ca in ["ca", "stranger"] {
        let files = ["-keyout", &format!("{ca}.key"), "-out", &format!("{ca}.pem"), "-subj", &format!("/CN={ca}")];
        make(&[&key[..], &files].concat());
    }
    for (name, host) in [("archive", "archive.local"), ("own", "colvis")] {
        let (keys, cert) = (format!("{name}.key"), format!("{name}.pem"));
        let of =
            ["-keyout", &keys, "-out", &cert, "-subj", &format!("/CN={host}"), "-CA", "ca.pem", "-CAkey", "ca.key"];
        let names = ["-addext", &format!("subjectAltName=DNS:{host}"), "-addext", "basicConstraints=critical,CA:FALSE"];
        make(&[&key[..], &of, &names].concat());
    }
    let running = archives::orthanc(
        &program,
        &place.folder("storage"),
        &json!({
            "DicomTlsEnabled": true, "DicomTlsRemoteCertificateRequired": true,
            "DicomTlsCertificate": folder.join("archive.pem"), "DicomTlsPrivateKey": folder.join("archive.key"),
            "DicomTlsTrustedCertificates": folder.join("ca.pem"),
        }),
    );
    let settings = |tls: &str| {
        let port = running.port;
        let table = format!("[archive.it]\nhost = \"127.0.0.1\"\nport = {port}\ntitle = \"ORTHANC\"\nanswer_s = 5\n");
        place.write_settings(&format!("{table}{tls}"));
    };
    let tls = "[archive.it.tls]\nca = \"ca.pem\"\ncert = \"own.pem\"\nkey = \"own.key\"\nname = \"archive.local\"\n";
    settings(tls);
    place.run(&["echo"], 0);
    FIRST.write(&place.folder("first"));
    place.run(&["send", "first"], 0);
    place.run(&GET, 0);
    FIRST.check_in(&place.path("got"));
    for (tls, word) in [
        (tls.replace("ca.pem", "stranger.pem"), "cannot be encrypted (invalid peer certificate"),
        (tls.replace("archive.local", "elsewhere.local"), "cannot be encrypted (invalid peer certificate"),
        (tls.replace("cert = \"own.pem\"\nkey = \"own.key\"\n", ""), "archive it"),
        (String::new(), "archive it"),
    ] {
        settings(&tls);
        let (_, said) = place.run(&["echo"], 3);
        assert!(said.contains(word), "{said}");
    }
}
