//! `colvis surface`: meshes read back and measured here, against known properties of balls, tubes, masks and phantoms.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::path::Path;
use std::process::Command;

use colvis::fields::lumen::{self, Interior};
use colvis::fields::voxels::VoxelBits;
use colvis::math::hash::uniform;
use colvis::phantom::{Phantom, PhantomSettings, Size};
use colvis::progress::Progress;
use colvis::surface::{LumenMesh, Measures};
use colvis::volume::{Grid, Volume, io};
use glam::{DMat3, DVec3};
use serde_json::Value;

/// A mesh with shared vertices.
struct Read {
    places: Vec<DVec3>,
    triangles: Vec<[usize; 3]>,
}

fn word(bytes: &[u8], at: usize) -> [u8; 4] {
    bytes[at..at + 4].try_into().unwrap()
}

fn place(bytes: &[u8], at: usize) -> DVec3 {
    DVec3::from_array([0, 4, 8].map(|n| f64::from(f32::from_le_bytes(word(bytes, at + n)))))
}

fn read(path: &Path) -> Read {
    let bytes = std::fs::read(path).unwrap();
    let (mut places, mut triangles) = (Vec::new(), Vec::new());
    match path.extension().unwrap().to_str().unwrap() {
        "stl" => {
            assert!(!bytes.starts_with(b"solid"), "it would be taken for text");
            let count = u32::from_le_bytes(word(&bytes, 80)) as usize;
            assert_eq!(bytes.len(), 84 + 50 * count);
            let mut known = BTreeMap::new();
            for n in 0..count {
                let corners = [12, 24, 36].map(|o| place(&bytes, 84 + 50 * n + o));
                let [a, b, c] = corners;
                let normal = place(&bytes, 84 + 50 * n);
                assert!(normal.dot((b - a).cross(c - a).normalize()) > 0.999, "as the corners are wound");
                triangles.push(corners.map(|p| {
                    *known.entry(p.to_array().map(f64::to_bits)).or_insert_with(|| {
                        places.push(p);
                        places.len() - 1
                    })
                }));
            }
        }
        "ply" => {
            let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
            let head = std::str::from_utf8(&bytes[..end]).unwrap();
            assert!(head.starts_with("ply\nformat binary_little_endian 1.0\n"));
            let count = |what: &str| -> usize {
                let line = head.lines().find_map(|l| l.strip_prefix(&format!("element {what} "))).unwrap();
                line.parse().unwrap()
            };
            places = (0..count("vertex")).map(|n| place(&bytes, end + 12 * n)).collect();
            let faces = end + 12 * places.len();
            assert_eq!(bytes.len(), faces + 13 * count("face"));
            for f in bytes[faces..].chunks_exact(13) {
                assert_eq!(f[0], 3);
                triangles.push([1, 5, 9].map(|o| u32::from_le_bytes(word(f, o)) as usize));
            }
        }
        _ => {
            for line in std::str::from_utf8(&bytes).unwrap().lines() {
                let words: Vec<&str> = line.split(' ').collect();
                match words[0] {
                    "v" => places.push(DVec3::from_array([1, 2, 3].map(|n| words[n].parse().unwrap()))),
                    "f" => triangles.push([1, 2, 3].map(|n| words[n].parse::<usize>().unwrap() - 1)),
                    _ => assert_eq!(words[0], "#"),
                }
            }
        }
    }
    Read { places, triangles }
}

impl Read {
    /// Checks that every side is traversed once in each direction, every vertex is used, and every triangle has an
    /// area. Returns area (mm²) and volume (mm³).
    fn check(&self) -> (f64, f64) {
        let mut sides: BTreeMap<(usize, usize), u32> = BTreeMap::new();
        let mut used = vec![false; self.places.len()];
        let (mut area, mut volume) = (0.0, 0.0);
        for t in &self.triangles {
            let [a, b, c] = t.map(|v| self.places[v] - self.places[0]);
            let own = 0.5 * (b - a).cross(c - a).length();
            assert!(own > 1e-7, "a triangle of {own} mm²");
            area += own;
            volume += a.dot(b.cross(c)) / 6.0;
            for n in 0..3 {
                used[t[n]] = true;
                *sides.entry((t[n], t[(n + 1) % 3])).or_default() += 1;
            }
        }
        for (&(a, b), &n) in &sides {
            assert_eq!((n, sides.get(&(b, a))), (1, Some(&1)), "one triangle on either hand");
        }
        assert!(used.into_iter().all(|u| u));
        (area, volume)
    }
}

/// Runs the command and prints its output if the exit status is not as expected.
fn surface(args: &[&str], status: i32) -> String {
    let out = Command::new(env!("CARGO_BIN_EXE_colvis")).arg("surface").args(args).output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(status), "surface {args:?}: {said}");
    said
}

/// Runs the command for each format and checks that all contain the same mesh, which the stats describe.
fn in_all_formats(folder: &Path, args: &[&str]) -> (Read, f64, f64) {
    let at = |n: &str| folder.join(n).to_str().unwrap().to_owned();
    let mut all: Vec<(Read, f64, f64)> = Vec::new();
    for name in ["m.stl", "m.ply", "m.obj"] {
        surface(&[args, &["--out", &at(name), "--stats", &at("s.json")]].concat(), 0);
        let mesh = read(Path::new(&at(name)));
        let (area, volume) = mesh.check();
        let stats: Value = serde_json::from_slice(&std::fs::read(at("s.json")).unwrap()).unwrap();
        let near = |name: &str, value: f64| {
            let told = stats[name].as_f64().unwrap();
            assert!((told / value - 1.0).abs() < 2e-5, "{name}: {told}, in the file {value}");
        };
        near("area_mm2", area);
        near("volume_ml", volume / 1000.0);
        assert_eq!(stats["boundary_edges"], 0);
        assert_eq!(stats["triangles"].as_u64().unwrap() as usize, mesh.triangles.len());
        assert_eq!(stats["vertices"].as_u64().unwrap() as usize, mesh.places.len());
        assert!(stats["prepare"]["surface_s"].as_f64().unwrap() > 0.0);
        all.push((mesh, area, volume));
    }
    assert!(all.iter().all(|m| m.0.triangles.len() == all[0].0.triangles.len()));
    all.swap_remove(1)
}

/// Returns the HU of a linear edge of 600 HU/mm at `far` mm outside gas.
fn edge(far: f64) -> f64 {
    (-650.0 + 600.0 * far).clamp(-1000.0, 40.0)
}

fn written(path: &Path, grid: &Grid, hu: impl Fn(DVec3) -> f64) -> String {
    let [nx, ny, _] = grid.dims();
    let place = |n: usize| grid.world(DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64));
    let data = (0..grid.len()).map(|n| hu(place(n)).round() as i16).collect();
    io::save(path, &Volume::new(grid.clone(), data), &Progress::new()).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Creates a tilted grid of anisotropic voxels, optionally mirrored.
fn oblique(mirror: f64) -> Grid {
    let (s, c) = 0.4f64.sin_cos();
    let turn = DMat3::from_cols(DVec3::new(c, s, 0.0), DVec3::new(-s, c, 0.0), DVec3::new(0.0, 0.0, mirror));
    let tilt = DMat3::from_cols(DVec3::X, DVec3::new(0.0, 0.8, 0.6), DVec3::new(0.0, -0.6, 0.8));
    Grid::new([60, 50, 34], DVec3::new(0.7, 0.8, 1.3), DVec3::new(-120.0, 60.0, 700.0), tilt * turn).unwrap()
}

#[test]
#[ignore = "slow: surfaces on fine grids"]
fn a_ball_in_a_tilted_grid_is_where_it_is_in_the_world() {
    for mirror in [1.0, -1.0] {
        let dir = tempfile::tempdir().unwrap();
        let grid = oblique(mirror);
        let (middle, r) = (grid.world(DVec3::new(29.3, 24.6, 16.4)), 12.0);
        let scan = written(&dir.path().join("b.nrrd"), &grid, |p| edge(p.distance(middle) - r));
        let from = format!("--from={},{},{}", middle.x, middle.y, middle.z);
        let (mesh, area, volume) = in_all_formats(dir.path(), &[&scan, &from]);
        assert!((area / (4.0 * PI * r * r) - 1.0).abs() < 0.01, "{area} mm²");
        assert!((volume / (4.0 / 3.0 * PI * r.powi(3)) - 1.0).abs() < 0.01, "{volume} mm³, and not less than none");
        for p in &mesh.places {
            assert!((p.distance(middle) - r).abs() < 0.15, "{p} is {} mm from the middle", p.distance(middle));
        }
        // Another wall is elsewhere: at −350 HU it is half a millimetre farther out.
        let wide = in_all_formats(dir.path(), &[&scan, &from, "--wall=-500,-200"]).2;
        let far = r + 0.5;
        assert!((wide / (4.0 / 3.0 * PI * far.powi(3)) - 1.0).abs() < 0.01, "{wide} mm³");
        let narrow = in_all_formats(dir.path(), &[&scan, &from, "--wall=-900,-500"]).2;
        let near = r - 50.0 / 600.0;
        assert!((narrow / (4.0 / 3.0 * PI * near.powi(3)) - 1.0).abs() < 0.01, "{narrow} mm³");
    }
}

#[test]
fn a_tube_through_the_scans_faces_is_capped() {
    let dir = tempfile::tempdir().unwrap();
    let grid = Grid::new([50, 50, 30], DVec3::new(0.8, 0.8, 1.5), DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let (r, length) = (12.0, 45.0);
    let far = |p: DVec3| (p.x - 19.7).hypot(p.y - 19.5) - r;
    let scan = written(&dir.path().join("t.nii.gz"), &grid, |p| edge(far(p)));
    let (mesh, area, volume) = in_all_formats(dir.path(), &[&scan, "--from", "19,19,20"]);
    assert!((volume / (PI * r * r * length) - 1.0).abs() < 0.01, "{volume}");
    assert!((area / (2.0 * PI * r * (length + r)) - 1.0).abs() < 0.015, "{area}");
    let (low, high) = mesh.places.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p.z), h.max(p.z)));
    assert!((low + 0.75).abs() < 1e-4 && (high - 44.25).abs() < 1e-4, "the outer faces of the outermost voxels");
}

#[test]
fn a_masks_steps_are_smoothed() {
    let dir = tempfile::tempdir().unwrap();
    let grid = oblique(1.0);
    let (middle, r) = (grid.world(DVec3::new(29.3, 24.6, 16.4)), 12.0);
    let [nx, ny, _] = grid.dims();
    let place = |n: usize| grid.world(DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64));
    let mask: Vec<u8> = (0..grid.len()).map(|n| 7 * u8::from(place(n).distance(middle) < r)).collect();
    let path = dir.path().join("m.nii.gz");
    io::save_mask(&path, &grid, &mask, &Progress::new()).unwrap();
    let (mesh, area, volume) = in_all_formats(dir.path(), &["--mask", path.to_str().unwrap()]);
    // Half-way between voxels the area would be 9 % too large.
    assert!((area / (4.0 * PI * r * r) - 1.0).abs() < 0.035, "{area} mm²");
    assert!((volume / (4.0 / 3.0 * PI * r.powi(3)) - 1.0).abs() < 0.02, "{volume} mm³");
    let off = mesh.places.iter().map(|p| (p.distance(middle) - r).powi(2)).sum::<f64>() / mesh.places.len() as f64;
    assert!(off.sqrt() < 0.2, "{} mm from the ball, root mean square", off.sqrt());
}

#[test]
fn noise_is_closed_too() {
    // Voxels that meet at edges and corners in every way, up to the faces of the grid.
    for (seed, share) in [(1, 0.5), (2, 0.2), (3, 0.8)] {
        let dims = [17, 15, 13];
        let grid = Grid::new(dims, DVec3::new(1.0, 0.5, 2.0), DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let data = (0..grid.len()).map(|n| i16::from(uniform(seed, n as u64) < share)).collect();
        let volume = Volume::new(grid, data);
        let mesh = LumenMesh::new(&Interior::of_mask(&volume).unwrap(), &Progress::new()).unwrap();
        let own = Read {
            places: (0..mesh.vertices() as u32).map(|v| mesh.world(v)).collect(),
            triangles: mesh.triangles().iter().map(|t| t.map(|v| v as usize)).collect(),
        };
        own.check();
        assert_eq!(Measures::of(&mesh).boundary_edges, 0);
    }
}

/// The phantom's area and volume: by the surface, and by integrals over its analytic wall.
///
/// With w the signed distance to first order, ∫ |∇w| dV over |w| < ε, divided by 2ε, is the mean area of the level sets
/// around the wall (co-area formula). Its difference from the area of w = 0 is of second order in ε. One jittered
/// sample is taken in each eighth of a voxel near the wall.
#[test]
#[ignore = "slow: integrates over a phantom's wall"]
fn a_phantoms_area_and_volume_are_its_truths() {
    const BAND_MM: f64 = 0.5;
    let progress = Progress::new();
    let phantom = Phantom::new(&PhantomSettings { size: Size::Small, ..PhantomSettings::default() });
    let grid = phantom.grid();
    let volume = phantom.voxelise(&grid, &progress).unwrap();
    let lumen = lumen::find(&volume, &progress).unwrap();
    let interior = Interior::of_lumen(&volume, &lumen, -650.0, &progress).unwrap();
    let (mesh, islands) = LumenMesh::new(&interior, &progress).unwrap().without_islands();
    let m = Measures::of(&mesh);
    assert_eq!((m.boundary_edges, m.components, islands), (0, 1, 0));
    let near = interior.set().bits().dilated(2).numbered().unwrap();
    let outside = VoxelBits::from_fn(grid.dims(), |n| {
        let [nx, ny, _] = grid.dims();
        !interior.set().contains([(n % nx) as i64, (n / nx % ny) as i64, (n / nx / ny) as i64])
    });
    let outside = outside.dilated(2);
    let (mut area, mut samples) = (0.0, 0u64);
    let cell = grid.voxel_ml() * 1000.0 / 8.0;
    near.for_each(|_, v| {
        if !outside.contains(v.map(|x| x as i64)) {
            return;
        }
        for eighth in 0..8u64 {
            samples += 1;
            let jitter = [0, 1, 2].map(|a| 0.5 * ((eighth >> a & 1) as f64 + uniform(11 + a, samples)) - 0.5);
            let p = grid.world(DVec3::from_array([0, 1, 2].map(|a| v[a] as f64 + jitter[a])));
            if phantom.wall(p).abs() < BAND_MM {
                let slope = |d: DVec3| (phantom.wall(p + d) - phantom.wall(p - d)) / (2.0 * d.length());
                let h = 1e-3;
                area += cell * DVec3::new(slope(h * DVec3::X), slope(h * DVec3::Y), slope(h * DVec3::Z)).length();
            }
        }
    });
    area /= 2.0 * BAND_MM;
    let truth = phantom.truth().lumen_ml;
    println!("area {} mm², {area} by the integral; volume {} ml, {truth} in truth", m.area_mm2, m.volume_ml);
    assert!((m.area_mm2 / area - 1.0).abs() < 0.02, "{} mm², not {area}", m.area_mm2);
    assert!((m.volume_ml / truth - 1.0).abs() < 0.012, "{} ml, not {truth}", m.volume_ml);
}

#[test]
fn what_cannot_be_made_is_told_and_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let at = |n: &str| dir.path().join(n).to_str().unwrap().to_owned();
    let grid = Grid::new([20; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let tissue = written(&dir.path().join("t.nii.gz"), &grid, |_| 40.0);
    let out = at("o.stl");
    assert!(surface(&[&tissue, "--out", &at("o.xyz")], 2).contains(".stl, .ply or .obj"));
    surface(&[&tissue, "--out", &out], 4);
    surface(&[&tissue, "--from", "9,9,9", "--out", &out], 4);
    surface(&["--mask", &tissue, &tissue, "--out", &out], 2);
    surface(&["--out", &out], 2);
    surface(&[&at("none.nii"), "--out", &out], 3);
    surface(&[&tissue, "--from", "9,9,9", "--out", &at("none/o.stl")], 5);
    io::save_mask(Path::new(&at("e.nii.gz")), &grid, &vec![0; grid.len()], &Progress::new()).unwrap();
    surface(&["--mask", &at("e.nii.gz"), "--out", &out], 4);
    assert!(!Path::new(&out).exists());
    // So far from the world's origin, single precision would fold triangles.
    let far = Grid::new([9; 3], DVec3::ONE, DVec3::splat(1e6), DMat3::IDENTITY).unwrap();
    let mut mask = vec![0; far.len()];
    mask[364] = 1;
    io::save_mask(Path::new(&at("f.mha")), &far, &mask, &Progress::new()).unwrap();
    assert!(surface(&["--mask", &at("f.mha"), "--out", &out], 2).contains(".ply"));
    surface(&["--mask", &at("f.mha"), "--out", &at("f.ply")], 0);
    let head = String::from_utf8_lossy(&std::fs::read(at("f.ply")).unwrap()[..300]).into_owned();
    assert!(head.contains("property double x"));
}
