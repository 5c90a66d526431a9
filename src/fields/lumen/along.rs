//! Where a place is along the colon, by the coarse map of the gas.

use glam::DVec3;

use super::Lumen;
use super::graph::Graph;
use crate::error::Result;
use crate::progress::Progress;

/// A place farther than this from all gas is nowhere along it, mm.
const NEAR_MM: f64 = 12.0;

/// Distances along the segments of a lumen. They are as coarse as the map: within about a tenth of the way, and 5 mm.
#[derive(Clone, Debug, Default)]
pub struct Along {
    /// Centre of each node, its segment, and how far it is along, mm.
    nodes: Vec<(DVec3, usize, f64)>,
}

impl Along {
    /// Measures the ways from each segment's rectal end. If the segments' order is known, each begins where the one before
    /// ends.
    ///
    /// # Errors
    /// Returns status 4 if interrupted.
    pub fn new(lumen: &Lumen, progress: &Progress) -> Result<Self> {
        let graph = Graph::of(lumen.grid(), lumen.gas(), progress)?;
        let mut nodes = Vec::with_capacity(graph.nodes.len());
        let mut before = 0.0;
        for (n, segment) in lumen.segments.iter().enumerate() {
            progress.check()?;
            let own: Vec<u32> = graph.of_label(n as u32).collect();
            let away = |v: u32, p: DVec3| graph.nodes[v as usize].centre.distance_squared(p);
            let nearest = |p: DVec3| own.iter().copied().reduce(|a, b| if away(b, p) < away(a, p) { b } else { a });
            let Some([first, last]) = nearest(segment.ends[0]).zip(nearest(segment.ends[1])).map(|(a, b)| [a, b])
            else {
                continue;
            };
            let ways = graph.ways(first);
            // The way from cell to cell zigzags.
            let length = ways.length[last as usize];
            let straight = if length > 0.0 && length.is_finite() { segment.length_mm / length } else { 1.0 };
            nodes.extend(
                own.iter()
                    .filter(|&&v| ways.length[v as usize].is_finite())
                    .map(|&v| (graph.nodes[v as usize].centre, n, before + ways.length[v as usize] * straight)),
            );
            if lumen.ordered {
                before += segment.length_mm;
            }
        }
        Ok(Self { nodes })
    }

    /// Returns the segment of the gas nearest to a place (world, mm), and how far along it is from the rectal end, mm.
    pub fn of(&self, world: DVec3) -> Option<(usize, f64)> {
        let square = |n: &(DVec3, usize, f64)| n.0.distance_squared(world);
        let nearest = self.nodes.iter().reduce(|a, b| if square(b) < square(a) { b } else { a })?;
        (square(nearest) <= NEAR_MM * NEAR_MM).then_some((nearest.1, nearest.2))
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::lumen;
    use crate::phantom::{Phantom, PhantomSettings, Size};

    #[test]
    fn places_on_the_axis_are_as_far_along_as_they_are() {
        let settings = PhantomSettings { size: Size::Small, ..PhantomSettings::default() };
        let phantom = Phantom::new(&settings);
        let volume = phantom.voxelise(&phantom.grid(), &Progress::new()).unwrap();
        let lumen = lumen::find(&volume, &Progress::new()).unwrap();
        let along = Along::new(&lumen, &Progress::new()).unwrap();
        let truth = phantom.truth();
        let whole = truth.length_mm;
        for n in [30, 100, 300, 500, 600] {
            let at = truth.centerline[n];
            let (segment, mm) = along.of(at).unwrap();
            let wanted = n as f64 * whole / (truth.centerline.len() - 1) as f64;
            assert!(segment == 0 && (mm - wanted).abs() < 25.0, "{mm} mm instead of {wanted}");
        }
        assert_eq!(along.of(DVec3::splat(1e4)), None);
        assert_eq!(Along::default().of(DVec3::ZERO), None);
    }
}
