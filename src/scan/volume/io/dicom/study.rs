//! Groups the slices of a folder into series, lists them and chooses one.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;
use serde_json::{Value, json};

use super::origin::Kind;
use super::passes::{self, Pass};
use super::slice::Slice;
use super::units::Units;
use crate::error::{Error, Result};
use crate::volume::PatientPosition;
use crate::volume::io::Modality;
use crate::volume::io::study::{self, Series, table};

/// Least component of a unit normal along an axis of the patient, for slices across that axis. A gantry tilts by up to 30°.
const ALONG: f64 = 0.85;

/// The series of a folder, in the order of the list.
pub(crate) struct Groups {
    /// The slices of each series; a series without an image has one that stands for each of its files.
    pub slices: Vec<Vec<Slice>>,
    /// Their list.
    pub list: Vec<Series>,
}

impl Groups {
    /// Groups slices by series, in the stable order that `--series` counts: by number, then UID. Localizers, captures, other
    /// patients and the passes under one UID are kept apart; series without an image come last.
    pub(crate) fn of(slices: impl Iterator<Item = Slice>) -> Self {
        let mut map: BTreeMap<(bool, i64, String, Kind, u64), Vec<Slice>> = BTreeMap::new();
        for s in slices {
            let kind = s.origin.kind;
            let number = s.series_number.unwrap_or(i64::MAX);
            let patient = if s.origin.has_identity { s.origin.patient } else { 0 };
            let key = (kind == Kind::NoImage, number, s.series.clone(), kind, patient);
            map.entry(key).or_default().push(s);
        }
        let passes: Vec<Pass> = map.into_values().flat_map(passes::split).collect();
        let (mut patients, mut studies) = (Vec::new(), Vec::new());
        let mut list: Vec<Series> = Vec::with_capacity(passes.len());
        for Pass { slices: group, words } in &passes {
            let origin = &group[0].origin;
            let patient = number_of(&mut patients, origin.patient);
            let study = number_of(&mut studies, (origin.patient, origin.study));
            let mut series = Series { number: list.len() + 1, patient, study, ..describe(group) };
            if !words.is_empty() && series.description != *words {
                let between = if series.description.is_empty() { "" } else { ", " };
                series.description = format!("{}{between}{words}", series.description);
            }
            list.push(series);
        }
        let slices: Vec<Vec<Slice>> = passes.into_iter().map(|p| p.slices).collect();
        let frame = |g: &Vec<Slice>| g.iter().find_map(|s| s.origin.frame_of_reference);
        let frames: Vec<Option<u64>> = slices.iter().map(frame).collect();
        study::pair(&mut list, &frames);
        Self { slices, list }
    }

    /// Returns the number of series with images.
    pub(crate) fn images(&self) -> usize {
        self.list.iter().filter(|s| s.slices > 0).count()
    }

    /// Chooses the series `asked` for, or the only one, or the usual one. Adds a note if there were others. Fails with status 3
    /// and the list as choices if there is no such series, or if `--series` must choose.
    pub(crate) fn choose(
        &self,
        input: &Path,
        asked: Option<usize>,
        wanted: Modality,
        notes: &mut Vec<String>,
    ) -> Result<usize> {
        let all = self.list.len();
        let refuse = |why: String, hint: &str| Error { choices: table(&self.list), ..Error::file(input, why, hint) };
        if let Some(n) = asked {
            let chosen = n.checked_sub(1).filter(|k| *k < all);
            return chosen
                .ok_or_else(|| refuse(format!("has no series {n}, only {all}"), "choose one with --series N"));
        }
        if let Some(k) = study::usual(&self.list) {
            if all > 1 {
                let s = &self.list[k];
                let position = s.position().map_or_else(String::new, |p| format!(", {p}"));
                let n = s.number;
                notes.push(format!(
                    "series {n} of {all} was taken, the CT series with the most slices ({}{position})",
                    s.slices
                ));
            }
            return Ok(k);
        }
        // A scan of another modality may lie beside its reports.
        let mut images = (0..all).filter(|k| self.list[*k].slices > 0);
        if let (Some(only), None) = (images.next(), images.next()) {
            return Ok(only);
        }
        let counting = self.list.iter().filter(|s| s.counts).count();
        Err(match (counting, wanted) {
            (0, Modality::Ct) => {
                refuse(format!("holds {all} series, none of them a CT volume"), "give a folder with a CT series")
            }
            (0, Modality::Any) => refuse(format!("holds {all} series"), "choose one with --series N"),
            _ => {
                let why = format!("holds {all} series, {counting} of them CT, and none has far more slices");
                refuse(why, "choose one with --series N")
            }
        })
    }

    /// Refuses a series that is not a CT volume, where another could be meant. Fails with status 3 and the reason.
    pub(crate) fn check(&self, input: &Path, chosen: usize, wanted: Modality) -> Result<()> {
        let s = &self.list[chosen];
        let faulty = self.slices[chosen].iter().any(|s| s.fault.is_some());
        match &s.why {
            // The fault of a file says more.
            Some(why) if wanted == Modality::Ct && self.list.len() > 1 && !s.counts && !faulty => {
                let why = format!("its series {} cannot be opened ({why})", s.number);
                Err(Error {
                    choices: table(&self.list),
                    ..Error::file(input, why, "choose a CT volume with --series N")
                })
            }
            _ => Ok(()),
        }
    }
}

/// Returns the entry of `info` for a series. `chosen` is true if the rest of `info` describes it.
pub(crate) fn entry(s: &Series, chosen: bool) -> Value {
    json!({
        "series": s.number,
        "number": s.series_number,
        "modality": s.modality,
        "slices": s.slices,
        "columns": s.size[0],
        "rows": s.size[1],
        "spacing_mm": s.spacing_mm,
        "position": s.position(),
        "description": s.description,
        "patient": s.patient,
        "study": s.study,
        "plane": s.plane,
        "usable": s.why.is_none(),
        "why": s.why,
        "pair": s.pair,
        "chosen": chosen,
    })
}

/// Returns the number from 1 that stands for `key`: that of its first appearance.
fn number_of<T: PartialEq>(known: &mut Vec<T>, key: T) -> usize {
    let at = known.iter().position(|k| *k == key).unwrap_or_else(|| {
        known.push(key);
        known.len() - 1
    });
    at + 1
}

/// Describes a series by its slices.
fn describe(group: &[Slice]) -> Series {
    let s = &group[0];
    let sound = group.iter().find(|s| s.fault.is_none()).unwrap_or(s);
    let kind = s.origin.kind;
    let faults = group.iter().filter(|s| s.fault.is_some()).count();
    let other = match &s.units {
        Units::Other(what) => Some(what),
        _ => None,
    };
    let counts = s.modality == "CT" && kind == Kind::Slices && faults < group.len() && other.is_none();
    let why = match kind {
        Kind::NoImage => Some("no image".to_owned()),
        Kind::Localizer => Some("a localizer".to_owned()),
        Kind::Capture => Some("a secondary capture".to_owned()),
        Kind::Slices if s.modality != "CT" => Some("not CT".to_owned()),
        Kind::Slices if other.is_some() => other.cloned(),
        Kind::Slices if faults == group.len() => s.fault.as_ref().map(|f| f.why.clone()),
        Kind::Slices if faults > 0 => Some(format!("{faults} of its slices are damaged")),
        Kind::Slices => None,
    };
    Series {
        series_number: s.series_number,
        modality: word(&s.modality),
        slices: if kind == Kind::NoImage { 0 } else { group.len() },
        size: [sound.file.cols, sound.file.rows],
        spacing_mm: spacing(group),
        patient_position: patient_position(group),
        description: s.origin.description.clone(),
        plane: plane(group),
        counts,
        // The semicolon separates the parts of a message.
        why: why.map(|why| why.replace(';', ",").replace(char::is_control, " ")),
        ..Series::default()
    }
}

/// Shortens a modality, which is one word of at most 16 letters, to what a list can show.
fn word(modality: &str) -> String {
    let plain = |c: char| if c.is_control() || c.is_whitespace() || c == ';' { '_' } else { c };
    modality.chars().take(16).map(plain).collect()
}

fn normal(slice: &Slice) -> Option<DVec3> {
    slice.axes.map(|[x, y]| x.cross(y))
}

/// Returns the code of the patient's position that the slices give: the first that says which side is down, else the first.
pub(crate) fn patient_position(group: &[Slice]) -> Option<String> {
    let mut codes = group.iter().filter_map(|s| s.patient_position.as_ref());
    let known = codes.clone().find(|code| PatientPosition::of_header(code).is_some());
    known.or_else(|| codes.next()).cloned()
}

/// Returns the plane of slices that agree.
fn plane(group: &[Slice]) -> Option<&'static str> {
    let name = |n: DVec3| {
        let [x, y, z] = n.abs().to_array();
        [("sagittal", x), ("coronal", y), ("axial", z)].into_iter().find(|p| p.1 >= ALONG).map_or("oblique", |p| p.0)
    };
    let mut sound = group.iter().filter(|s| s.fault.is_none()).map(|s| normal(s).map(name));
    let first = sound.next()??;
    sound.all(|plane| plane == Some(first)).then_some(first)
}

/// Returns the distance between columns and rows, and the usual one between slices, mm.
fn spacing(group: &[Slice]) -> Option<[f64; 3]> {
    let first = group.iter().find(|s| s.fault.is_none())?;
    let [x, y] = first.spacing?;
    // Localizers in several planes have no distance between them.
    let mut along = plane(group).and_then(|_| positions(group)).unwrap_or_default();
    along.sort_by(f64::total_cmp);
    let mut apart: Vec<f64> = along.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 1e-3).collect();
    apart.sort_by(f64::total_cmp);
    let usual = apart.get(apart.len().saturating_sub(1) / 2).copied();
    usual.or(first.depth).filter(|z| z.is_finite()).map(|z| [x, y, (1e4 * z).round() / 1e4])
}

/// Returns the positions of slices along the normal of the first, mm.
fn positions(group: &[Slice]) -> Option<Vec<f64>> {
    let mut sound = group.iter().filter(|s| s.fault.is_none()).peekable();
    let normal = normal(sound.peek()?)?;
    sound.map(|s| s.position.map(|p| p.dot(normal))).collect()
}

/// Returns the middle slice of a series, of those that can be read.
pub(crate) fn middle(group: &[Slice]) -> Option<&Slice> {
    let mut sound: Vec<&Slice> = group.iter().filter(|s| s.fault.is_none()).collect();
    if let Some(normal) = sound.first().and_then(|s| normal(s)) {
        let along = |s: &Slice| s.position.map_or(0.0, |p| p.dot(normal));
        sound.sort_by(|a, b| along(a).total_cmp(&along(b)).then_with(|| a.file.path.cmp(&b.file.path)));
    }
    sound.get(sound.len() / 2).copied()
}
