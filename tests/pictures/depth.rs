//! Depth and normals of the renderer against the phantom's analytic wall.
//!
//! Interpolated between voxels, the blurred wall appears about 0.07 voxels too near to the camera: below the edge's
//! middle the value curves upwards, and its chords are above it. A ray that just passes a fold's rim may therefore hit
//! it. This causes the few large errors, all of which are on such rims.

use std::path::Path;
use std::sync::Arc;

use colvis::math::hash;
use colvis::phantom::{Phantom, PhantomSettings, Size};
use colvis::progress::Progress;
use colvis::render::internals::{Regression, Weighting, block, central_differences, to_world};
use colvis::render::{Frame, PreparedVolume, Quality, TransferFunction, View, render};
use colvis::volume::{Volume, io};
use glam::DVec3;
use rayon::prelude::*;

use crate::support::program::colvis;

/// Rays that meet the wall at a smaller angle than this are not judged, degrees.
const GRAZING: f64 = 20.0;
/// Rays are not followed beyond this, mm: the small body is smaller.
const FAR: f64 = 300.0;

fn phantom(noise: bool) -> (Phantom, Volume) {
    let phantom = Phantom::new(&PhantomSettings { size: Size::Small, noise, ..PhantomSettings::default() });
    let volume = phantom.voxelise(&phantom.grid(), &Progress::new()).unwrap();
    (phantom, volume)
}

/// A pose in the lumen, at a share of the path's length, off the axis and turned away from it.
#[derive(Clone, Copy)]
struct Pose {
    position: DVec3,
    forward: DVec3,
    up: DVec3,
}

fn pose(phantom: &Phantom, n: u64) -> Pose {
    let u = |k| hash::uniform(0xDE97, 8 * n + k);
    let axis = phantom.axis();
    let frame = axis.frame(axis.length() * (0.08 + 0.12 * n as f64));
    let position = frame.at + frame.direction(6.3 * u(0)) * (4.0 * u(1));
    let turn = frame.direction(6.3 * u(2)) * (1.2 * u(3));
    let along = if n.is_multiple_of(2) { frame.tangent } else { -frame.tangent };
    Pose { position, forward: along + turn, up: frame.direction(6.3 * u(4)) }
}

fn view(p: Pose, side: usize) -> View {
    View::new(p.position, p.forward, p.up, 90.0, side, side).unwrap()
}

/// Returns the distance to the analytic wall along a ray, by steps and bisection, or infinity if there is none.
fn true_distance(phantom: &Phantom, from: DVec3, direction: DVec3) -> f64 {
    const STEP: f64 = 0.2;
    let outside = |t: f64| phantom.wall(from + direction * t) >= 0.0;
    let mut n = 1;
    while !outside(f64::from(n) * STEP) {
        n += 1;
        if f64::from(n) * STEP > FAR {
            return f64::INFINITY;
        }
    }
    let (mut lo, mut hi) = (f64::from(n - 1) * STEP, f64::from(n) * STEP);
    for _ in 0..30 {
        let middle = 0.5 * (lo + hi);
        if outside(middle) { hi = middle } else { lo = middle }
    }
    0.5 * (lo + hi)
}

/// Returns the true depth of each pixel whose ray does not graze the wall, mm.
fn truth(phantom: &Phantom, view: &View) -> Vec<Option<f64>> {
    assert!(phantom.wall(view.position()) < -1.0, "the camera is in the lumen");
    let one = |n: usize| {
        let direction = view.ray(n % view.width(), n / view.width()).unwrap().direction;
        let t = true_distance(phantom, view.position(), direction);
        let normal = phantom.gradient(view.position() + direction * t).normalize();
        (normal.dot(direction).abs() > GRAZING.to_radians().sin()).then_some(t)
    };
    (0..view.width() * view.height()).into_par_iter().map(one).collect()
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}

/// Compares a depth image with its truth, in voxels (the least spacing), and prints the numbers.
fn judge(name: &str, phantom: &Phantom, truth: &[Option<f64>], depth: &[f32]) {
    let voxel = phantom.grid().min_spacing();
    assert_eq!(truth.len(), depth.len());
    let pairs = truth.iter().zip(depth);
    let mut errors: Vec<f64> = pairs.filter_map(|(t, d)| t.map(|t| (f64::from(*d) - t).abs() / voxel)).collect();
    errors.sort_by(f64::total_cmp);
    let (median, most) = (quantile(&errors, 0.5), quantile(&errors, 0.99));
    let over = 100.0 * errors.iter().filter(|e| **e > 0.5).count() as f64 / errors.len() as f64;
    let (judged, pixels) = (errors.len(), depth.len());
    println!("{name}: {judged} of {pixels} pixels judged, error in voxels:");
    println!("  median {median:.3}, 99 % {most:.3}, {over:.2} % above 0.5");
    assert!(judged * 2 > pixels, "{name}: most pixels are judged");
    assert!(median <= 0.1, "{name}: median {median}");
    assert!(most <= 0.5, "{name}: 99 % {most}");
}

#[test]
#[ignore = "slow: the analytic wall behind every pixel"]
fn depth_is_that_of_the_analytic_wall() {
    // Only the voxels have noise: both volumes have the same wall.
    let volumes = [false, true].map(|noise| {
        let (phantom, volume) = phantom(noise);
        (
            if noise { "noise" } else { "no noise" },
            phantom,
            PreparedVolume::new(Arc::new(volume), TransferFunction::default()),
        )
    });
    let settings = colvis::render::Settings::new(Quality::Reference);
    for n in 0..6 {
        let view = view(pose(&volumes[0].1, n), 64);
        let truth = truth(&volumes[0].1, &view);
        for (noise, phantom, volume) in &volumes {
            let mut frame = Frame::with_depth(64, 64);
            render(volume, &view, &settings, &mut frame);
            judge(&format!("pose {n}, {noise}"), phantom, &truth, frame.depth().unwrap());
        }
    }
}

/// Reads a NumPy array of float32 and checks its whole header.
fn npy(path: &Path, rows: usize, columns: usize) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(bytes[..8], *b"\x93NUMPY\x01\x00");
    let end = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    assert!(end.is_multiple_of(64) && bytes[end - 1] == b'\n');
    let header = std::str::from_utf8(&bytes[10..end]).unwrap();
    for part in ["'descr': '<f4'", "'fortran_order': False", &format!("'shape': ({rows}, {columns})")] {
        assert!(header.contains(part), "{header}");
    }
    assert_eq!(bytes.len() - end, 4 * rows * columns);
    bytes[end..].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

#[test]
fn the_program_writes_that_depth() {
    let dir = tempfile::tempdir().unwrap();
    let (phantom, volume) = phantom(true);
    io::save(&dir.path().join("v.nii"), &volume, &Progress::new()).unwrap();
    let p = pose(&phantom, 3);
    let [position, forward, up] = [p.position, p.forward, p.up].map(|v| v.to_array());
    let one = serde_json::json!({"position": position, "forward": forward, "up": up});
    std::fs::write(dir.path().join("p.json"), serde_json::json!({"poses": [one]}).to_string()).unwrap();
    let done = colvis()
        .current_dir(dir.path())
        .args(["render", "v.nii", "--poses", "p.json", "--out", "out", "--size", "120x96", "--quality", "reference"])
        .arg("--depth")
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert!(dir.path().join("out/0000.png").is_file());
    let depth = npy(&dir.path().join("out/0000.npy"), 96, 120);
    let view = View::new(p.position, p.forward, p.up, 90.0, 120, 96).unwrap();
    judge("through the program", &phantom, &truth(&phantom, &view), &depth);
}

/// Returns mean angular errors in degrees at points on the wall: central differences, then w = 1/d², then w = 1/d.
fn angular_errors(phantom: &Phantom, volume: &Volume) -> [f64; 3] {
    let grid = volume.grid();
    let turn = to_world(volume).as_dmat3();
    let regressions = [Weighting::InverseSquare, Weighting::Inverse].map(|w| Regression::new(grid.spacing(), w));
    let axis = phantom.axis();
    let place = |n: u64| {
        let u = |k| hash::uniform(0x0A51, 4 * n + k);
        let frame = axis.frame(axis.length() * (0.02 + 0.96 * u(0)));
        let direction = (frame.direction(6.3 * u(1)) + frame.tangent * (u(2) - 0.5)).normalize();
        let at = frame.at + direction * true_distance(phantom, frame.at, direction);
        let normal = phantom.gradient(at).normalize();
        let voxel = grid.voxel(at);
        let first = voxel.floor().to_array().map(|c| c as i32 - 1);
        let (block, t) = (block(volume, first), (voxel - voxel.floor()).as_vec3());
        let central = central_differences(&block, t, grid.spacing().as_vec3());
        let [square, plain] = regressions.map(|r| r.fit(&block, t).gradient);
        [central, square, plain].map(|g| (turn * g.as_dvec3()).angle_between(normal).to_degrees())
    };
    let all: Vec<[f64; 3]> = (0..4000).into_par_iter().map(place).collect();
    std::array::from_fn(|e| all.iter().map(|a| a[e]).sum::<f64>() / all.len() as f64)
}

#[test]
fn normals_are_ordered_by_their_estimators() {
    println!("noise HU   central   1/d²   1/d (mean angular error, degrees)");
    let [clean, noisy] = [false, true].map(|noise| {
        let (phantom, volume) = phantom(noise);
        let e = angular_errors(&phantom, &volume);
        println!("{:8} {:9.2} {:6.2} {:5.2}", if noise { 22 } else { 0 }, e[0], e[1], e[2]);
        e
    });
    // A tube of 20 voxels radius has the same order, without noise and with 30 HU.
    for e in [clean, noisy] {
        assert!(e[1] < e[2] && e[2] < e[0], "{e:?}");
    }
    assert!(clean[1] < 2.5 && noisy[1] < 2.7 && (0..3).all(|n| clean[n] < noisy[n]), "{clean:?} {noisy:?}");
}
