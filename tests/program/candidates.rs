//! `colvis candidates` and its report: phantoms against their truth, the same list on any number of threads, exit statuses.

use std::path::Path;

use colvis::phantom::TruePolyp;
use glam::DVec3;
use serde_json::Value;

use crate::support::run::run;

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn position(entry: &Value) -> DVec3 {
    serde_json::from_value(entry["position"].clone()).unwrap()
}

#[test]
#[ignore = "slow: candidates of a phantom, twice"]
fn polyps_of_a_phantom_come_first_and_the_list_is_the_same_on_any_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let [scan, truth, out] = ["p.nii.gz", "t.json", "c.json"].map(at);
    let with = "folds,lesions,decoys,pools,noise";
    let size = ["--size", "small", "--with", with, "--seed", "3"];
    run(&[&["phantom", "--out", &scan, "--truth", &truth][..], &size].concat(), 0);
    let stats = at("s.json");
    run(&["candidates", &scan, "--out", &out, "--stats", &stats, "--threads", "1"], 0);
    let list = json(Path::new(&out));
    let found = list["candidates"].as_array().unwrap();
    let polyps: Vec<TruePolyp> = serde_json::from_value(json(Path::new(&truth))["polyps"].clone()).unwrap();
    let near = |p: &TruePolyp, c: &Value| position(c).distance(p.position) < 0.5 * p.diameter_mm + 3.0;
    let mut errors = Vec::new();
    for p in polyps.iter().filter(|p| p.diameter_mm >= 6.0 && format!("{:?}", p.shape) != "Flat") {
        let rank = found.iter().position(|c| near(p, c));
        assert!(rank.is_some_and(|r| r < polyps.len() + 2), "{rank:?} for {p:?}");
        let hit = &found[rank.unwrap()];
        errors.push((hit["diameter_mm"].as_f64().unwrap() - p.diameter_mm).abs());
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors.len() >= 4 && errors[errors.len() / 2] < 0.6, "with voxels of 0.9 mm: {errors:?}");
    for (n, c) in found.iter().enumerate() {
        assert_eq!(c["rank"].as_u64(), Some(n as u64 + 1));
        let score = c["score"].as_f64().unwrap();
        assert!((0.0..=1.0).contains(&score) && c["along_mm"].as_f64().is_some_and(|mm| mm >= 0.0), "{c}");
        assert!(["height_mm", "volume_mm3"].iter().all(|f| c[f].as_f64().is_some()) && c["segment"] == 0, "{c}");
        assert!(c["features"].as_object().unwrap().values().all(|f| f.as_f64().is_some()), "{c}");
    }
    let told = json(Path::new(&stats));
    assert_eq!(told["candidates"].as_u64(), Some(found.len() as u64));
    assert!(["wall_s", "candidates_s", "cleanse_s"].iter().all(|p| told["prepare"][p].as_f64().is_some()), "{told}");

    let two = at("two.json");
    run(&["candidates", &scan, "--out", &two, "--threads", "2", "--detector", "shape"], 0);
    assert!(std::fs::read(&two).unwrap() == std::fs::read(&out).unwrap());
    run(&["candidates", &scan, "--out", &two, "--max", "3"], 0);
    assert_eq!(json(Path::new(&two))["candidates"].as_array().unwrap()[..], found[..3]);
    run(&["candidates", &scan, "--out", &two, "--detector", "curvature"], 0);
    let baseline = json(Path::new(&two));
    assert!(baseline["candidates"][0]["diameter_mm"].is_null(), "the baseline measures nothing");

    let said = run(&["candidates", &scan, "--out", &two, "--detector", "nose"], 2);
    let said = String::from_utf8_lossy(&said.stderr).into_owned();
    assert!(said.contains("shape") && said.contains("curvature"), "{said}");
    run(&["candidates", &scan, "--out", &two, "--from", "900,0,0"], 4);
    run(&["candidates", &at("no.nii.gz"), "--out", &two], 3);
    run(&["candidates", &scan, "--out", &at("no/folder.json")], 5);
}

#[test]
#[ignore = "slow: galleries of a phantom"]
fn a_gallery_shows_each_candidate_and_is_the_same_on_any_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let [scan, out, folder] = ["p & <q>.nii.gz", "c.json", "g/"].map(at);
    run(&["phantom", "--out", &scan, "--size", "small", "--with", "folds,lesions,decoys,noise", "--seed", "3"], 0);
    run(&["candidates", &scan, "--out", &out, "--gallery", &folder, "--max", "12", "--threads", "1"], 0);
    let list = json(Path::new(&out));
    let found = list["candidates"].as_array().unwrap();
    let html = std::fs::read_to_string(Path::new(&folder).join("index.html")).unwrap();
    assert!(found.len() == 12 && html.matches("<article").count() == 12 && html.contains("12 candidates"));
    assert!(html.contains("not a diagnosis") && html.contains("p &amp; &lt;q&gt;.nii.gz"));
    for outside in ["http:", "https:", "src=\"/", "<link", "@import", "url(", "NaN"] {
        assert!(!html.contains(outside), "{outside}");
    }
    let data = html.split("id=\"list\">").nth(1).and_then(|t| t.split("</script>").next()).unwrap();
    let data: Value = serde_json::from_str(data).unwrap();
    assert_eq!(data["scan"], "p & <q>.nii.gz");
    for (n, c) in found.iter().enumerate() {
        assert!(data["candidates"][n]["position"] == c["position"] && data["candidates"][n]["rank"] == c["rank"]);
        let card = html.split(&format!("id=\"c{}\"", n + 1)).nth(1).and_then(|t| t.split("</article>").next()).unwrap();
        let told = format!("diameter {:.1} mm", c["diameter_mm"].as_f64().unwrap());
        assert!(card.contains(&told) && card.contains("fold_mm") && card.matches("data-answer").count() == 3, "{card}");
        for (kind, side) in [("view", 320), ("axial", 240), ("across", 240), ("along", 240)] {
            let name = format!("{:04}-{kind}.png", n + 1);
            assert!(card.contains(&format!("src=\"{name}\"")), "{name}");
            let picture = image::open(Path::new(&folder).join(&name)).unwrap().into_luma8();
            assert_eq!((picture.width(), picture.height()), (side, side), "{name}");
            // Neither black nor all of one shade: gas and wall, or lit and dark parts of the wall.
            let [least, most] = [picture.pixels().map(|p| p.0[0]).min(), picture.pixels().map(|p| p.0[0]).max()];
            assert!(most > Some(90) && most.unwrap() - least.unwrap() > 40, "{name}: {least:?} to {most:?}");
        }
    }
    let files = |folder: &str| {
        let mut all: Vec<_> = std::fs::read_dir(folder).unwrap().map(|f| f.unwrap().path()).collect();
        all.sort();
        all.iter().map(|f| (f.file_name().unwrap().to_owned(), std::fs::read(f).unwrap())).collect::<Vec<_>>()
    };
    let (first, again) = (files(&folder), at("deep/again"));
    assert_eq!(first.len(), 4 * 12 + 1);
    run(&["candidates", &scan, "--out", &out, "--gallery", &again, "--max", "12", "--threads", "2"], 0);
    assert!(files(&again) == first);

    // A detector that measures nothing has pictures, too, and a shorter list replaces a longer one.
    let inside = at("g/c.json");
    run(&["candidates", &scan, "--out", &inside, "--gallery", &folder, "--max", "3", "--detector", "curvature"], 0);
    let html = std::fs::read_to_string(Path::new(&folder).join("index.html")).unwrap();
    assert!(html.matches("<article").count() == 3 && !html.contains("diameter") && !html.contains("class=\"terms\""));

    run(&["candidates", &scan, "--out", &out, "--gallery", &scan], 2);
    run(&["candidates", &scan, "--out", &out, "--gallery", &out], 2);
    run(&["candidates", &scan, "--out", &at("g/index.html"), "--gallery", &folder], 2);
    run(&["candidates", &scan, "--out", &at("d.json"), "--gallery", &at("p & <q>.nii.gz/g")], 5);
    assert!(!Path::new(&at("d.json")).exists());
}

#[test]
fn a_scan_without_a_wall_has_no_candidates_and_says_why() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    use colvis::volume::{Grid, Volume, io};
    for (name, hu, dims) in [("air", -1000i16, [40, 40, 40]), ("water", 0, [40, 40, 40]), ("thin", 0, [40, 40, 1])] {
        let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO, glam::DMat3::IDENTITY).unwrap();
        let volume = Volume::new(grid.clone(), vec![hu; grid.len()]);
        let scan = at(&format!("{name}.nii.gz"));
        io::save(Path::new(&scan), &volume, &colvis::progress::Progress::new()).unwrap();
        let out = at("c.json");
        run(&["candidates", &scan, "--out", &out], 4);
        assert!(!Path::new(&out).exists(), "{name}");
    }
}

#[test]
fn a_truth_that_is_none_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (scan, truth, out) = (at("p.nii.gz"), at("t.json"), at("r"));
    run(&["phantom", "--size", "small", "--out", &scan], 0);
    let report =
        |status| run(&["report", "candidates", "--quick", "--out", &out, "--scan", &scan, "--truth", &truth], status);
    report(3);
    for text in [
        "",
        "{",
        "[]",
        "{}",
        "{\"polyps\": 3}",
        "{\"polyps\": [{\"position\": [1, 2]}]}",
        "{\"polyps\": [{\"position\": [1, 2, 3]}]}",
        "{\"polyps\": [{\"position\": [1, 2, 3], \"diameter_mm\": -1}]}",
        "{\"polyps\": [{\"position\": [1, 2, 1e999], \"diameter_mm\": 5}]}",
        "{\"polyps\": [], \"decoys\": [{\"kind\": \"cheese\", \"position\": [1, 2, 3], \"diameter_mm\": 5}]}",
    ] {
        std::fs::write(&truth, text).unwrap();
        report(3);
    }
    run(&["report", "candidates", "--quick", "--out", &out, "--truth", &truth], 2);
}

#[test]
#[ignore = "slow: a quick report"]
fn detectors_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (scan, truth, out) = (at("p.nii.gz"), at("t.json"), at("r"));
    run(&["phantom", "--size", "small", "--out", &scan], 0);
    // Some other program's truth: places and sizes alone.
    std::fs::write(&truth, "{\"polyps\": [{\"position\": [0, 0, 0], \"diameter_mm\": 5}]}").unwrap();
    let said = run(&["report", "candidates", "--quick", "--out", &out, "--scan", &scan, "--truth", &truth], 0);
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    let found: Vec<&str> = said.lines().filter(|l| l.contains("sessile and stalked")).collect();
    assert_eq!(found.len(), 3, "{said}");
    let html = std::fs::read_to_string(Path::new(&out).join("report.html")).unwrap();
    assert!(html.contains("p.nii.gz") && html.contains("<svg") && !html.contains("NaN"));
    let rows = |name: &str| {
        let text = std::fs::read_to_string(Path::new(&out).join(name)).unwrap();
        text.lines().map(|l| l.split(',').map(str::to_owned).collect::<Vec<_>>()).collect::<Vec<_>>()
    };
    let own = rows("own.csv");
    assert!(own.iter().any(|r| r[0] == "shape" && r[1] == "sessile 3-5 mm" && r[2] == "1"), "{own:?}");
    let kinds = rows("decoys.csv");
    assert!(kinds.iter().any(|r| r[1] == "ileocecal valve" && r[2] == "2"), "{kinds:?}");
    assert!(rows("candidates.csv").len() > 50 && rows("froc.csv").len() > 40);
}

#[test]
#[ignore = "slow: measures of lesions in a phantom"]
fn a_lesion_is_measured_where_it_is_pointed_at_and_nowhere_else() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let [scan, truth, out] = ["p.nii.gz", "t.json", "m.json"].map(at);
    run(&["phantom", "--out", &scan, "--truth", &truth, "--size", "small", "--seed", "2"], 0);
    let polyps: Vec<TruePolyp> = serde_json::from_value(json(Path::new(&truth))["polyps"].clone()).unwrap();
    let largest = polyps.iter().max_by(|a, b| a.diameter_mm.total_cmp(&b.diameter_mm)).unwrap();
    let point = |p: DVec3| format!("--at={},{},{}", p.x, p.y, p.z);
    run(&["measure", &scan, &point(largest.position), "--out", &out], 4);
    // The centre of a large polyp is no place of the wall, its top is.
    let list = at("c.json");
    run(&["candidates", &scan, "--out", &list], 0);
    let found = json(Path::new(&list));
    let near = |c: &&Value| position(c).distance(largest.position) < 0.5 * largest.diameter_mm + 1.0;
    let top = position(found["candidates"].as_array().unwrap().iter().find(near).expect("the largest polyp"));
    let said = run(&["measure", &scan, &point(top), "--threads", "1"], 0);
    let said: Value = serde_json::from_slice(&said.stdout).unwrap();
    run(&["measure", &scan, &point(top), "--out", &out, "--threads", "2"], 0);
    assert_eq!(json(Path::new(&out)), said);
    assert!((said["diameter_mm"].as_f64().unwrap() - largest.diameter_mm).abs() < 1.0, "{said} for {largest:?}");
    let ends: [DVec3; 2] = serde_json::from_value(said["ends"].clone()).unwrap();
    assert!((ends[0].distance(ends[1]) - said["diameter_mm"].as_f64().unwrap()).abs() < 1e-6);
    assert!((0.0..=1.0).contains(&said["confidence"].as_f64().unwrap()), "{said}");
    assert!(said["height_mm"].as_f64().unwrap() > 1.0 && said["volume_mm3"].as_f64().unwrap() > 1.0, "{said}");
    // In mid-air, outside the scan, no number.
    let truth = json(Path::new(&truth));
    let axis: Vec<DVec3> = serde_json::from_value(truth["centerline"].clone()).unwrap();
    run(&["measure", &scan, &point(axis[axis.len() / 2])], 4);
    run(&["measure", &scan, "--at=1e9,0,0"], 4);
    run(&["measure", &scan, "--at=1,2"], 2);
    run(&["measure", &scan, "--at=nan,0,0"], 2);
    run(&["measure", &at("none.nii"), "--at=0,0,0"], 3);
}
