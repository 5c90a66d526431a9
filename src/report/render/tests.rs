use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::worth::Variant;
use super::*;
use crate::error::Result as Outcome;
use crate::render::{Direct, Frame, GradientSource, Leaping, MemoryPart, Renderer, Settings, View, Work};
use crate::report::Effort;
use crate::report::flight::{Pose, Stop};
use crate::report::methods::{REFERENCE, Traits};
use crate::space::TransferFunction;
use crate::volume::{Grid, Volume};

/// Shows the frame before the requested one: the worst case of reuse.
struct Late(Direct, Option<Frame>);

impl Renderer for Late {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        let work = self.0.render(view, frame);
        let now = frame.clone();
        if let Some(last) = self.1.replace(now) {
            frame.buffers().0.copy_from_slice(last.pixels());
        }
        work
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        vec![(MemoryPart::Other("nothing"), self.0.bytes())]
    }
}

fn late(volume: &PreparedVolume) -> Outcome<Box<dyn Renderer>> {
    Ok(Box::new(Late(Direct::new(volume, Settings::default()), None)))
}

fn tube() -> PreparedVolume {
    let n = 40;
    let grid = Grid::new([n; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let data = (0..n * n * n)
        .map(|i| {
            let (x, y, z) = ((i % n) as f64 - 19.5, (i / n % n) as f64 - 19.5, (i / n / n) as f64);
            (-650.0 + 150.0 * (x.hypot(y) - 9.0 - 2.0 * (0.5 * z).sin())).clamp(-1000.0, 40.0) as i16
        })
        .collect();
    PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default())
}

fn stops() -> Vec<Stop> {
    let pose = |x: f64, z: f64, forward| Pose { position: DVec3::new(x, 19.0, z), forward, up: DVec3::Y };
    vec![
        Stop {
            jump: false,
            pose: pose(19.0, 12.0, DVec3::Z),
            lead: vec![pose(18.0, 10.0, DVec3::Z), pose(18.5, 11.0, DVec3::Z)],
        },
        Stop { jump: true, pose: pose(22.0, 25.0, DVec3::X), lead: vec![] },
    ]
}

const EXTENT: Extent = Extent {
    pixels: 40,
    fov_degrees: 90.0,
    along: 1,
    jumps: 1,
    lead: 2,
    sides: &[20, 40],
    moving: 8,
    stops: 1,
    effort: Effort::Quick,
};

#[test]
fn the_reference_has_no_error_and_a_finer_step_has_less() {
    let methods: Vec<RenderMethod> = METHODS.iter().copied().filter(|m| m.name != "16 samples").collect();
    let all = measure::measure(&tube(), &methods, &stops(), &EXTENT, &Progress::new()).unwrap();
    assert_eq!(all.len(), methods.len() + 1);
    let of = |name: &str| all.iter().find(|m| m.method.name == name).unwrap();
    let reference = of(REFERENCE.name);
    assert!(reference.faults.iter().all(|f| f.psnr == f64::INFINITY && (f.ssim - 1.0).abs() < 1e-12));
    assert!(reference.worst.is_none() && reference.rms() == 0.0);
    assert!(of("brute h/16").rms() < of("brute h/4").rms() && of("brute h/4").rms() < of("brute h").rms());
    // The flags omit nothing visible, so only early ray termination makes a difference.
    assert!((of("high h").rms() - of("brute h").rms()).abs() < 0.5);
    assert!(of("high h").faults[0].samples < of("brute h").faults[0].samples);
    assert!(of("low h").worst_psnr() < of("high h/2").worst_psnr());
    for m in &all {
        let keeps = m.method.traits.keeps;
        // Methods that keep data also fly to the stop, and their reuse is evaluated separately.
        assert_eq!((m.ms.len(), m.jump_ms.len(), m.faults.len()), (1 + usize::from(keeps), 1, 2), "{}", m.method.name);
        assert!(m.faults.iter().all(|f| f.ms > 0.0 && f.ssim <= 1.0 && f.reuse.is_some() == keeps));
        assert_eq!(m.faults[0].displaced.is_some(), m.method.traits.own_depth, "{}", m.method.name);
    }
    let mesh = of("marching cubes");
    assert!(mesh.faults.iter().all(|f| f.displaced.unwrap() < 0.05) && mesh.worst_psnr() > 20.0 && mesh.bytes > 0);
}

#[test]
#[ignore = "slow: the claims of the report on renderers"]
fn reuse_is_told_apart_from_sampling() {
    let make = late;
    let traits = Traits { keeps: true, ..Traits::default() };
    let methods = [RenderMethod { name: "late", family: "flags, trilinear", make, traits }, METHODS[6]];
    assert_eq!(METHODS[6].name, "high h/2");
    let all = measure::measure(&tube(), &methods, &stops(), &EXTENT, &Progress::new()).unwrap();
    let (late, plain) = (&all[1], &all[2]);
    assert_eq!(late.ms.len(), 2, "the frame before, but for the first, and the frame itself");
    for (f, p) in late.faults.iter().zip(&plain.faults) {
        let [reuse, sampling] = f.reuse.unwrap();
        assert!(reuse < 35.0 && f.psnr < 35.0, "the last frame is not this one: {reuse} {}", f.psnr);
        assert!((sampling - p.psnr).abs() < 1e-9, "a fresh renderer has the error of sampling alone");
    }
    // The claims name it, together with a method of its family that keeps nothing.
    let claims = claims::claims(&tube(), &all, &[], &EXTENT, &Progress::new()).unwrap();
    assert!(claims.claims.iter().any(|c| c.paper.contains("reuse") && c.measured.contains("late takes")));
}

#[test]
fn claims_without_their_methods_are_not_told() {
    let claims = claims::claims(&tube(), &[], &[], &EXTENT, &Progress::new()).unwrap();
    // Four claims follow from the preparations alone. Those about frames need a method's results, or frames.
    assert_eq!(claims.claims.len(), 4, "{:?}", claims.claims);
    assert!(claims.claims.iter().any(|c| c.measured.contains("% of the voxels")));
    assert!(!claims.claims.iter().any(|c| c.paper.contains("reuse")));
    assert!(claims.costs.iter().all(|c| c.seconds > 0.0 && c.bytes > 0));
}

/// Recalculations with a cache are counted; those without one are the worst case.
#[test]
#[ignore = "slow: the claims of the report on renderers"]
fn recalculations_are_counted() {
    let r = recount::recount(&tube(), &stops()[..1], &EXTENT).unwrap();
    assert!(r.voxels > 100 && r.again <= r.voxels && r.computed >= 2 * r.voxels, "{r:?}");
    // With so few voxels no two share an entry, unless two threads compute one at the same time.
    assert!(r.cached >= r.voxels && r.cached < r.voxels + r.voxels / 50, "{r:?}");
    let claims = claims::claims(&tube(), &[], &stops(), &EXTENT, &Progress::new()).unwrap().claims;
    let of = |paper: &str| claims.iter().find(|c| c.paper.contains(paper)).unwrap().measured.clone();
    assert!(of("double recalculation").contains(&format!("computed {:.1} times", r.computed as f64 / r.voxels as f64)));
    assert!(of("around 2 seconds").contains("At 512 × 512 pixels (the paper names no size) and 90°"));
}

#[test]
fn each_idea_is_worth_what_it_takes_away() {
    let s = tube();
    let taken = worth::measure(&s, &stops(), &EXTENT, &Progress::new()).unwrap();
    let of = |v: Variant| taken.iter().find(|t| t.variant == v).unwrap();
    let samples = |v| of(v).work.samples as f64 / of(v).work.rays as f64;
    let whole = samples(Variant::Whole);
    assert!(samples(Variant::NoSensitivity) > 1.5 * whole && samples(Variant::Unaccelerated) > 1.5 * whole);
    assert!((samples(Variant::Gradients(GradientSource::Eight)) - whole).abs() < 0.05 * whole);
    assert!(of(Variant::NoReuse).work.reused == 0 && of(Variant::Whole).work.reused > 0);
    assert!(of(Variant::Leap(Leaping::Voxel)).bytes >= of(Variant::Whole).bytes + s.voxels().grid().len());
    assert!(of(Variant::Low).worst_psnr < of(Variant::Whole).worst_psnr);
    let table = worth::table(&taken, s.voxels().bytes());
    assert_eq!(table.csv().lines().count(), 14, "a row for each idea");
}
