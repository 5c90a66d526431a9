//! What the wall belongs to: by the phantom's anatomy, or by the values of a scan.

use glam::DVec3;

use crate::app::Scan;
use crate::dataset::truth::{Labeller, Lattice};
use crate::fields::Along;
use crate::phantom::{Phantom, WallKind};
use crate::space::PreparedVolume;

/// From this value on, HU, what lies [`BEHIND_MM`] behind the wall is tagged fluid or stool.
const TAG_HU: f32 = 200.0;
const BEHIND_MM: f64 = 1.5;

/// The labels before the polyps.
const NAMES: [&str; 8] =
    ["nothing", "wall", "fold", "fluid", "stool", "bridge of residue", "decoy", "tagged fluid or stool"];

/// The numbers of labels and parts.
pub(super) struct Labels {
    phantom: Option<Phantom>,
    volume: PreparedVolume,
    known: Lattice,
    polyps: usize,
    /// Where each part begins along the line, mm, and its name.
    parts: Vec<(f64, String)>,
}

impl Labels {
    pub(super) fn new(phantom: Option<Phantom>, scan: &Scan, along: Option<&Along>) -> Self {
        let polyps = phantom.as_ref().map_or(0, |p| p.polyps().len());
        let mut from = 0.0;
        let parts = along.map_or(&[][..], Along::parts).iter().map(|p| {
            let begins = from;
            from = p.to_mm;
            (begins, p.name.to_string())
        });
        Self {
            polyps,
            known: Lattice::new(scan.volume().voxels().grid()),
            volume: scan.volume().clone(),
            parts: parts.collect(),
            phantom,
        }
    }

    /// Returns the labels' names, by their numbers.
    pub(super) fn names(&self) -> Vec<String> {
        let polyps = (1..=self.polyps).map(|n| format!("polyp {n}"));
        NAMES.map(str::to_owned).into_iter().chain(polyps).collect()
    }

    /// Returns the parts' names, by their numbers.
    pub(super) fn parts(&self) -> Vec<String> {
        std::iter::once("unknown".to_owned()).chain(self.parts.iter().map(|p| p.1.clone())).collect()
    }
}

impl Labeller for Labels {
    fn label(&self, place: DVec3, normal: DVec3, along: Option<f64>) -> [u8; 2] {
        let part = along.map_or(0, |mm| self.parts.partition_point(|p| p.0 <= mm).min(255) as u8);
        let tag = || crate::space::value(&self.volume, place - normal * BEHIND_MM) >= TAG_HU;
        let label = match &self.phantom {
            Some(phantom) => self.known.label(place, &mut |place| number(phantom.wall_kind(place)).into()) as u8,
            None if tag() => 7,
            None => 1,
        };
        [label, part]
    }
}

/// Returns the number of what a phantom's wall belongs to.
fn number(kind: Option<WallKind>) -> u8 {
    match kind {
        Some(WallKind::Fold) => 2,
        Some(WallKind::Fluid) => 3,
        Some(WallKind::Stool) => 4,
        Some(WallKind::Bridge) => 5,
        Some(WallKind::Decoy) => 6,
        Some(WallKind::Polyp(n)) => (NAMES.len() + n).min(254) as u8,
        _ => 1,
    }
}
