//! `colvis segment --labels`: the wall and what is not colon, against the phantom's own anatomy.

use std::path::Path;
use std::process::Command;

use colvis::fields::voxels::VoxelBits;
use colvis::phantom::{Phantom, PhantomSettings, Size};
use colvis::progress::Progress;
use colvis::volume::io;
use glam::DVec3;
use serde_json::Value;

fn segment(args: &[&str]) {
    let out = Command::new(env!("CARGO_BIN_EXE_colvis")).arg("segment").args(args).output().unwrap();
    assert!(out.status.success(), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
}

fn mask(path: &str) -> Vec<i16> {
    io::load(Path::new(path), &io::LoadOptions::default(), &Progress::new()).unwrap().volume.data().to_vec()
}

fn json(path: &str) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

#[test]
#[ignore = "slow: the wall of two phantoms"]
fn the_wall_of_a_phantom_is_its_soft_tissue() {
    let dir = tempfile::tempdir().unwrap();
    let at = |n: &str| dir.path().join(n).to_str().unwrap().to_owned();
    for fluid in [false, true] {
        let phantom = Phantom::new(&PhantomSettings { size: Size::Small, fluid, ..PhantomSettings::default() });
        let grid = phantom.grid();
        let volume = phantom.voxelise(&grid, &Progress::new()).unwrap();
        io::save(Path::new(&at("v.nii.gz")), &volume, &Progress::new()).unwrap();
        segment(&[&at("v.nii.gz"), "--out", &at("plain.nii.gz")]);
        segment(&[&at("v.nii.gz"), "--labels", "other,wall", "--out", &at("m.nii.gz"), "--stats", &at("s.json")]);
        let (plain, marked) = (mask(&at("plain.nii.gz")), mask(&at("m.nii.gz")));
        // Only unlabelled voxels are marked, and no lumen is left without a wall.
        let [nx, ny, nz] = grid.dims();
        // There is no wall farther than five millimetres from the lumen.
        let near = VoxelBits::from_fn(grid.dims(), |n| plain[n] != 0).dilated(6);
        let steps = [1, nx, nx * ny];
        let (mut wall, mut agree, mut either) = (0, 0, 0);
        for n in 0..marked.len() {
            assert_eq!(if marked[n] > 2 { 0 } else { marked[n] }, plain[n]);
            let v = [n % nx, n / nx % ny, n / nx / ny];
            if plain[n] > 0 {
                for a in 0..3 {
                    let inside = [v[a] > 0, v[a] + 1 < [nx, ny, nz][a]];
                    let beside = [(inside[0], n.wrapping_sub(steps[a])), (inside[1], n + steps[a])];
                    for (_, m) in beside.into_iter().filter(|b| b.0) {
                        assert_ne!(marked[m], 0, "a voxel beside the lumen is lumen or wall");
                    }
                }
            }
            let is_wall = marked[n] == 4;
            wall += u64::from(is_wall);
            // The wall's inner edge is blurred. Behind it, the wall is whatever is brighter than fat.
            let truly = plain[n] == 0 && near.contains(v.map(|x| x as i64)) && {
                let p = grid.world(DVec3::from_array(v.map(|x| x as f64)));
                let far = phantom.wall(p);
                (0.0..5.0).contains(&far) && (far < 1.2 || phantom.value(p) > -30.0)
            };
            agree += u64::from(is_wall && truly);
            either += u64::from(is_wall || truly);
        }
        let stats = json(&at("s.json"));
        let overlap = agree as f64 / either as f64;
        println!("fluid {fluid}: overlap {overlap:.3}, {}, told {}", stats["wall_thickness"], stats["wall_told"]);
        assert!(overlap > 0.8, "{overlap} of the voxels that either calls wall");
        let ml = stats["wall_ml"].as_f64().unwrap();
        assert!((ml - wall as f64 * grid.voxel_ml()).abs() < 1e-6 * ml);
        // The phantom's wall is 3 mm of tissue that fades into fat.
        let median = stats["wall_thickness"]["median_mm"].as_f64().unwrap();
        assert!((median - 3.0).abs() < 0.5, "median {median} mm");
        assert!(stats["wall_told"].as_f64().unwrap() > 0.8);
        // The air around the patient and the lungs are reported; no part of the colon is among them.
        let other = stats["not_colon"].as_array().unwrap();
        for kind in ["outside", "lung"] {
            assert!(other.iter().any(|o| o["kind"] == kind && o["ml"].as_f64().unwrap() > 20.0), "{kind}: {other:?}");
        }
        assert_eq!(marked[0], 3, "the corner of the scan is air");
    }
}
