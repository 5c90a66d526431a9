//! Left and right, front and back: one body with one polyp gives the same picture through every reader and on every
//! kind of grid, and the polyp is where the camera must show it.

use std::path::Path;
use std::sync::Arc;

use colvis::phantom::{Phantom, PhantomSettings, Size};
use colvis::progress::Progress;
use colvis::render::slice::{Slice, SlicePlane};
use colvis::render::{self, Frame, PreparedVolume, Preset, Quality, Reuse, TransferFunction, View, psnr, renderer};
use colvis::volume::{Grid, Volume, io};
use glam::{DMat3, DVec3};

use crate::frames::shown;
use crate::support::nifti::Nifti;
use crate::support::reading::load;

/// Side of the square image with a view angle of 90°, pixels.
const SIDE: usize = 96;
/// Distance of the camera from the polyp, mm.
const BEFORE: f64 = 22.0;
/// The body is kept within this distance of the polyp's place on the axis, mm. Beyond it everything becomes tissue, so
/// that the picture does not depend on where a grid ends.
const KEPT: f64 = 27.0;
/// Half of a grid's edge, mm.
const HALF: f64 = 32.0;
const VOXEL: f64 = 0.7;

/// To the patient's left and a little to the front.
const LEFT_FRONT: DVec3 = DVec3::new(1.0, -0.5, 0.0);

/// The wall near a point where the axis runs along the patient's long axis, with or without a polyp on one side.
struct Body {
    phantom: Phantom,
    /// Arc length and point on the axis.
    s: f64,
    centre: DVec3,
    /// Centre of the polyp's ball.
    polyp: Option<DVec3>,
}

impl Body {
    fn new(side: Option<DVec3>) -> Self {
        let settings = PhantomSettings {
            size: Size::Small,
            folds: false,
            polyps: false,
            noise: false,
            ..PhantomSettings::default()
        };
        let bare = Phantom::new(&settings);
        let axis = bare.axis();
        let upright = |s: f64| (-4..=4).map(|k| axis.frame(s + 7.0 * f64::from(k)).tangent.z.abs()).fold(1.0, f64::min);
        let places = (40..axis.length() as i32 - 40).map(f64::from);
        let s = places.max_by(|a, b| upright(*a).total_cmp(&upright(*b))).unwrap();
        assert!(upright(s) > 0.9, "a straight stretch");
        let centre = axis.frame(s).at;
        let polyps: Vec<_> = side.map(|d| bare.polyp_at(s, d, 8.0)).into_iter().collect();
        let polyp = polyps.first().map(|p| p.position);
        Self { phantom: Phantom::with_polyps(&settings, &polyps), s, centre, polyp }
    }

    /// Creates a grid around the point with the given directions of its index axes.
    fn grid(&self, direction: DMat3, spacing: DVec3) -> Grid {
        let dims = (2.0 * HALF / spacing).ceil();
        // Rounded to the few digits that a header holds.
        let origin = ((self.centre - direction * (0.5 * (dims - 1.0) * spacing)) * 1e4).round() / 1e4;
        Grid::new(dims.to_array().map(|n| n as usize), spacing, origin, direction).unwrap()
    }

    /// Returns the body's values at the voxels' world positions.
    fn on(&self, grid: &Grid) -> Volume {
        let [nx, ny, _] = grid.dims();
        let mut data = self.phantom.voxelise(grid, &Progress::new()).unwrap().data().to_vec();
        for (n, hu) in data.iter_mut().enumerate() {
            let at = grid.world(DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64));
            let t = (((at - self.centre).length() - KEPT) / 3.0).clamp(0.0, 1.0);
            let share = t * t * (3.0 - 2.0 * t);
            *hu = (f64::from(*hu) * (1.0 - share) + 40.0 * share).round() as i16;
        }
        Volume::new(grid.clone(), data)
    }

    fn plain(&self) -> Volume {
        self.on(&self.grid(DMat3::IDENTITY, DVec3::splat(VOXEL)))
    }

    fn eye(&self, backwards: bool) -> Eye {
        let axis = self.phantom.axis();
        let from = axis.frame(if backwards { self.s + BEFORE } else { self.s - BEFORE });
        let forward = if backwards { -from.tangent } else { from.tangent };
        Eye { position: from.at, forward }
    }
}

/// A camera that looks along the axis with the patient's front at the top.
struct Eye {
    position: DVec3,
    forward: DVec3,
}

impl Eye {
    fn look(&self, volume: Volume) -> Frame {
        let volume = PreparedVolume::new(Arc::new(volume), TransferFunction::default());
        let view = View::new(self.position, self.forward, DVec3::NEG_Y, 90.0, SIDE, SIDE).unwrap();
        let mut frame = Frame::with_depth(SIDE, SIDE);
        render::render(&volume, &view, &render::Settings::new(Quality::Reference), &mut frame);
        // The renderer used in flight must not flip the image either.
        let mut flown = Frame::default();
        renderer(&volume, render::Settings::default(), Preset::default(), Reuse::Allowed).render(&view, &mut flown);
        let db = psnr(&flown, &frame);
        assert!(
            db >= 47.0,
            "the default renderer: {db:.1} dB; {}",
            shown("handedness default renderer", &frame, &flown)
        );
        frame
    }

    /// Returns the image position of a point, in pixels from the centre, to the right and up.
    fn project(&self, place: DVec3) -> [f64; 2] {
        let forward = self.forward.normalize();
        let right = forward.cross(DVec3::NEG_Y).normalize();
        let up = right.cross(forward);
        let d = place - self.position;
        let scale = 0.5 * SIDE as f64 / d.dot(forward);
        [d.dot(right) * scale, d.dot(up) * scale]
    }
}

/// Returns the centre of the differences between two pictures, in pixels from the image's centre, to the right and up,
/// by depth and by brightness.
fn difference(a: &Frame, b: &Frame) -> [[f64; 2]; 2] {
    let depth: Vec<f64> = a
        .depth()
        .unwrap()
        .iter()
        .zip(b.depth().unwrap())
        .map(|(a, b)| f64::from((a - b).abs()))
        .map(|d| if d > 0.7 { 1.0 } else { 0.0 })
        .collect();
    let bright: Vec<f64> = a
        .pixels()
        .iter()
        .zip(b.pixels())
        .map(|(a, b)| f64::from(a[0].abs_diff(b[0])))
        .map(|d| if d > 12.0 { d } else { 0.0 })
        .collect();
    [depth, bright].map(|weights| {
        let sum: f64 = weights.iter().sum();
        assert!(sum > 0.0, "the pictures differ");
        let half = 0.5 * SIDE as f64;
        let mean = |place: fn(usize) -> usize| {
            weights.iter().enumerate().map(|(n, w)| w * (place(n) as f64 + 0.5)).sum::<f64>() / sum
        };
        [mean(|n| n % SIDE) - half, half - mean(|n| n / SIDE)]
    })
}

/// Asserts that the polyp is where it should be: `with` differs from `without` around its place.
fn assert_there(name: &str, place: [f64; 2], with: &Frame, without: &Frame) {
    for (kind, at) in ["depth", "brightness"].iter().zip(difference(with, without)) {
        let off = (at[0] - place[0]).hypot(at[1] - place[1]);
        println!("{name}: by {kind} at {:.1}, {:.1}, expected {:.1}, {:.1}", at[0], at[1], place[0], place[1]);
        assert!(
            off < 3.0,
            "{name}: by {kind} {off:.1} pixels off; {}",
            shown(&format!("handedness {name}"), without, with)
        );
    }
}

#[test]
fn a_polyp_is_on_its_side() {
    let bare = Body::new(None);
    for (name, side) in [
        ("left, front", LEFT_FRONT),
        ("right, front", DVec3::new(-1.0, -0.5, 0.0)),
        ("left, back", DVec3::new(1.0, 0.5, 0.0)),
    ] {
        let body = Body::new(Some(side));
        for backwards in [false, true] {
            let eye = body.eye(backwards);
            // Looking towards the head with the front at the top, the patient's left is on the right, as when you lie
            // on your back and look up along your own body. Looking towards the feet it is reversed.
            let right_is_left = eye.forward.z.signum();
            let place = eye.project(body.polyp.unwrap());
            assert_eq!(place[0].signum(), side.x.signum() * right_is_left, "{name}: {place:?}");
            assert_eq!(place[1].signum(), -side.y.signum(), "{name}: {place:?}");
            assert!(place[0].abs() > 12.0 && place[1].abs() > 4.0, "{name}: well beside the middle: {place:?}");
            let name = format!("{name}, {}", if eye.forward.z > 0.0 { "to the head" } else { "to the feet" });
            assert_there(&name, place, &eye.look(body.plain()), &eye.look(bare.plain()));
        }
    }
}

/// Little-endian bytes of the voxels.
fn raw(volume: &Volume) -> Vec<u8> {
    volume.data().iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// The NIfTI file of a volume, written from the format's own description: rows of an affine to RAS.
fn nifti(v: &Volume) -> Vec<u8> {
    let g = v.grid();
    let (step, origin) = (g.direction() * DMat3::from_diagonal(g.spacing()), g.origin());
    let row = |a: usize| {
        let sign = if a < 2 { -1.0 } else { 1.0 };
        [step.x_axis[a], step.y_axis[a], step.z_axis[a], origin[a]].map(|c| sign * c)
    };
    let [nx, ny, nz] = g.dims().map(|n| n as i64);
    let [dx, dy, dz] = g.spacing().to_array();
    Nifti {
        dim: [3, nx, ny, nz, 1, 1, 1, 1],
        pixdim: [1.0, dx, dy, dz, 0.0, 0.0, 0.0, 0.0],
        srow: [row(0), row(1), row(2)],
        data: raw(v),
        ..Nifti::small()
    }
    .bytes()
}

/// The MetaImage file of a volume: the directions of the index axes in sequence, LPS.
fn metaimage(v: &Volume) -> Vec<u8> {
    let g = v.grid();
    let list = |v: &[f64]| v.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    let dims = g.dims().map(|n| n as f64);
    let mut out = format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n\
         TransformMatrix = {}\nOffset = {}\nElementSpacing = {}\nDimSize = {}\nElementType = MET_SHORT\n\
         ElementDataFile = LOCAL\n",
        list(&g.direction().to_cols_array()),
        list(&g.origin().to_array()),
        list(&g.spacing().to_array()),
        list(&dims),
    )
    .into_bytes();
    out.extend(raw(v));
    out
}

/// The NRRD file of a volume in one of the format's spaces. `sign` converts from LPS.
fn nrrd(v: &Volume, volume: &str, sign: DVec3) -> Vec<u8> {
    let g = v.grid();
    let vector = |v: DVec3| format!("({},{},{})", v.x, v.y, v.z);
    let step = |n: usize| vector(g.direction().col(n) * g.spacing()[n] * sign);
    let [nx, ny, nz] = g.dims();
    let mut out = format!(
        "NRRD0004\ntype: short\ndimension: 3\nspace: {volume}\nsizes: {nx} {ny} {nz}\nspace directions: {} {} {}\n\
         kinds: domain domain domain\nendian: little\nencoding: raw\nspace origin: {}\n\n",
        step(0),
        step(1),
        step(2),
        vector(g.origin() * sign),
    )
    .into_bytes();
    out.extend(raw(v));
    out
}

fn read(path: &Path) -> Volume {
    load(path).unwrap().volume
}

fn from_bytes(folder: &Path, name: &str, bytes: &[u8]) -> Volume {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    read(&path)
}

fn written_and_read(folder: &Path, name: &str, v: &Volume) -> Volume {
    let path = folder.join(name);
    io::save(&path, v, &Progress::new()).unwrap();
    read(&path)
}

/// Reads the body as a DICOM series with the patient's position on the table and the row and column directions that a
/// scanner writes for it, in the patient's frame. Images are always seen from the same end of the table, and their top
/// is up in the room.
#[cfg(feature = "dicom")]
fn series(body: &Body, patient_position: &'static str, row: DVec3, column: DVec3) -> Volume {
    use crate::support::dicom::Slice;
    use crate::support::series::write_series;

    let grid = body.grid(DMat3::from_cols(row, column, row.cross(column)), DVec3::new(VOXEL, VOXEL, 0.8));
    let volume = body.on(&grid);
    let [nx, ny, nz] = grid.dims();
    let slices: Vec<Slice> = (0..nz)
        // Not in spatial order.
        .map(|n| (n * 7 + 3) % nz)
        .map(|k| {
            let place = (grid.world(DVec3::new(0.0, 0.0, k as f64)) * 1e4).round() / 1e4;
            Slice {
                patient_position,
                rows: ny as u16,
                cols: nx as u16,
                position: Some(place.to_array()),
                orientation: [row.x, row.y, row.z, column.x, column.y, column.z],
                spacing: format!("{VOXEL}\\{VOXEL}"),
                pixels: volume.data()[k * nx * ny..][..nx * ny].iter().map(|hu| (hu + 1024) as u16).collect(),
                ..Slice::at(0.0)
            }
        })
        .collect();
    let folder = tempfile::tempdir().unwrap();
    write_series(folder.path(), &slices);
    read(folder.path())
}

/// Returns the body on every kind of grid and through every reader, each with a name.
fn through_every_reader(body: &Body) -> Vec<(String, Volume)> {
    let cube = DVec3::splat(VOXEL);
    let diagonal = |x: f64, y: f64, z: f64| DMat3::from_diagonal(DVec3::new(x, y, z));
    let mirrored = body.on(&body.grid(diagonal(-1.0, 1.0, 1.0), cube));
    let permuted = body.on(&body.grid(DMat3::from_cols(DVec3::Z, DVec3::NEG_X, DVec3::Y), DVec3::new(0.8, 0.7, 0.7)));
    let turn = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(-0.3);
    let oblique = body.on(&body.grid(turn * diagonal(1.0, -1.0, 1.0), cube));
    assert!(mirrored.grid().direction().determinant() < 0.0 && oblique.grid().direction().determinant() < 0.0);

    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let plain = body.plain();
    let mut all: Vec<(String, Volume)> = Vec::new();
    for (name, v) in [("plain", &plain), ("mirrored", &mirrored), ("permuted", &permuted), ("oblique", &oblique)] {
        all.push((name.to_owned(), v.clone()));
        let mut add = |kind: &str, v: Volume| all.push((format!("{name}, {kind}"), v));
        add("NIfTI", from_bytes(dir, "a.nii", &nifti(v)));
        add("MetaImage", from_bytes(dir, "a.mha", &metaimage(v)));
        add("NRRD", from_bytes(dir, "a.nrrd", &nrrd(v, "left-posterior-superior", DVec3::ONE)));
        let sign = DVec3::new(-1.0, -1.0, 1.0);
        add("NRRD in RAS", from_bytes(dir, "b.nrrd", &nrrd(v, "right-anterior-superior", sign)));
        for file in ["b.nii", "b.mha", "c.nrrd"] {
            add(&format!("our {file}"), written_and_read(dir, file, v));
        }
    }
    #[cfg(feature = "dicom")]
    for (position, row, column) in [
        ("HFS", DVec3::X, DVec3::Y),
        ("HFP", DVec3::NEG_X, DVec3::NEG_Y),
        ("FFS", DVec3::NEG_X, DVec3::Y),
        ("FFP", DVec3::X, DVec3::NEG_Y),
    ] {
        all.push((position.to_owned(), series(body, position, row, column)));
    }
    all
}

#[test]
#[ignore = "slow: a body through every reader"]
fn every_grid_and_every_reader_give_one_picture() {
    let body = Body::new(Some(LEFT_FRONT));
    let eye = body.eye(false);
    let all = through_every_reader(&body);
    let place = eye.project(body.polyp.unwrap());
    let without = eye.look(Body::new(None).plain());
    let frames: Vec<(String, Frame)> = all.into_iter().map(|(name, v)| (name, eye.look(v))).collect();
    for (name, frame) in &frames {
        assert_there(name, place, frame, &without);
    }
    let pairs = frames.iter().enumerate().flat_map(|(n, a)| frames[..n].iter().map(move |b| (a, b)));
    let worst = pairs
        .map(|((a, x), (b, y))| {
            let db = psnr(x, y);
            assert!(db > 40.0, "{a} and {b}: {db:.1} dB; {}", shown(&format!("handedness {a} and {b}"), x, y));
            db
        })
        .fold(f64::INFINITY, f64::min);
    println!("{} pictures, {worst:.1} dB between the most different two", frames.len());
    // With the polyp on the right the picture must differ: the bound distinguishes the two.
    let other = Body::new(Some(DVec3::new(-1.0, -0.5, 0.0)));
    let db = psnr(&eye.look(other.plain()), &frames[0].1);
    println!("{db:.1} dB to the polyp on the right");
    assert!(db < 30.0, "{db:.1} dB to the polyp on the right");
}

/// Returns the root mean square difference of two slices, HU.
fn rms(a: &[f32], b: &[f32]) -> f64 {
    (a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

#[test]
fn every_grid_and_every_reader_give_the_same_slices() {
    let body = Body::new(Some(LEFT_FRONT));
    let polyp = body.polyp.unwrap();
    // A point beside the polyp and within its ball, so that each plane shows the polyp off-centre.
    let centre = polyp + DVec3::new(-2.0, 1.5, 1.0);
    let without = Body::new(None).plain();
    let other = Body::new(Some(DVec3::new(-1.0, -0.5, 0.0))).plain();
    let all = through_every_reader(&body);
    for (plane, edges, sides) in [
        (SlicePlane::Axial, ["R", "L", "A", "P"], [1.0, -1.0]),
        (SlicePlane::Coronal, ["R", "L", "S", "I"], [1.0, 1.0]),
        (SlicePlane::Sagittal, ["A", "P", "S", "I"], [-1.0, 1.0]),
    ] {
        let slice = Slice { centre, frame: plane.frame().unwrap(), mm_per_pixel: 0.5, size: [64, 60] };
        assert_eq!(slice.frame.edges(), edges);
        let hu = |volume: &Volume| {
            let mut out = Vec::new();
            slice.fill(volume, &mut out);
            out
        };
        // The polyp's position relative to the middle: to the right, and down.
        let (place, _) = slice.pixel(polyp);
        let off = [place[0] - 32.0, place[1] - 30.0];
        assert!(off[0] * sides[0] > 1.5 && off[1] * sides[1] > 1.5, "{plane:?}: {off:?}");
        let (bare, turned) = (hu(&without), hu(&other));
        let first = hu(&all[0].1);
        let mut worst = 0.0f64;
        for (name, volume) in &all {
            let shown = hu(volume);
            let differs: Vec<usize> = (0..shown.len()).filter(|&n| (shown[n] - bare[n]).abs() > 300.0).collect();
            let mean = |place: fn(usize) -> usize| {
                differs.iter().map(|&n| place(n) as f64 + 0.5).sum::<f64>() / differs.len() as f64
            };
            let seen = [mean(|n| n % 64), mean(|n| n / 64)];
            let far = (seen[0] - place[0]).hypot(seen[1] - place[1]);
            // There is no difference where the polyp is attached to the wall.
            assert!(far < 4.0, "{name}, {plane:?}: the polyp is at {seen:?}, expected {place:?}");
            worst = worst.max(rms(&shown, &first));
            assert!(rms(&shown, &first) < 30.0, "{name}, {plane:?}: {:.1} HU", rms(&shown, &first));
        }
        let right = rms(&turned, &first);
        println!("{plane:?}: {} slices, {worst:.1} HU at most; {right:.1} HU to the polyp on the right", all.len());
        assert!(right > 100.0, "{plane:?}: {right:.1} HU");
        // A click converts to the world and back.
        for at in [[0.0, 0.0], [13.5, 42.25], [64.0, 60.0], [-7.0, 99.0]] {
            let world = slice.world(at);
            let (back, before) = slice.pixel(world);
            assert!((back[0] - at[0]).hypot(back[1] - at[1]) < 1e-9 && before.abs() < 1e-9, "{plane:?}: {back:?}");
            assert!((slice.world(back) - world).length() < 1e-9);
        }
    }
}
