//! `report unfold`: how well the colon laid flat shows the wall, beside a map of plain rays across the centerline.

mod shown;

use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::Effort;
use super::page::Page;
use super::table::{Table, row};
use crate::coverage::Wall;
use crate::error::{Error, Result};
use crate::fields::centerline::Centerline;
use crate::fields::cleanse;
use crate::fields::frames::{evenly, frames};
use crate::fields::lumen::{self, Interior};
use crate::phantom::{Phantom, PhantomSettings, Size};
use crate::progress::Progress;
use crate::space::{PreparedVolume, TransferFunction, first_crossing};
use crate::unfold::{Chart, Measures, Sheet, Unfolding};
use crate::volume::{Grid, Volume};
use shown::{Face, Map, Shares, places, shares};

/// A plain ray ends here, mm.
const FAR_MM: f64 = 80.0;
/// Fewer pixels than this of a polyp are a corner of it.
const SHOWN: usize = 12;
/// A pixel shows a polyp if its point is within this of its ball, mm.
const ON_MM: f64 = 0.5;
/// The bent tubes: distance of the middle from the centre of the bend, and radius, mm.
const TUBES: [[f64; 2]; 2] = [[40.0, 12.0], [24.0, 16.0]];
/// Values inside and outside a tube, HU.
const TUBE_HU: [i16; 2] = [-1000, 50];

/// A wall that is laid flat in two ways.
struct Subject {
    title: String,
    volume: PreparedVolume,
    line: Centerline,
    faces: Vec<Face>,
    /// Places and diameters, mm.
    polyps: Vec<(DVec3, f64)>,
}

/// What a map shows.
struct Row {
    title: String,
    method: &'static str,
    seconds: f64,
    shares: Shares,
    measures: Option<Measures>,
    /// How often each polyp is shown, and its diameter on the map less the true one, mm.
    polyps: Vec<(usize, Option<f64>)>,
}

/// Measures on bent tubes, phantoms and a scan with its title, and writes the report into `folder`. Returns the findings, one sentence
/// each.
///
/// # Errors
/// Returns status 4 if interrupted or if a scan contains no colon with a line through it, 5 if a file cannot be written.
pub fn report(
    effort: Effort,
    seed: u64,
    scan: Option<(String, Volume)>,
    folder: &Path,
    progress: &Progress,
) -> Result<Vec<String>> {
    let mut rows = Vec::new();
    for [bend, radius] in TUBES {
        let (volume, line, faces) = tube(bend, radius)?;
        let chart = |progress: &Progress| Chart::of_interior(&Interior::of_mask(&mask(&volume))?, &line, progress);
        let title = format!("tube of {radius:.0} mm, bent at {bend:.0} mm");
        let prepared = PreparedVolume::new(Arc::new(volume.clone()), TransferFunction::default());
        let subject = Subject { title, volume: prepared, line: line.clone(), faces, polyps: Vec::new() };
        rows.extend(both(&subject, chart, progress)?);
    }
    let (size, name) = effort.choose((Size::Small, "small"), (Size::Standard, "standard"));
    for seed in seed..seed.saturating_add(effort.choose(1, 10)) {
        let phantom = Phantom::new(&PhantomSettings { size, seed, ..PhantomSettings::default() });
        let volume = phantom.voxelise(&phantom.grid(), progress)?;
        let polyps = phantom.truth().polyps.iter().map(|p| (p.position, p.diameter_mm)).collect();
        rows.extend(colon(format!("phantom, {name}, seed {seed}"), volume, polyps, progress)?);
    }
    if let Some((title, volume)) = scan {
        rows.extend(colon(title, volume, Vec::new(), progress)?);
    }
    page(&rows, folder)
}

/// Measures a colon, cleansed.
fn colon(title: String, mut volume: Volume, polyps: Vec<(DVec3, f64)>, progress: &Progress) -> Result<Vec<Row>> {
    let found = lumen::find(&volume, progress)?;
    if found.segments.is_empty() {
        return Err(Error::incomplete(title, "no gas of a colon was found in it", "give a scan of a colon"));
    }
    let along = found.along(&volume, progress)?;
    let mut cleansed = cleanse::cleanse(&volume, &found, progress)?;
    let mut lumen = found;
    if !cleansed.changes.is_empty() {
        cleansed.changes.exchange(&mut volume);
        let mut without = lumen::find(&volume, progress)?;
        cleanse::keep_ends(&mut without, &lumen);
        without.keep_along(&lumen);
        lumen = without;
    }
    let Some(line) = along.line().cloned() else {
        let why = "no one line leads from the rectum to the cecum";
        return Err(Error::incomplete(title, why, "give a scan whose colon is better filled"));
    };
    let transfer = TransferFunction::default();
    let iso = transfer.iso();
    let all: Vec<usize> = (0..lumen.segments.len()).collect();
    let wall = Wall::of(&volume, &lumen, &all, iso, progress)?;
    let face = |n: usize| Face { at: wall.centroid(n), normal: wall.normal(n), mm2: wall.mm2_at(n) };
    let faces = (0..wall.len()).into_par_iter().map(face).collect();
    drop(wall);
    let volume = PreparedVolume::new(Arc::new(volume), transfer);
    let subject = Subject { title, volume, line: line.clone(), faces, polyps };
    let voxels = subject.volume.shared_voxels();
    both(&subject, |progress| Chart::new(&voxels, &lumen, &line, iso, progress), progress)
}

/// Lays a wall flat in both ways.
fn both(subject: &Subject, chart: impl FnOnce(&Progress) -> Result<Chart>, progress: &Progress) -> Result<Vec<Row>> {
    progress.stage(&format!("unfolding {}", subject.title), 0);
    let begun = Instant::now();
    let (volume, iso) = (subject.volume.voxels(), subject.volume.transfer().iso());
    let map = Unfolding::new(chart(progress)?, volume, iso, &Sheet::default(), progress)?;
    let seconds = begun.elapsed().as_secs_f64();
    let measures = Measures::of(&map);
    let own = Map { columns: map.columns(), points: map.points().to_vec() };
    let begun = Instant::now();
    let step_mm = (map.mm(map.rows() - 1) - map.mm(0)) / (map.rows() - 1).max(1) as f64;
    drop(map);
    let plain = plain(subject, own.columns, step_mm);
    let plain_seconds = begun.elapsed().as_secs_f64();
    progress.stage(&format!("measuring {}", subject.title), 0);
    let row = |method, map: &Map, seconds, measures| Row {
        title: subject.title.clone(),
        method,
        seconds,
        shares: shares(&subject.faces, map),
        measures,
        polyps: subject.polyps.iter().map(|p| polyp(*p, map)).collect(),
    };
    let rows = vec![row("level sets", &own, seconds, Some(measures)), row("plain rays", &plain, plain_seconds, None)];
    progress.check()?;
    Ok(rows)
}

/// Returns the map of rays across the line: perpendicular to it, at equal angles, up to the first wall.
fn plain(subject: &Subject, columns: usize, step_mm: f64) -> Map {
    let (points, _) = evenly(&subject.line.points);
    let frames = frames(&points);
    let length = (frames.len().max(1) - 1) as f64 * crate::fields::frames::STEP_MM;
    let rows = (length / step_mm.max(0.05)) as usize + 1;
    let points = (0..rows * columns)
        .into_par_iter()
        .map(|n| {
            let at = (n / columns) as f64 * step_mm / crate::fields::frames::STEP_MM;
            let (low, high) = (at.floor() as usize, (at.ceil() as usize).min(frames.len() - 1));
            let frame = frames[low].to(&frames[high], at - at.floor());
            let direction = frame.direction(TAU * (n % columns) as f64 / columns as f64);
            let mm = first_crossing(&subject.volume, frame.at, direction, FAR_MM).filter(|mm| *mm > 0.0);
            mm.map_or([f32::NAN; 3], |mm| (frame.at + direction * mm).as_vec3().to_array())
        })
        .collect();
    Map { columns, points }
}

/// Returns how often a map shows a polyp, and the largest distance of two of its pixels in one of these places less the diameter, mm.
fn polyp((at, diameter_mm): (DVec3, f64), map: &Map) -> (usize, Option<f64>) {
    let point = |n: usize| glam::Vec3::from_array(map.points[n]).as_dvec3();
    let near: Vec<usize> =
        (0..map.points.len()).into_par_iter().filter(|n| point(*n).distance(at) < 0.5 * diameter_mm + ON_MM).collect();
    let places: Vec<Vec<usize>> = places(&near, map.columns).into_iter().filter(|p| p.len() >= SHOWN).collect();
    let size = |place: &Vec<usize>| {
        let some: Vec<DVec3> = place.iter().step_by(place.len().div_ceil(300)).map(|n| point(*n)).collect();
        let pairs = some.iter().enumerate().flat_map(|(n, a)| some[n..].iter().map(|b| a.distance(*b)));
        pairs.fold(0.0, f64::max)
    };
    let largest = places.iter().map(size).fold(None, |most: Option<f64>, mm| Some(most.map_or(mm, |m| m.max(mm))));
    (places.len(), largest.map(|mm| mm - diameter_mm))
}

/// Returns half a torus in a volume, its line, and faces of its wall in closed form. Its ends are left out.
fn tube(bend: f64, radius: f64) -> Result<(Volume, Centerline, Vec<Face>)> {
    let (spacing, room) = (0.8, 6.0);
    let side = 2.0 * (bend + radius + room);
    let dims = [side, bend + radius + 2.0 * room, 2.0 * (radius + room)].map(|mm| (mm / spacing).ceil() as usize);
    let grid = Grid::new(dims, DVec3::splat(spacing), DVec3::ZERO, DMat3::IDENTITY)?;
    let centre = DVec3::new(0.5 * side, room, radius + room);
    let at = |n: usize| {
        grid.world(DVec3::from_array([n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]].map(|c| c as f64)))
    };
    // Over one voxel, the value goes from inside to outside: the surface is where the distance is 0.
    let value = |p: DVec3| {
        let out = p - centre;
        let off = (out.truncate().length() - bend).hypot(out.z) - radius;
        let off = off.max(-out.y);
        let share = (off / spacing + 0.5).clamp(0.0, 1.0);
        (f64::from(TUBE_HU[0]) + f64::from(TUBE_HU[1] - TUBE_HU[0]) * share).round() as i16
    };
    let volume = Volume::new(grid.clone(), (0..grid.len()).into_par_iter().map(|n| value(at(n))).collect());
    let turn = |a: f64| DVec3::new(a.cos(), a.sin(), 0.0);
    let (first, last) = (0.1, PI - 0.1);
    let count = (bend * (last - first)).ceil() as usize;
    let points: Vec<DVec3> =
        (0..=count).map(|n| centre + turn(first + (last - first) * n as f64 / count as f64) * bend).collect();
    let length_mm = points.windows(2).map(|w| w[0].distance(w[1])).sum();
    let line = Centerline { radius_mm: vec![radius; points.len()], points, length_mm, guessed: Vec::new() };
    // dA = r (R + r cos v) dv du.
    let (us, vs) = (400, 200);
    let (from, to) = (first + 0.15, last - 0.15);
    let face = |n: usize| {
        let (u, v) =
            (from + (to - from) * ((n / vs) as f64 + 0.5) / us as f64, TAU * ((n % vs) as f64 + 0.5) / vs as f64);
        let inwards = -(turn(u) * v.cos() + DVec3::Z * v.sin());
        let mm2 = radius * (bend + radius * v.cos()) * (TAU / vs as f64) * ((to - from) / us as f64);
        Face { at: centre + turn(u) * bend - inwards * radius, normal: inwards, mm2 }
    };
    Ok((volume, line, (0..us * vs).map(face).collect()))
}

/// Returns the inside of a tube as a mask.
fn mask(volume: &Volume) -> Volume {
    let middle = f64::from(TUBE_HU[0]).midpoint(f64::from(TUBE_HU[1]));
    let data = volume.data().iter().map(|hu| i16::from(f64::from(*hu) < middle)).collect();
    Volume::new(volume.grid().clone(), data)
}

fn page(rows: &[Row], folder: &Path) -> Result<Vec<String>> {
    let mut page = Page::new(folder, "colvis: the colon laid flat")?;
    page.text(&format!(
        "Each wall is laid flat along level sets of a harmonic function, and by plain rays perpendicular to the centerline, with as many \
         columns and rows as far apart. A part of the wall is absent if no pixel's point lies within {} mm of it (in brackets: {} mm) on the \
         same side of any fold; it is shown twice if such pixels are in two places of the map. Both are found from the points alone. Bent \
         tubes have their wall in closed form; that of colons is the triangles of the lumen's surface.",
        shown::NEAR_MM, shown::WIDE_MM
    ));
    page.text(
        "A polyp is shown once if the pixels within 0.5 mm of its ball are in one place. Its size on the map is the largest distance \
         between two of their points. Published for a map of the same kind: −0.23 ± 1.67 mm on 110 scans (Yao and others, IEEE TBME, 2010).",
    );
    let findings = findings(rows);
    page.findings(&findings);
    let mut table = Table::new(&[
        "wall",
        "method",
        "absent / %",
        "absent within 2 mm / %",
        "twice / %",
        "s1/s2, 5 %",
        "50 %",
        "95 %",
        "pixel / mm², 5 %",
        "median",
        "at 95 %",
        "round trip, 99 % / mm",
        "polyps",
        "shown once",
        "size error / mm",
        "deviation / mm",
        "time / s",
    ]);
    for r in rows {
        let of = |f: fn(&Measures) -> f64| r.measures.as_ref().map(f);
        let errors: Vec<f64> = r.polyps.iter().filter_map(|p| p.1).collect();
        let [mean, deviation] = moments(&errors).map_or([None; 2], |m| m.map(Some));
        table.row(row![
            &r.title,
            r.method,
            (100.0 * r.shares.absent[0], 2),
            (100.0 * r.shares.absent[1], 2),
            (100.0 * r.shares.twice, 3),
            (of(|m| m.stretch[0]), 2),
            (of(|m| m.stretch[1]), 2),
            (of(|m| m.stretch[2]), 2),
            (of(|m| m.pixel_mm2[0]), 3),
            (of(|m| m.pixel_mm2[1]), 3),
            (of(|m| m.pixel_mm2[2]), 3),
            (of(|m| m.round_trip_mm[2]), 3),
            r.polyps.len(),
            r.polyps.iter().filter(|p| p.0 == 1).count(),
            (mean, 2),
            (deviation, 2),
            (r.seconds, 2),
        ]);
    }
    page.table("unfold", &table)?;
    page.finish()?;
    Ok(findings)
}

/// Returns mean and standard deviation; `None` without values.
fn moments(values: &[f64]) -> Option<[f64; 2]> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    (!values.is_empty()).then(|| [mean, square.sqrt()])
}

fn findings(rows: &[Row]) -> Vec<String> {
    let of = |method: &'static str| rows.iter().filter(move |r| r.method == method);
    let mut findings: Vec<String> = of("level sets")
        .zip(of("plain rays"))
        .map(|(own, plain)| {
            format!(
                "{}: {:.2} % of the wall is absent and {:.3} % shown twice; of plain rays {:.2} % and {:.2} %.",
                own.title,
                100.0 * own.shares.absent[0],
                100.0 * own.shares.twice,
                100.0 * plain.shares.absent[0],
                100.0 * plain.shares.twice
            )
        })
        .collect();
    for method in ["level sets", "plain rays"] {
        let polyps: Vec<_> = of(method).flat_map(|r| &r.polyps).collect();
        let errors: Vec<f64> = polyps.iter().filter_map(|p| p.1).collect();
        if let Some([mean, deviation]) = moments(&errors) {
            let once = polyps.iter().filter(|p| p.0 == 1).count();
            findings.push(format!(
                "{method}: {once} of {} polyps are shown once; their sizes differ from the truth by {mean:.2} ± {deviation:.2} mm.",
                polyps.len()
            ));
        }
    }
    findings
}
