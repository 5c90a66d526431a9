//! What the wall belongs to: by the phantom's anatomy, or by the values of a scan.

use crate::dataset::truth::{Find, Labels};
use crate::fields::Along;
use crate::phantom::{Phantom, WallKind};
use crate::space::PreparedVolume;

/// The labels before the polyps.
const NAMES: [&str; 8] =
    ["nothing", "wall", "fold", "fluid", "stool", "bridge of residue", "decoy", "tagged fluid or stool"];
/// The numbers of tag and of the wall.
const TAG_AND_WALL: [u8; 2] = [7, 1];

/// Returns the labels of a scan: those of its phantom, of which `find` is [`number`], or those that its values tell.
pub(super) fn labels<'a>(volume: &'a PreparedVolume, find: Option<Find<'a>>, along: Option<&Along>) -> Labels<'a> {
    let mut from = 0.0;
    let begins = along.map_or(&[][..], Along::parts).iter().map(|p| std::mem::replace(&mut from, p.to_mm));
    let begins = begins.collect();
    match find {
        Some(find) => Labels::found(volume, find, begins),
        None => Labels::of_tag(volume, TAG_AND_WALL, begins),
    }
}

/// Returns the labels' names and those of the parts, by their numbers.
pub(super) fn names(phantom: Option<&Phantom>, along: Option<&Along>) -> [Vec<String>; 2] {
    let polyps = (1..=phantom.map_or(0, |p| p.polyps().len())).map(|n| format!("polyp {n}"));
    let parts = along.map_or(&[][..], Along::parts).iter().map(|p| p.name.to_string());
    [
        NAMES.map(str::to_owned).into_iter().chain(polyps).collect(),
        std::iter::once("unknown".to_owned()).chain(parts).collect(),
    ]
}

/// Returns the number of what a phantom's wall belongs to.
pub(super) fn number(kind: Option<WallKind>) -> u8 {
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
