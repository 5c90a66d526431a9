//! Every writer against every reader, and every form of header against its meaning.

use crate::support::nifti::Nifti;
use crate::support::packing::{gz, zlib};
use crate::support::reading::load;
use crate::support::scans::data;
use crate::support::volumes::ramp;
use colvis::progress::Progress;
use colvis::volume::{Volume, io};
use glam::{DMat3, DQuat, DVec3};
use proptest::prelude::*;

const WRITTEN: [&str; 6] = ["a.nii", "a.nii.gz", "a.mha", "a.mhd", "a.nrrd", "a.nhdr"];

fn same_place(a: &Volume, b: &Volume, tolerance: f64) -> bool {
    let [x, y, z] = a.grid().dims().map(|n| (n - 1) as f64);
    [DVec3::ZERO, DVec3::new(x, 0.0, 0.0), DVec3::new(0.0, y, 0.0), DVec3::new(0.0, 0.0, z), DVec3::new(x, y, z)]
        .iter()
        .all(|v| (a.grid().world(*v) - b.grid().world(*v)).length() < tolerance)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn what_is_written_is_read(
        dims in [1usize..7, 1usize..7, 1usize..7],
        spacing in [0.1f64..5.0, 0.1f64..5.0, 0.1f64..5.0],
        origin in [-500f64..500.0, -500f64..500.0, -500f64..500.0],
        axis in [-1f64..1.0, -1f64..1.0, -1f64..1.0],
        angle in -3.1f64..3.1,
        mirrored: bool,
        oblique in -0.3f64..0.3,
    ) {
        let axis = DVec3::from_array(axis).try_normalize().unwrap_or(DVec3::Z);
        let mut direction = DMat3::from_quat(DQuat::from_axis_angle(axis, angle));
        if mirrored {
            direction.y_axis = -direction.y_axis;
        }
        // Every second case has a tilted gantry, which no quaternion can represent.
        if oblique > 0.0 {
            direction.z_axis = (direction.z_axis + oblique * direction.y_axis).normalize();
        }
        let volume = ramp(dims, DVec3::from_array(spacing), DVec3::from_array(origin), direction);
        let dir = tempfile::tempdir().unwrap();
        for name in WRITTEN {
            let path = dir.path().join(name);
            io::save(&path, &volume, &Progress::new()).unwrap();
            let back = load(&path).unwrap();
            // Nothing is said but what thick slices cannot show.
            let said: Vec<String> = io::thick_slices(back.volume.grid()).into_iter().collect();
            prop_assert_eq!(&back.notes, &said, "{}", name);
            prop_assert_eq!(back.volume.data(), volume.data(), "{}", name);
            // NIfTI-1 stores single precision.
            let tolerance = if name.contains("nii") { 2e-3 } else { 1e-9 };
            prop_assert!(same_place(&back.volume, &volume, tolerance), "{name}");
            let (a, b) = (back.volume.grid().direction(), volume.grid().direction());
            prop_assert_eq!(a.determinant() < 0.0, b.determinant() < 0.0, "{}", name);
        }
    }
}

#[test]
fn masks_are_read_back() {
    let volume = ramp([5, 4, 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY);
    let mask: Vec<u8> = (0..60).map(|i| i % 3).collect();
    let dir = tempfile::tempdir().unwrap();
    for name in WRITTEN {
        let path = dir.path().join(name);
        io::save_mask(&path, volume.grid(), &mask, &Progress::new()).unwrap();
        let back = load(&path).unwrap().volume;
        assert!(back.data().iter().zip(&mask).all(|(a, b)| *a == i16::from(*b)), "{name}");
    }
    let header = std::fs::read(dir.path().join("a.nii")).unwrap();
    assert_eq!((header[70], header[72], header.len()), (2, 8, 352 + 60), "one byte for each voxel");
}

#[test]
fn a_cancelled_or_refused_writer_leaves_nothing() {
    let volume = ramp([64, 64, 300], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY);
    for name in WRITTEN {
        let dir = tempfile::tempdir().unwrap();
        let progress = Progress::new();
        progress.cancel();
        let e = io::save(&dir.path().join(name), &volume, &progress).unwrap_err();
        assert_eq!(e.kind as i32, 4, "{name}");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "{name}");
    }
    let dir = tempfile::tempdir().unwrap();
    let e = io::save(&dir.path().join("a.tiff"), &volume, &Progress::new()).unwrap_err();
    assert_eq!(e.kind as i32, 2);
    let e = io::save(&dir.path().join("none/a.nii"), &volume, &Progress::new()).unwrap_err();
    assert_eq!(e.kind as i32, 5);
}

#[test]
fn a_cancelled_reader_stops() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.nii.gz");
    io::save(&path, &ramp([64, 64, 64], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY), &Progress::new()).unwrap();
    let progress = Progress::new();
    progress.cancel();
    assert_eq!(io::load(&path, &io::LoadOptions::default(), &progress).unwrap_err().kind as i32, 4);
}

fn read(name: &str, bytes: &[u8]) -> colvis::error::Result<io::Loaded> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    load(&path)
}

#[test]
fn nifti_of_every_type_version_order_and_packing() {
    macro_rules! voxels {
        ($t:ty, $big:expr) => {
            (0..24u8)
                .flat_map(|i| {
                    let v = i as $t;
                    if $big { v.to_be_bytes().to_vec() } else { v.to_le_bytes().to_vec() }
                })
                .collect::<Vec<u8>>()
        };
    }
    for big in [false, true] {
        for (datatype, bits, data) in [
            (2, 8, voxels!(u8, big)),
            (256, 8, voxels!(i8, big)),
            (4, 16, voxels!(i16, big)),
            (512, 16, voxels!(u16, big)),
            (8, 32, voxels!(i32, big)),
            (768, 32, voxels!(u32, big)),
            (1024, 64, voxels!(i64, big)),
            (1280, 64, voxels!(u64, big)),
            (16, 32, voxels!(f32, big)),
            (64, 64, voxels!(f64, big)),
        ] {
            for (version, magic, offset) in [(1, &b"n+1\0"[..], 352.0), (2, &b"n+2\0\r\n\x1a\n"[..], 544.0)] {
                let n = Nifti {
                    big,
                    version,
                    magic,
                    vox_offset: offset,
                    datatype,
                    bitpix: bits,
                    data: data.clone(),
                    slope: 2.0,
                    inter: -5.0,
                    ..Nifti::small()
                };
                let expected: Vec<i16> = (0..24).map(|i| 2 * i - 5).collect();
                let plain = read("a.nii", &n.bytes()).unwrap();
                assert_eq!(plain.volume.data(), expected, "{datatype} {version} {big}");
                assert_eq!(plain.volume.grid().world(DVec3::ONE), DVec3::new(-9.5, -19.25, 32.0));
                let packed = read("a.nii.gz", &gz(&n.bytes())).unwrap();
                assert_eq!(packed.volume, plain.volume);
            }
        }
    }
}

#[test]
fn nifti_orientation() {
    // sform takes precedence over qform; qform is used if it is alone; with neither there is a note.
    let both = Nifti { qform_code: 1, qoffset: [1.0, 2.0, 3.0], ..Nifti::small() };
    assert_eq!(read("a.nii", &both.bytes()).unwrap().volume.grid().origin(), DVec3::new(-10.0, -20.0, 30.0));
    // A half turn about z: RAS x and y point to the right and to anterior, which is LPS with identity direction.
    let alone = Nifti { sform_code: 0, quatern: [0.0, 0.0, 1.0], ..both };
    let g = read("a.nii", &alone.bytes()).unwrap().volume.grid().clone();
    assert!((g.origin() - DVec3::new(-1.0, -2.0, 3.0)).length() < 1e-6);
    assert!(g.direction().abs_diff_eq(DMat3::IDENTITY, 1e-6));
    assert!((g.spacing() - DVec3::new(0.5, 0.75, 2.0)).length() < 1e-6);
    // qfac -1 reverses the third axis.
    let flipped = Nifti { pixdim: [-1.0, 0.5, 0.75, 2.0, 0.0, 0.0, 0.0, 0.0], ..alone };
    assert!(read("a.nii", &flipped.bytes()).unwrap().volume.grid().direction().determinant() < 0.0);
    let neither = Nifti { sform_code: 0, ..Nifti::small() };
    let loaded = read("a.nii", &neither.bytes()).unwrap();
    assert_eq!(loaded.notes.len(), 1);
    // Units: metres and microns.
    for (units, scale) in [(0, 1.0), (1, 1000.0), (2, 1.0), (3, 0.001), (2 + 8, 1.0)] {
        let n = Nifti { units, ..Nifti::small() };
        let g = read("a.nii", &n.bytes()).unwrap().volume.grid().clone();
        assert!((g.spacing() - scale * DVec3::new(0.5, 0.75, 2.0)).length() < 1e-6 * scale);
        assert!((g.origin() - scale * DVec3::new(-10.0, -20.0, 30.0)).length() < 1e-6 * scale);
    }
}

#[test]
fn nifti_oddities() {
    // One frame of a fourth dimension; a NaN slope; trailing bytes; members of a gzip.
    let n = Nifti { dim: [4, 4, 3, 2, 1, 1, 1, 1], slope: f64::NAN, ..Nifti::small() };
    let mut bytes = n.bytes();
    bytes.extend([0xAB; 99]);
    let plain = read("a.nii", &bytes).unwrap().volume;
    assert_eq!(plain.data()[23], 23);
    let (a, b) = bytes.split_at(361);
    let mut members = [gz(a), gz(b)].concat();
    members.extend([0; 64]);
    assert_eq!(read("a.nii.gz", &members).unwrap().volume, plain);
    // A header and data pair.
    let dir = tempfile::tempdir().unwrap();
    let pair = Nifti { magic: b"ni1\0", vox_offset: 0.0, ..Nifti::small() };
    std::fs::write(dir.path().join("p.hdr"), pair.header()).unwrap();
    std::fs::write(dir.path().join("p.img"), &pair.data).unwrap();
    assert_eq!(load(&dir.path().join("p.hdr")).unwrap().volume.data(), plain.data());
    // Non-finite values become air, with one note.
    let data: Vec<u8> = (0..24).flat_map(|i| if i < 3 { f32::NAN } else { i as f32 }.to_le_bytes()).collect();
    let n = Nifti { datatype: 16, bitpix: 32, data, ..Nifti::small() };
    let loaded = read("a.nii", &n.bytes()).unwrap();
    assert_eq!(loaded.volume.data()[..4], [-1024, -1024, -1024, 3]);
    assert_eq!(loaded.notes.len(), 1, "{:?}", loaded.notes);
}

const MHA: &str = "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementSpacing = 0.5 0.75 2\nOffset = -10 -20 30\n\
                   TransformMatrix = 0 1 0 -1 0 0 0 0 1\nElementType = MET_SHORT\n";

#[test]
fn metaimage_forms() {
    let le: Vec<u8> = (0..24i16).flat_map(i16::to_le_bytes).collect();
    let be: Vec<u8> = (0..24i16).flat_map(i16::to_be_bytes).collect();
    let text: String = (0..24).map(|i| format!("{i} ")).collect();
    let with = |extra: &str, data: &[u8]| [format!("{MHA}{extra}ElementDataFile = LOCAL\n").as_bytes(), data].concat();
    let reference = read("a.mha", &with("", &le)).unwrap().volume;
    assert_eq!(reference.data()[23], 23);
    // The first index axis runs along world y, the second along negative world x.
    assert!((reference.grid().world(DVec3::X) - DVec3::new(-10.0, -19.5, 30.0)).length() < 1e-12);
    assert!((reference.grid().world(DVec3::Y) - DVec3::new(-10.75, -20.0, 30.0)).length() < 1e-12);
    for (extra, data) in [
        ("BinaryDataByteOrderMSB = True\n", be.clone()),
        ("ElementByteOrderMSB = True\nAnatomicalOrientation = RAI\n", be),
        ("CompressedData = True\n", zlib(&le)),
        ("CompressedData = True\n", gz(&le)),
        ("BinaryData = False\n", text.into_bytes()),
        ("HeaderSize = -1\n", [b"junk".as_slice(), &le].concat()),
    ] {
        assert_eq!(read("a.mha", &with(extra, &data)).unwrap().volume, reference, "{extra}");
    }
    let aliases = MHA.replace("Offset", "Position").replace("TransformMatrix", "Orientation");
    let bytes = [format!("{aliases}ElementDataFile = LOCAL\n").as_bytes(), &le].concat();
    assert_eq!(read("any.name", &bytes).unwrap().volume, reference);
    // A missing spacing is reported.
    let untold = MHA.replace("ElementSpacing = 0.5 0.75 2\n", "");
    let loaded = read("a.mha", &[format!("{untold}ElementDataFile = LOCAL\n").as_bytes(), &le].concat()).unwrap();
    assert_eq!((loaded.volume.grid().spacing(), loaded.notes.len()), (DVec3::ONE, 1));
    // Two dimensions, and the element size in place of the spacing.
    let flat = "NDims = 2\nDimSize = 4 6\nElementSize = 0.5 0.75\nElementType = MET_SHORT\nElementDataFile = LOCAL\n";
    let v = read("a.mha", &[flat.as_bytes(), &le].concat()).unwrap().volume;
    assert_eq!((v.grid().dims(), v.grid().spacing()), ([4, 6, 1], DVec3::new(0.5, 0.75, 1.0)));
}

const NRRD: &str = "NRRD0004\n# a comment\ntype: short\ndimension: 3\nsizes: 4 3 2\nendian: little\n\
                    space directions: (0.5,0,0) (0,0.75,0) (0,0,2)\nspace origin: (10,20,30)\nkey:=value\n";

#[test]
fn nrrd_forms() {
    let le: Vec<u8> = (0..24i16).flat_map(i16::to_le_bytes).collect();
    let be: Vec<u8> = (0..24i16).flat_map(i16::to_be_bytes).collect();
    let text = (0..24).map(|i| format!("{i}\n")).collect::<String>().into_bytes();
    let with = |extra: &str, data: &[u8]| [format!("{NRRD}{extra}\n").as_bytes(), data].concat();
    let lps = "space: left-posterior-superior\nencoding: raw\n";
    let reference = read("a.nrrd", &with(lps, &le)).unwrap().volume;
    assert_eq!(reference.grid().world(DVec3::ONE), DVec3::new(10.5, 20.75, 32.0));
    let cases = [
        ("space: LPS\nencoding: gzip\n", gz(&le)),
        ("space: LPS\nencoding: ascii\n", text.clone()),
        ("space: LPS\nencoding: raw\nbyte skip: 4\n", [b"skip".as_slice(), &le].concat()),
        ("space: LPS\nencoding: gz\nbyte skip: 4\n", gz(&[b"skip".as_slice(), &le].concat())),
        ("space: LPS\nencoding: raw\nbyte skip: -1\n", [b"any".as_slice(), &le].concat()),
        ("space: LPS\nencoding: raw\nline skip: 2\n", [b"one\ntwo\n".as_slice(), &le].concat()),
    ];
    for (extra, data) in cases {
        assert_eq!(read("a.nrrd", &with(extra, &data)).unwrap().volume, reference, "{extra}");
    }
    // Enumerated values are not case-sensitive, nor are the names of fields.
    let head = NRRD.replace("short", "Unsigned SHORT").replace("endian: little", "Endian: Little");
    let loud = |encoding: &str| {
        let head = head.replace("NRRD0004\n", "NRRD0004\nKinds: Domain DOMAIN domain\n");
        format!("{head}SPACE: Left-Posterior-Superior\nEncoding: {encoding}\n\n")
    };
    for (encoding, data) in [("Raw", le.clone()), ("GZIP", gz(&le)), ("Gz", gz(&le)), ("ASCII", text)] {
        let bytes = [loud(encoding).as_bytes(), &data].concat();
        assert_eq!(read("a.nrrd", &bytes).unwrap().volume, reference, "{encoding}");
    }
    let big = with(lps, &be);
    let big = String::from_utf8_lossy(&big[..big.len() - be.len()]).replace("little", "big");
    assert_eq!(read("a.nrrd", &[big.as_bytes(), &be].concat()).unwrap().volume, reference);
    let ras = read("a.nrrd", &with("space: right-anterior-superior\nencoding: raw\n", &le)).unwrap().volume;
    assert_eq!(ras.grid().world(DVec3::ONE), DVec3::new(-10.5, -20.75, 32.0));
    let las = read("a.nrrd", &with("space: LAS\nencoding: raw\n", &le)).unwrap().volume;
    assert_eq!(las.grid().world(DVec3::ONE), DVec3::new(10.5, -20.75, 32.0));
    let none = read("a.nrrd", &with("encoding: raw\n", &le)).unwrap();
    assert_eq!((none.volume, none.notes.len()), (reference, 1));
    let spacings = "NRRD0001\ntype: int16\ndimension: 3\nsizes: 4 3 2\nendian: little\nspacings: 0.5 0.75 2\n\
                    encoding: raw\n\n";
    let v = read("a.nrrd", &[spacings.as_bytes(), &le].concat()).unwrap().volume;
    assert_eq!(v.grid().spacing(), DVec3::new(0.5, 0.75, 2.0));
}

#[test]
fn data_files_stay_in_the_headers_folder() {
    let dir = tempfile::tempdir().unwrap();
    let inside = dir.path().join("inside");
    std::fs::create_dir_all(inside.join("below")).unwrap();
    let voxels: Vec<u8> = (0..24i16).flat_map(i16::to_le_bytes).collect();
    for p in ["secret.raw", "inside/a.raw", "inside/below/a.raw"] {
        std::fs::write(dir.path().join(p), &voxels).unwrap();
    }
    #[cfg(unix)]
    std::os::unix::fs::symlink("../secret.raw", inside.join("link.raw")).unwrap();
    let absolute = dir.path().join("secret.raw").display().to_string();
    let own = inside.join("a.raw").display().to_string();
    let header = inside.join("a.mhd");
    let nhdr = inside.join("a.nhdr");
    let mut cases = vec![
        ("a.raw", true),
        ("below/a.raw", true),
        ("below/../a.raw", true),
        (own.as_str(), true),
        ("../secret.raw", false),
        ("../none.raw", false),
        (absolute.as_str(), false),
    ];
    if cfg!(unix) {
        cases.push(("link.raw", false));
    }
    for (name, good) in cases {
        std::fs::write(&header, format!("{MHA}ElementDataFile = {name}\n")).unwrap();
        std::fs::write(&nhdr, format!("{NRRD}encoding: raw\ndata file: {name}\n")).unwrap();
        for path in [&header, &nhdr] {
            match load(path) {
                Ok(l) => assert!(good && l.volume.data()[23] == 23, "{name}"),
                Err(e) => assert!(!good && e.why.contains("outside") && e.kind as i32 == 3, "{name}: {e}"),
            }
        }
    }
}

fn slices(write: impl Fn(&std::path::Path), options: &io::LoadOptions) -> io::Loaded {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path());
    io::load(dir.path(), options, &Progress::new()).unwrap()
}

#[test]
fn png_slices() {
    let spacing = Some(DVec3::new(0.5, 0.75, 2.0));
    let options = io::LoadOptions { spacing, hu: Some((-1000.0, 1000.0)), ..io::LoadOptions::default() };
    // Eight bits; names in natural order, the first most inferior; rows to posterior, columns to the left.
    let eight = |dir: &std::path::Path| {
        for k in [9u8, 10, 11] {
            let mut slice = image::GrayImage::new(5, 4);
            slice.put_pixel(3, 1, image::Luma([k]));
            slice.put_pixel(0, 0, image::Luma([255]));
            slice.save(dir.join(format!("s{k}.png"))).unwrap();
        }
    };
    let loaded = slices(eight, &options);
    let g = loaded.volume.grid();
    assert_eq!((g.dims(), g.world(DVec3::ONE) - g.origin()), ([5, 4, 3], DVec3::new(0.5, 0.75, 2.0)));
    for (k, grey) in [9.0, 10.0, 11.0].into_iter().enumerate() {
        assert_eq!(loaded.volume.get(3, 1, k as i64), (-1000.0 + 2000.0 * grey / 255.0f64).round() as i16);
        assert_eq!((loaded.volume.get(0, 0, k as i64), loaded.volume.get(4, 3, k as i64)), (1000, -1000));
    }
    assert!(loaded.notes.is_empty());
    // Sixteen bits keep their depth. Colours are converted by luma.
    let sixteen = |dir: &std::path::Path| {
        let slice = image::ImageBuffer::<image::Luma<u16>, _>::from_vec(2, 1, vec![0, 30000]).unwrap();
        slice.save(dir.join("a.png")).unwrap();
    };
    let full = io::LoadOptions { spacing, hu: Some((0.0, 65535.0 / 4.0)), ..io::LoadOptions::default() };
    assert_eq!(slices(sixteen, &full).volume.data(), [0, 7500]);
    let colour = |dir: &std::path::Path| {
        image::RgbImage::from_pixel(2, 2, image::Rgb([255, 255, 255])).save(dir.join("a.png")).unwrap();
    };
    assert_eq!(slices(colour, &options).volume.data(), [1000; 4]);
    // Without --hu the histogram decides, which is reported.
    let body = |dir: &std::path::Path| {
        image::GrayImage::from_fn(64, 64, |x, _| image::Luma([if x < 20 { 10 } else { 180 }]))
            .save(dir.join("a.png"))
            .unwrap();
    };
    let loaded = slices(body, &io::LoadOptions { spacing, ..io::LoadOptions::default() });
    assert!((loaded.volume.get(5, 5, 0) + 1000).abs() < 1 && (loaded.volume.get(40, 5, 0) - 40).abs() < 4);
    assert!(loaded.notes[0].contains("has no HU"), "{:?}", loaded.notes);
}

#[test]
#[ignore = "slow: the real scan in every format"]
fn the_real_scan_survives_a_round_trip() {
    let Some(path) = data("ctc_prone.nii.gz") else { return };
    let began = std::time::Instant::now();
    let v = load(&path).unwrap().volume;
    let loaded = began.elapsed();
    assert_eq!(v.grid().dims(), [512, 512, 430]);
    assert!((v.grid().spacing() - DVec3::new(0.675781, 0.675781, 1.0)).length() < 1e-5);
    let dir = tempfile::tempdir().unwrap();
    let copy = dir.path().join("copy.nii.gz");
    io::save(&copy, &v, &Progress::new()).unwrap();
    eprintln!("load {loaded:.2?}, load and save {:.2?}", began.elapsed());
    let back = load(&copy).unwrap().volume;
    assert!(back.data() == v.data() && same_place(&back, &v, 1e-3));
}
