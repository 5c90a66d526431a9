//! `colvis batch --group`: the table and the page of many cases, and what is missing, extra, there twice or broken.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::support::run::run;

/// A folder with a batch of four scans, two of which are the same, and a file that is none.
struct Study {
    dir: tempfile::TempDir,
}

impl Study {
    fn new() -> Self {
        let study = Self { dir: tempfile::tempdir().unwrap() };
        for (seed, name) in [("1", "SMITH^JOHN.nii.gz"), ("2", "b.nii"), ("3", "c.nii")] {
            run(&["phantom", "--out", &study.at(name), "--size", "small", "--with", "folds,fluid", "--seed", seed], 0);
        }
        fs::copy(study.at("SMITH^JOHN.nii.gz"), study.at("copy.nii.gz")).unwrap();
        fs::write(study.at("bad.nii"), "no scan").unwrap();
        fs::write(
            study.at("list.csv"),
            "id,path\n=a,SMITH^JOHN.nii.gz\nb,b.nii\nc & c,copy.nii.gz\nbad,bad.nii\nlate,c.nii\n",
        )
        .unwrap();
        study
    }

    fn at(&self, name: &str) -> String {
        self.dir.path().join(name).to_str().unwrap().to_owned()
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn batch(&self) {
        run(&["batch", &self.at("list.csv"), "--out", &self.at("out"), "--do", "segment,centerline"], 4);
    }

    /// The table of a report: cells by id and column.
    fn table(&self, report: &str) -> BTreeMap<String, BTreeMap<String, String>> {
        let mut rows = csv::Reader::from_path(self.path(report).join("cases.csv")).unwrap();
        let columns: Vec<String> = rows.headers().unwrap().iter().map(str::to_owned).collect();
        let row = |row: csv::StringRecord| {
            (row[0].to_owned(), columns.iter().cloned().zip(row.iter().map(str::to_owned)).collect())
        };
        rows.records().map(|r| row(r.unwrap())).collect()
    }

    fn page(&self, report: &str) -> String {
        fs::read_to_string(self.path(report).join("index.html")).unwrap()
    }
}

/// All files below a folder with their bytes.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        if path.is_dir() {
            all.extend(files(&path));
        } else {
            all.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    all
}

#[test]
fn a_batch_becomes_a_table_and_a_page() {
    let study = Study::new();
    study.batch();
    let before = files(&study.path("out"));
    let said = run(&["batch", "--group", &study.at("out"), "--out", &study.at("report")], 0);
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    assert_eq!(said, "5 cases: 4 done, 1 failed; 0 not in the list, 1 scan is there twice\n");
    let table = study.table("report");
    assert_eq!(table.keys().collect::<Vec<_>>(), ["'=a", "b", "bad", "c & c", "late"]);
    let record: serde_json::Value =
        serde_json::from_slice(&fs::read(study.path("out").join("b/case.json")).unwrap()).unwrap();
    let results = |step: &str, name: &str| record["steps"][step]["results"][name].as_f64().unwrap();
    let b = &table["b"];
    for (column, expected) in [
        ("length_mm", results("centerline", "length_mm")),
        ("caliber_mm", results("centerline", "caliber_mm")),
        ("lumen_ml", results("segment", "lumen_ml")),
        ("voxels", record["input"]["voxels"].as_f64().unwrap()),
    ] {
        assert_eq!(b[column].parse::<f64>().unwrap(), expected, "{column}");
    }
    assert_eq!([&*b["state"], &b["listed"], &b["coverage"], &b["class"]], ["done", "yes", "", ""]);
    assert!(b["seconds"].parse::<f64>().unwrap() > 0.0 && b["segment_peak_bytes"].parse::<f64>().unwrap() > 1e6);
    assert_eq!([&*table["bad"]["state"], &table["bad"]["class"], &table["bad"]["picture"]], ["failed", "input", ""]);
    assert!(table["bad"]["error"].starts_with("SCAN: "));
    let picture = fs::read(study.path("report").join(&b["picture"])).unwrap();
    assert_eq!(picture, fs::read(study.path("out").join("b/outside.png")).unwrap());
    let page = study.page("report");
    for text in [
        "Batch of 5 cases",
        "failed: 1 input",
        "=a</a> = <a href=\"#c3\">c &amp; c</a>",
        "loading=\"lazy\"",
        &b["picture"],
    ] {
        assert!(page.contains(text), "{text}");
    }
    // The same again, also with the manifest, on any number of threads; and nothing of the cases is touched.
    let first = files(&study.path("report"));
    let list = study.at("list.csv");
    run(&["batch", &list, "--group", &study.at("out"), "--out", &study.at("report"), "--threads", "1"], 0);
    for (path, bytes) in files(&study.path("report")) {
        assert!(path.ends_with("index.html") || bytes == first[&path], "{}", path.display());
    }
    assert_eq!(page.replace("The list that the batch left beside the cases", "The manifest"), study.page("report"));
    assert!(before == files(&study.path("out")));
    for (path, bytes) in first {
        assert!(!String::from_utf8_lossy(&bytes).contains("SMITH"), "{}", path.display());
    }
}

#[test]
fn what_is_missing_extra_or_broken_is_a_row() {
    let study = Study::new();
    study.batch();
    let case = |id: &str| study.path("out").join(id);
    fs::remove_dir_all(case("late")).unwrap();
    fs::create_dir(case(".work-late")).unwrap();
    fs::create_dir(case("notes")).unwrap();
    fs::create_dir(case("copied")).unwrap();
    fs::copy(case("b").join("case.json"), case("copied").join("case.json")).unwrap();
    let text = fs::read_to_string(case("c & c").join("case.json")).unwrap();
    fs::write(case("c & c").join("case.json"), text[..text.len() / 2].replace("0.2", "0.1")).unwrap();
    let old = text.replace(&format!("\"version\": \"{}\"", env!("CARGO_PKG_VERSION")), "\"version\": \"0.0.1\"");
    fs::write(case("=a").join("case.json"), old).unwrap();
    // A report inside the folder of cases is no case.
    let report = study.at("out/report");
    let group = |status| {
        let out = run(&["batch", "--group", &study.at("out"), "--out", &report], status);
        String::from_utf8_lossy(&out.stdout).into_owned()
    };
    let told = "6 cases: 3 done, 1 failed, 1 unreadable, 1 missing; 1 not in the list, 1 scan is there twice\n";
    assert_eq!(group(0), told);
    assert_eq!(group(0), told, "again, with the first report there");
    let table = study.table("out/report");
    let state = |id: &str| (table[id]["state"].as_str(), table[id]["listed"].as_str(), table[id]["error"].as_str());
    assert_eq!(state("late"), ("missing", "yes", "it is being made, or a run was interrupted"));
    assert_eq!(state("c & c"), ("unreadable", "yes", "case.json is cut short"));
    assert_eq!(state("copied"), ("done", "no", ""));
    assert_eq!(table["'=a"]["version"], "0.0.1");
    let page = study.page("out/report");
    for text in ["made by 2 versions of colvis", "copied</a> (of b)", "<td class=\"line\">notes</td>"] {
        assert!(page.contains(text), "{text}");
    }
    fs::remove_file(study.path("out/cases.csv")).unwrap();
    group(0);
    assert!(study.page("out/report").contains("There is no list of the cases"));
    fs::write(study.path("out/cases.csv"), "x\n").unwrap();
    group(0);
    assert!(study.page("out/report").contains("cannot be read: nothing tells which are missing"));
}

#[test]
fn folders_and_options_that_are_wrong_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (cases, report) = (at("cases"), at("report"));
    let group = |out: &str, more: &[&str], status: i32| {
        run(&[&["batch", "--group", &cases, "--out", out][..], more].concat(), status);
    };
    group(&report, &[], 3);
    fs::create_dir_all(at("cases/empty")).unwrap();
    group(&report, &[], 3);
    fs::create_dir_all(at("cases/a")).unwrap();
    fs::write(at("cases/a/case.json"), "{}").unwrap();
    for more in
        [&["--do", "segment"][..], &["--shard", "1/2"], &["--jobs", "1"], &["--memory", "1G"], &["--timeout", "5"]]
    {
        group(&report, more, 2);
    }
    run(&["batch", "--out", &report], 2);
    for own in ["cases", "cases/a", "cases/a/report", "cases/a/b/../report"] {
        group(&at(own), &[], 2);
    }
    group(&report, &[], 0);
    fs::remove_dir_all(&report).unwrap();
    fs::write(&report, "").unwrap();
    group(&report, &[], 5);
    fs::write(at("list.csv"), "id\na\n").unwrap();
    run(&["batch", &at("list.csv"), "--group", &cases, "--out", &at("other")], 3);
    assert_eq!(fs::read_dir(at("cases/a")).unwrap().count(), 1);
}
