//! The default renderer's pictures against the reference's, on many grids and at many sizes.
//! Run it with `cargo bench -p colvis-bench --bench grids`.
//!
//! It uses phantoms on six grids, from cubes to voxels five times as long as wide, and the given scans, on their own
//! grid and resampled to two others. On each it flies a flight. At poses along it, in its narrowest bends, close to the
//! wall and turned aside, it compares pictures with those of quality `reference`. A row is a grid and a size: the PSNR
//! of the worst frame and the mean, the PSNR of the worst frame with a ray for every pixel (the rest of its error is
//! due to interpolation between rays), the worst pose, and rays per pixel. It fails if a frame has less than 40 dB.
//!
//! ```sh
//! cargo bench -p colvis-bench --bench grids -- SCAN.nii.gz …                          # all of it, half an hour
//! cargo bench -p colvis-bench --bench grids -- --seeds 3 --sizes 384 --poses 20       # a part
//! cargo bench -p colvis-bench --bench grids -- --grids 0.8,0.8,2.0 --keep            # one grid, and pictures of its worst frames
//! ```

use std::path::PathBuf;
use std::sync::Arc;

use colvis::phantom::{Phantom, PhantomSettings, Size};
use colvis::progress::Progress;
use colvis::render::internals::{PacketRenderer, Pixels};
use colvis::render::{
    Direct, Frame, PreparedVolume, Preset, Quality, Renderer, Reuse, Settings, TransferFunction, psnr, renderer,
};
use colvis::report::flight::{self, Pose};
use colvis::space::value;
use colvis::volume::io::{self, LoadOptions};
use colvis::volume::{Grid, Volume};
use glam::DVec3;
use image::RgbImage;
use rayon::prelude::*;

#[path = "../support"]
mod support {
    pub(crate) mod failed;
    pub(crate) mod panels;
    pub(crate) mod poses;
}

use support::panels::panels;
use support::poses;

/// Voxels of the phantoms, mm.
const GRIDS: [[f64; 3]; 6] =
    [[1.0, 1.0, 1.0], [0.5, 0.5, 0.5], [0.7, 0.7, 1.0], [0.9, 0.9, 1.25], [0.8, 0.8, 2.0], [0.6, 0.6, 3.0]];
/// Voxels that scans are resampled to in addition to their own, mm.
const SCAN_GRIDS: [[f64; 3]; 2] = [[1.0, 1.0, 1.0], [0.8, 0.8, 2.0]];
/// Sides of the pictures, pixels.
const SIZES: [usize; 5] = [256, 384, 512, 768, 1024];
/// The minimum PSNR of every frame, dB.
const LEAST_DB: f64 = 40.0;
const FOV_DEGREES: f64 = 90.0;

/// The command-line options.
struct Options {
    grids: Vec<[f64; 3]>,
    sizes: Vec<usize>,
    seeds: Vec<u64>,
    poses: usize,
    size: Size,
    keep: bool,
    list: bool,
    scans: Vec<PathBuf>,
}

impl Options {
    fn read() -> Self {
        let mut all = Self {
            grids: GRIDS.to_vec(),
            sizes: SIZES.to_vec(),
            seeds: vec![1, 2],
            poses: 60,
            size: Size::Small,
            keep: false,
            list: false,
            scans: Vec::new(),
        };
        // Cargo adds --bench.
        let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
        while let Some(arg) = args.next() {
            let mut list = || args.next().unwrap_or_default().split(',').map(str::to_owned).collect::<Vec<_>>();
            let number = |s: &String| s.parse::<f64>().unwrap_or_else(|_| panic!("{s} is no number"));
            match arg.as_str() {
                "--grids" => {
                    let numbers: Vec<f64> = list().iter().map(number).collect();
                    all.grids = numbers.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
                }
                "--sizes" => all.sizes = list().iter().map(|s| number(s) as usize).collect(),
                "--seeds" => {
                    all.seeds = list().iter().filter(|s| *s != "none").map(|s| number(s) as u64).collect();
                }
                "--poses" => all.poses = number(&list()[0]) as usize,
                "--standard" => all.size = Size::Standard,
                "--list" => all.list = true,
                "--keep" => all.keep = true,
                _ => all.scans.push(PathBuf::from(arg)),
            }
        }
        all
    }
}

/// Returns a grid with other voxels over the same space.
fn regrid(grid: &Grid, spacing: [f64; 3]) -> Grid {
    let spacing = DVec3::from_array(spacing);
    let last = grid.dims().map(|n| (n - 1) as f64);
    let reach = DVec3::from_array(last) * grid.spacing();
    let dims = (reach / spacing).floor().to_array().map(|n| n as usize + 1);
    Grid::new(dims, spacing, grid.origin(), grid.direction()).expect("a grid")
}

/// Resamples a scan to other voxels, trilinearly.
fn resampled(volume: &PreparedVolume, spacing: [f64; 3]) -> Volume {
    let grid = regrid(volume.voxels().grid(), spacing);
    let [nx, ny, _] = grid.dims();
    let at = |n: usize| {
        let voxel = DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64);
        value(volume, grid.world(voxel)).round() as i16
    };
    let data = (0..grid.len()).into_par_iter().map(at).collect();
    Volume::new(grid, data)
}

/// The result for a size on a grid.
struct Row {
    least: (f64, usize),
    sum: f64,
    all_rays: f64,
    rays: u64,
    samples: u64,
}

fn picture(frame: &Frame) -> RgbImage {
    let bytes = frame.pixels().concat();
    RgbImage::from_raw(frame.width() as u32, frame.height() as u32, bytes).expect("a whole picture")
}

/// Compares one volume at all sizes and returns the lowest PSNR.
fn compare(name: &str, volume: Arc<Volume>, options: &Options) -> f64 {
    let grid = volume.grid().spacing();
    let volume = PreparedVolume::new(volume, TransferFunction::default());
    let flown = match flight::fly(&volume, &Progress::new()) {
        Ok(flown) => flown,
        Err(why) => {
            println!("| {name} | {grid} | not flown: {why} |");
            return f64::INFINITY;
        }
    };
    let poses = poses::hard(&flown, &volume, options.poses);
    let mut default = renderer(&volume, Settings::default(), Preset::default(), Reuse::Allowed);
    let mut all = PacketRenderer::new(&volume, Settings::default(), Pixels::All);
    let mut reference = Direct::new(&volume, Settings::new(Quality::Reference));
    let [mut fast, mut every, mut exact] = [(); 3].map(|()| Frame::default());
    let mut least = f64::INFINITY;
    for &size in &options.sizes {
        let mut row = Row { least: (f64::INFINITY, 0), sum: 0.0, all_rays: f64::INFINITY, rays: 0, samples: 0 };
        for (n, (kind, pose)) in poses.iter().enumerate() {
            let view = pose.view(FOV_DEGREES, size).expect("a view");
            let work = default.render(&view, &mut fast);
            all.render(&view, &mut every);
            reference.render(&view, &mut exact);
            let [db, every] = [psnr(&fast, &exact), psnr(&every, &exact)];
            row.sum += db.min(99.0);
            row.rays += work.rays;
            row.samples += work.samples;
            row.all_rays = row.all_rays.min(every);
            if db < row.least.0 {
                row.least = (db, n);
            }
            if options.list {
                println!(
                    "    {n} {kind}: {db:.2} dB, {every:.2} with all rays, {:.3} rays, {:.2} samples a pixel",
                    work.rays as f64 / (size * size) as f64,
                    work.samples as f64 / (size * size) as f64
                );
            }
        }
        let (db, worst) = row.least;
        let (kind, Pose { position, forward, up }) = poses[worst];
        let pixels = (poses.len() * size * size) as f64;
        let [rays, samples] = [row.rays, row.samples].map(|n| n as f64 / pixels);
        println!(
            "| {name} | {} × {} × {} | {size} | {db:.1} | {:.1} | {:.1} | {rays:.3} | {samples:.3} | {worst} {kind}: {position:.3} {forward:.4} {up:.4} |",
            grid.x,
            grid.y,
            grid.z,
            row.sum / poses.len() as f64,
            row.all_rays
        );
        if options.keep {
            let view = poses[worst].1.view(FOV_DEGREES, size).expect("a view");
            default.render(&view, &mut fast);
            reference.render(&view, &mut exact);
            let name = format!("grids {name} {:.1} {:.1} {size}", grid.x, grid.z);
            println!("{}", panels(&name, &picture(&exact), &picture(&fast)));
        }
        least = least.min(db);
    }
    least
}

fn main() {
    // Cargo runs benches in the folder of their package. Files are given from the root, where cargo is called.
    std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).expect("the root");
    let options = Options::read();
    println!(
        "| body | voxels, mm | pixels | least dB | mean dB | least dB, all rays | rays a pixel | samples a pixel | worst pose: position, forward, up |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let mut least = f64::INFINITY;
    for &seed in &options.seeds {
        let phantom = Phantom::new(&PhantomSettings { size: options.size, seed, ..PhantomSettings::default() });
        for &spacing in &options.grids {
            let volume = phantom.voxelise(&regrid(&phantom.grid(), spacing), &Progress::new()).expect("a phantom");
            least = least.min(compare(&format!("phantom {seed}"), Arc::new(volume), &options));
        }
    }
    for path in &options.scans {
        let scan = Arc::new(io::load(path, &LoadOptions::default(), &Progress::new()).expect("a scan").volume);
        let scan = PreparedVolume::lean(scan, TransferFunction::default());
        let name = path.file_name().map_or(String::new(), |n| n.to_string_lossy().into_owned());
        for spacing in SCAN_GRIDS {
            least = least.min(compare(&name, Arc::new(resampled(&scan, spacing)), &options));
        }
        least = least.min(compare(&name, scan.shared_voxels(), &options));
    }
    println!("least: {least:.2} dB");
    assert!(least >= LEAST_DB, "a frame has less than {LEAST_DB} dB");
}
