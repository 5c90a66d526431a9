//! A scan that comes from an archive into the window, and its report that goes back there.

use colvis::volume::io::LoadOptions;

use super::findings::kept_when;
use super::*;
use crate::support::archives;
use crate::support::scan_study::{STUDY, write_scan};

/// Where the window shows the field for a patient and the first series that was found, pixels.
const PATIENT: (u32, u32) = (1030, 112);
const SERIES: (u32, u32) = (960, 177);

/// Returns the modalities of the series that an archive has of the study.
fn modalities(port: u16) -> Vec<String> {
    let keys = ["QueryRetrieveLevel=SERIES".to_owned(), format!("StudyInstanceUID={STUDY}"), "Modality".to_owned()];
    let keys = keys.iter().flat_map(|key| ["-k", key]);
    let output = Command::new("findscu")
        .args(["-S", "-aec", "ORTHANC"])
        .args(keys)
        .args(["127.0.0.1", &port.to_string()])
        .output();
    let output = output.unwrap();
    let said = [output.stdout, output.stderr].map(|t| String::from_utf8_lossy(&t).into_owned()).concat();
    let answers = said.lines().filter(|l| l.contains("(0008,0060) CS ["));
    let mut list: Vec<String> = answers.filter_map(|l| Some(l.split(['[', ']']).nth(1)?.trim().to_owned())).collect();
    list.sort();
    list
}

#[test]
#[ignore = "slow: a session in a window, and an archive"]
fn a_scan_comes_from_an_archive_and_its_report_goes_there() {
    let Some(screen) = Screen::open_with("1280x800x24", &[], &[]) else { return };
    let (Some(orthanc), Some(_)) = (archives::program("Orthanc"), archives::program("findscu")) else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (database, study) = (folder.join("database"), folder.join("study"));
    fs::create_dir(&database).unwrap();
    let archive = archives::orthanc(&orthanc, &database, &serde_json::json!({}));
    let port = archive.port;
    keep_settings(
        folder,
        &format!(
            "[keys]\nreport-send = [\"Ctrl+R\"]\n[archive.hospital]\nhost = \"127.0.0.1\"\nport = {port}\ntitle = \"ORTHANC\"\n"
        ),
    );
    let made = colvis()
        .args(["phantom", "--out", "scan.nii.gz", "--size", "small", "--with", "folds,polyps,noise", "--seed", "1"])
        .current_dir(folder)
        .status();
    assert!(made.unwrap().success());
    let scan = io::load(&folder.join("scan.nii.gz"), &LoadOptions::default(), &Progress::new()).unwrap().volume;
    write_scan(&scan, [false, true], "FFP", &study);
    let mut sending = colvis();
    sending.args(["archive", "send", "study"]).env("XDG_CONFIG_HOME", folder.join("config")).current_dir(folder);
    assert!(sending.output().unwrap().status.success());

    let args = ["fly", "--size", "1280x800", "--layout", "reading"];
    let mut window = screen.open_window(folder, &args, flies);
    screen.key("ctrl+o");
    std::thread::sleep(Duration::from_secs(2));
    screen
        .tool("xdotool", &["mousemove", &PATIENT.0.to_string(), &PATIENT.1.to_string(), "click", "1", "sleep", "0.3"]);
    screen.tool("xdotool", &["type", "--delay", "60", "feather"]);
    std::thread::sleep(Duration::from_secs(3));
    keep("archive searched", &screen.shot());
    screen.tool("xdotool", &["mousemove", &SERIES.0.to_string(), &SERIES.1.to_string(), "sleep", "0.3", "click", "1"]);
    let title = || {
        let ids = String::from_utf8(screen.tool("xdotool", &["search", "--name", "colvis"])).unwrap();
        String::from_utf8(screen.tool("xdotool", &["getwindowname", ids.lines().next().unwrap()])).unwrap()
    };
    // It is among the recent scans once it is open.
    let recent = || fs::read_to_string(folder.join("state/colvis/recent.json")).unwrap_or_default();
    screen.shot_when("the series", |i| {
        title().starts_with("1.2.826.0.1.99.2") && recent().contains("1.2.826.0.1.99.2") && flies(i)
    });
    let fetched = fs::read_dir(folder.join("state/colvis/archive/1.2.826.0.1.99.2")).unwrap().count();
    assert_eq!(fetched, scan.grid().dims()[2]);

    screen.key("space");
    screen.key("j");
    kept_when(folder, "a finding", |found| found["findings"].as_array().is_some_and(|list| list.len() == 1));
    assert_eq!(modalities(port), ["CT"]);
    screen.key("ctrl+r");
    screen.shot_when("the report in the archive", |_| modalities(port) == ["CT", "OT", "SEG", "SR"]);
    screen.key("ctrl+q");
    let status = window.wait();
    let (_, err) = window.output();
    assert!(status.success(), "{status}: {err}");
}
