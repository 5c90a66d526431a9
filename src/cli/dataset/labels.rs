//! What the wall belongs to: by the phantom's anatomy, or by the values of a scan.

use glam::DVec3;

use crate::app::Scan;
use crate::dataset::truth::Labeller;
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
        Self { polyps, volume: scan.volume().clone(), parts: parts.collect(), phantom }
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
        let kind = self.phantom.as_ref().map(|p| p.wall_kind(place));
        let label = match kind {
            Some(Some(WallKind::Fold)) => 2,
            Some(Some(WallKind::Fluid)) => 3,
            Some(Some(WallKind::Stool)) => 4,
            Some(Some(WallKind::Bridge)) => 5,
            Some(Some(WallKind::Decoy)) => 6,
            Some(Some(WallKind::Polyp(n))) => (NAMES.len() + n).min(255) as u8,
            Some(_) => 1,
            None if crate::space::value(&self.volume, place - normal * BEHIND_MM) >= TAG_HU => 7,
            None => 1,
        };
        [label, part]
    }
}
