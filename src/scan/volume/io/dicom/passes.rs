//! Splits the slices of one series UID into passes, each of which can be a volume.
//!
//! Patient position, frame of reference, orientation, size and spacing always separate. Acquisition, kernel, energy, phase and
//! the other [`marks`] separate only where the slices do not lie as those of one pass do: where passes alternate, repeat
//! positions or overlap, or where a pass is interrupted just where the attribute changes.

use glam::DVec3;

use super::marks::{self, Marks};
use super::origin::Kind;
use super::slice::Slice;
use super::{even, stack};
use crate::volume::PatientPosition;

/// Maximum number of passes of a series. More are not passes but single slices that differ.
const MOST_PASSES: usize = 64;
/// Maximum number of attributes that split a series one after the other.
const DEEPEST: usize = 4;
/// Minimum mean number of slices per pass if there are more than two passes.
const LEAST_SLICES: usize = 3;

/// Minimum gap between passes that do not overlap, as a multiple of the usual step. A smaller one is a gap within a pass.
const LEAST_GAP: f64 = 3.5;

/// A pass of a series.
#[derive(Debug)]
pub(crate) struct Pass {
    /// Its slices, in the order of the files.
    pub slices: Vec<Slice>,
    /// What distinguishes it from the others of its series, in words; empty if it is the only one.
    pub words: String,
}

/// Indices of slices, and what distinguishes them from others.
#[derive(Clone, Debug)]
struct Part {
    slices: Vec<usize>,
    words: Vec<String>,
}

impl Part {
    fn with(&self, slices: Vec<usize>, words: String) -> Self {
        let mut all = self.words.clone();
        all.extend((!words.is_empty()).then_some(words));
        Self { slices, words: all }
    }
}

/// Splits the slices of a series.
pub(crate) fn split(slices: Vec<Slice>) -> Vec<Pass> {
    let whole = Part { slices: (0..slices.len()).collect(), words: Vec::new() };
    if slices.len() < 2 || slices[0].origin.kind != Kind::Slices {
        return vec![Pass { slices, words: String::new() }];
    }
    let mut parts = Vec::new();
    for by_frame in apart(&slices, &whole) {
        for by_plane in alike(&slices, &by_frame) {
            by_marks(&slices, by_plane, DEEPEST, &mut parts);
        }
    }
    if parts.len() > MOST_PASSES {
        parts = vec![whole];
    }
    let mut slots: Vec<Option<Slice>> = slices.into_iter().map(Some).collect();
    let mut take = |part: &Part| part.slices.iter().filter_map(|k| slots[*k].take()).collect();
    parts.iter().map(|p| Pass { slices: take(p), words: p.words.join(", ") }).collect()
}

/// Groups `slices` by a key, in the order in which keys appear.
fn grouped<K: PartialEq>(slices: &[usize], key: impl Fn(usize) -> K) -> Vec<(K, Vec<usize>)> {
    let mut out: Vec<(K, Vec<usize>)> = Vec::new();
    for &s in slices {
        let key = key(s);
        // A key mostly repeats that of the last group.
        match out.iter().rposition(|g| g.0 == key) {
            Some(at) => out[at].1.push(s),
            None => out.push((key, vec![s])),
        }
        if out.len() > MOST_PASSES {
            break;
        }
    }
    out
}

/// Splits by position of the patient and frame of reference. A slice without them matches any.
fn apart(slices: &[Slice], whole: &Part) -> Vec<Part> {
    let code = |s: usize| slices[s].patient_position.as_ref().map(|p| p.trim().to_ascii_uppercase());
    let frame = |s: usize| slices[s].origin.frame_of_reference;
    let codes = grouped(&whole.slices, code);
    // Some writers give each slice its own frame.
    let frames = grouped(&whole.slices, frame);
    let few = |groups: usize| groups > 2 && groups * LEAST_SLICES > whole.slices.len();
    let own = frames.len() > MOST_PASSES || few(frames.len()) || frames.iter().all(|f| f.1.len() == 1);
    let only_code = codes.iter().filter(|c| c.0.is_some()).count() < 2 || codes.len() > MOST_PASSES || few(codes.len());
    let only_frame = frames.iter().filter(|f| f.0.is_some()).count() < 2 || own;
    let key = |s: usize| ((!only_code).then(|| code(s)), (!only_frame).then(|| frame(s)));
    let groups = grouped(&whole.slices, key);
    if groups.len() < 2 || groups.len() > MOST_PASSES {
        return vec![whole.clone()];
    }
    let lying = |code: &Option<Option<String>>| code.clone().flatten().as_deref().and_then(PatientPosition::of_header);
    let parts = groups.iter().map(|((code, frame), own)| {
        let alike = groups.iter().filter(|g| lying(&g.0.0) == lying(code));
        // The list tells supine from prone, but not how the patient enters.
        let codes = alike.clone().any(|g| g.0.0 != *code);
        let frames = alike.clone().any(|g| g.0.1 != *frame);
        let number = groups.iter().position(|g| g.0.1 == *frame).unwrap_or(0) + 1;
        let code = code.clone().flatten().unwrap_or_else(|| "no position".to_owned());
        let code: String = code.chars().filter(char::is_ascii_alphanumeric).take(16).collect();
        let words = [codes.then_some(code), frames.then(|| format!("frame of reference {number}"))];
        whole.with(own.clone(), words.into_iter().flatten().collect::<Vec<_>>().join(", "))
    });
    parts.collect()
}

/// Splits by size, orientation and spacing, unless a slice is alone with them.
fn alike(slices: &[Slice], part: &Part) -> Vec<Part> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let (sound, faulty): (Vec<usize>, Vec<usize>) = part.slices.iter().partition(|s| slices[**s].fault.is_none());
    for s in sound {
        match groups.iter().rposition(|g| stack::difference(&slices[g[0]], &slices[s]).is_none()) {
            Some(at) => groups[at].push(s),
            None => groups.push(vec![s]),
        }
        if groups.len() > MOST_PASSES {
            return vec![part.clone()];
        }
    }
    if groups.len() < 2 || groups.iter().any(|g| g.len() < 2) {
        return vec![part.clone()];
    }
    let first: Vec<usize> = groups.iter().map(|g| g[0]).collect();
    groups[0].extend(faulty);
    groups[0].sort_unstable();
    let size = |s: usize| (slices[s].file.cols, slices[s].file.rows);
    let words = |s: usize| match first.iter().all(|f| size(*f) == size(s)) {
        true => String::new(),
        false => format!("{}×{}", size(s).0, size(s).1),
    };
    groups.into_iter().zip(&first).map(|(own, s)| part.with(own, words(*s))).collect()
}

/// A way to split a part.
struct Cut {
    groups: Vec<Vec<usize>>,
    words: Vec<String>,
    /// Irregular steps that remain, and boundaries.
    cost: usize,
}

/// Splits by attributes for as long as one of them separates passes.
fn by_marks(slices: &[Slice], part: Part, depth: usize, out: &mut Vec<Part>) {
    let best =
        (depth > 0).then(|| Lines::of(slices, &part.slices)).flatten().and_then(|lines| best(slices, &part, &lines));
    match best {
        None => out.push(part),
        Some(cut) => {
            for (own, words) in cut.groups.into_iter().zip(cut.words) {
                by_marks(slices, part.with(own, words), depth - 1, out);
            }
        }
    }
}

/// Positions of slices along their normal.
struct Lines {
    /// Position of each slice of the series, mm; NaN for one that has none or that is damaged.
    along: Vec<f64>,
    /// Position beside the normal.
    beside: Vec<DVec3>,
}

impl Lines {
    /// Returns `None` if the positions of `own` are not known.
    fn of(slices: &[Slice], own: &[usize]) -> Option<Self> {
        let sound = || own.iter().filter(|s| slices[**s].fault.is_none());
        let [x, y] = slices[*sound().next()?].axes?;
        let normal = x.cross(y);
        let (mut along, mut beside) = (vec![f64::NAN; slices.len()], vec![DVec3::ZERO; slices.len()]);
        for &s in sound() {
            let place = slices[s].position?;
            along[s] = place.dot(normal);
            beside[s] = place - along[s] * normal;
        }
        Some(Self { along, beside })
    }

    /// Returns the positions of `own`, ascending.
    fn sorted(&self, own: &[usize]) -> Vec<f64> {
        let mut along: Vec<f64> = own.iter().map(|s| self.along[*s]).filter(|t| t.is_finite()).collect();
        along.sort_by(f64::total_cmp);
        along
    }
}

/// Returns the best way to split a part; `None` if it lies as one pass does, or if no attribute separates it.
fn best(slices: &[Slice], part: &Part, lines: &Lines) -> Option<Cut> {
    let own = &part.slices;
    let whole = lines.sorted(own);
    let faults = even::faults(&whole);
    // Other modalities acquire slices in turn.
    if faults == 0 && slices[own[0]].modality != "CT" {
        return None;
    }
    let mut best: Option<Cut> = None;
    let offer = |best: &mut Option<Cut>, groups: Vec<Vec<usize>>, words: &dyn Fn(&[Vec<usize>]) -> Vec<String>| {
        if let Some(cost) = cost(&groups, lines, faults)
            && best.as_ref().is_none_or(|b| cost < b.cost)
        {
            *best = Some(Cut { words: words(&groups), groups, cost });
        }
    };
    let marks = |s: usize| &*slices[s].marks;
    for k in 0..marks::COUNT {
        let mut groups = bare(grouped(own, |s| marks(s).key(k)));
        groups.sort_by(|a, b| {
            let ((x, p), (y, q)) = (marks(a[0]).rank(k), marks(b[0]).rank(k));
            x.total_cmp(&y).then_with(|| p.cmp(q))
        });
        offer(&mut best, groups, &|groups| marks::words(k, &of(groups, slices)));
    }
    let apart = |s: usize| (10.0 * lines.beside[s]).round().to_array().map(|v| v as i64);
    offer(&mut best, bare(grouped(own, apart)), &|groups| {
        let corner = |g: &Vec<usize>| lines.beside[g[0]];
        let name = |p: DVec3| format!("first voxel at {:.0}, {:.0}, {:.0} mm", p.x, p.y, p.z);
        groups.iter().map(|g| name(corner(g))).collect()
    });
    if best.is_none() {
        offer(&mut best, bare(grouped(own, |s| marks(s).all())), &numbered);
    }
    if best.is_none() {
        type Key = fn(&Marks) -> Option<f64>;
        let orders: [Key; 3] = [|m| m.times[0], |m| m.instance, |m| m.times[1]];
        // Images are made in any order.
        let count = if faults == 0 { 2 } else { 3 };
        for (order, falling) in orders[..count].iter().flat_map(|o| [(o, false), (o, true)]) {
            let Some(groups) = runs(own, lines, |s| order(marks(s)), falling) else { continue };
            offer(&mut best, groups, &numbered);
        }
    }
    best
}

fn bare<K>(groups: Vec<(K, Vec<usize>)>) -> Vec<Vec<usize>> {
    groups.into_iter().map(|g| g.1).collect()
}

fn of<'a>(groups: &[Vec<usize>], slices: &'a [Slice]) -> Vec<&'a Marks> {
    groups.iter().map(|g| &*slices[g[0]].marks).collect()
}

fn numbered(groups: &[Vec<usize>]) -> Vec<String> {
    (1..=groups.len()).map(|n| format!("pass {n}")).collect()
}

/// Follows slices in the order of a time or a number, and begins a new group wherever their positions turn back. Slices of the
/// same time are taken from the lowest position upwards, or downwards if `falling`. A copy stays with its original.
fn runs(own: &[usize], lines: &Lines, key: impl Fn(usize) -> Option<f64>, falling: bool) -> Option<Vec<Vec<usize>>> {
    let mut order: Vec<(f64, f64, usize)> = Vec::with_capacity(own.len());
    for &s in own {
        let t = lines.along[s];
        order.push((key(s)?, if falling { -t } else { t }, s));
    }
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.total_cmp(&b.1)));
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let mut copies: Vec<(usize, usize)> = Vec::new();
    let mut before: Option<(f64, f64)> = None;
    for (key, t, s) in order {
        if before.is_some_and(|b| b.0 == key && (b.1 - t).abs() < even::SAME_PLACE) {
            copies.push((groups.len() - 1, s));
            continue;
        }
        before = Some((key, t));
        let full = groups.len() >= MOST_PASSES;
        match groups.last_mut() {
            Some(group) if continues(group, s, lines) => group.push(s),
            _ if full => return None,
            _ => groups.push(vec![s]),
        }
    }
    copies.into_iter().for_each(|(group, s)| groups[group].push(s));
    groups.iter_mut().for_each(|g| g.sort_unstable());
    Some(groups)
}

fn continues(group: &[usize], s: usize, lines: &Lines) -> bool {
    let at = |n: usize| lines.along[group[group.len() - n]];
    let step = lines.along[s] - at(1);
    step != 0.0 && (group.len() < 2 || step * (at(1) - at(2)) > 0.0)
}

/// Returns the median step within passes, whose positions are ascending.
fn median_step(passes: &[Vec<f64>]) -> f64 {
    let mut steps: Vec<f64> = passes.iter().flat_map(|p| p.windows(2).map(|w| w[1] - w[0])).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(0.0)
}

/// Returns what a split leaves irregular; `None` if it does not separate passes. `faults` are those of the whole.
fn cost(groups: &[Vec<usize>], lines: &Lines, faults: usize) -> Option<usize> {
    let count = groups.len();
    let total: usize = groups.iter().map(Vec::len).sum();
    if !(2..=MOST_PASSES).contains(&count) || count > 2 && count * LEAST_SLICES > total {
        return None;
    }
    let sorted: Vec<Vec<f64>> = groups.iter().map(|g| lines.sorted(g)).collect();
    if sorted.iter().any(Vec::is_empty) {
        return None;
    }
    let mut ranges: Vec<[f64; 2]> = sorted.iter().map(|t| [t[0], t[t.len() - 1]]).collect();
    ranges.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut reach = f64::NEG_INFINITY;
    let overlap = ranges.iter().any(|[low, high]| {
        let within = *low < reach + even::SAME_PLACE;
        reach = reach.max(*high);
        within
    });
    // Where slices are missing, or a table has stepped on, attributes change, too.
    let usual = median_step(&sorted);
    if !overlap && ranges.windows(2).any(|w| w[1][0] - w[0][1] < LEAST_GAP * usual) {
        return None;
    }
    let left: usize = sorted.iter().map(|t| even::faults(t)).sum();
    let cost = left + count - 1;
    let separates = match overlap {
        // Passes that alternate evenly lie as one does. Each of them must then be even.
        true if faults == 0 => left == 0 && sorted.iter().all(|t| t.len() >= LEAST_SLICES),
        _ => cost <= faults,
    };
    separates.then_some(cost)
}
