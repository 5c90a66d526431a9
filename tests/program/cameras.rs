//! `colvis render` with cameras other than the perspective one: depth and normals against a ray marcher of this file's own, pictures
//! against the reference, and what is refused.

use std::path::Path;

use glam::{DVec3, Vec3};

use crate::support::run::run;

const DIMS: [usize; 3] = [64, 56, 48];
const SPACING: DVec3 = DVec3::new(0.8, 0.9, 1.1);
const ORIGIN: DVec3 = DVec3::new(-11.0, 7.0, 30.0);
const EYE: DVec3 = DVec3::new(15.3, 30.2, 57.0);
const FORWARD: DVec3 = DVec3::new(0.2, 0.9, -0.3);
const UP: DVec3 = DVec3::new(0.1, 0.2, 1.0);

/// A room with folded walls, HU.
fn voxels() -> Vec<i16> {
    let value = |n: usize| {
        let index = DVec3::new((n % 64) as f64, (n / 64 % 56) as f64, (n / (64 * 56)) as f64);
        let p = (index - DVec3::new(31.5, 27.5, 23.5)) * SPACING;
        let fold = 2.0 * (0.5 * p.x).sin() + 1.5 * (0.7 * p.z + 0.3 * p.y).cos();
        (-650.0 + 180.0 * (p.length() - 17.0 - fold)).clamp(-1000.0, 60.0).round() as i16
    };
    (0..DIMS.iter().product()).map(value).collect()
}

/// Returns the trilinear HU at a place within the volume, world mm.
fn hu(voxels: &[i16], place: DVec3) -> f64 {
    let p = (place - ORIGIN) / SPACING;
    let base = p.floor();
    let t = p - base;
    let mut sum = 0.0;
    for n in 0..8 {
        let corner = [n & 1, n >> 1 & 1, n >> 2];
        let at = [0, 1, 2].map(|a| (base[a] as usize) + corner[a]);
        let weight: f64 = (0..3).map(|a| if corner[a] == 1 { t[a] } else { 1.0 - t[a] }).product();
        sum += weight * f64::from(voxels[at[0] + DIMS[0] * (at[1] + DIMS[1] * at[2])]);
    }
    sum
}

/// Marches in small steps, and halves the last one until the wall is found.
fn march(voxels: &[i16], along: DVec3) -> f64 {
    let is_wall = |t: f64| hu(voxels, EYE + along * t) >= -650.0;
    let (mut low, mut high) = (0.0, 0.01);
    while !is_wall(high) {
        (low, high) = (high, high + 0.01);
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if is_wall(middle) { high = middle } else { low = middle }
    }
    high
}

/// Returns the gradient of the trilinear volume just before a place that is reached along a ray, HU/mm.
fn gradient(voxels: &[i16], place: DVec3, along: DVec3) -> DVec3 {
    let at = place - along * 1e-5;
    let change = |axis: DVec3| (hu(voxels, at + axis * 1e-6) - hu(voxels, at - axis * 1e-6)) / 2e-6;
    DVec3::new(change(DVec3::X), change(DVec3::Y), change(DVec3::Z))
}

/// Returns the numbers of an array of float32.
fn npy(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    let head = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[head..].chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
}

fn write_scan(folder: &Path) {
    let raw: Vec<u8> = voxels().iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(folder.join("room.raw"), raw).unwrap();
    let text = |v: [String; 3]| v.join(" ");
    let [spacing, origin] = [SPACING, ORIGIN].map(|v| text(v.to_array().map(|c| c.to_string())));
    let head = format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nOffset = {origin}\n\
         ElementSpacing = {spacing}\nDimSize = {}\nElementType = MET_SHORT\nElementDataFile = room.raw\n",
        text(DIMS.map(|n| n.to_string()))
    );
    std::fs::write(folder.join("room.mhd"), head).unwrap();
}

fn write_poses(path: &Path, camera: Option<&str>) {
    let list = |v: DVec3| format!("[{},{},{}]", v.x, v.y, v.z);
    let camera = camera.map_or_else(String::new, |c| format!(r#""camera": {c}, "#));
    let [eye, forward, up] = [EYE, FORWARD, UP].map(list);
    let text = format!(r#"{{{camera}"poses": [{{"position": {eye}, "forward": {forward}, "up": {up}}}]}}"#);
    std::fs::write(path, text).unwrap();
}

/// The direction that a pixel shows, right, up and forward: by the definitions, and solved by halving.
type Direction = fn(f64, f64) -> Option<DVec3>;
/// A camera's name, what the poses file has of it, its options, its image's size and the directions of its pixels.
type Case = (&'static str, Option<&'static str>, &'static [&'static str], [usize; 2], Direction);

const COEFFICIENTS: &str =
    r#"{"model": "fisheye", "fx": 31, "fy": 29, "cx": 24.5, "cy": 16, "k": [0.06, -0.02, 0.004, -0.0005]}"#;

fn kannala_brandt(x: f64, y: f64) -> Option<DVec3> {
    let (u, v) = ((x - 24.5) / 31.0, (y - 16.0) / 29.0);
    let r = |a: f64| a + 0.06 * a.powi(3) - 0.02 * a.powi(5) + 0.004 * a.powi(7) - 0.0005 * a.powi(9);
    let wanted = u.hypot(v);
    let (mut low, mut high) = (0.0, 0.0);
    while r(high) < wanted {
        (low, high) = (high, high + 0.01);
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if r(middle) < wanted { low = middle } else { high = middle }
    }
    let share = low.sin() / wanted.max(1e-300);
    Some(DVec3::new(u * share, -v * share, low.cos()))
}

const TAYLOR: &str =
    r#"{"model": "scaramuzza", "a": [20, -0.012, 0.0001, -2e-6], "cx": 24, "cy": 17, "stretch": [1.01, 0.02, -0.01]}"#;

fn taylor(x: f64, y: f64) -> Option<DVec3> {
    // The inverse of [c d; e 1].
    let (x, y, determinant) = (x - 24.0, y - 17.0, 1.01 + 0.02 * 0.01);
    let (u, v) = ((x - 0.02 * y) / determinant, (0.01 * x + 1.01 * y) / determinant);
    let rho = u.hypot(v);
    let ahead = 20.0 - 0.012 * rho.powi(2) + 0.0001 * rho.powi(3) - 2e-6 * rho.powi(4);
    Some(DVec3::new(u, -v, ahead).normalize())
}

fn panorama(x: f64, y: f64) -> Option<DVec3> {
    let (longitude, latitude) = (((x + 0.5) / 64.0 - 0.5) * 360.0, (0.5 - (y + 0.5) / 32.0) * 180.0);
    let (across, ahead) = longitude.to_radians().sin_cos();
    let (up, level) = latitude.to_radians().sin_cos();
    Some(DVec3::new(level * across, up, level * ahead))
}

fn fisheye_200(x: f64, y: f64) -> Option<DVec3> {
    let (u, v) = ((x + 0.5 - 24.0) / 18.0, (18.0 - y - 0.5) / 18.0);
    let angle = u.hypot(v) * 100f64.to_radians();
    let share = angle.sin() / u.hypot(v);
    (angle <= std::f64::consts::PI).then(|| DVec3::new(u * share, v * share, angle.cos()))
}

#[test]
fn depth_and_normals_are_those_of_a_marcher_for_every_camera() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    write_scan(dir.path());
    let voxels = voxels();
    let (forward, right) = (FORWARD.normalize(), FORWARD.cross(UP).normalize());
    let up = right.cross(forward);
    let cameras: [Case; 4] = [
        ("kannala-brandt", Some(COEFFICIENTS), &[], [48, 36], kannala_brandt),
        ("scaramuzza", Some(TAYLOR), &[], [48, 36], taylor),
        ("panorama", None, &["--camera", "panorama"], [64, 32], panorama),
        ("fisheye", None, &["--camera", "fisheye", "--fov", "200"], [48, 36], fisheye_200),
    ];
    for (name, camera, options, [width, height], direction) in cameras {
        write_poses(&dir.path().join("poses.json"), camera);
        let size = format!("{width}x{height}");
        let out = at(name);
        let (scan, poses) = (at("room.mhd"), at("poses.json"));
        let line = ["render", &scan, "--poses", &poses, "--out", &out, "--size", &size, "--depth", "--normals"];
        run(&[&line[..], options].concat(), 0);
        let depths = npy(&dir.path().join(name).join("0000.npy"));
        let normals = npy(&dir.path().join(name).join("0000.normals.npy"));
        assert_eq!((depths.len(), normals.len()), (width * height, 3 * width * height));
        let (mut deep, mut turned) = (0, 0);
        for (n, &depth) in depths.iter().enumerate() {
            let normal = Vec3::from_slice(&normals[3 * n..3 * n + 3]);
            let Some(local) = direction((n % width) as f64, (n / width) as f64) else {
                assert!(depth == f32::INFINITY && normal.is_nan(), "{name}: pixel {n} shows nothing");
                continue;
            };
            let along = right * local.x + up * local.y + forward * local.z;
            let exact = march(&voxels, along);
            deep += usize::from((f64::from(depth) - exact).abs() > 0.1);
            assert!((normal.length() - 1.0).abs() < 1e-5, "{name}: {normal}");
            assert!(normal.dot(along.as_vec3()) < 1e-5, "{name}: {normal} points away from the camera");
            let wall = -gradient(&voxels, EYE + along * exact, along).normalize();
            turned += usize::from(wall.angle_between(normal.as_dvec3()) > 0.01);
        }
        let most = depths.len() / 200;
        assert!(
            deep <= most && turned <= most,
            "{name}: {deep} depths and {turned} normals of {} differ",
            depths.len()
        );
    }
}

#[test]
fn pictures_are_close_to_the_reference() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    write_scan(dir.path());
    let wide = r#"{"model": "fisheye", "fx": 60, "fy": 60, "cx": 80, "cy": 60, "k": [0.06, -0.02, 0.004, -0.0005]}"#;
    for (camera, options) in [
        (Some(wide), &["--size", "160x120"][..]),
        (None, &["--camera", "panorama", "--size", "512x256"]),
        (None, &["--camera", "fisheye", "--fov", "180", "--size", "160x160"]),
    ] {
        write_poses(&dir.path().join("poses.json"), camera);
        let render = |out: &str, quality: &str| {
            let (scan, poses, out) = (at("room.mhd"), at("poses.json"), at(out));
            let line = ["render", &scan, "--poses", &poses, "--out", &out, "--quality", quality];
            run(&[&line[..], options].concat(), 0);
            image::open(dir.path().join(out).join("0000.png")).unwrap().into_rgb8().into_raw()
        };
        let (high, exact) = (render("high", "high"), render("reference", "reference"));
        let squares: f64 = high.iter().zip(&exact).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum();
        let db = 10.0 * (255f64.powi(2) * high.len() as f64 / squares.max(1e-9)).log10();
        assert!(db >= 42.0, "{options:?}: {db:.1} dB");
        assert!(exact.iter().any(|v| *v > 60), "{options:?}: there is something to see");
    }
}

#[test]
fn coefficients_that_fold_back_leave_the_rest_black() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    write_scan(dir.path());
    // r = θ − θ³/3 grows up to 57°, at 2/3 of the focal length: 20 pixels.
    let folds =
        r#"{"model": "fisheye", "fx": 30, "fy": 30, "cx": 31.5, "cy": 23.5, "k": [-0.3333333333333333, 0, 0, 0]}"#;
    write_poses(&dir.path().join("poses.json"), Some(folds));
    let (scan, poses, out) = (at("room.mhd"), at("poses.json"), at("out"));
    run(&["render", &scan, "--poses", &poses, "--out", &out, "--size", "64x48", "--depth"], 0);
    let depths = npy(&dir.path().join("out/0000.npy"));
    let picture = image::open(dir.path().join("out/0000.png")).unwrap().into_rgb8();
    for (n, (depth, pixel)) in depths.iter().zip(picture.pixels()).enumerate() {
        let radius = ((n % 64) as f64 - 31.5).hypot((n / 64) as f64 - 23.5);
        assert_eq!(depth.is_finite(), radius < 20.0, "{radius}");
        assert!(radius < 20.0 || pixel.0 == [0; 3], "{radius}");
    }
}

#[test]
fn cameras_without_sense_are_refused_with_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    write_scan(dir.path());
    let said = |camera: Option<&str>, more: &[&str], status: i32| {
        write_poses(&dir.path().join("poses.json"), camera);
        let (scan, poses, out) = (at("room.mhd"), at("poses.json"), at("out"));
        let out = run(&[&["render", &scan, "--poses", &poses, "--out", &out][..], more].concat(), status);
        String::from_utf8_lossy(&out.stderr).into_owned()
    };
    for (camera, why) in [
        (r#"{"model": "keyhole"}"#, "keyhole"),
        (r#""keyhole""#, "keyhole"),
        (r#"{"fx": 1}"#, "model"),
        ("[]", "object"),
        (r#"{"model": "fisheye", "fx": 0, "fy": 1, "cx": 1, "cy": 1, "k": [0,0,0,0]}"#, "fx"),
        (r#"{"model": "fisheye", "fx": 1, "fy": 1, "cx": 1, "k": [0,0,0,0]}"#, "cy"),
        (r#"{"model": "scaramuzza", "a": [-1,0,0,0], "cx": 1, "cy": 1, "stretch": [1,0,0]}"#, "never grow"),
    ] {
        let said = said(Some(camera), &["--size", "32x24"], 2);
        assert!(said.contains(why) && said.contains("poses.json"), "{camera}: {said}");
    }
    let square = said(None, &["--camera", "panorama", "--size", "64x64"], 2);
    assert!(square.contains("128x64"), "{square}");
    assert!(said(None, &["--camera", "fisheye", "--fov", "221"], 2).contains("220"));
    said(None, &["--camera", "fisheye", "--size", "0x0"], 2);
    for option in [["--camera", "fisheye"], ["--fov", "90"]] {
        assert!(said(Some(COEFFICIENTS), &option, 2).contains("holds a camera"), "{option:?}");
    }
    assert!(!dir.path().join("out").exists(), "nothing was written");
    // A model that is only named has the command line's view angle, and a panorama its own size.
    said(Some(r#""fisheye""#), &["--fov", "150", "--size", "16x16"], 0);
    said(Some(r#""panorama""#), &["--size", "32x16"], 0);
}
