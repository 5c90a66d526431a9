//! Finds the colon's interior in a scan.

use glam::DVec3;

use super::bodies::{Bodies, Core, parted};
use super::frame::Frame;
use super::graph::Graph;
use super::kinds::GasKind;
use super::model::{Lumen, Told};
use super::runs::Rows;
use super::{CORE_HU, GAS_HU, SNAP_MM, choose, ends, judgement, runs};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Volume;

/// Finds the colon's gas, its segments, their ends and order. No seed point is needed. A scan without a colon has no
/// segments, which is not an error.
///
/// ```
/// # mod colvis {
/// # pub use colvis_kernels::*;
/// # pub use colvis_phantom as phantom;
/// # }
/// use colvis::fields::lumen;
/// use colvis::phantom::Phantom;
/// use colvis::progress::Progress;
///
/// let progress = Progress::new();
/// let volume = Phantom::embedded(&progress)?; // a small synthetic colon
/// let lumen = lumen::find(&volume, &progress)?;
/// assert!(lumen.is_flyable() && lumen.segments.len() == 1 && lumen.gas_ml() > 100.0);
/// # Ok::<(), colvis::error::Error>(())
/// ```
///
/// # Errors
/// Returns an error if cancelled, or if the volume cannot be addressed.
pub fn find(volume: &Volume, progress: &Progress) -> Result<Lumen> {
    find_told(volume, &[], progress)
}

/// Same as [`find`], where the gas at some places has the kind that the reader gave to it.
///
/// # Errors
/// As [`find`].
pub fn find_told(volume: &Volume, told: &[Told], progress: &Progress) -> Result<Lumen> {
    progress.stage("finding the colon", volume.grid().dims()[2] as u64);
    let frame = Frame::of(volume.grid());
    let (rows, components) = runs::components_below(volume, CORE_HU, progress)?;
    let looked = choose::look(volume, &rows, components, frame);
    let mut chosen = looked.colon();
    for (at, kind) in told {
        if let Some((label, _)) = ends::nearest(volume.grid(), &rows, *at, SNAP_MM, |_| true)
            && *kind == GasKind::Colon
            && !chosen.contains(&label)
        {
            chosen.push(label);
        }
    }
    let mut others = looked.others(volume.grid(), &rows, &chosen);
    let mut place = vec![None; components];
    for (n, &c) in chosen.iter().enumerate() {
        place[c as usize] = Some(n as u32);
    }
    let core = rows.select(|c| place[c as usize]);
    drop(rows);
    let core = parted(volume, core, chosen.len(), progress)?;
    let mut lumen = judgement::lumen(volume, core, told, frame, progress)?;
    lumen.others.append(&mut others);
    lumen.others.sort_by(|a, b| b.ml.total_cmp(&a.ml));
    Ok(lumen)
}

/// Finds the gas that contains `world` (mm) or is within 5 mm of it, whatever its size. Returns a lumen of one segment
/// with its ends, or `None` if there is no gas, or only the air outside the patient.
///
/// # Errors
/// Returns an error if cancelled, or if the volume cannot be addressed.
pub fn gas_at(volume: &Volume, world: DVec3, progress: &Progress) -> Result<Option<Lumen>> {
    progress.stage("finding the gas at the given point", volume.grid().dims()[2] as u64);
    let frame = Frame::of(volume.grid());
    let (rows, _) = runs::components_below(volume, CORE_HU, progress)?;
    let Some((label, _)) = ends::nearest(volume.grid(), &rows, world, SNAP_MM, |_| true) else { return Ok(None) };
    if choose::is_outside(&rows, label, frame) {
        return Ok(None);
    }
    let core = rows.select(|c| (c == label).then_some(0));
    drop(rows);
    let core = parted(volume, core, 1, progress)?;
    let Some((label, _)) = ends::nearest(volume.grid(), &core.rows, world, SNAP_MM, |_| true) else { return Ok(None) };
    let rows = core.rows.select(|c| (c == label).then_some(0));
    lumen(volume, Core { rows, count: 1, ..core }, frame, progress).map(Some)
}

/// Finds the gas connected to the voxel of gas nearest to `world` (mm), within 5 mm, in a part of a scan. It has no segments, and what
/// leaves the part belongs to it. `None` if there is no gas.
///
/// # Errors
/// Returns an error if cancelled, or if the volume cannot be addressed.
pub fn gas_near(volume: &Volume, world: DVec3, progress: &Progress) -> Result<Option<Lumen>> {
    let (rows, _) = runs::components_below(volume, GAS_HU, progress)?;
    let Some((label, _)) = ends::nearest(volume.grid(), &rows, world, SNAP_MM, |_| true) else { return Ok(None) };
    let gas = rows.select(|c| (c == label).then_some(0));
    Ok(Some(Lumen::of_rows(volume.grid(), gas, Rows::default())))
}

/// Builds a lumen from its cores.
fn lumen(volume: &Volume, core: Core, frame: Frame, progress: &Progress) -> Result<Lumen> {
    let graph = Graph::of(volume.grid(), &core.rows, progress)?;
    let bodies = Bodies::of(volume, core, &graph, frame, progress)?;
    Ok(bodies.into_lumen(volume, frame, None))
}
