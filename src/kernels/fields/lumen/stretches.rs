//! Where a place is along the gas, by its coarse map: for watching a flight. Distances that users read come from
//! [`Along`](crate::fields::Along).

use glam::{DVec3, I64Vec3, USizeVec3};

use super::Lumen;
use super::graph::Graph;
use crate::error::Result;
use crate::progress::Progress;

/// A place farther than this from all gas is nowhere along it, mm.
const NEAR_MM: f64 = 12.0;

/// Distances along the segments of a lumen, as coarse as the map: within about a tenth of the way, and 5 mm.
#[derive(Clone, Debug, Default)]
pub struct CoarseAlong {
    /// Centre of each node, its segment, and how far it is along, mm. Those of one box follow each other.
    nodes: Vec<(DVec3, usize, f64)>,
    /// The lower corner of the boxes around all of them, world mm, and the number of boxes, whose side is [`NEAR_MM`].
    low: DVec3,
    boxes: USizeVec3,
    /// The first node of each box, x fastest, and the number of nodes.
    first: Vec<u32>,
}

impl CoarseAlong {
    /// Measures the ways from each segment's rectal end. If the segments' order is known, each begins where the one before ends.
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
        Ok(Self::boxed(nodes))
    }

    /// Sorts the nodes into boxes.
    fn boxed(mut nodes: Vec<(DVec3, usize, f64)>) -> Self {
        let low = nodes.iter().fold(DVec3::INFINITY, |low, n| low.min(n.0));
        let high = nodes.iter().fold(DVec3::NEG_INFINITY, |high, n| high.max(n.0));
        if nodes.is_empty() {
            return Self::default();
        }
        let mut along = Self { low, ..Self::default() };
        along.boxes = along.place(high).as_usizevec3() + 1;
        let index = |p: DVec3| along.index(along.place(p).as_usizevec3());
        nodes.sort_by_key(|n| index(n.0));
        let mut first = vec![0; along.boxes.element_product() + 1];
        nodes.iter().for_each(|n| first[index(n.0) + 1] += 1);
        for n in 1..first.len() {
            first[n] += first[n - 1];
        }
        Self { nodes, first, ..along }
    }

    /// Returns the box of a place, which may lie outside of all.
    fn place(&self, world: DVec3) -> I64Vec3 {
        ((world - self.low) / NEAR_MM).floor().as_i64vec3()
    }

    fn index(&self, at: USizeVec3) -> usize {
        at.x + self.boxes.x * (at.y + self.boxes.y * at.z)
    }

    /// Returns the segment of the gas nearest to a place (world, mm), and how far along it is from the rectal end, mm.
    pub fn of(&self, world: DVec3) -> Option<(usize, f64)> {
        let square = |n: &(DVec3, usize, f64)| n.0.distance_squared(world);
        let at = self.place(world);
        let side = |a: usize| {
            let most = self.boxes[a] as i64;
            at[a].saturating_sub(1).clamp(0, most) as usize..at[a].saturating_add(2).clamp(0, most) as usize
        };
        let rows = side(2).flat_map(|z| side(1).map(move |y| (y, z)));
        let near = rows.flat_map(|(y, z)| {
            let x = side(0);
            let [from, to] = [x.start, x.end].map(|x| self.index(USizeVec3::new(x, y, z)));
            &self.nodes[self.first[from] as usize..self.first[to.max(from)] as usize]
        });
        let nearest = near.reduce(|a, b| if square(b) < square(a) { b } else { a })?;
        (square(nearest) <= NEAR_MM * NEAR_MM).then_some((nearest.1, nearest.2))
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice()) + size_of_val(self.first.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::lumen;
    use crate::math::hash;
    use crate::phantom::{PhantomSettings, Size};
    use crate::shared::shared;

    #[test]
    fn places_on_the_axis_are_as_far_along_as_they_are() {
        let settings = PhantomSettings { size: Size::Small, ..PhantomSettings::default() };
        let (phantom, volume) = shared(&settings);
        let lumen = lumen::find(&volume, &Progress::new()).unwrap();
        let along = CoarseAlong::new(&lumen, &Progress::new()).unwrap();
        let truth = phantom.truth();
        let whole = truth.length_mm;
        for n in [30, 100, 300, 500, 600] {
            let at = truth.centerline[n];
            let (segment, mm) = along.of(at).unwrap();
            let wanted = n as f64 * whole / (truth.centerline.len() - 1) as f64;
            assert!(segment == 0 && (mm - wanted).abs() < 25.0, "{mm} mm instead of {wanted}");
        }
        // The boxes find what a look at all nodes finds.
        for n in 0..3000 {
            let [x, y, z] = [0, 1, 2].map(|a| 2.4 * hash::uniform(7, 3 * n + a) - 1.2);
            let at = truth.centerline[300] + DVec3::new(x, y, z) * 120.0;
            let square = |n: &(DVec3, usize, f64)| n.0.distance_squared(at);
            let nearest = along.nodes.iter().min_by(|a, b| square(a).total_cmp(&square(b))).unwrap();
            let wanted = (square(nearest) <= NEAR_MM * NEAR_MM).then_some((nearest.1, nearest.2));
            assert_eq!(along.of(at), wanted, "{at}");
        }
        for nowhere in [DVec3::NAN, DVec3::INFINITY, DVec3::splat(-1e300)] {
            assert_eq!(along.of(nowhere), None);
        }
        assert_eq!(along.of(DVec3::splat(1e4)), None);
        assert_eq!(CoarseAlong::default().of(DVec3::ZERO), None);
    }
}
