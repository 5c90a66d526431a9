//! `colvis unfold`: what the map shows, and what cannot be unfolded.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::support::run::run;

/// The map of a file: rows, columns, and the point of each pixel.
struct Map {
    rows: usize,
    columns: usize,
    points: Vec<[f32; 3]>,
}

impl Map {
    fn read(path: &str) -> Self {
        let bytes = fs::read(path).unwrap();
        let head = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        let text = String::from_utf8_lossy(&bytes[10..head]).into_owned();
        assert!(text.contains("'<f4'") && text.contains("'fortran_order': False"), "{text}");
        let shape = text.split_once("'shape': (").unwrap().1.split_once(')').unwrap().0;
        let shape: Vec<usize> = shape.split(',').filter_map(|n| n.trim().parse().ok()).collect();
        let values: Vec<f32> = bytes[head..].as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        assert_eq!((shape.len(), shape[2], values.len()), (3, 3, shape.iter().product()));
        Self { rows: shape[0], columns: shape[1], points: values.as_chunks::<3>().0.to_vec() }
    }

    /// The sizes of the connected parts of the map within `mm` of a place, in pixels, the largest first. Left and right are joined.
    fn parts(&self, at: [f64; 3], mm: f64) -> Vec<usize> {
        let far = |p: &[f32; 3]| p.iter().zip(at).map(|(a, b)| (f64::from(*a) - b).powi(2)).sum::<f64>().sqrt();
        let mut left: BTreeSet<usize> = (0..self.points.len()).filter(|&n| far(&self.points[n]) < mm).collect();
        let mut parts = Vec::new();
        while let Some(first) = left.pop_first() {
            let (mut open, mut size) = (vec![first], 0);
            while let Some(n) = open.pop() {
                size += 1;
                let (row, column) = (n / self.columns, n % self.columns);
                for r in row.saturating_sub(1)..(row + 2).min(self.rows) {
                    for c in [column + self.columns - 1, column, column + 1].map(|c| c % self.columns) {
                        if left.remove(&(r * self.columns + c)) {
                            open.push(r * self.columns + c);
                        }
                    }
                }
            }
            parts.push(size);
        }
        parts.sort_unstable_by(|a, b| b.cmp(a));
        parts
    }
}

fn read(path: &str) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn the_wall_of_a_phantom_is_laid_flat_with_each_polyp_once() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (scan, truth) = (at("a.nii"), at("t.json"));
    let parts = "folds,polyps,noise";
    run(&["phantom", "--size", "small", "--seed", "4", "--with", parts, "--out", &scan, "--truth", &truth], 0);
    let (png, npy, stats) = (at("u.png"), at("u.npy"), at("s.json"));
    run(&["unfold", &scan, "--out", &png, "--map", &npy, "--stats", &stats, "--threads", "1"], 0);
    let (map, stats, truth) = (Map::read(&npy), read(&stats), read(&truth));
    assert_eq!([&stats["rows"], &stats["columns"]], [map.rows, map.columns]);
    // At most half a millimetre from row to row.
    let length = stats["length_mm"].as_f64().unwrap();
    assert!(map.rows as f64 >= length / 0.5, "{} rows for {length} mm", map.rows);
    let share = |name: &str| stats[name].as_f64().unwrap();
    assert!(share("shown") > 0.98 && share("absent") < 0.01, "{stats}");
    let trip: Vec<f64> = serde_json::from_value(stats["round_trip_mm"].clone()).unwrap();
    assert!(trip[2] < 0.5, "{trip:?}");
    let polyps = truth["polyps"].as_array().unwrap();
    assert!(!polyps.is_empty());
    for polyp in polyps {
        let position: [f64; 3] = serde_json::from_value(polyp["position"].clone()).unwrap();
        let radius = 0.5 * polyp["diameter_mm"].as_f64().unwrap();
        let sizes = map.parts(position, radius + 1.0);
        assert!(sizes.first().is_some_and(|s| *s > 20), "{polyp}: {sizes:?}");
        assert!(sizes.get(1).is_none_or(|second| 20 * second < sizes[0]), "{polyp}: {sizes:?}");
    }
    // The same for any number of threads, and in a batch.
    let (again, npy_again) = (at("v.png"), at("v.npy"));
    run(&["unfold", &scan, "--out", &again, "--map", &npy_again, "--threads", "3"], 0);
    assert!(fs::read(&npy).unwrap() == fs::read(npy_again).unwrap());
    fs::write(at("list.csv"), "id,path\na,a.nii\n").unwrap();
    run(&["batch", &at("list.csv"), "--do", "unfold", "--out", &at("out")], 0);
    let made = fs::read(Path::new(&at("out")).join("a/unfolded.png")).unwrap();
    assert!(fs::read(&png).unwrap() == made && fs::read(again).unwrap() == made);

    // Part of it: the rows between two points of the wall.
    let middle = |row: usize| map.points[row * map.columns + map.columns / 2].map(|c| c.to_string()).join(",");
    let (low, high) = (map.rows / 3, map.rows / 2);
    let ends = [middle(low), middle(high)];
    let (part, npy) = (at("p.png"), at("p.npy"));
    for [from, to] in [[&ends[0], &ends[1]], [&ends[1], &ends[0]]] {
        run(&["unfold", &scan, "--out", &part, "--map", &npy, "--from", from, "--to", to], 0);
        let part = Map::read(&npy);
        assert!(part.rows.abs_diff(high - low) < 100, "{} of {}", part.rows, high - low);
    }
    for (options, status) in [
        (&["--out", "u.jpg"][..], 2),
        (&["--out", &*png, "--map", "u.txt"], 2),
        (&["--out", &png, "--from", "4000,0,0"], 4),
        (&["--out", &png, "--from", &ends[0], "--to", &ends[0]], 4),
        (&["--out", &png, "--from", "cecum"], 4),
        (&["--out", "/nowhere/u.png"], 5),
    ] {
        run(&[&["unfold", &scan], options].concat(), status);
    }
}

#[test]
fn what_has_no_line_from_end_to_end_is_refused_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    fs::write(at("none.nii"), "no scan").unwrap();
    run(&["unfold", &at("none.nii"), "--out", &at("u.png")], 3);
    let scan = at("a.nii");
    run(&["phantom", "--size", "small", "--with", "folds,collapsed", "--out", &scan], 0);
    // Collapsed stretches are empty rows, or the order of the pieces is not known.
    let out = crate::support::program::colvis().args(["unfold", &scan, "--out", &at("u.png")]).output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    match out.status.code() {
        Some(0) => assert!(said.contains("those rows are empty"), "{said}"),
        Some(4) => assert!(said.contains("no line leads from the rectum to the cecum"), "{said}"),
        other => panic!("{other:?}: {said}"),
    }
}
