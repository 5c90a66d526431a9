//! The kinds given to the bodies of gas, against the truth of phantoms with all kinds of gas, and how often each rule decides.

use glam::DVec3;

use crate::error::Result;
use crate::fields::lumen::{self, Considered, GasKind, Lumen, RULES};
use crate::phantom::{BodyKind, Phantom, PhantomSettings, Position, Size, TrueBody};
use crate::progress::Progress;
use crate::report::page::Page;
use crate::report::table::{Cell, Table, row, table};
use crate::volume::{PatientPosition, Volume};

/// Distance from the valve up to which ileum may be classified as colon, mm.
const VALVE_MM: f64 = 20.0;
/// Labels of the colon and of the small bowel in a phantom's labels.
const COLON: u8 = 1;
const SMALL_BOWEL: u8 = 2;

/// The classification of the gas of one phantom, compared with the truth.
#[derive(Clone, Debug)]
pub(super) struct Judgement {
    title: String,
    /// Overlap of the lumen with the colon, gas and fluid (Dice): twice the common volume over the sum of both.
    dice: f64,
    ordered: bool,
    /// Ileum farther than 20 mm from the valve that was classified as colon, ml.
    ileum_ml: f64,
    /// Kinds of the true bodies, and the kinds that they were given.
    bodies: Vec<(BodyKind, GasKind)>,
    position: bool,
    /// Largest error of a junction between two named parts, mm.
    worst_mm: Option<f64>,
    rules: Decisions,
}

/// For each rule, the bodies for which it holds, and those whose kind, or place in the lumen, depends on it.
#[derive(Clone, Debug)]
pub(super) struct Decisions {
    bodies: usize,
    holds: Vec<usize>,
    decides: Vec<usize>,
}

impl Decisions {
    /// Counts the rules in a lumen.
    pub(super) fn of(lumen: &Lumen) -> Self {
        let count = |which: &dyn Fn(usize, &Considered) -> bool| {
            (0..RULES.len()).map(|n| lumen.considered.iter().filter(|c| which(n, c)).count()).collect()
        };
        Self {
            bodies: lumen.considered.len(),
            holds: count(&|n, c| (RULES[n].holds)(&c.features, c.chain)),
            decides: count(&|n, c| {
                let without = lumen::judge(&c.features, c.chain, Some(n));
                let with = lumen::judge(&c.features, c.chain, None);
                (without.kind, without.is_lumen) != (with.kind, with.is_lumen)
            }),
        }
    }
}

/// Classifies the gas of phantoms with every kind of gas, in all four positions.
pub(super) fn phantoms(size: Size, name: &str, seeds: u64, progress: &Progress) -> Result<Vec<Judgement>> {
    const POSITIONS: [(Position, PatientPosition, &str); 4] = [
        (Position::Supine, PatientPosition::Supine, "supine"),
        (Position::Prone, PatientPosition::Prone, "prone"),
        (Position::Left, PatientPosition::Left, "left"),
        (Position::Right, PatientPosition::Right, "right"),
    ];
    let mut all = Vec::new();
    for seed in 1..=seeds {
        let (position, expected, word) = POSITIONS[(seed as usize - 1) % POSITIONS.len()];
        let phantom = Phantom::new(&PhantomSettings::with_all_gas(size, seed, position));
        let volume = phantom.voxelise(&phantom.grid(), progress)?;
        all.push(judged(format!("{name}, seed {seed}, {word}"), &phantom, &volume, expected, progress)?);
    }
    Ok(all)
}

fn judged(
    title: String,
    phantom: &Phantom,
    volume: &Volume,
    position: PatientPosition,
    progress: &Progress,
) -> Result<Judgement> {
    let (grid, truth) = (volume.grid(), phantom.truth());
    let lumen = lumen::find(volume, progress)?;
    let map = lumen::not_colon(volume, &lumen, progress)?.map(&lumen, &[])?;
    let (mask, labels) = (lumen.mask(), phantom.labels(grid, progress)?);
    let [nx, ny, _] = grid.dims();
    let valve = truth.valve.as_ref().map(|v| v.position);
    let (mut both, mut sum, mut ileum) = (0u64, 0u64, 0u64);
    for (n, (&found, &label)) in mask.iter().zip(&labels).enumerate() {
        let (found, is_colon) = (found != 0, label == COLON);
        both += u64::from(found && is_colon);
        sum += u64::from(found) + u64::from(is_colon);
        if found && label == SMALL_BOWEL {
            let p = grid.world(DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64));
            ileum += u64::from(valve.is_none_or(|v| v.distance(p) > VALVE_MM));
        }
    }
    let kind = |b: &TrueBody| map.body_at(b.position).map_or(GasKind::Unknown, |n| map.bodies()[n].kind);
    let found = lumen.names().on(&truth.centerline);
    let errors = found.iter().zip(&truth.names).take(7).map(|(a, b)| (a.to_mm - b.to_mm).abs());
    Ok(Judgement {
        title,
        dice: 2.0 * both as f64 / (sum as f64).max(1.0),
        ordered: lumen.ordered,
        ileum_ml: ileum as f64 * grid.voxel_ml(),
        bodies: truth.bodies.iter().map(|b| (b.kind, kind(b))).collect(),
        position: lumen.lying.is_some_and(|l| l.position == position),
        worst_mm: (found.len() == truth.names.len()).then(|| errors.fold(0.0, f64::max)),
        rules: Decisions::of(&lumen),
    })
}

fn is_right(truth: BodyKind, found: GasKind) -> bool {
    matches!(
        (truth, found),
        (BodyKind::Colon, GasKind::Colon)
            | (BodyKind::SmallBowel, GasKind::SmallBowel)
            | (BodyKind::Stomach, GasKind::Stomach)
            | (BodyKind::Lung, GasKind::Lung)
    )
}

/// Writes the section; `scan` is what the rules decide in a scan, with its title. Returns the findings. Fails with status 5 if a
/// file cannot be written.
pub(super) fn write(page: &mut Page, all: &[Judgement], scan: Option<&(String, Decisions)>) -> Result<Vec<String>> {
    page.section("Kinds of gas");
    page.text(
        "Phantoms with small bowel, a stomach, lungs, collapsed stretches, a pelvis and pools. Each true body of gas is \
         compared with the kind found for it; \"unknown\" is neither right nor wrong.",
    );
    let is_unknown = |b: &&(BodyKind, GasKind)| b.1 == GasKind::Unknown;
    let kinds = table!(for j in all;
        let right = j.bodies.iter().filter(|b| is_right(b.0, b.1)).count();
        let unknown = j.bodies.iter().filter(is_unknown).count();
        "phantom" => &j.title,
        "Dice of the colon" => (j.dice, 4),
        "in order" => j.ordered,
        "ileum beyond 20 mm / ml" => (j.ileum_ml, 2),
        "bodies right" => right,
        "unknown" => unknown,
        "wrong" => j.bodies.len() - right - unknown,
        "position right" => j.position,
        "worst junction / mm" => (j.worst_mm, 1),
    );
    page.table("kinds", &kinds)?;
    let mut pairs: Vec<(BodyKind, GasKind)> = all.iter().flat_map(|j| &j.bodies).copied().collect();
    pairs.sort_by_key(|p| (p.0 as usize, p.1));
    let confusion = table!(for pair in pairs.chunk_by(|a, b| a == b);
        "truth" => format!("{:?}", pair[0].0),
        "classified as" => pair[0].1.name(),
        "bodies" => pair.len(),
    );
    page.table("confusion", &confusion)?;
    page.text("The rules, with the bodies for which each holds, and those whose kind or place in the lumen depends on it alone.");
    let mut head = vec!["kind", "weight", "reason", "holds, phantoms", "decides, phantoms"];
    if let Some((title, _)) = scan {
        head.extend([title.as_str(), "decides in it"]);
    }
    let mut t = Table::new(&head);
    for (n, r) in RULES.iter().enumerate() {
        let sum = |of: fn(&Decisions) -> &Vec<usize>| all.iter().map(|j| of(&j.rules)[n]).sum::<usize>();
        let (holds, decides) = (sum(|d| &d.holds), sum(|d| &d.decides));
        let mut row = row![r.kind.name(), (r.weight, 1), r.why, holds, decides];
        row.extend(scan.iter().flat_map(|(_, d)| [d.holds[n], d.decides[n]]).map(Cell::from));
        t.row(row);
    }
    page.table("rules", &t)?;
    let worst = all.iter().map(|j| j.dice).fold(1.0, f64::min);
    let wrong = all.iter().flat_map(|j| &j.bodies).filter(|b| !is_right(b.0, b.1) && b.1 != GasKind::Unknown).count();
    let bodies: usize = all.iter().map(|j| j.bodies.len()).sum();
    let judged: usize = all.iter().map(|j| j.rules.bodies).sum();
    Ok(vec![format!(
        "In {} phantoms, the gas classified as colon has a Dice coefficient of at least {worst:.3}; {wrong} of {bodies} bodies of gas \
         have a wrong kind ({judged} were weighed by rules).",
        all.len()
    )])
}
