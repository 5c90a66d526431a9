//! Judgement of the bodies of gas that may be colon, and the lumen of those that are.

use super::bodies::{Bodies, Core, measured};
use super::frame::Frame;
use super::graph::Graph;
use super::kinds::rules::{self, Chain};
use super::kinds::{Considered, Features, GasKind, Judged, Landmarks, features, necks};
use super::model::{Lumen, Told};
use super::order::{self, Body};
use super::others::Other;
use super::runs::{Rows, touching};
use super::{SNAP_MM, ends};
use crate::error::Result;
use crate::math::sets::Sets;
use crate::progress::Progress;
use crate::volume::Volume;

/// Length of a chain that is a whole colon, mm, in an adult: three standard deviations below the mean of two studies (Khashab 2009,
/// Utano 2021).
const WHOLE_MM: f64 = 950.0;
/// Worth of a body about which nothing speaks for or against the colon, mm of a chain …
const WORTH_MM: f64 = 60.0;
/// … and of each unit of evidence.
const EVIDENCE_MM: f64 = 60.0;
/// The length of a body counts, too: in full for one as wide as the second caliber, mm, in an adult; against one near the first, because
/// a chain must not lead through it free of cost …
const NARROW_MM: [f64; 2] = [20.0, 30.0];
/// … with this share.
const NARROW: f64 = 0.5;

/// Builds the lumen from its cores: judges each body, or its parts if narrow passages divide it, and keeps what is colon or may be.
pub(super) fn lumen(volume: &Volume, core: Core, told: &[Told], frame: Frame, progress: &Progress) -> Result<Lumen> {
    let grid = volume.grid();
    let landmarks = Landmarks::of(volume, frame);
    let mut graph = Graph::of(grid, &core.rows, progress)?;
    let former = match &landmarks {
        Some(l) => necks::part(&mut graph, core.count, grid.voxel_ml(), l.scale()),
        None => (0..core.count as u32).collect(),
    };
    let is_divided = former.len() > core.count;
    let mut core = Core { count: former.len(), ..core };
    if is_divided {
        core.rows = graph.labelled(&graph.cells(grid), &core.rows, |n| graph.nodes[n as usize].label, progress)?;
    }
    let mut bodies = Bodies::of(volume, core, &graph, frame, progress)?;
    let Some(landmarks) = landmarks else { return Ok(bodies.into_lumen(volume, frame, None)) };
    let considered = considered(volume, &bodies, told, &landmarks);
    let judged: Vec<Judged> = considered.iter().map(|c| c.judged).collect();
    // Parts that touch and are both colon become one again. Cores that meet only where they were grown stay two: no way leads from one
    // to the other, so ends of both together would be those of one.
    let mut sets = Sets::new(former.len());
    if is_divided {
        touching_labels(&bodies.gas, |a, b| {
            if former[a as usize] == former[b as usize] && judged[a as usize].is_lumen && judged[b as usize].is_lumen {
                sets.join(a, b);
            }
        });
    }
    let (set, _) = sets.numbered();
    // The bodies that stay, by volume, the largest first.
    let mut ml = vec![0.0; former.len()];
    for (n, s) in bodies.segments.iter().enumerate().filter(|(n, _)| judged[*n].is_lumen) {
        ml[set[n] as usize] += s.ml;
    }
    let mut kept: Vec<u32> = (0..former.len() as u32).filter(|&s| ml[s as usize] > 0.0).collect();
    kept.sort_by(|&a, &b| ml[b as usize].total_cmp(&ml[a as usize]).then(a.cmp(&b)));
    let label_of = |n: usize| {
        let place = kept.iter().position(|&s| s == set[n]).filter(|_| judged[n].is_lumen);
        place.map(|p| p as u32)
    };
    let label: Vec<Option<u32>> = (0..former.len()).map(label_of).collect();
    let other = bodies.gas.select(|n| label[n as usize].is_none().then(|| judged[n as usize].kind.number() as u32));
    let mut others: Vec<Other> = Vec::new();
    for (n, s) in bodies.segments.iter().enumerate().filter(|(n, _)| label[*n].is_none()) {
        let Judged { kind, why, .. } = judged[n];
        others.push(Other {
            ml: s.ml,
            kind,
            why,
            bounds_mm: s.bounds_mm,
            is_judged: true,
            features: Some(considered[n].features),
        });
    }
    for (n, l) in label.iter().enumerate() {
        bodies.segments[n].judged = l.map(|_| judged[n]);
    }
    if is_divided || !others.is_empty() {
        bodies = bodies.relabelled(volume, &mut graph, &label, kept.len(), progress)?;
    }
    let mut lumen = bodies.into_lumen(volume, frame, Some(landmarks));
    (lumen.others, lumen.other, lumen.considered) = (others, other, considered);
    Ok(lumen)
}

/// Judges the bodies: first each by itself, then by the cheapest chain.
fn considered(volume: &Volume, bodies: &Bodies, told: &[Told], landmarks: &Landmarks) -> Vec<Considered> {
    let count = bodies.segments.len();
    let surfaces = features::surfaces(volume.grid(), &bodies.gas, count);
    let features: Vec<Features> = (0..count)
        .map(|n| features::measure(&bodies.segments, n, &bodies.clearances[n], surfaces[n], landmarks))
        .collect();
    let scale = landmarks.scale();
    let worth = |n: usize, pool_mm: f64| {
        let f = &features[n];
        let wide = 2.0 * (f.caliber_mm - NARROW_MM[0]) / (NARROW_MM[1] - NARROW_MM[0]) - 1.0;
        // A limb that is half full of fluid is longer than its gas.
        let length_mm = f.length_mm.max(f.along_mm) + pool_mm / scale;
        WORTH_MM + EVIDENCE_MM * rules::for_colon(f) + wide.clamp(-NARROW, 1.0) * length_mm
    };
    let body = Body::of(volume, bodies.lowest(), scale);
    let order = order::order(&bodies.links(volume.grid(), scale, worth), &body);
    let is_trusted = order.trusted && !landmarks.is_chest();
    let links = &order.chain[..order.passed];
    let is_whole = is_trusted && order.length_mm >= WHOLE_MM * scale;
    let chain = |n: usize| match links.iter().any(|l| l.0 == n) {
        true if is_trusted => Chain::Link,
        false if is_whole => Chain::Spare,
        _ => Chain::Unknown,
    };
    let consider = |n: usize| {
        let (features, chain) = (features[n], chain(n));
        Considered { features, chain, judged: rules::judge(&features, chain, None) }
    };
    let mut all: Vec<Considered> = (0..count).map(consider).collect();
    for &(at, kind) in told {
        if let Some((n, _)) = ends::nearest(volume.grid(), &bodies.gas, at, SNAP_MM, |_| true) {
            all[n as usize].judged = Judged { kind, why: "set by the reader", is_lumen: kind == GasKind::Colon };
        }
    }
    all
}

impl Bodies {
    /// Gives the bodies new labels, 0 to `count` − 1; drops those without. Bodies with one label become one.
    fn relabelled(
        self,
        volume: &Volume,
        graph: &mut Graph,
        label: &[Option<u32>],
        count: usize,
        progress: &Progress,
    ) -> Result<Self> {
        let grid = volume.grid();
        for node in &mut graph.nodes {
            // What is dropped gets a label that nothing asks for.
            node.label = label[node.label as usize].unwrap_or(u32::MAX);
        }
        let gas = self.gas.joined(|_, r| label[r.label as usize]);
        let fluid = self.fluid.joined(|_, r| label[r.label as usize]);
        let mut parts = vec![Vec::new(); count];
        for (n, l) in label.iter().enumerate() {
            if let Some(l) = l {
                parts[*l as usize].push(n);
            }
        }
        let mut segments = measured(grid, &gas, count);
        let mut clearances = vec![Vec::new(); count];
        for (l, parts) in parts.iter().enumerate() {
            let s = &mut segments[l];
            s.fluid_ml = parts.iter().map(|&n| self.segments[n].fluid_ml).sum();
            // Of the parts of one body, the surest speaks for all.
            let judged = parts.iter().filter_map(|&n| self.segments[n].judged);
            s.judged = judged.reduce(|a, b| if a.kind == GasKind::Unknown { b } else { a });
            let joined = parts.iter().flat_map(|&n| &self.segments[n].joined_to).filter_map(|&o| label[o]);
            s.joined_to = joined.map(|o| o as usize).filter(|&o| o != l).collect();
            s.joined_to.sort_unstable();
            s.joined_to.dedup();
            if let [n] = parts[..] {
                let from = &self.segments[n];
                (s.ends, s.length_mm, s.way) = (from.ends, from.length_mm, from.way.clone());
                clearances[l].clone_from(&self.clearances[n]);
            }
        }
        let mut bodies = Self { segments, clearances, gas, fluid, septa: self.septa, down: self.down };
        let whole: Vec<u32> = (0..count as u32).filter(|&l| parts[l as usize].len() > 1).collect();
        let found = Self::ends(grid, &bodies.gas, graph, whole, progress)?;
        bodies.put_ends(found);
        Ok(bodies)
    }
}

/// Calls `f` with every two different labels whose runs touch, possibly often.
fn touching_labels(rows: &Rows, mut f: impl FnMut(u32, u32)) {
    let [_, ny, nz] = rows.dims();
    for (j, k) in (0..nz).flat_map(|k| (0..ny).map(move |j| (j, k))) {
        let own = rows.row(j, k);
        for w in own.windows(2).filter(|w| w[0].end == w[1].start && w[0].label != w[1].label) {
            f(w[0].label, w[1].label);
        }
        for other in [(j > 0).then(|| rows.row(j - 1, k)), (k > 0).then(|| rows.row(j, k - 1))].into_iter().flatten() {
            touching(other, own, |a, b| {
                if other[a].label != own[b].label {
                    f(other[a].label, own[b].label);
                }
            });
        }
    }
}
