//! `colvis batch`: a folder for each case, whole or not at all, and nothing done twice.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::support::program::colvis;
use crate::support::run::run;

/// A folder with two scans, one of which is there twice, and a file that is none.
struct Study {
    dir: tempfile::TempDir,
}

impl Study {
    fn new() -> Self {
        let study = Self { dir: tempfile::tempdir().unwrap() };
        for (seed, name) in [("1", "SMITH^JOHN.nii.gz"), ("2", "b, c.nii")] {
            run(&["phantom", "--out", &study.at(name), "--size", "small", "--with", "folds,fluid", "--seed", seed], 0);
        }
        fs::write(study.at("bad.nii"), "no scan").unwrap();
        study
    }

    fn at(&self, name: &str) -> String {
        self.dir.path().join(name).to_str().unwrap().to_owned()
    }

    /// Writes a manifest whose rows are the given lines.
    fn list(&self, rows: &[&str]) -> String {
        let text = format!("id,path,options\n{}\n", rows.join("\n"));
        fs::write(self.at("list.csv"), text).unwrap();
        self.at("list.csv")
    }

    fn case(&self, out: &str, id: &str) -> Value {
        let path = Path::new(&self.at(out)).join(id).join("case.json");
        serde_json::from_slice(&fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))).unwrap()
    }

    /// Returns everything in an output folder but what differs from run to run.
    fn lasting(&self, out: &str) -> BTreeMap<PathBuf, Vec<u8>> {
        fn add(folder: &Path, root: &Path, all: &mut BTreeMap<PathBuf, Vec<u8>>) {
            for entry in fs::read_dir(folder).unwrap().flatten() {
                let path = entry.path();
                if path.is_dir() {
                    add(&path, root, all);
                    continue;
                }
                let mut bytes = fs::read(&path).unwrap();
                if path.ends_with("case.json") {
                    let mut record: Value = serde_json::from_slice(&bytes).unwrap();
                    for (_, step) in record["steps"].as_object_mut().unwrap() {
                        assert!(step.as_object_mut().unwrap().remove("times").unwrap()["seconds"].as_f64() > Some(0.0));
                    }
                    bytes = serde_json::to_vec(&record).unwrap();
                }
                all.insert(path.strip_prefix(root).unwrap().to_owned(), bytes);
            }
        }
        let mut all = BTreeMap::new();
        add(Path::new(&self.at(out)), Path::new(&self.at(out)), &mut all);
        all
    }
}

fn said(out: &std::process::Output) -> String {
    String::from_utf8_lossy(&out.stdout).into_owned()
}

const ROWS: [&str; 3] = ["a,SMITH^JOHN.nii.gz,", "b,\"b, c.nii\",--from=rectum", "bad,bad.nii,"];
const STEPS: &str = "segment,centerline";

#[test]
fn cases_are_made_once_and_a_changed_option_repeats_its_steps() {
    let study = Study::new();
    let list = study.list(&["a,SMITH^JOHN.nii.gz,", "b,\"b, c.nii\",--method peel", ROWS[2]]);
    let batch = |list: &str, status: i32| run(&["batch", list, "--out", &study.at("out"), "--do", STEPS], status);
    let first = batch(&list, 4);
    assert!(said(&first).starts_with("3 cases: 2 done, 1 failed (1 input); 0 were known"), "{}", said(&first));
    let told = String::from_utf8_lossy(&first.stderr).into_owned();
    assert!(!told.contains("SMITH") && told.contains("a: done in") && told.contains("bad: failed (input)"), "{told}");

    let a = study.case("out", "a");
    assert_eq!((&a["state"], &a["version"]), (&"done".into(), &env!("CARGO_PKG_VERSION").into()));
    assert!(a["input"]["content"].as_str().unwrap().starts_with("sha256:") && a["input"]["voxels"].as_u64() > Some(0));
    let outputs = a["steps"]["segment"]["outputs"].as_object().unwrap();
    assert_eq!(outputs.keys().collect::<Vec<_>>(), ["outside.png", "segment.nii.gz"]);
    assert!(a["steps"]["segment"]["results"]["lumen_ml"].as_f64() > Some(0.0), "{a}");
    assert!(a["steps"]["segment"]["times"]["peak_rss_bytes"].as_u64() > Some(0), "{a}");
    assert!(!a.to_string().contains("SMITH"));
    let bad = study.case("out", "bad");
    assert_eq!((&bad["state"], &bad["failure"]["class"]), (&"failed".into(), &"input".into()));
    assert!(bad["failure"]["line"].as_str().unwrap().starts_with("SCAN: "), "{bad}");
    // The list of all ids, and nothing but ids.
    assert_eq!(fs::read_to_string(study.at("out/cases.csv")).unwrap(), "id\na\nb\nbad\n");
    // What a command alone writes.
    run(&["centerline", &study.at("SMITH^JOHN.nii.gz"), "--out", &study.at("alone.json")], 0);
    let made = fs::read(Path::new(&study.at("out")).join("a/centerline.json")).unwrap();
    assert!(made == fs::read(study.at("alone.json")).unwrap());

    // Nothing is done again, and nothing is touched.
    let before = study.lasting("out");
    let again = batch(&list, 4);
    assert!(said(&again).starts_with("3 cases: 2 done, 1 failed (1 input); 3 were known"), "{}", said(&again));
    assert_eq!(before, study.lasting("out"));

    // A changed option repeats one step of one case.
    let b = study.case("out", "b");
    let changed = study.list(&["a,SMITH^JOHN.nii.gz,", "b,\"b, c.nii\",", ROWS[2]]);
    assert!(said(&batch(&changed, 4)).contains("; 2 were known"));
    let now = study.case("out", "b");
    assert_eq!(now["steps"]["segment"], b["steps"]["segment"], "with its times");
    assert_ne!(now["steps"]["centerline"]["key"], b["steps"]["centerline"]["key"]);
    // So does a lost file; another scan repeats the case.
    fs::remove_file(Path::new(&study.at("out")).join("a/segment.nii.gz")).unwrap();
    assert!(said(&batch(&changed, 4)).contains("; 2 were known"));
    fs::copy(study.at("b, c.nii"), study.at("bad.nii")).unwrap();
    assert!(said(&batch(&changed, 0)).starts_with("3 cases: 3 done, 0 failed; 2 were known"));
    assert_eq!(study.case("out", "bad")["steps"]["segment"]["outputs"], now["steps"]["segment"]["outputs"]);
}

/// What the steps of a case share changes none of them, and a scan in another process of this program is the same.
#[test]
fn steps_that_share_a_scan_make_what_commands_make_alone() {
    let study = Study::new();
    let scan = study.at("tagged.nii");
    run(&["phantom", "--out", &scan, "--size", "small", "--with", "folds,polyps,pools,films,noise"], 0);
    let list = study.list(&["t,tagged.nii,--guide path", "f,tagged.nii,--from=rectum --cleanse"]);
    let out = study.at("out");
    run(&["batch", &list, "--out", &out, "--jobs", "1"], 4);
    assert_eq!(study.case("out", "f")["failure"]["class"], "usage", "only some of the steps begin at a named place");
    let case = study.case("out", "t");
    assert_eq!(case["state"], "done", "{case}");
    let alone = |name: &str, line: &[&str]| {
        let file = study.at(name);
        let mut line: Vec<&str> = line.to_vec();
        let at = line.iter().position(|a| *a == "OUT").unwrap();
        line[at] = &file;
        run(&line, 0);
        let made = fs::read(Path::new(&out).join("t").join(name)).unwrap();
        assert!(made == fs::read(&file).unwrap(), "{name}");
    };
    alone("segment.nii.gz", &["segment", &scan, "--out", "OUT"]);
    alone("centerline.json", &["centerline", &scan, "--out", "OUT"]);
    alone("cleansed.nii.gz", &["cleanse", &scan, "--out", "OUT"]);
    alone("candidates.json", &["candidates", &scan, "--out", "OUT"]);
    alone("surface.ply", &["surface", &scan, "--out", "OUT"]);
    alone("flight.jsonl", &["fly", &scan, "--headless", "--guide", "path", "--log", "OUT"]);
    let stats = study.at("stats.json");
    run(&["fly", &scan, "--headless", "--coverage", "--guide", "path", "--cleanse", "--stats", &stats], 0);
    let stats: Value = serde_json::from_slice(&fs::read(stats).unwrap()).unwrap();
    let made: Value = serde_json::from_slice(&fs::read(Path::new(&out).join("t/coverage.json")).unwrap()).unwrap();
    assert!(made["missed"].as_array().is_some() && made["wall_mm2"].as_f64() > Some(0.0), "{made}");
    for (name, value) in made.as_object().unwrap() {
        assert_eq!(value, &stats[name], "{name}");
    }
    let times = |step: &str| case["steps"][step]["times"]["prepare"]["lumen_s"].as_f64().unwrap_or_default();
    let all = ["segment", "centerline", "cleanse", "fly", "candidates", "coverage", "surface"].map(times);
    assert!(all.iter().filter(|s| **s > 1e-3).count() == 1, "the lumen is found once: {all:?}");
}

#[test]
fn shards_and_runs_that_were_killed_make_what_one_run_makes() {
    let study = Study::new();
    let list = study.list(&ROWS.map(|row| row.replace("--from=rectum", "")).each_ref().map(String::as_str));
    let batch = |out: &str, more: &[&str]| {
        let out = study.at(out);
        let line: Vec<&str> = [&["batch", &list, "--out", &out, "--do", STEPS][..], more].concat();
        colvis().args(&line).output().unwrap()
    };
    batch("one", &[]);
    for shard in ["1/3", "2/3", "3/3"] {
        batch("shards", &["--shard", shard, "--jobs", "2", "--memory", "4G"]);
    }
    let one = study.lasting("one");
    assert!(one == study.lasting("shards"));
    // Killed at several moments, without a chance to tidy up.
    for ms in [100, 300, 600, 1000, 2000] {
        let out = study.at("killed");
        let mut child = colvis()
            .args(["batch", &list, "--out", &out, "--do", STEPS, "--jobs", "1"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        thread::sleep(Duration::from_millis(ms));
        child.kill().unwrap();
        child.wait().unwrap();
        let entries = fs::read_dir(&out).into_iter().flatten().flatten();
        for case in entries.filter(|e| e.path().is_dir()) {
            let name = case.file_name().into_string().unwrap();
            assert!(name.starts_with(".work-") || case.path().join("case.json").is_file(), "{name}");
        }
    }
    batch("killed", &[]);
    assert!(one == study.lasting("killed"));
}

#[test]
fn a_case_that_takes_too_long_is_a_row_and_is_tried_again() {
    let study = Study::new();
    let list = study.list(&["a,SMITH^JOHN.nii.gz,", "gone,no-such.nii,", "wrong,\"b, c.nii\",--method nonsense"]);
    let out = study.at("out");
    let begun = Instant::now();
    let late = run(&["batch", &list, "--out", &out, "--do", "centerline", "--timeout", "0.01"], 4);
    assert!(begun.elapsed() < Duration::from_secs(60));
    assert!(said(&late).contains("timeout"), "{}", said(&late));
    assert_eq!(study.case("out", "a")["failure"]["class"], "timeout");
    // So is one that takes too much memory, where the system tells what it takes.
    if cfg!(target_os = "linux") {
        let large = run(&["batch", &list, "--out", &out, "--do", "centerline", "--memory", "1K"], 4);
        assert!(said(&large).contains("memory"), "{}", said(&large));
        assert_eq!(study.case("out", "a")["failure"]["class"], "memory");
    }
    let again = run(&["batch", &list, "--out", &out, "--do", "centerline"], 4);
    assert!(said(&again).starts_with("3 cases: 1 done, 2 failed (1 usage, 1 input)"), "{}", said(&again));
    assert_eq!(study.case("out", "a")["state"], "done");
    assert_eq!(study.case("out", "wrong")["failure"]["step"], "centerline");
}

/// What a scheduler asks for: one case a process, and what each will take.
#[test]
fn one_case_is_run_alone_and_a_plan_tells_what_each_takes() {
    let study = Study::new();
    let list =
        study.list(&["A 1,SMITH^JOHN.nii.gz,", "b,\"b, c.nii\",--max 3", "\"bad,1\",bad.nii,", "gone,gone.nii,"]);
    let batch = |more: &[&str], status: i32| {
        let out = study.at("out");
        let line = [&["batch", &list, "--out", &out, "--do", "segment"][..], more].concat();
        said(&run(&line, status))
    };
    let plan = || -> Vec<Value> { serde_json::from_str(&batch(&["--plan"], 0)).unwrap() };
    let before = plan();
    let ids: Vec<_> = before.iter().map(|c| c["id"].as_str().unwrap()).collect();
    assert_eq!(ids, ["A 1", "b", "bad,1", "gone"]);
    for case in &before {
        assert!(case["memory_bytes"].as_u64() > Some(1 << 20) && case["seconds"].as_f64() > Some(1.0), "{case}");
        assert!(case["state"].is_null() && !case.to_string().contains("SMITH"), "{case}");
    }
    assert!(!Path::new(&study.at("out")).exists(), "a plan makes nothing");

    assert!(batch(&["--only", "A 1"], 0).starts_with("1 cases: 1 done"));
    assert!(batch(&["--only", "bad,1", "--only", "A 1,gone"], 4).starts_with("3 cases: 1 done, 2 failed"));
    assert!(batch(&["--only", "A 1,other"], 2).is_empty());
    assert!(!Path::new(&study.at("out")).join("b").exists());
    let after = plan();
    assert_eq!(
        [&after[0]["state"], &after[1]["state"], &after[2]["class"]],
        [&"done".into(), &Value::Null, &"input".into()]
    );
    let took = study.case("out", "A 1")["steps"]["segment"]["times"]["peak_rss_bytes"].clone();
    assert_eq!(after[0]["memory_bytes"], took);
    // The key of a case changes with its scan and its options, and with nothing else.
    let keys = |plan: &[Value]| plan.iter().map(|c| c["key"].as_str().unwrap().to_owned()).collect::<Vec<_>>();
    assert_eq!(keys(&before), keys(&after));
    fs::copy(study.at("b, c.nii"), study.at("gone.nii")).unwrap();
    study.list(&["A 1,SMITH^JOHN.nii.gz,", "b,\"b, c.nii\",--max 4", "\"bad,1\",bad.nii,", "gone,gone.nii,"]);
    let is_changed: Vec<_> = keys(&plan()).iter().zip(keys(&after)).map(|(now, then)| *now != then).collect();
    assert_eq!(is_changed, [false, true, false, true]);
}

#[test]
fn lists_and_options_that_are_wrong_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (list, out) = (at("list.csv"), at("out"));
    run(&["batch", &list, "--out", &out], 3);
    fs::write(&list, "path\na.nii\n").unwrap();
    for wrong in [
        &["--shard", "0/2"][..],
        &["--shard", "3/2"],
        &["--shard", "1"],
        &["--jobs", "0"],
        &["--timeout", "0"],
        &["--timeout", "-1"],
        &["--memory", "much"],
        &["--do", "fold"],
        &["--only", "b"],
        &["--do", ""],
    ] {
        run(&[&["batch", &list, "--out", &out][..], wrong].concat(), 2);
    }
    assert!(!Path::new(&out).exists());
    fs::write(&out, "").unwrap();
    run(&["batch", &list, "--out", &out], 5);
    fs::write(&list, "path,id\na.nii,../x\n").unwrap();
    run(&["batch", &list, "--out", &at("other")], 3);
}
