//! Bad inputs through the real program. It must report the exit status and one line with the problem, the reason and
//! the fix. It must not panic, and must finish quickly and within little memory whatever a header claims.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::support::nifti::Nifti;
use crate::support::packing::{gz, zlib};

/// Address space available to the program, KiB: enough for itself and its threads, far less than the false headers
/// below claim.
const ROOM: u32 = 1_500_000;
/// The maximum time for a refusal.
const SOON: Duration = Duration::from_secs(10);

fn run(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = if cfg!(target_os = "linux") {
        let mut c = Command::new("sh");
        c.args(["-c", &format!("ulimit -v {ROOM}; exec \"$0\" \"$@\""), env!("CARGO_BIN_EXE_colvis")]);
        c
    } else {
        Command::new(env!("CARGO_BIN_EXE_colvis"))
    };
    let began = Instant::now();
    let output =
        command.args(arguments).args(["--threads", "2"]).current_dir(folder).stdin(Stdio::null()).output().unwrap();
    assert!(began.elapsed() < SOON, "{arguments:?} took {:?}", began.elapsed());
    output
}

/// Asserts the properties of every error message.
fn refused(folder: &Path, arguments: &[&str], status: i32, fragment: &str) {
    let output = run(folder, arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{arguments:?}: {stderr}");
    assert!(output.stdout.is_empty(), "{arguments:?} printed a result");
    let errors: Vec<&str> = stderr.lines().filter(|l| l.starts_with("error: ")).collect();
    assert_eq!(errors.len(), 1, "{arguments:?}: {stderr}");
    assert!(stderr.lines().all(|l| l.starts_with("error: ") || l.starts_with("note: ")), "{arguments:?}: {stderr}");
    assert!(errors[0].contains(fragment), "{arguments:?}: {:?} is not in {stderr}", fragment);
    let (why, hint) = errors[0].split_once("; ").unwrap_or_else(|| panic!("{arguments:?}: no hint in {stderr}"));
    assert!(why["error: ".len()..].contains(": ") && hint.trim().len() > 5, "{arguments:?}: {stderr}");
}

const MHA: &str = "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementSpacing = 1 1 1\nElementType = MET_SHORT\n";
const NRRD: &str = "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\nendian: little\nspacings: 1 1 1\n";

fn mha(from: &str, to: &str, last: &str) -> Vec<u8> {
    assert!(MHA.contains(from));
    [format!("{}{last}", MHA.replace(from, to)).as_bytes(), &[0; 48]].concat()
}

fn nrrd(from: &str, to: &str, last: &str) -> Vec<u8> {
    assert!(NRRD.contains(from));
    [format!("{}{last}\n", NRRD.replace(from, to)).as_bytes(), &[0; 48]].concat()
}

fn nifti(change: impl FnOnce(&mut Nifti)) -> Vec<u8> {
    let mut n = Nifti::small();
    change(&mut n);
    n.bytes()
}

/// A table of files with the expected message of each: long, and meant to be read from top to bottom.
#[test]
fn files() {
    let local = "ElementDataFile = LOCAL\n";
    let raw = "encoding: raw\n";
    let small = Nifti::small();
    let pixdim = |k: usize, v: f64| nifti(move |n| n.pixdim[k] = v);
    let huge = |n: &mut Nifti| n.dim = [3, 30000, 30000, 30000, 1, 1, 1, 1];
    #[rustfmt::skip]
    let table: Vec<(&str, Vec<u8>, &str)> = vec![
        // Any format.
        ("empty.nii", vec![], "is empty"),
        ("noise.bin", (0..5000u64).map(|i| colvis::math::hash::bits(3, i) as u8).collect(), "not in a supported format"),
        ("text.txt", b"hello, this is no scan\n".to_vec(), "give NIfTI"),
        ("image.png", b"\x89PNG\r\n\x1a\n_______".to_vec(), "single PNG"),
        ("short.gz", vec![0x1f, 0x8b, 8], "ends early"),
        ("other.gz", gz(b"some text that is no scan"), "does not contain NIfTI"),
        ("packed.nrrd.gz", gz(&nrrd("short", "short", raw)), "does not contain NIfTI"),
        ("noise.nii.gz", [&[0x1f, 0x8b, 8, 0][..], &[0x77; 300]].concat(), "damaged"),
        // NIfTI.
        ("head.nii", small.bytes()[..300].to_vec(), "bytes of a header of 348"),
        ("magic.nii", nifti(|n| n.magic = b"n-1\0"), "wrong magic"),
        ("analyze.nii", nifti(|n| n.magic = b"\0\0\0\0"), "Analyze 7.5"),
        ("truncated.nii", small.bytes()[..390].to_vec(), "ends early"),
        ("truncated.nii.gz", gz(&small.bytes()[..390]), "ends early"),
        ("cut.nii.gz", { let g = gz(&small.bytes()); g[..g.len() - 12].to_vec() }, "ends early"),
        ("sum.nii.gz", { let mut g = gz(&small.bytes()); let k = g.len() - 6; g[k] ^= 1; g }, "damaged"),
        ("negative-dim.nii", nifti(|n| n.dim[2] = -3), "dimension of -3"),
        ("zero-dim.nii", nifti(|n| n.dim[1] = 0), "dimension of 0"),
        ("no-dims.nii", nifti(|n| n.dim[0] = 0), "dim[0] is 0"),
        ("nine-dims.nii", nifti(|n| n.dim[0] = 9), "dim[0] is 9"),
        ("frames.nii", nifti(|n| { n.dim[0] = 4; n.dim[4] = 2; }), "more than one frame"),
        ("huge.nii", nifti(huge), "54000000000000 bytes"),
        ("huge.nii.gz", gz(&nifti(huge)), "ends early"),
        ("overflow.nii", nifti(|n| { n.version = 2; n.magic = b"n+2\0\r\n\x1a\n"; n.vox_offset = 544.0; n.dim = [3, i64::MAX, 4, 4, 1, 1, 1, 1]; }), "overflow"),
        ("lie.nii.gz", gz(&[Nifti { dim: [3, 1000, 1000, 400, 1, 1, 1, 1], ..small }.header(), vec![0; 1 << 20]].concat()), "ends early"),
        ("rgb.nii", nifti(|n| { n.datatype = 128; n.bitpix = 24; }), "RGB"),
        ("complex.nii", nifti(|n| { n.datatype = 32; n.bitpix = 64; }), "complex"),
        ("type.nii", nifti(|n| n.datatype = 999), "datatype 999"),
        ("bitpix.nii", nifti(|n| n.bitpix = 8), "bitpix 8"),
        ("offset.nii", nifti(|n| n.vox_offset = 100.0), "vox_offset 100"),
        ("offset-nan.nii", nifti(|n| n.vox_offset = f64::NAN), "vox_offset NaN"),
        ("offset-far.nii", nifti(|n| n.vox_offset = 1e9), "ends early"),
        ("spacing-0.nii", pixdim(1, 0.0), "spacing 0"),
        ("spacing-neg.nii", pixdim(2, -1.0), "spacing -1"),
        ("spacing-nan.nii", pixdim(3, f64::NAN), "spacing NaN"),
        ("spacing-inf.nii", pixdim(1, f64::INFINITY), "spacing inf"),
        ("sform.nii", nifti(|n| n.srow = [[0.0; 4]; 3]), "not positive and finite"),
        ("sform-flat.nii", nifti(|n| n.srow = [[1.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]), "direction is singular"),
        ("sform-nan.nii", nifti(|n| n.srow[0][3] = f64::NAN), "origin"),
        ("quaternion.nii", nifti(|n| { n.sform_code = 0; n.qform_code = 1; n.quatern = [1.0, 1.0, 1.0]; }), "is not a rotation"),
        ("quaternion-nan.nii", nifti(|n| { n.qform_code = 1; n.quatern[0] = f64::NAN; }), "is not a rotation"),
        ("units.nii", nifti(|n| n.units = 5), "is not a unit of length"),
        ("inter.nii", nifti(|n| { n.slope = 1.0; n.inter = f64::INFINITY; }), "scl_inter is inf"),
        ("pair.nii", nifti(|n| n.magic = b"ni1\0"), "does not exist"),
        // MetaImage.
        ("end.mha", MHA.as_bytes().to_vec(), "no ElementDataFile"),
        ("ndims.mha", mha("NDims = 3", "NDims = 7", local), "NDims is \"7\""),
        ("dims.mha", mha("4 3 2", "4 3", local), "DimSize"),
        ("dims-neg.mha", mha("4 3 2", "4 -3 2", local), "DimSize"),
        ("dims-huge.mha", mha("4 3 2", "4000000000 4000000000 4000000000", local), "overflow"),
        ("dims-big.mha", mha("4 3 2", "40000 40000 40000", local), "ends early"),
        ("spacing.mha", mha("1 1 1", "1 0 1", local), "spacing 0"),
        ("spacing-nan.mha", mha("1 1 1", "1 nan 1", local), "spacing NaN"),
        ("size.mha", mha("1 1 1", "1 1 1\nElementSize = -1 1 1", local), "ElementSize has spacing -1"),
        ("type.mha", mha("MET_SHORT", "MET_SHORT_ARRAY", local), "ElementType"),
        ("matrix.mha", mha("NDims = 3", "NDims = 3\nTransformMatrix = 1 0 0 1 0 0 0 0 1", local), "singular"),
        ("zlib.mha", mha("NDims = 3", "NDims = 3\nCompressedData = True", local), "damaged"),
        ("zlib-cut.mha", [format!("{MHA}CompressedData = True\n{local}").as_bytes(), &zlib(&[0; 48])[..8]].concat(), "ends early"),
        ("list.mhd", mha("NDims = 3", "NDims = 3", "ElementDataFile = LIST\n"), "its own file"),
        ("none.mhd", mha("NDims = 3", "NDims = 3", "ElementDataFile = none.raw\n"), "does not exist"),
        ("up.mhd", mha("NDims = 3", "NDims = 3", "ElementDataFile = ../up.raw\n"), "outside"),
        ("root.mhd", mha("NDims = 3", "NDims = 3", "ElementDataFile = /etc/passwd\n"), "outside"),
        ("self.mhd", mha("NDims = 3", "NDims = 3", "ElementDataFile = .\n"), "outside"),
        ("channels.mha", mha("NDims = 3", "NDims = 3\nElementNumberOfChannels = 3", local), "ElementNumberOfChannels"),
        // NRRD.
        ("version.nrrd", b"NRRD9999\n\n".to_vec(), "first line"),
        ("end.nrrd", NRRD.as_bytes().to_vec(), "encoding"),
        ("type.nrrd", nrrd("short", "block", raw), "type is \"block\""),
        ("hex.nrrd", nrrd("short", "short", "encoding: hex\n"), "encoding is \"hex\""),
        ("bzip.nrrd", nrrd("short", "short", "encoding: bzip2\n"), "encoding is \"bzip2\""),
        ("endian.nrrd", nrrd("endian: little\n", "", raw), "endian"),
        ("sizes.nrrd", nrrd("4 3 2", "4 3", raw), "sizes"),
        ("huge.nrrd", nrrd("4 3 2", "99999 99999 99999", raw), "ends early"),
        ("huge-gz.nrrd", nrrd("4 3 2", "99999 99999 99999", "encoding: gzip\n"), "ends early"),
        ("frames.nrrd", nrrd("dimension: 3\nsizes: 4 3 2\nendian: little\nspacings: 1 1 1", "dimension: 4\nsizes: 4 3 2 1\nendian: little\nspacings: 1 1 1 1\nspace directions: (1,0,0) (0,1,0) (0,0,1) (0,0,1)", raw), "several frames"),
        ("spacing.nrrd", nrrd("spacings: 1 1 1", "spacings: 1 -1 1", raw), "spacing -1"),
        ("spacing-nan.nrrd", nrrd("spacings: 1 1 1", "spacings: 1 nan 1", raw), "NaN"),
        ("directions.nrrd", nrrd("spacings: 1 1 1", "space directions: (1,0,0) (2,0,0) (0,0,1)", raw), "singular"),
        ("space.nrrd", nrrd("short", "short\nspace: 3D-left-handed", raw), "left from right"),
        ("up.nhdr", nrrd("short", "short\ndata file: ../x.raw", raw), "outside"),
        ("ascii.nrrd", nrrd("short", "short", "encoding: ascii\n\n1 2 x"), "not a number"),
    ];
    assert!(table.len() >= 40);
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes, fragment) in table {
        std::fs::write(dir.path().join(name), bytes).unwrap();
        refused(dir.path(), &["info", name], 3, fragment);
    }
}

#[cfg(feature = "dicom")]
#[test]
fn dicom() {
    use crate::support::dicom::{self, Slice};
    use crate::support::series::write_series;
    let at = Slice::at;
    let image = at(0.0);
    let mut lie = at(0.0);
    lie.rows = 16000;
    lie.cols = 16000;
    let coded = |syntax, packed: &[u8]| Slice { syntax, packed: Some(packed.to_vec()), ..at(0.0) };
    let length = {
        // A value whose length extends beyond the file.
        let mut b = image.bytes();
        let k = b.windows(4).position(|w| w == b"\x08\0\x60\0").unwrap();
        b.splice(k + 4..k + 8, *b"UN\0\0\xf0\xff\xff\x7f");
        b
    };
    let deflated = {
        let mut b = Slice { syntax: dicom::DEFLATED, ..at(0.0) }.bytes();
        let n = b.len();
        b.truncate(n - 30);
        b
    };
    #[rustfmt::skip]
    let table: Vec<(&str, Vec<u8>, &str)> = vec![
        ("preamble.dcm", [&[0; 128][..], b"DICM"].concat(), "no transfer syntax"),
        ("header.dcm", image.bytes()[..400].to_vec(), "ends early"),
        ("length.dcm", length, "ends early"),
        ("pixels.dcm", image.bytes()[..image.bytes().len() - 7].to_vec(), "ends early"),
        ("deflated.dcm", deflated, "ends early"),
        ("lie.dcm", lie.bytes(), "ends early"),
        ("lie-rle.dcm", Slice { syntax: dicom::RLE, packed: Some(vec![0; 80]), ..lie }.bytes(), "cannot hold"),
        ("mpeg.dcm", coded("1.2.840.10008.1.2.4.102", &[0; 64]).bytes(), "MPEG-4"),
        ("unknown.dcm", coded("1.2.3", &[0; 64]).bytes(), "transfer syntax 1.2.3"),
        ("rle.dcm", coded(dicom::RLE, &[9; 80]).bytes(), "damaged"),
        ("jpeg.dcm", coded(dicom::JPEG_LOSSLESS, b"not a jpeg").bytes(), "does not match its transfer syntax"),
        ("jpeg-8.dcm", coded(dicom::JPEG_LOSSLESS, b"\xff\xd8\xff\xc3\0\x0b\x08\0\x04\0\x06\x01\x01\x11\0").bytes(), "damaged"),
        ("jpegls.dcm", coded(dicom::JPEG_LS, b"\xff\xd8\xff\xf7\0\x0b\x10\0\x04\0\x06\x01\x01\x11\0").bytes(), "damaged"),
        ("j2k.dcm", coded("1.2.840.10008.1.2.4.90", &[0xFF; 64]).bytes(), "does not match its transfer syntax"),
        ("rgb.dcm", Slice { samples: 3, photometric: "RGB", ..at(0.0) }.bytes(), "colours"),
        ("bits.dcm", Slice { allocated: 32, stored: 32, high: 31, ..at(0.0) }.bytes(), "32 bits"),
        ("spacing.dcm", Slice { spacing: "0\\1".to_owned(), ..at(0.0) }.bytes(), "spacing 0"),
        ("no-spacing.dcm", Slice { spacing: String::new(), ..at(0.0) }.bytes(), "no PixelSpacing"),
        ("orientation.dcm", Slice { orientation: [1.0, 0.0, 0.0, 1.0, 0.0, 0.0], ..at(0.0) }.bytes(), "right angles"),
        ("position.dcm", Slice { position: Some([f64::NAN, 0.0, 0.0]), ..at(0.0) }.bytes(), "ImagePositionPatient"),
        ("slope.dcm", Slice { slope: "0", ..at(0.0) }.bytes(), "RescaleSlope"),
        ("frames.dcm", Slice { frames: Some("-1"), ..at(0.0) }.bytes(), "NumberOfFrames"),
        ("many.dcm", Slice { frames: Some("2"), rows: 2, ..at(0.0) }.bytes(), "2 frames"),
        ("none.dcm", Slice { rows: 0, ..at(0.0) }.bytes(), "0 rows"),
    ];
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes, fragment) in table {
        std::fs::write(dir.path().join(name), bytes).unwrap();
        refused(dir.path(), &["info", name], 3, fragment);
    }
    let series = |name: &str, slices: &[Slice]| {
        std::fs::create_dir(dir.path().join(name)).unwrap();
        write_series(&dir.path().join(name), slices);
    };
    let other = |z| Slice { series: "9.9".to_owned(), ..at(z) };
    series("mixed", &[at(0.0), at(1.0), other(0.0), other(1.0)]);
    refused(dir.path(), &["info", "mixed"], 3, "choose one with --series N");
    refused(dir.path(), &["info", "mixed", "--series", "5"], 3, "has no series 5");
    let mut changed = at(1.0);
    changed.pixels[0] = 7;
    series("twice", &[at(0.0), at(1.0), changed]);
    refused(dir.path(), &["info", "twice"], 3, "has the same position as");
    series("sizes", &[at(0.0), Slice { rows: 6, cols: 4, ..at(1.0) }]);
    refused(dir.path(), &["info", "sizes"], 3, "its size");
    series("far", &[at(0.0), at(1.0), at(2.0), at(30000.0)]);
    refused(dir.path(), &["info", "far"], 3, "cover the space");
    series("nowhere", &[at(0.0), Slice { position: None, ..at(1.0) }]);
    refused(dir.path(), &["info", "nowhere"], 3, "no ImagePositionPatient");
}

#[test]
fn folders_and_places() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    refused(here, &["info", "none.nii"], 3, "does not exist");
    refused(here, &["info", "none.nii/below"], 3, "does not exist");
    refused(here, &["info"], 2, "INPUT");
    std::fs::create_dir(here.join("empty")).unwrap();
    refused(here, &["info", "empty"], 3, "empty folder");
    std::fs::create_dir(here.join("other")).unwrap();
    std::fs::write(here.join("other/a.txt"), "x").unwrap();
    refused(here, &["info", "other"], 3, "none of them DICOM or PNG");
    std::fs::write(here.join("other/scan.nii"), Nifti::small().bytes()).unwrap();
    refused(here, &["info", "other"], 3, "name the file: other/scan.nii");
    // A name with a line break must not produce a second line.
    refused(here, &["info", "a\nerror: b"], 3, "does not exist");
    std::fs::create_dir(here.join("folder.raw")).unwrap();
    std::fs::write(here.join("folder.mhd"), format!("{MHA}ElementDataFile = folder.raw\n")).unwrap();
    refused(here, &["info", "folder.mhd"], 3, "is a folder");
    if cfg!(target_os = "linux") {
        refused(here, &["info", "/dev/zero"], 3, "not a regular file");
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let secret = here.join("secret.nii");
        std::fs::write(&secret, Nifti::small().bytes()).unwrap();
        std::fs::set_permissions(&secret, std::fs::Permissions::from_mode(0o000)).unwrap();
        // The superuser can read everything.
        if std::fs::File::open(&secret).is_err() {
            refused(here, &["info", "secret.nii"], 3, "permission denied");
        }
    }
}

#[test]
fn folders_of_png() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path();
    let write = |name: &str, w: u32, h: u32| image::GrayImage::new(w, h).save(here.join(name)).unwrap();
    std::fs::create_dir(here.join("p")).unwrap();
    write("p/1.png", 4, 4);
    write("p/2.png", 4, 4);
    refused(here, &["info", "p"], 3, "--spacing");
    refused(here, &["info", "p", "--spacing", "1,0,1"], 2, "--spacing: [1, 0, 1] mm");
    refused(here, &["info", "p", "--spacing", "1,1"], 2, "--spacing");
    write("p/2.png", 4, 5);
    refused(here, &["info", "p", "--spacing", "1,1,1"], 3, "4×5, but the first slice is 4×4");
    let whole = std::fs::read(here.join("p/1.png")).unwrap();
    std::fs::write(here.join("p/2.png"), &whole[..whole.len() / 2]).unwrap();
    refused(here, &["info", "p", "--spacing", "1,1,1"], 3, "damaged PNG");
    let mut big = whole;
    big[16..24].copy_from_slice(&[0, 0, 0x27, 0x10, 0, 0, 0x27, 0x10]);
    std::fs::write(here.join("p/2.png"), &big).unwrap();
    refused(here, &["info", "p", "--spacing", "1,1,1"], 3, "damaged PNG");
}

#[test]
fn small_volumes_are_no_bad_input() {
    let dir = tempfile::tempdir().unwrap();
    let one = Nifti { dim: [3, 1, 1, 1, 1, 1, 1, 1], data: vec![40, 0], ..Nifti::small() };
    let slice = Nifti { dim: [2, 4, 3, 1, 1, 1, 1, 1], ..Nifti::small() };
    for (name, n, dims) in [("one.nii", one, "[1,1,1]"), ("slice.nii", slice, "[4,3,1]")] {
        std::fs::write(dir.path().join(name), n.bytes()).unwrap();
        let output = run(dir.path(), &["info", name]);
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
        let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(value["dims"].to_string(), dims);
    }
}
