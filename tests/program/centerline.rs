//! `colvis centerline`: phantoms against their truth, masks of every kind, exit statuses, the real scan.

use std::path::{Path, PathBuf};

use colvis::fields::lumen;
use colvis::phantom::{PhantomSettings, Size, Truth};
use colvis::progress::Progress;
use colvis::volume::{Grid, Volume, io};
use glam::{DMat3, DVec3};
use serde_json::Value;

use crate::support::phantom::phantom;
use crate::support::run::run;
use crate::support::scans::data;

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn points(line: &Value) -> Vec<DVec3> {
    serde_json::from_value(line["points"].clone()).unwrap()
}

fn off(p: DVec3, line: &[DVec3]) -> f64 {
    let part = |w: &[DVec3]| {
        let way = w[1] - w[0];
        p.distance(w[0] + way * ((p - w[0]).dot(way) / way.length_squared().max(1e-12)).clamp(0.0, 1.0))
    };
    line.windows(2).map(part).fold(f64::INFINITY, f64::min)
}

/// Writes a mask of the voxels (indices) that `is_in` accepts, and returns it with its grid.
fn mask(at: PathBuf, dims: [usize; 3], spacing: DVec3, is_in: impl Fn([i64; 3]) -> bool) -> (PathBuf, Grid, Vec<u8>) {
    let grid = Grid::new(dims, spacing, DVec3::new(-20.0, 10.0, 5.0), DMat3::IDENTITY).unwrap();
    let voxels: Vec<u8> = (0..grid.len())
        .map(|n| [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]].map(|x| x as i64))
        .map(|v| 3 * u8::from(is_in(v)))
        .collect();
    io::save_mask(&at, &grid, &voxels, &Progress::new()).unwrap();
    (at, grid, voxels)
}

/// Returns true if every point of a line, sampled finely, is in a voxel of the mask.
fn is_inside(line: &[DVec3], grid: &Grid, voxels: &[u8]) -> bool {
    let [nx, ny, _] = grid.dims();
    line.windows(2).all(|w| {
        (0..=20).all(|n| {
            let u = grid.voxel(w[0].lerp(w[1], f64::from(n) / 20.0)).round();
            voxels[u.x as usize + nx * (u.y as usize + ny * u.z as usize)] != 0
        })
    })
}

/// Runs the command on a mask and returns the points and the length.
fn through_mask(mask: &Path, more: &[&str]) -> (Vec<DVec3>, f64) {
    let out = mask.with_file_name("line.json");
    let args = ["centerline", "--mask", mask.to_str().unwrap(), "--out", out.to_str().unwrap()];
    run(&[&args[..], more].concat(), 0);
    let line = json(&out);
    (points(&line), line["length_mm"].as_f64().unwrap())
}

fn against(truth: &Truth, line: &[DVec3]) -> (f64, f64) {
    let errors: Vec<f64> = line.iter().map(|&p| off(p, &truth.centerline)).collect();
    (errors.iter().sum::<f64>() / errors.len() as f64, errors.iter().copied().fold(0.0, f64::max))
}

#[test]
#[ignore = "slow: lines through phantoms"]
fn phantoms_are_met_from_end_to_end() {
    let dir = tempfile::tempdir().unwrap();
    let at = |n: &str| dir.path().join(n).to_str().unwrap().to_owned();
    for (seed, fluid) in [(1, false), (2, true), (3, false)] {
        let settings = PhantomSettings { size: Size::Small, seed, fluid, bridges: true, ..PhantomSettings::default() };
        let (volume, truth) = phantom(&settings);
        io::save(Path::new(&at("v.nii.gz")), &volume, &Progress::new()).unwrap();
        run(&["centerline", &at("v.nii.gz"), "--out", &at("c.json"), "--stats", &at("s.json")], 0);
        let line = json(Path::new(&at("c.json")));
        let p = points(&line);
        let (mean, worst) = against(&truth, &p);
        assert!(mean <= 0.35 && worst <= 2.5, "seed {seed}: mean {mean}, worst {worst}");
        let radii = line["radius_mm"].as_array().unwrap();
        assert!(radii.len() == p.len() && radii.iter().all(|r| r.as_f64().unwrap() > 2.5));
        assert!((line["length_mm"].as_f64().unwrap() - truth.length_mm).abs() < 0.005 * truth.length_mm);
        // The line starts at the rectum, and nothing is missing between the balls at the two ends.
        assert!(p[0].distance(truth.centerline[0]) < p[0].distance(*truth.centerline.last().unwrap()));
        let missed = |n: usize| off(truth.centerline[n], &p);
        let worst = (0..truth.centerline.len()).map(missed).fold(0.0, f64::max);
        assert!(worst < 1.8, "seed {seed}: {worst} mm of the axis are missing at an end");
        let stats = json(Path::new(&at("s.json")));
        assert_eq!(stats["points"].as_u64().unwrap() as usize, p.len());
        assert_eq!(stats["length_mm"], line["length_mm"]);
        for part in ["load_s", "lumen_s", "distance_s", "centerline_s"] {
            assert!(stats["prepare"][part].as_f64().unwrap() > 0.0);
        }
        assert!(stats["peak_rss_bytes"].as_u64().unwrap() > 0);
    }
}

#[test]
#[ignore = "slow: lines in every format and direction"]
fn formats_and_directions() {
    let dir = tempfile::tempdir().unwrap();
    let at = |n: &str| dir.path().join(n).to_str().unwrap().to_owned();
    let (volume, _) = phantom(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    io::save(Path::new(&at("v.nii.gz")), &volume, &Progress::new()).unwrap();
    let line = |out: &str, more: &[&str]| run(&[&["centerline", &at("v.nii.gz"), "--out", &at(out)], more].concat(), 0);
    line("c.json", &[]);
    line("one.json", &["--threads", "1"]);
    let same = std::fs::read(at("one.json")).unwrap() == std::fs::read(at("c.json")).unwrap();
    assert!(same, "the same bytes on one thread");
    line("c.csv", &[]);
    line("c.mrk.json", &["--from", "rectum", "--to", "cecum"]);
    line("back.json", &["--from", "cecum"]);
    let there = points(&json(Path::new(&at("c.json"))));
    let csv = std::fs::read_to_string(at("c.csv")).unwrap();
    assert_eq!(csv.lines().next(), Some("x_mm,y_mm,z_mm,radius_mm"));
    let rows: Vec<DVec3> = csv
        .lines()
        .skip(1)
        .map(|l| l.split(',').map(|x| x.parse().unwrap()).collect::<Vec<f64>>())
        .map(|r| DVec3::new(r[0], r[1], r[2]))
        .collect();
    assert_eq!(rows.len(), there.len());
    // Readers may round the last digit differently.
    assert!(rows.iter().zip(&there).all(|(a, b)| a.distance(*b) < 1e-9));
    let curve = json(Path::new(&at("c.mrk.json")));
    let curve = &curve["markups"][0];
    assert_eq!((curve["type"].as_str(), curve["coordinateSystem"].as_str()), (Some("Curve"), Some("LPS")));
    let controls = curve["controlPoints"].as_array().unwrap();
    assert_eq!(controls.len(), there.len());
    assert!(serde_json::from_value::<DVec3>(controls[7]["position"].clone()).unwrap().distance(there[7]) < 1e-9);
    let back = points(&json(Path::new(&at("back.json"))));
    assert!(back[0].distance(*there.last().unwrap()) < 0.4 && back.last().unwrap().distance(there[0]) < 1.0);
    // Between two points of the line, and from one to the end that is farther along.
    let place = |p: DVec3| format!("{:.2},{:.2},{:.2}", p.x, p.y, p.z);
    let (a, b) = (there[100], there[300]);
    line("part.json", &["--from", &place(a), "--to", &place(b)]);
    let part = json(Path::new(&at("part.json")));
    let part_points = points(&part);
    assert!(part_points[0].distance(a) < 0.012 && part_points.last().unwrap().distance(b) < 0.01);
    assert!((part["length_mm"].as_f64().unwrap() - 200.0).abs() < 0.5);
    line("rest.json", &["--from", &place(a)]);
    assert!(points(&json(Path::new(&at("rest.json")))).last().unwrap().distance(*there.last().unwrap()) < 0.8);
}

/// A serpentine of 1.5 m whose limbs share walls one voxel thick.
#[test]
fn a_long_serpentine_mask() {
    let dir = tempfile::tempdir().unwrap();
    let limbs = 16;
    let wall = |v: [i64; 3]| {
        // Limb n: y from 8n to 8n + 6; the wall at 8n + 7 is open at alternating ends.
        let n = v[1] / 8;
        let open = if n % 2 == 0 { v[0] >= 94 } else { v[0] <= 7 };
        v[1] % 8 == 7 && !open
    };
    let (path, grid, voxels) = mask(dir.path().join("m.nii.gz"), [102, 8 * limbs + 1, 9], DVec3::ONE, |v| {
        (1..=100).contains(&v[0]) && (1..=7).contains(&v[2]) && (1..8 * limbs as i64 - 1).contains(&v[1]) && !wall(v)
    });
    let (line, length) = through_mask(&path, &[]);
    assert!(is_inside(&line, &grid, &voxels));
    assert!(length > 1400.0 && length < 1700.0, "{length}");
    // The line passes each limb in turn: its y never goes back by more than a limb's width.
    let (mut most, mut back) = (f64::NEG_INFINITY, 0.0f64);
    let forwards: Vec<DVec3> = if line[0].y < line[line.len() - 1].y { line } else { line.into_iter().rev().collect() };
    for p in &forwards {
        most = most.max(p.y);
        back = back.max(most - p.y);
    }
    assert!(back < 0.6, "{back}");
}

#[test]
fn masks_of_every_kind() {
    let dir = tempfile::tempdir().unwrap();
    let at = |n: &str| dir.path().join(n);
    // Walls that touch along edges: a staircase.
    let (path, grid, voxels) = mask(at("edges.nii.gz"), [62, 19, 13], DVec3::ONE, |v| {
        let inside = (1..=60).contains(&v[0]) && (1..=17).contains(&v[1]) && (2..=10).contains(&v[2]);
        inside && (v[1] != 9 + (v[0] + v[2]) % 2 || v[0] > 53)
    });
    let (line, length) = through_mask(&path, &[]);
    assert!(is_inside(&line, &grid, &voxels) && length > 90.0, "{length}");
    // Thick slices, and one voxel wide.
    let (path, grid, voxels) = mask(at("flat.nii.gz"), [40, 200, 12], DVec3::new(0.3, 0.3, 10.0), |v| {
        (10..30).contains(&v[0]) && (4..196).contains(&v[1]) && (3..9).contains(&v[2])
    });
    let (line, length) = through_mask(&path, &[]);
    assert!(is_inside(&line, &grid, &voxels) && length > 41.0, "{length}");
    let (path, grid, voxels) = mask(at("thin.nii.gz"), [40, 40, 6], DVec3::new(0.3, 0.3, 10.0), |v| {
        (v[2] == 2 && (v[1] == 3 || v[0] == 38)) || (v[0] == 38 && v[1] == 39)
    });
    let (line, length) = through_mask(&path, &[]);
    assert!(is_inside(&line, &grid, &voxels) && length > 26.0, "{length}");
    // A closed ring: half of it.
    let (path, grid, voxels) = mask(at("ring.nrrd"), [50, 50, 13], DVec3::ONE, |v| {
        let q = DVec3::new(v[0] as f64 - 24.5, v[1] as f64 - 24.5, v[2] as f64 - 6.0);
        (q.x.hypot(q.y) - 17.0).hypot(q.z) < 5.0
    });
    let (line, length) = through_mask(&path, &[]);
    assert!(is_inside(&line, &grid, &voxels) && (30.0..75.0).contains(&length), "{length}");
    // The lumen reaches the grid's border. One voxel is outside: a file without such a voxel is no mask.
    let (path, grid, voxels) = mask(at("full.nii.gz"), [9, 9, 60], DVec3::ONE, |v| v != [0; 3]);
    let (line, length) = through_mask(&path, &[]);
    assert!(is_inside(&line, &grid, &voxels) && length > 40.0, "{length}");
}

#[test]
fn what_cannot_be_done_says_why() {
    let dir = tempfile::tempdir().unwrap();
    let at = |n: &str| dir.path().join(n).to_str().unwrap().to_owned();
    let empty = mask(dir.path().join("empty.nii.gz"), [9, 9, 9], DVec3::ONE, |_| false).0;
    let empty = empty.to_str().unwrap();
    let said = |args: &[&str], status: i32| String::from_utf8_lossy(&run(args, status).stderr).into_owned();
    assert!(said(&["centerline", "--mask", empty, "--out", &at("c.json")], 4).contains("empty"));
    let slice = mask(dir.path().join("slice.nii.gz"), [9, 9, 1], DVec3::ONE, |v| v != [0; 3]).0;
    assert!(said(&["centerline", "--mask", slice.to_str().unwrap(), "--out", &at("c.json")], 4).contains("slice"));
    let full = mask(dir.path().join("full.nii.gz"), [9, 9, 9], DVec3::ONE, |_| true).0;
    assert!(
        said(&["centerline", "--mask", full.to_str().unwrap(), "--out", &at("c.json")], 3)
            .contains("it has no voxel of 0")
    );
    let two = mask(dir.path().join("two.nii.gz"), [30, 9, 9], DVec3::ONE, |v| v[0] < 12 || v[0] > 16).0;
    let two = two.to_str().unwrap();
    let apart = ["centerline", "--mask", two, "--out", &at("c.json"), "--from", "-18,14,9", "--to", "7,14,9"];
    assert!(said(&apart, 4).contains("no path"));
    let outside = ["centerline", "--mask", two, "--out", &at("c.json"), "--from", "-18,14,99", "--to", "7,14,9"];
    assert!(said(&outside, 4).contains("not in the lumen"));
    said(&["centerline", "--mask", &at("none.nii.gz"), "--out", &at("c.json")], 3);
    said(&["centerline", "--mask", two, "--out", &at("c.txt")], 2);
    said(&["centerline", two, "--mask", two, "--out", &at("c.json")], 2);
    said(&["centerline", "--out", &at("c.json")], 2);
    said(&["centerline", "--mask", two, "--out", &at("no/c.json")], 5);
    said(&["centerline", "--mask", two, "--out", "/dev/full"], 2);
    // Tissue alone has no colon.
    let grid = Grid::new([20; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let tissue = Volume::new(grid, vec![40; 8000]);
    io::save(Path::new(&at("t.nii.gz")), &tissue, &Progress::new()).unwrap();
    assert!(said(&["centerline", &at("t.nii.gz"), "--out", &at("c.json")], 4).contains("no gas"));
    assert!(!Path::new(&at("c.json")).exists(), "nothing is left of what failed");
}

/// A colon that is collapsed twice: the line follows guesses that are marked and near the truth, and a flight tells them.
#[test]
#[ignore = "slow: lines through collapsed phantoms"]
fn collapsed_stretches_are_guessed_near_the_truth_and_told() {
    let dir = tempfile::tempdir().unwrap();
    let at = |n: &str| dir.path().join(n).to_str().unwrap().to_owned();
    let (scan, truth) = (at("scan.nii"), at("truth.json"));
    run(&["phantom", "--out", &scan, "--truth", &truth, "--size", "small", "--with", "collapsed", "--seed", "3"], 0);
    let truth: Truth = serde_json::from_value(json(Path::new(&truth))).unwrap();
    let line_to = |more: &[&str]| {
        run(&[&["centerline", &scan, "--out", &at("c.json"), "--stats", &at("s.json")], more].concat(), 0);
        (json(Path::new(&at("c.json"))), json(Path::new(&at("s.json")))["guessed_mm"].clone())
    };
    let ends = ["--from", "rectum", "--to", "cecum"];
    let (line, guessed) = line_to(&ends);
    let guessed: Vec<[f64; 2]> = serde_json::from_value(guessed).unwrap();
    assert_eq!(guessed.len(), truth.collapsed.len());
    let (points, radius) = (points(&line), line["radius_mm"].as_array().unwrap().clone());
    let mut along = 0.0;
    for (n, &p) in points.iter().enumerate() {
        along += if n > 0 { p.distance(points[n - 1]) } else { 0.0 };
        let is_guess = guessed.iter().any(|g| along > g[0] + 1e-6 && along < g[1] - 1e-6);
        assert!(!is_guess || radius[n] == 0.0 && off(p, &truth.centerline) < 10.0, "{along} mm");
    }
    assert!((line["length_mm"].as_f64().unwrap() - along).abs() < 1e-6);
    for threads in ["1", "2"] {
        assert_eq!(line_to(&[&ends[..], &["--threads", threads]].concat()).0, line);
    }
    // The flight ends where the gas does, and says how it would go on.
    let stats = at("f.json");
    let fly = ["fly", &scan, "--headless", "--guide", "path", "--stats", &stats];
    let said = String::from_utf8(run(&[&fly[..], &ends].concat(), 4).stderr).unwrap();
    assert!(said.contains("from the rectum to the cecum: 5 stretches: "), "{said}");
    let stats = json(Path::new(&stats));
    let told = stats["connection"].as_array().unwrap();
    let kinds: Vec<&str> = told.iter().map(|s| s["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["gas", "collapsed", "gas", "collapsed", "gas"]);
    assert_eq!((&told[1]["from"], &told[1]["to"]), (&0.into(), &1.into()));
    assert!(stats["length_mm"].as_f64().unwrap() < told[0]["length_mm"].as_f64().unwrap() + 60.0, "only gas is flown");
}

/// The real scan: its three segments of gas, each from end to end, and the whole colon through the fluid between them.
#[test]
#[ignore = "slow: the real scan, four lines"]
fn the_real_scan_by_segments_and_as_a_whole() {
    let Some(scan) = data("ctc_prone.nii.gz") else { return };
    let dir = tempfile::tempdir().unwrap();
    let at = |n: &str| dir.path().join(n).to_str().unwrap().to_owned();
    let volume = io::load(&scan, &io::LoadOptions::default(), &Progress::new()).unwrap().volume;
    let lumen = lumen::find(&volume, &Progress::new()).unwrap();
    let inside = lumen.mask();
    let scan = scan.to_str().unwrap();
    let place = |p: DVec3| format!("{:.2},{:.2},{:.2}", p.x, p.y, p.z);
    let check = |more: &[&str]| {
        run(&[&["centerline", scan, "--out", &at("c.json"), "--stats", &at("s.json")], more].concat(), 0);
        let line = json(Path::new(&at("c.json")));
        assert!(is_inside(&points(&line), volume.grid(), &inside), "{more:?}");
        assert_eq!(json(Path::new(&at("s.json")))["guessed_mm"].as_array().unwrap().len(), 0);
        (points(&line), line["length_mm"].as_f64().unwrap())
    };
    let mut sum = 0.0;
    for s in &lumen.segments {
        let (line, length) = check(&["--from", &place(s.ends[0]), "--to", &place(s.ends[1])]);
        assert!(line[0].distance(s.ends[0]) < 0.015 && line.last().unwrap().distance(s.ends[1]) < 0.014);
        assert!(length > 0.8 * s.length_mm, "{length} for {}", s.length_mm);
        sum += length;
    }
    let (line, length) = check(&[]);
    assert!(length > sum, "the whole, {length} mm, is more than its parts, {sum} mm");
    for s in &lumen.segments {
        assert!(s.ends.iter().all(|&e| off(e, &line) < 20.0), "the line passes every segment");
    }
}
