//! Readers against mutated files: no panic, no hang, no allocation beyond the file's own size class.
//!
//! The test is deterministic: the n-th mutation is the same everywhere. `COLVIS_FUZZ_SECONDS` sets the time for each
//! reader (0.25 if unset, or 2 with `COLVIS_CHECKS=full`), `COLVIS_FUZZ_START` the number of the first mutation. A
//! finding is written to the folder `COLVIS_FUZZ_KEEP`, if that is set. Move it to `tests/regressions/`, which is run
//! first.
//!
//! This is a separate program because it counts the allocations of the whole process.

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

use colvis::math::hash::bits;
use colvis::progress::Progress;
use colvis::volume::io::{self, LoadOptions};
use glam::{DMat3, DVec3};

use support::checks::cases;
use support::nifti::Nifti;
use support::packing::{gz, zlib};
use support::reading::load;
use support::scans::data;
use support::volumes::ramp;

#[path = "../support"]
mod support {
    pub(crate) mod checks;
    #[cfg(feature = "dicom")]
    pub(crate) mod dicom;
    #[cfg(feature = "dicom")]
    pub(crate) mod enhanced;
    pub(crate) mod nifti;
    pub(crate) mod packing;
    pub(crate) mod reading;
    pub(crate) mod scans;
    pub(crate) mod skips;
    pub(crate) mod volumes;
}

/// The system allocator with a counter.
struct Counting;

static NOW: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

fn grown(by: usize) {
    let now = NOW.fetch_add(by, Relaxed) + by;
    MOST.fetch_max(now, Relaxed);
}

#[expect(unsafe_code, reason = "counting allocations needs a global allocator of our own, in this test alone")]
// SAFETY: every call goes to the system allocator unchanged; counting touches no memory of the caller's.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        grown(layout.size());
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        grown(layout.size());
        // SAFETY: as the caller promises.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        NOW.fetch_sub(layout.size(), Relaxed);
        grown(size);
        // SAFETY: as the caller promises.
        unsafe { System.realloc(at, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Runs one reader at a time, so that the count belongs to it.
static TURN: Mutex<()> = Mutex::new(());

/// Returns the memory that a reader may allocate for an input: buffers, and the unpacked size up to the format's own
/// limit.
fn allowance(input: &[u8]) -> usize {
    (48 << 20) + 64 * input.len()
}

/// The maximum duration of one read.
const SLOWEST: Duration = Duration::from_secs(5);

/// Reads one input and describes any fault. A PNG is read through the folder that contains it.
fn trial(path: &Path, input: &[u8]) -> Result<bool, String> {
    std::fs::write(path, input).map_err(|e| e.to_string())?;
    let is_png = path.extension().is_some_and(|e| e == "png");
    let path = path.parent().filter(|_| is_png).unwrap_or(path);
    let options = LoadOptions { allow_gaps: true, spacing: is_png.then_some(DVec3::ONE), ..LoadOptions::default() };
    let before = NOW.load(Relaxed);
    MOST.store(before, Relaxed);
    let began = Instant::now();
    let result = std::panic::catch_unwind(|| io::info(path, &options, &Progress::new()));
    let most = MOST.load(Relaxed).saturating_sub(before);
    let Ok(result) = result else { return Err("panics".to_owned()) };
    if began.elapsed() > SLOWEST {
        return Err(format!("takes {:?}", began.elapsed()));
    }
    if most > allowance(input) {
        return Err(format!("allocates {most} bytes for {}", input.len()));
    }
    match result {
        Ok(_) => Ok(true),
        Err(e) if e.kind as i32 == 3 && !e.why.is_empty() && !e.hint.is_empty() => Ok(false),
        Err(e) => Err(format!("has status {}: {e}", e.kind as i32)),
    }
}

/// Returns the `n`-th mutation of a seed: bytes, runs, cuts, and numbers in the header replaced by dangerous ones, in
/// binary or as text.
fn mutate(seed: &[u8], n: u64) -> Vec<u8> {
    let mut out = seed.to_vec();
    let mut draw = 0;
    let mut pick = |below: usize| {
        draw += 1;
        (bits(n, draw) % below.max(1) as u64) as usize
    };
    for _ in 0..=pick(4) {
        if out.is_empty() {
            break;
        }
        // Mostly within the header.
        let reach = if pick(3) > 0 { out.len().min(1024) } else { out.len() };
        let at = pick(reach);
        match pick(10) {
            0 => out[at] ^= 1 << pick(8),
            1 => out[at] = [0, 1, 0x7F, 0x80, 0xFF, b'0', b'9', b'-', b' ', b'\n'][pick(10)],
            2 => out.truncate(at),
            3 => {
                let word: [u8; 8] =
                    [0u64, 1, 0x7FFF, 0xFFFF, 0x7FFF_FFFF, u64::MAX, 1 << 62, bits(n, 99)][pick(8)].to_le_bytes();
                let width = [2, 4, 8][pick(3)].min(out.len() - at);
                out[at..at + width].copy_from_slice(&word[..width]);
            }
            4 => {
                let float = [f32::NAN, f32::INFINITY, -1.0, 0.0, 1e30, 1e-30, -0.0, 3.5][pick(8)].to_le_bytes();
                let width = 4.min(out.len() - at);
                out[at..at + width].copy_from_slice(&float[..width]);
            }
            5 => {
                let to = (at + 1 + pick(32)).min(out.len());
                out.drain(at..to);
            }
            6 => {
                let to = (at + 1 + pick(64)).min(out.len());
                let copy = out[at..to].to_vec();
                let into = pick(out.len());
                out.splice(into..into, copy);
            }
            // Replaces a number in text.
            7 | 8 => {
                let digits: Vec<usize> = (0..reach).filter(|&i| out[i].is_ascii_digit()).collect();
                if !digits.is_empty() {
                    let from = digits[pick(digits.len())];
                    let to = (from..out.len()).find(|&i| !out[i].is_ascii_digit()).unwrap_or(out.len());
                    let numbers: [&[u8]; 9] =
                        [b"0", b"-1", b"nan", b"inf", b"99999999999", b"1e308", b"65535", b"4294967296", b"2"];
                    out.splice(from..to, numbers[pick(9)].iter().copied());
                }
            }
            _ => {
                let tail: Vec<u8> = (0..pick(40) as u64).map(|i| bits(n, 1000 + i) as u8).collect();
                out.extend(tail);
            }
        }
    }
    out
}

fn seconds() -> f64 {
    std::env::var("COLVIS_FUZZ_SECONDS").ok().and_then(|s| s.parse().ok()).unwrap_or_else(|| cases(2.0, 0.25))
}

fn fuzz(name: &str, seeds: &[Vec<u8>]) {
    // A failure of another test reports itself.
    let _turn = TURN.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    for seed in seeds {
        assert_eq!(trial(&path, seed), Ok(true), "a seed of {name} must be good");
    }
    let start: u64 = std::env::var("COLVIS_FUZZ_START").ok().and_then(|s| s.parse().ok()).unwrap_or(0);
    let (began, time) = (Instant::now(), Duration::from_secs_f64(seconds()));
    let (mut n, mut good) = (start, 0u64);
    while began.elapsed() < time {
        let input = mutate(&seeds[(n % seeds.len() as u64) as usize], n);
        match trial(&path, &input) {
            Ok(read) => good += u64::from(read),
            Err(why) => {
                if let Some(keep) = std::env::var_os("COLVIS_FUZZ_KEEP") {
                    std::fs::write(PathBuf::from(keep).join(format!("{n}-{name}")), &input).unwrap();
                }
                panic!("{name}, mutation {n}: {why}");
            }
        }
        n += 1;
    }
    eprintln!("{name}: {} mutations, {good} still readable", n - start);
    assert!(n > start, "no mutation was tried");
}

fn written(name: &str) -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    let volume = ramp([9, 8, 7], DVec3::new(0.5, 0.75, 2.0), DVec3::new(-3.0, 4.0, 5.0), DMat3::IDENTITY);
    io::save(&path, &volume, &Progress::new()).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn nifti() {
    let n = Nifti::small();
    let second = Nifti { version: 2, magic: b"n+2\0\r\n\x1a\n", vox_offset: 544.0, ..n.clone() };
    let float =
        Nifti { datatype: 16, bitpix: 32, data: vec![0x3F; 96], qform_code: 1, sform_code: 0, ..Nifti::small() };
    let big = Nifti { big: true, slope: 2.0, ..n.clone() };
    fuzz("a.nii", &[n.bytes(), second.bytes(), float.bytes(), big.bytes(), written("a.nii")]);
}

#[test]
fn nifti_gz() {
    fuzz("a.nii.gz", &[written("a.nii.gz"), gz(&Nifti::small().bytes())]);
}

#[test]
fn nifti_inside_gz() {
    let _turn = TURN.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let seed = Nifti::small().bytes();
    let dir = tempfile::tempdir().unwrap();
    let began = Instant::now();
    let mut n = 0;
    while began.elapsed().as_secs_f64() < seconds() {
        let input = gz(&mutate(&seed, n));
        assert!(trial(&dir.path().join("a.nii.gz"), &input).is_ok(), "mutation {n}");
        n += 1;
    }
    assert!(n > 0);
}

#[test]
fn metaimage() {
    let header = "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementSpacing = 1 1 1\nOffset = 1 2 3\n\
                  TransformMatrix = 1 0 0 0 1 0 0 0 1\nElementType = MET_SHORT\n";
    let with =
        |extra: &str, data: &[u8]| [format!("{header}{extra}ElementDataFile = LOCAL\n").as_bytes(), data].concat();
    let text = b"1 2 3 4 5 6 7 8 9 10 11 12 1 2 3 4 5 6 7 8 9 10 11 12";
    let packed = with("CompressedData = True\n", &zlib(&[5; 48]));
    fuzz("a.mha", &[written("a.mha"), packed, with("BinaryData = False\n", text), with("HeaderSize = -1\n", &[1; 48])]);
}

#[test]
fn nrrd() {
    let header = "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\nendian: little\nspace: RAS\n\
                  space directions: (0.5,0,0) (0,0.75,0) (0,0,2)\nspace origin: (10,20,30)\n";
    let with = |extra: &str, data: &[u8]| [format!("{header}{extra}\n").as_bytes(), data].concat();
    let skipped = with("encoding: raw\nline skip: 1\nbyte skip: 2\n", &[b"x\nyz".as_slice(), &[1; 48]].concat());
    let text = b"1 2 3 4 5 6 7 8 9 10 11 12 1 2 3 4 5 6 7 8 9 10 11 12";
    fuzz("a.nrrd", &[written("a.nrrd"), with("encoding: raw\n", &[1; 48]), skipped, with("encoding: ascii\n", text)]);
}

#[test]
fn png() {
    let encode = |image: image::DynamicImage| {
        let mut out = std::io::Cursor::new(Vec::new());
        image.write_to(&mut out, image::ImageFormat::Png).unwrap();
        out.into_inner()
    };
    let grey = image::GrayImage::from_fn(9, 8, |x, y| image::Luma([(20 * x + y) as u8]));
    let deep = image::ImageBuffer::<image::Luma<u16>, _>::from_fn(9, 8, |x, y| image::Luma([(5000 * x + y) as u16]));
    fuzz("a.png", &[encode(grey.into()), encode(deep.into())]);
}

#[cfg(feature = "dicom")]
mod dicom {
    use super::fuzz;
    use crate::support::dicom::{self, Slice};

    fn seed(syntax: &'static str) -> Vec<u8> {
        Slice { syntax, padding: Some(7), ..Slice::at(0.0) }.bytes()
    }

    #[test]
    fn uncompressed() {
        fuzz("a.dcm", &[seed(dicom::EXPLICIT), seed(dicom::IMPLICIT), seed(dicom::BIG), seed(dicom::DEFLATED)]);
    }

    #[test]
    fn enhanced() {
        fuzz("enhanced.dcm", &[Slice::enhanced().bytes()]);
    }

    #[test]
    fn rle() {
        fuzz("rle.dcm", &[seed(dicom::RLE)]);
    }

    #[test]
    fn jpeg_lossless() {
        fuzz("jpeg.dcm", &[seed(dicom::JPEG_LOSSLESS)]);
    }

    #[test]
    fn jpeg_ls() {
        fuzz("jpegls.dcm", &[seed(dicom::JPEG_LS)]);
    }

    #[test]
    fn jpeg_2000() {
        // A slice of 4×4 pixels made by an independent encoder.
        let packed = include_bytes!("../regressions/seed-4x4.j2k");
        let slice = Slice {
            syntax: "1.2.840.10008.1.2.4.90",
            rows: 4,
            cols: 4,
            packed: Some(packed.to_vec()),
            ..Slice::at(0.0)
        };
        fuzz("j2k.dcm", &[slice.bytes()]);
    }
}

#[test]
fn a_scan_needs_little_more_than_itself() {
    let Some(path) = data("ctc_prone.nii.gz") else { return };
    let _turn = TURN.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let before = NOW.load(Relaxed);
    MOST.store(before, Relaxed);
    let volume = load(&path).unwrap().volume;
    let most = MOST.load(Relaxed) - before;
    assert!(most as f64 <= 1.2 * volume.bytes() as f64, "{most} bytes for {}", volume.bytes());
}

#[test]
fn findings_stay_mended() {
    let _turn = TURN.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let dir = tempfile::tempdir().unwrap();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/regressions");
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    for file in files.iter().filter(|f| f.file_name().is_some_and(|n| !n.to_string_lossy().starts_with("seed-"))) {
        let input = std::fs::read(file).unwrap();
        let name = file.file_name().unwrap_or_default();
        let outcome = trial(&dir.path().join(name), &input);
        assert!(outcome.is_ok(), "{}: {outcome:?}", file.display());
    }
}
