//! `report perforation`: random forces, steps, bodies, methods and places, and the number of times the wall was crossed.

mod judge;
mod places;
mod walk;

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use walk::Ground;
pub use walk::{Failure, Fault, Tally};

use super::page::Page;
use super::table::{Cell, Table, finite, table};
use crate::dynamics::Integrator;
use crate::error::Result;
use crate::fields::ClearanceFinder;
use crate::progress::Progress;
use judge::Judge;

/// Value of the wall, HU: the middle of the default ramp.
const ISO: f32 = -650.0;
/// Search radius of clearances in a step, mm.
const LIMIT_MM: f64 = 4.0;

/// Creates all places, ready for walks, with their names.
pub(crate) fn grounds(seed: u64, progress: &Progress) -> Result<Vec<(String, Ground)>> {
    let places = places::all(seed, progress)?;
    Ok(places
        .into_par_iter()
        .map(|p| {
            let grid = p.volume.grid().clone();
            let last = DVec3::from_array(grid.dims().map(|n| n as f64 - 1.0));
            let corners = (0..8)
                .map(|c| grid.world(last * DVec3::new(f64::from(c & 1), f64::from(c >> 1 & 1), f64::from(c >> 2))));
            let (low, high) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
            let ground = Ground {
                walls: ClearanceFinder::new(Arc::clone(&p.volume), ISO, LIMIT_MM),
                judge: Judge::new(Arc::clone(&p.volume), f64::from(ISO)),
                from: low - 1.0,
                to: high + 1.0,
            };
            (p.name, ground)
        })
        .collect())
}

/// Results for each place and each method.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// By place.
    pub places: Vec<(String, Tally)>,
    /// By method.
    pub methods: Vec<(&'static str, Tally)>,
    /// Total.
    pub all: Tally,
    /// Each step that perforated, with the index of its place and its method.
    pub failures: Vec<(usize, Integrator, Failure)>,
}

/// Executes `steps` steps. They are the same for the same seed and for any number of threads.
///
/// # Errors
/// Returns status 4 if interrupted.
pub fn run(steps: u64, seed: u64, progress: &Progress) -> Result<Outcome> {
    let grounds = grounds(seed, progress)?;
    let walks = steps.div_ceil(walk::STEPS);
    progress.stage("walking into walls", walks);
    let walked: Vec<(usize, Integrator, Tally, Vec<Failure>)> = (0..walks)
        .into_par_iter()
        .map(|n| {
            let place = (n % grounds.len() as u64) as usize;
            let left = (steps - n * walk::STEPS).min(walk::STEPS);
            let (integrator, tally, failures) = walk::walk(&grounds[place].1, seed, n, left);
            progress.advance(1)?;
            Ok((place, integrator, tally, failures))
        })
        .collect::<Result<_>>()?;
    let over = |meant: &dyn Fn(usize, Integrator) -> bool| {
        let meant = walked.iter().filter(|w| meant(w.0, w.1));
        meant.fold(Tally::none(), |sum, w| sum.and(w.2))
    };
    Ok(Outcome {
        places: grounds.iter().enumerate().map(|(n, (name, _))| (name.clone(), over(&|p, _| p == n))).collect(),
        methods: Integrator::ALL.iter().map(|(i, name)| (*name, over(&|_, j| j == *i))).collect(),
        all: over(&|_, _| true),
        failures: walked.iter().flat_map(|w| w.3.iter().map(|f| (w.0, w.1, f.clone()))).collect(),
    })
}

/// Measures and writes the report into `folder`. Returns the findings, one sentence each.
///
/// # Errors
/// Returns status 4 if interrupted, 5 if a file cannot be written.
pub fn report(steps: u64, seed: u64, folder: &Path, progress: &Progress) -> Result<Vec<String>> {
    let outcome = run(steps, seed, progress)?;
    let mut page = Page::new(folder, "colvis: random steps against the wall")?;
    page.text(&format!(
        "{steps} steps in walks of {}, seed {seed}: forces from 1e-3 to 1e9 g·mm/s² and their slopes, steps from 1e-6 to \
         10 s, masses from 1e-6 to 1e6 g, C_s from 1e-9 to 1e9, spins to 1e4 rad/s, needles to discs, radii from 0 to 1.5 mm, \
         each with one of all integrators. Walks begin where the camera fits, in the wall, at distance 0, and outside. A step has perforated if its swept path comes closer than the radius to any point of the wall (sampled from the voxels every quarter of a millimetre, not by the clearance finder that the step relies on), if any point of the path goes from gas into the wall, or if a body that was too close came closer.",
        walk::STEPS
    ));
    let a = outcome.all;
    let finding = format!(
        "{} perforations, {} steps with a non-finite result, {} hangs in {} steps; {} steps were stopped by a wall, {} began too close to it, and {} of those found no way out. No step took more than {} evaluations.",
        a.perforations, a.broken, a.hangs, a.steps, a.blocked, a.too_near, a.stuck, a.most_rates
    );
    page.finding(&finding);
    let table = |what: &str, all: &mut dyn Iterator<Item = (&str, &Tally)>| {
        let columns =
            ["steps", "perforations", "not finite", "hangs", "blocked", "too near", "stuck", "most evaluations"];
        let mut table = Table::new(&[&[what], &columns[..], &["least margin / mm"]].concat());
        for (name, t) in all {
            let counts =
                [t.steps, t.perforations, t.broken, t.hangs, t.blocked, t.too_near, t.stuck, u64::from(t.most_rates)];
            let counts = counts.map(|n| Cell::Number(n as f64, 0));
            table.row([name.into()].into_iter().chain(counts).chain([finite(t.margin_mm, 4)]).collect());
        }
        table
    };
    page.section("By place");
    page.table("places", &table("place", &mut outcome.places.iter().map(|p| (p.0.as_str(), &p.1))))?;
    page.section("By method");
    page.table("methods", &table("method", &mut outcome.methods.iter().map(|m| (m.0, &m.1))))?;
    if !outcome.failures.is_empty() {
        let failures = table!(for (place, integrator, f) in &outcome.failures;
            "walk" => f.walk as usize,
            "step" => f.step as usize,
            "place" => &outcome.places[*place].0,
            "method" => Integrator::ALL.iter().find(|(i, _)| i == integrator).map_or("", |(_, name)| name),
            "radius / mm" => (f.radius_mm, 1),
            "from / mm" => format!("{:.6} {:.6} {:.6}", f.from.x, f.from.y, f.from.z),
            "what" => f.what.name(),
        );
        page.section("Steps that perforated");
        page.table("failures", &failures)?;
    }
    page.finish()?;
    Ok(vec![finding])
}
