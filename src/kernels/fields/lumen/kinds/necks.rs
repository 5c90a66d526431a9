//! Narrow passages between two parts of one piece of gas, such as an open ileocecal valve.
//!
//! The parts are basins of the clearance: nodes of the coarse map are taken from the widest to the narrowest, and each joins the
//! basins beside it (a watershed, Vincent and Soille 1991, with merging by depth). Two ample basins that meet only where the
//! passage is narrow stay apart.

use crate::fields::lumen::graph::Graph;
use crate::math::sets::Sets;

/// Clearance below which a passage is narrow, mm, as coarse as the map.
const NARROW_MM: f64 = 2.6;
/// Minimum volume of a part, ml, in an adult.
const AMPLE_ML: f64 = 6.0;
/// Minimum clearance in the middle of a part, mm, in an adult.
const WIDE_MM: f64 = 5.0;

/// Gives the parts of each label their own labels, from 0 on without gaps, and returns the former label of each; the patient's
/// size compared with an adult's is `scale`. Where nothing is narrow, labels stay as they are.
pub(crate) fn part(graph: &mut Graph, count: usize, voxel_ml: f64, scale: f64) -> Vec<u32> {
    let nodes = &graph.nodes;
    let mut order: Vec<u32> = (0..nodes.len() as u32).collect();
    order.sort_by(|&a, &b| nodes[b as usize].clearance.total_cmp(&nodes[a as usize].clearance).then(a.cmp(&b)));
    let mut sets = Sets::new(nodes.len());
    // Of each set's root: its voxels and its largest clearance.
    let mut size: Vec<(u64, f64)> = nodes.iter().map(|n| (u64::from(n.voxels), n.clearance)).collect();
    let mut taken = vec![false; nodes.len()];
    let (least_ml, least_mm) = (AMPLE_ML * scale.powi(3), WIDE_MM * scale);
    let is_part = |(voxels, widest): (u64, f64)| voxels as f64 * voxel_ml >= least_ml && widest >= least_mm;
    for &n in &order {
        taken[n as usize] = true;
        let here = &nodes[n as usize];
        // The largest basin first: a node in a narrow passage belongs to it.
        let mut beside: Vec<u32> = graph
            .neighbours(n)
            .iter()
            .filter(|&&m| taken[m as usize] && nodes[m as usize].label == here.label)
            .map(|&m| sets.find(m))
            .collect();
        beside.sort_unstable();
        beside.dedup();
        beside.sort_by_key(|&s| (std::cmp::Reverse(size[s as usize].0), s));
        for other in beside {
            let own = sets.find(n);
            if own == other {
                continue;
            }
            let [a, b] = [size[own as usize], size[other as usize]];
            if here.clearance <= NARROW_MM && is_part(a) && is_part(b) {
                continue;
            }
            sets.join(own, other);
            size[sets.find(n) as usize] = (a.0 + b.0, a.1.max(b.1));
        }
    }
    let (of, parts) = sets.numbered();
    // A basin that stayed small belongs to the part it touches; there is one, because all of a label's nodes are connected.
    let mut label = vec![u32::MAX; parts];
    let mut former = vec![u32::MAX; parts];
    for (n, node) in nodes.iter().enumerate() {
        former[of[n] as usize] = node.label;
    }
    // Parts of the first label first, each by its first node.
    let mut by_label: Vec<u32> = (0..parts as u32).collect();
    by_label.sort_by_key(|&p| (former[p as usize], p));
    for (n, &p) in by_label.iter().enumerate() {
        label[p as usize] = n as u32;
    }
    debug_assert!(parts >= count || nodes.is_empty());
    for (n, node) in graph.nodes.iter_mut().enumerate() {
        node.label = label[of[n] as usize];
    }
    by_label.iter().map(|&p| former[p as usize]).collect()
}
