//! `report coverage`: how much of the wall flights see, compared with a study of readers and with the visible maximum; where the
//! unseen wall lies; and the cost of the measurement.

mod live;
mod pages;
mod rest;
mod runs;
mod visible;

use std::path::Path;
use std::sync::Arc;

use crate::app::Scan;
use crate::error::{Error, Result};
use crate::phantom::{Phantom, PhantomSettings, Size};
use crate::progress::Progress;
use crate::space::{PreparedVolume, TransferFunction};

use super::Effort;
use live::Live;
use rest::Rest;
use runs::{Run, Toured};
use visible::Visible;

/// Measurements in one colon.
struct Measured {
    title: String,
    is_scan: bool,
    runs: Vec<Run>,
    /// The review of the planned flight at a view angle of 90°.
    toured: Toured,
    visible: Visible,
    rest: Rest,
    /// Time (s) and memory (MB) of the coverage of a planned flight in pictures of 90°, with its wall, and the wall's area and bytes.
    cost: Cost,
    live: Live,
}

/// Cost of the measurement.
#[derive(Clone, Copy, Debug)]
struct Cost {
    seconds: f64,
    megabytes: Option<f64>,
    places: usize,
    triangles: usize,
    wall_bytes: usize,
}

/// Measures on phantoms, and on a scan with its title, and writes the report into `folder`. Returns the findings, one sentence each.
///
/// # Errors
/// Returns status 4 if interrupted or if a scan contains no colon, 5 if a file cannot be written.
pub fn report(
    effort: Effort,
    seed: u64,
    scan: Option<(String, PreparedVolume)>,
    folder: &Path,
    progress: &Progress,
) -> Result<Vec<String>> {
    let (size, name) = effort.choose((Size::Small, "small"), (Size::Standard, "standard"));
    let mut all = Vec::new();
    for seed in seed..seed.saturating_add(effort.choose(1, 2)) {
        let phantom = Phantom::new(&PhantomSettings { size, seed, ..PhantomSettings::default() });
        let volume = Arc::new(phantom.voxelise(&phantom.grid(), progress)?);
        let volume = PreparedVolume::new(volume, TransferFunction::default());
        all.push(measure(effort, format!("phantom, {name}, seed {seed}"), volume, false, progress)?);
    }
    if let Some((title, volume)) = scan {
        all.push(measure(effort, title, volume, true, progress)?);
    }
    pages::write(&all, folder)
}

fn measure(
    effort: Effort,
    title: String,
    volume: PreparedVolume,
    is_scan: bool,
    progress: &Progress,
) -> Result<Measured> {
    progress.stage(&format!("flying {title}"), 0);
    let mut scan = Scan::prepared(volume, Arc::new(progress.clone()));
    let tagged = scan.lumen()?;
    let mut runs = Vec::new();
    let mut planned = None;
    for guide in runs::GUIDES {
        let flight = runs::measured(&mut scan, guide, progress)?;
        runs.extend(runs::runs(&flight, guide, progress)?);
        if guide == runs::PATH {
            planned = Some(flight);
        }
    }
    let Some(flight) = planned else {
        return Err(Error::fault("report coverage", "has no planned flight", "report it"));
    };
    progress.stage("measuring the visible maximum", 0);
    let planned = runs.iter().filter(|r| r.guide == runs::PATH).flat_map(|r| &r.reviewed);
    let looks: Vec<_> = planned.flat_map(|r| r.views.iter().copied()).collect();
    let visible = visible::visible(&flight, &[&flight.back[..], &looks].concat(), effort.choose(7.0, 4.0), progress)?;
    let reviewed = runs.iter().find(|r| r.guide == runs::PATH).map(|r| &r.reviewed[0]);
    let rest = rest::rest(&flight, reviewed, &visible, &tagged, progress)?;
    let cost = Cost {
        seconds: flight.seconds,
        megabytes: flight.megabytes,
        places: flight.views().len(),
        triangles: flight.wall.len(),
        wall_bytes: flight.wall.bytes(),
    };
    progress.stage("flying the review", 0);
    let toured = runs::toured(flight, progress)?;
    progress.stage("measuring live coverage", 0);
    let live = live::live(&mut scan, runs::PATH, progress)?;
    Ok(Measured { title, is_scan, runs, toured, visible, rest, cost, live })
}
