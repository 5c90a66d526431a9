//! `colvis slice`: its files and its errors.

use std::path::Path;

use crate::support::run::run;

/// Returns the shape and the values of an array of float32.
fn npy(path: &Path) -> (String, Vec<f32>) {
    let bytes = std::fs::read(path).unwrap();
    let head = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    assert!(bytes.starts_with(b"\x93NUMPY\x01\x00") && head.is_multiple_of(64));
    let told = String::from_utf8_lossy(&bytes[10..head]);
    assert!(told.contains("'<f4'") && told.contains("'fortran_order': False"));
    let shape = told.split("'shape': ").nth(1).unwrap().split(')').next().unwrap().to_owned() + ")";
    (shape, bytes[head..].chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect())
}

#[test]
#[ignore = "slow: slices of the real scan"]
fn a_picture_is_the_windowed_values() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    run(&["phantom", "--out", &at("v.nii.gz"), "--size", "small", "--truth", &at("t.json")], 0);
    let truth: serde_json::Value = serde_json::from_slice(&std::fs::read(at("t.json")).unwrap()).unwrap();
    let place: Vec<String> = truth["centerline"][200].as_array().unwrap().iter().map(|c| c.to_string()).collect();
    let place = format!("--at={}", place.join(","));
    let slice = |more: &[&str], out: &str| {
        run(&[&["slice", &at("v.nii.gz"), &place, "--size", "61x40", "--out", &at(out)], more].concat(), 0);
    };
    for plane in ["--plane=axial", "--plane=Coronal", "--plane=sagittal", "--plane=-1,2,0.5"] {
        slice(&[plane], "a.npy");
        let (shape, hu) = npy(Path::new(&at("a.npy")));
        assert_eq!((shape.as_str(), hu.len()), ("(40, 61)", 61 * 40));
        // The centerline is in gas: check the pixels next to the middle, which is between two rows.
        assert!(hu[19 * 61 + 30] < -900.0 && hu[20 * 61 + 30] < -900.0, "{plane}");
        for (level, window) in [(None, None), (Some(-500.0), Some(700.0))] {
            let given = [level.map(|l| format!("--level={l}")), window.map(|w| format!("--window={w}"))];
            let given: Vec<&str> = given.iter().flatten().map(String::as_str).collect();
            slice(&[&[plane], &given[..]].concat(), "a.png");
            let image::DynamicImage::ImageLuma8(grey) = image::open(at("a.png")).unwrap() else { panic!("no grey") };
            assert_eq!(grey.dimensions(), (61, 40));
            let (level, window) = (level.unwrap_or(0.0), window.unwrap_or(2000.0));
            for (grey, hu) in grey.iter().zip(&hu) {
                let wanted = 255.0 * ((f64::from(*hu) - level + window / 2.0) / window).clamp(0.0, 1.0);
                assert!((f64::from(*grey) - wanted).abs() <= 0.5 + 1e-9, "{plane}: {hu} HU is {grey}");
            }
        }
    }
    slice(&["--plane=axial"], "plane.npy");
    let (_, plane) = npy(Path::new(&at("plane.npy")));
    for (kind, order) in [("min", [0, 1]), ("max", [1, 0])] {
        slice(&["--plane=axial", &format!("--slab=4,{kind}")], "slab.npy");
        let (_, slab) = npy(Path::new(&at("slab.npy")));
        assert!(slab.iter().zip(&plane).all(|(s, p)| [*s, *p][order[0]] <= [*s, *p][order[1]] + 1e-2), "{kind}");
    }
    slice(&["--plane=axial", "--slab=0,max"], "slab.npy");
    assert!(npy(Path::new(&at("slab.npy"))).1 == plane, "a slab without thickness is the plane");
    // The bytes are the same for any number of threads.
    for threads in ["1", "2", "3"] {
        slice(&["--plane=1,1,1", "--slab=3,mean", "--threads", threads], &format!("t{threads}.npy"));
    }
    let bytes = |n: &str| std::fs::read(at(n)).unwrap();
    assert!(bytes("t1.npy") == bytes("t2.npy") && bytes("t1.npy") == bytes("t3.npy"));
}

#[test]
fn slices_without_sense_are_refused_and_leave_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let png = at("a.png");
    let slice = |place: &str, plane: &str, out: &str, more: &[&str], status| {
        let base = ["slice", &format!("--at={place}"), &format!("--plane={plane}"), "--out", out];
        let said = run(&[&base, more].concat(), status);
        let said = String::from_utf8_lossy(&said.stderr).into_owned();
        let line = said.lines().find(|l| l.starts_with("error: ")).unwrap().to_owned();
        assert!(line.matches(": ").count() >= 2 && line.contains("; "), "WHAT: WHY; HOW TO MEND: {line}");
        line
    };
    for plane in ["0,0,0", "nan,0,1", "inf,0,1", "1,2", "1,2,3,4", "transverse", ""] {
        slice("0,0,0", plane, &png, &[], 2);
    }
    for place in ["nan,0,0", "0,inf,0", "1e999,0,0", "1,2", "cecum"] {
        slice(place, "axial", &png, &[], 2);
    }
    for more in ["--size=0x5", "--size=31623x31623", "--slab=21,mean", "--window=0", "--mm-per-pixel=0"] {
        slice("0,0,0", "axial", &png, &[more], 2);
    }
    for out in ["a.jpg", "a", "a.nii.gz"] {
        assert!(slice("0,0,0", "axial", &at(out), &[], 2).contains(".png or .npy"));
    }
    assert!(slice("9999,0,0", "axial", &png, &[], 4).contains("outside the scan"));
    slice("0,0,0", "axial", &at("missing/a.png"), &[], 5);
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    run(&["slice", "--plane=axial", "--out", &png], 2);
    run(&["slice", "none.nii", "--at=0,0,0", "--plane=axial", "--out", &png], 3);
}
