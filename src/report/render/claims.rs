//! The paper's claims by name, each with a measurement. A claim whose methods are missing is omitted.

use std::hint::black_box;
use std::time::Instant;

use glam::Vec3;

use crate::error::Result;
use crate::math::hash;
use crate::progress::Progress;
use crate::render::bytes::{ByteTrilinear, ByteVolume};
use crate::render::sampler::Sampler;
use crate::render::{Frame, Preset, Reuse, Settings, renderer};
use crate::report::flight::Stop;
use crate::report::methods::{PREPARATIONS, Preparation, Role};
use crate::report::{mean, median};
use crate::space::PreparedVolume;
use crate::space::flags::Flags;

use super::recount::{Recount, recount};
use super::worth::Variant;
use super::{Extent, Measured};

/// Maximum number of poses at which frames are counted and timed for a claim.
const FRAMES: usize = 3;
/// Side of the picture that is compared with the paper's times, pixels.
const PAPER_PIXELS: usize = 512;
/// Maximum number of builds of a preparation, and their maximum total time, s.
const BUILDS: usize = 5;
const SECONDS: f64 = 4.0;

/// Cost of a preparation.
#[derive(Clone, Debug)]
pub(crate) struct Cost {
    /// Name of the preparation.
    pub name: &'static str,
    /// Its role.
    pub role: Role,
    /// Median time to build, s.
    pub seconds: f64,
    /// Its memory, bytes.
    pub bytes: usize,
}

/// A claim of the paper's section 2.2, with the measurement.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Claim {
    /// The paper's statement.
    pub paper: &'static str,
    /// The measurement.
    pub measured: String,
}

/// The costs and the claims.
pub(crate) struct Claims {
    /// Cost of each preparation.
    pub costs: Vec<Cost>,
    /// Each claim that was measured.
    pub claims: Vec<Claim>,
}

/// Builds the preparations in turn, and derives the claims from them and from the frames.
pub(crate) fn claims(
    volume: &PreparedVolume,
    measured: &[Measured],
    stops: &[Stop],
    extent: &Extent,
    progress: &Progress,
) -> Result<Claims> {
    let costs = costs(volume, PREPARATIONS, progress)?;
    let near = near_wall(volume);
    let flown: Vec<Stop> = stops.iter().filter(|s| !s.jump).take(FRAMES).cloned().collect();
    let claims = [
        sampling_steps(measured),
        recalculation(recount(volume, &flown, extent)?, extent.pixels),
        flag_against_field(&costs),
        memory_of_field(&costs, volume),
        Some(memory_of_gradients(&costs, volume, near)),
        reuse(measured),
        frame_time(volume, &flown, extent, progress)?,
        Some(fixed_point(volume)),
    ];
    Ok(Claims { costs, claims: claims.into_iter().flatten().collect() })
}

fn costs(volume: &PreparedVolume, preparations: &[Preparation], progress: &Progress) -> Result<Vec<Cost>> {
    progress.stage("building", (BUILDS * preparations.len()) as u64);
    let mut times = vec![Vec::new(); preparations.len()];
    let mut bytes = vec![0; preparations.len()];
    for _ in 0..BUILDS {
        for ((p, times), bytes) in preparations.iter().zip(&mut times).zip(&mut bytes) {
            if times.iter().sum::<f64>() < SECONDS {
                let begun = Instant::now();
                *bytes = (p.build)(volume)?;
                times.push(begun.elapsed().as_secs_f64());
            }
            progress.advance(1)?;
        }
    }
    let each = preparations.iter().zip(times).zip(bytes);
    Ok(each.map(|((p, t), bytes)| Cost { name: p.name, role: p.role, seconds: median(&t), bytes }).collect())
}

/// Returns the share of voxels near a wall, whose neighbourhood is not all of one class.
fn near_wall(volume: &PreparedVolume) -> f64 {
    let [nx, ny, nz] = volume.voxels().grid().dims();
    let flags = Flags::new(volume.voxels(), volume.transfer());
    let row = |j: usize, k: usize| (0..nx).filter(|&i| !flags.homogeneous(volume.voxels(), i, j, k)).count();
    let count: usize = (0..nz).map(|k| (0..ny).map(|j| row(j, k)).sum::<usize>()).sum();
    count as f64 / volume.voxels().grid().len() as f64
}

fn sampling_steps(measured: &[Measured]) -> Option<Claim> {
    let steps = |name: &str| {
        let m = measured.iter().find(|m| m.method.name == name)?;
        Some(mean(&m.faults.iter().map(|f| f.samples).collect::<Vec<_>>()))
    };
    let (whole, half) = (steps("high h")?, steps("high h/2")?);
    Some(Claim {
        paper: "Once in the proximity of the colon wall an average of 4 sampling steps are needed.",
        measured: format!(
            "{whole:.1} samples a ray at a step of one voxel (h), {half:.1} at half a voxel; flags skip the rest."
        ),
    })
}

fn recalculation(r: Recount, pixels: usize) -> Option<Claim> {
    let share = |a: u64, b: u64| a as f64 / b as f64;
    (r.voxels > 0).then(|| Claim {
        paper: "At least a double recalculation of most variables is performed; caching gradients at frame level may reduce it.",
        measured: format!(
            "With eight regressions for each sample and no cache, the regression of a voxel is computed {:.1} times in a frame of \
             {pixels} × {pixels} pixels, and more than once for {:.0} % of the voxels. With a cache per frame it is computed {:.2} times: \
             {:.1} % of the computations are saved.",
            share(r.computed, r.voxels),
            100.0 * share(r.again, r.voxels),
            share(r.cached, r.voxels),
            100.0 * (1.0 - share(r.cached, r.computed))
        ),
    })
}

/// Compares samples of the byte volume in fixed point and in floats, at points all over it, in turn.
fn fixed_point(volume: &PreparedVolume) -> Claim {
    let bytes = ByteVolume::new(volume, 1);
    let sampler = ByteTrilinear::new(volume, &bytes);
    let dims = Vec3::from_array(volume.voxels().grid().dims().map(|n| n as f32));
    // Runs of neighbouring points, as along rays, since memory access is not to be compared.
    let place = |n: u64| Vec3::from_array(std::array::from_fn(|a| hash::uniform(n, a as u64) as f32)) * dims;
    let places: Vec<Vec3> =
        (0..4000).flat_map(|n| (0..16).map(move |k| (place(n) + 0.4 * k as f32).min(dims))).collect();
    let time = |value: &dyn Fn(&[Vec3]) -> f32| {
        let begun = Instant::now();
        black_box(value(black_box(&places)));
        begun.elapsed().as_secs_f64() * 1e9 / places.len() as f64
    };
    let mut ns = [Vec::new(), Vec::new()];
    for _ in 0..15 {
        ns[0].push(time(&|places| places.iter().map(|&q| sampler.value(q)).sum()));
        ns[1].push(time(&|places| places.iter().map(|&q| sampler.value_in_floats(q)).sum()));
    }
    let [fixed, floats] = ns.map(|ns| median(&ns));
    Claim {
        paper: "Even switching to fixed-point arithmetic wherever possible is an option.",
        measured: format!(
            "A trilinear value of the 7 + 1-bit volume takes {fixed:.1} ns in fixed point and {floats:.1} ns in floats, one after the other \
             on one thread."
        ),
    }
}

/// Compares frame times with those that the paper states and aims at: the first frame without any acceleration, the others as
/// parts of a flight.
fn frame_time(volume: &PreparedVolume, stops: &[Stop], extent: &Extent, progress: &Progress) -> Result<Option<Claim>> {
    if stops.is_empty() {
        return Ok(None);
    }
    progress.stage("the paper's frame", stops.len() as u64);
    let default = || renderer(volume, Settings::default(), Preset::default(), Reuse::Allowed);
    let mut all = [Variant::Unaccelerated.renderer(volume), Variant::Whole.renderer(volume), default()];
    let mut times = [(); 3].map(|()| Vec::new());
    let mut frame = Frame::default();
    for stop in stops {
        for (n, (renderer, times)) in all.iter_mut().zip(&mut times).enumerate() {
            let lead = stop.lead.last().filter(|_| n > 0);
            for pose in lead.into_iter().chain([&stop.pose]) {
                let view = pose.view(extent.fov_degrees, PAPER_PIXELS)?;
                let begun = Instant::now();
                renderer.render(&view, &mut frame);
                if std::ptr::eq(pose, &stop.pose) {
                    times.push(begun.elapsed().as_secs_f64());
                }
            }
        }
        progress.advance(1)?;
    }
    let [plain, whole, fast] = times.map(|t| median(&t));
    Ok(Some(Claim {
        paper: "Rendering a scene without any kind of acceleration takes around 2 seconds on a 700 MHz PC; 0.05 seconds (20 frames/second) \
                are desired, more than 3 frames/second believed to be within reach.",
        measured: format!(
            "At {PAPER_PIXELS} × {PAPER_PIXELS} pixels (the paper names no size) and {:.0}°, on {} threads: {plain:.2} s with nothing skipped, \
             kept or reused; {whole:.3} s ({:.0} frames/second) by the preset colvis; {fast:.4} s ({:.0} frames/second) by the default.",
            extent.fov_degrees,
            rayon::current_num_threads(),
            1.0 / whole,
            1.0 / fast
        ),
    }))
}

fn find(costs: &[Cost], role: Role) -> Option<&Cost> {
    costs.iter().find(|c| c.role == role)
}

fn flag_against_field(costs: &[Cost]) -> Option<Claim> {
    let (flag, field) = (find(costs, Role::Flag)?, find(costs, Role::Field)?);
    Some(Claim {
        paper: "The flag's pre-calculation is by two orders faster than that needed to set up a potential field.",
        measured: format!(
            "{:.1} times faster ({:.3} s against {:.3} s), with {:.1} times less memory.",
            field.seconds / flag.seconds,
            flag.seconds,
            field.seconds,
            field.bytes as f64 / flag.bytes.max(1) as f64
        ),
    })
}

fn memory_of_field(costs: &[Cost], volume: &PreparedVolume) -> Option<Claim> {
    let field = find(costs, Role::Field)?;
    let voxels = volume.voxels().grid().len() as f64;
    Some(Claim {
        paper: "Memory is at least doubled if the potential field is calculated.",
        measured: format!(
            "{:.2} bytes a voxel in addition to the volume, in all {:.2} times the paper's 8-bit volume, {:.2} times the 16-bit one.",
            field.bytes as f64 / voxels,
            1.0 + field.bytes as f64 / voxels,
            1.0 + field.bytes as f64 / volume.voxels().bytes() as f64
        ),
    })
}

fn memory_of_gradients(costs: &[Cost], volume: &PreparedVolume, near: f64) -> Claim {
    let stored = find(costs, Role::Gradients).map_or_else(String::new, |c| {
        let times = 1.0 + c.bytes as f64 / volume.voxels().bytes() as f64;
        format!(" As stored here it is {times:.2} times the 16-bit volume.")
    });
    Claim {
        paper: "For voxels close to the wall memory is at least five-folded if (A,B,C) and D are calculated.",
        measured: format!(
            "{:.1} % of the voxels are close to a wall; with four more values of the same size for each of them, the \
             whole is {:.2} times the volume.{stored}",
            100.0 * near,
            1.0 + 4.0 * near
        ),
    }
}

fn reuse(measured: &[Measured]) -> Option<Claim> {
    let least = |ms: &&Measured| median(&ms.ms);
    let faster = |a: &&Measured, b: &&Measured| least(a).total_cmp(&least(b));
    let keeping = measured.iter().filter(|m| m.method.traits.keeps && !m.method.traits.other_picture).min_by(faster)?;
    let same = |m: &&Measured| m.method.family == keeping.method.family && !m.method.traits.keeps;
    let alone = measured.iter().filter(same).min_by(faster)?;
    let worst = keeping.faults.iter().filter_map(|f| f.reuse).map(|r| r[0]).fold(f64::INFINITY, f64::min);
    let change =
        if worst.is_finite() { format!("leaves at least {worst:.1} dB") } else { "changes no pixel".to_owned() };
    Some(Claim {
        paper: "Frame-to-frame reuse is a viable and very fast alternative to the potential field.",
        measured: format!(
            "{} takes {:.1} ms a frame, {} without reuse {:.1} ms; reuse itself {change}.",
            keeping.method.name,
            least(&keeping),
            alone.method.name,
            least(&alone)
        ),
    })
}
