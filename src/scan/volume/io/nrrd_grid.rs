//! The grid of a NRRD header: its axes, its space and its units.

use glam::{DMat3, DVec3};

use super::Fields;
use crate::error::{Error, Result};
use crate::volume::Grid;
use crate::volume::io::frame::{self, RAS_LPS};
use crate::volume::io::text::{self, bad, exactly, some};

/// One axis: its size, and its step through the world if the header gives one.
struct Axis {
    size: usize,
    step: Option<DVec3>,
    spacing: Option<f64>,
    /// Positions of its ends, and whether these are the outer faces of its first and last voxel, or their centres.
    ends: Ends,
}

/// Where an axis without a direction begins and ends.
#[derive(Clone, Copy)]
struct Ends {
    min: Option<f64>,
    max: Option<f64>,
    faces: bool,
}

impl Ends {
    /// Returns the spacing of `size` voxels between both ends.
    fn spacing(self, size: usize) -> Option<f64> {
        let steps = if self.faces { size } else { size.saturating_sub(1) };
        self.min.zip(self.max).filter(|_| steps > 0).map(|(min, max)| (max - min) / steps as f64)
    }

    /// Returns the position of the first voxel's centre.
    fn first(self, spacing: f64) -> Option<f64> {
        self.min.map(|min| if self.faces { min + spacing / 2.0 } else { min })
    }
}

/// Returns the ends of each axis.
fn ends(f: &Fields, count: usize) -> Result<Vec<Ends>> {
    let numbers = |names: &[&'static str]| match f.get(names) {
        None => Ok(vec![f64::NAN; count]),
        Some((key, value)) => some(value)
            .filter(|v: &Vec<f64>| v.len() == count && v.iter().all(|x| !x.is_infinite()))
            .ok_or_else(|| bad(f.path, key, value, &format!("{count} finite numbers"))),
    };
    let (mins, maxs) = (numbers(&["axis mins", "axismins"])?, numbers(&["axis maxs", "axismaxs"])?);
    let faces: Vec<bool> = match f.get(&["centers", "centerings"]) {
        // Teem, and with it ITK, takes voxels for cells where the header is silent.
        None => vec![true; count],
        Some((key, value)) => {
            let one = |word: &str| match word.to_ascii_lowercase().as_str() {
                "node" => Some(false),
                "cell" | "none" | "???" => Some(true),
                _ => None,
            };
            let words: Option<Vec<bool>> = value.split_whitespace().map(one).collect();
            let words = words.filter(|w| w.len() == count);
            words.ok_or_else(|| bad(f.path, key, value, &format!("{count} words: cell, node, none or ???")))?
        }
    };
    let known = |x: f64| Some(x).filter(|x| !x.is_nan());
    let one = |((min, max), faces)| Ends { min: known(min), max: known(max), faces };
    Ok(mins.into_iter().zip(maxs).zip(faces).map(one).collect())
}

/// Returns the grid of a header. Fails with status 3 if the header is invalid, or if its space does not tell where the patient's
/// sides are.
pub(super) fn grid(f: &Fields, notes: &mut Vec<String>) -> Result<Grid> {
    let path = f.path;
    let value = f.need("dimension")?;
    let [count] = exactly::<usize, 1>(value)
        .filter(|[n]| (1..=16).contains(n))
        .ok_or_else(|| bad(path, "dimension", value, "1 to 16"))?;
    let value = f.need("sizes")?;
    let sizes: Vec<usize> = some(value)
        .filter(|v: &Vec<usize>| v.len() == count)
        .ok_or_else(|| bad(path, "sizes", value, &format!("{count} whole numbers")))?;
    let to_lps = space_to_lps(f, notes)?;
    let steps = match f.get(&["space directions"]) {
        None => vec![None; count],
        Some((key, value)) => {
            let steps = vectors(value).filter(|v| v.len() == count);
            steps.ok_or_else(|| bad(path, key, value, &format!("{count} vectors of three numbers, or none")))?
        }
    };
    let spacings: Vec<f64> = match f.get(&["spacings"]) {
        None => vec![f64::NAN; count],
        Some((key, value)) => some(value)
            .filter(|v: &Vec<f64>| v.len() == count)
            .ok_or_else(|| bad(path, key, value, &format!("{count} numbers")))?,
    };
    let ends = ends(f, count)?;
    let reported = f.map.contains_key("spacings");
    let is_silent = f.get(&["centers", "centerings"]).is_none();
    let mut axes = Vec::new();
    for (((size, step), spacing), ends) in sizes.iter().zip(steps).zip(spacings).zip(ends) {
        // NaN means "no spacing" for an axis that is not spatial.
        if reported && !spacing.is_nan() {
            frame::check_spacing(path, "spacings", &[spacing])?;
        }
        let mut spacing = Some(spacing).filter(|s| !s.is_nan());
        let mut ends = ends;
        if is_silent && let Some(own) = spacing {
            // The ends are those of centres if only that agrees with the spacing.
            let of = |faces: bool| Ends { faces, ..ends }.spacing(*size);
            let agrees = |told: Option<f64>| told.is_some_and(|t| (t - own).abs() <= 0.01 * own);
            ends.faces = agrees(of(true)) || !agrees(of(false));
        }
        if let Some(told) = ends.spacing(*size).filter(|_| step.is_none()) {
            frame::check_spacing(path, "axis maxs", &[told])?;
            if spacing.is_some_and(|s| (s - told).abs() > 0.01 * told) {
                let why = format!("spacings has {}, but axis mins and axis maxs give {told}", spacing.unwrap_or(told));
                return Err(Error::file(path, why, "correct the header"));
            }
            spacing = spacing.or(Some(told));
        }
        axes.push(Axis { size: *size, step, spacing, ends });
    }
    if axes.len() > 3 {
        axes.retain(|a| a.size != 1 || a.step.is_some());
    }
    if axes.len() > 3
        || (axes.len() == 3 && f.map.contains_key("space directions") && axes.iter().any(|a| a.step.is_none()))
    {
        return Err(Error::file(
            path,
            format!("has more than one value for each voxel, or several frames (sizes {sizes:?})"),
            "extract one three-dimensional frame first",
        ));
    }
    let dims = std::array::from_fn(|k| axes.get(k).map_or(1, |a| a.size));
    text::voxel_count(path, dims)?;
    if reported && axes.iter().any(|a| a.spacing.is_none() && a.step.is_none()) {
        return Err(Error::file(path, "spacings has NaN, which is not positive and finite", "correct the header"));
    }
    if axes.iter().any(|a| a.step.is_none() && a.spacing.is_none()) {
        notes.push("has no spacing: 1 mm is assumed".to_owned());
    }
    let unit = [DVec3::X, DVec3::Y, DVec3::Z];
    let step = |k: usize| axes.get(k).map_or(unit[k], |a| a.step.unwrap_or(unit[k] * a.spacing.unwrap_or(1.0)));
    let steps = [step(0), step(1), step(2)];
    for s in steps {
        frame::check_spacing(path, "space directions", &[s.length()])?;
    }
    let origin = match f.get(&["space origin"]) {
        None => first(f, &axes, notes)?,
        Some((key, value)) => match vectors(value).as_deref() {
            Some([Some(o)]) => *o,
            _ => return Err(bad(path, key, value, "one vector of three numbers")),
        },
    };
    let mm = units(f)?;
    frame::from_steps(path, dims, to_lps * DMat3::from_cols(steps[0], steps[1], steps[2]) * mm, to_lps * origin * mm)
}

/// Returns the position of the first voxel's centre along axes without directions.
fn first(f: &Fields, axes: &[Axis], notes: &mut Vec<String>) -> Result<DVec3> {
    let Some((key, value)) = f.get(&["axis mins", "axismins"]) else { return Ok(DVec3::ZERO) };
    if axes.iter().any(|a| a.step.is_some()) {
        notes.push("has axis mins beside space directions, which are used".to_owned());
        return Ok(DVec3::ZERO);
    }
    let mut out = DVec3::ZERO;
    for (k, axis) in axes.iter().take(3).enumerate() {
        let first = axis.ends.first(axis.spacing.unwrap_or(1.0));
        out[k] = first.ok_or_else(|| bad(f.path, key, value, "a number for each axis"))?;
    }
    Ok(out)
}

/// Returns the matrix from the file's space to LPS.
fn space_to_lps(f: &Fields, notes: &mut Vec<String>) -> Result<DMat3> {
    let flip = |x: f64, y: f64| DMat3::from_diagonal(DVec3::new(x, y, 1.0));
    let Some((key, value)) = f.get(&["space"]) else {
        match f.get(&["space dimension"]) {
            Some((_, "3")) | None => {}
            Some((key, value)) => return Err(bad(f.path, key, value, "3")),
        }
        notes.push("names no space: left-posterior-superior is assumed".to_owned());
        return Ok(DMat3::IDENTITY);
    };
    let name = value.trim().to_ascii_lowercase();
    match name.as_str() {
        "left-posterior-superior" | "lps" => Ok(DMat3::IDENTITY),
        "right-anterior-superior" | "ras" => Ok(RAS_LPS),
        "left-anterior-superior" | "las" => Ok(flip(1.0, -1.0)),
        // Right-handed spaces that do not say where the patient's sides are.
        "scanner-xyz" | "3d-right-handed" => {
            notes.push(format!(
                "its space {value} does not name the patient's sides: left-posterior-superior is assumed"
            ));
            Ok(DMat3::IDENTITY)
        }
        "3d-left-handed" => Err(Error::file(
            f.path,
            format!("its space {value} does not distinguish the patient's left from right"),
            "name the space in the header, such as left-posterior-superior",
        )),
        _ if name.ends_with("-time") || ["rast", "last", "lpst"].contains(&&*name) => Err(Error::file(
            f.path,
            format!("its space {value} has a time axis"),
            "extract one three-dimensional frame first",
        )),
        _ => Err(bad(
            f.path,
            key,
            value,
            "left-posterior-superior, right-anterior-superior, left-anterior-superior, scanner-xyz or 3D-right-handed",
        )),
    }
}

/// Returns the millimetres per unit of the file's space; all axes must agree.
fn units(f: &Fields) -> Result<f64> {
    let Some((key, value)) = f.get(&["space units"]) else { return Ok(1.0) };
    let mut names = value.split_whitespace().map(|u| u.trim_matches('"'));
    let first = names.next().unwrap_or("mm");
    if names.any(|n| n != first) {
        return Err(bad(f.path, key, value, "the same unit for every axis"));
    }
    match first {
        "mm" | "millimeter" | "millimeters" | "" | "???" => Ok(1.0),
        "cm" => Ok(10.0),
        "m" | "meter" | "meters" => Ok(1000.0),
        "um" | "µm" | "micron" | "microns" => Ok(0.001),
        _ => Err(bad(f.path, key, value, "mm, cm, m or um")),
    }
}

/// Parses vectors as NRRD writes them: `(1,0,0) none (0,0,1)`.
fn vectors(value: &str) -> Option<Vec<Option<DVec3>>> {
    let mut out = Vec::new();
    let mut rest = value.trim();
    while !rest.is_empty() {
        if rest.get(..4).is_some_and(|word| word.eq_ignore_ascii_case("none")) {
            out.push(None);
            rest = rest[4..].trim_start();
            continue;
        }
        let (inside, after) = rest.strip_prefix('(')?.split_once(')')?;
        let numbers: Vec<f64> = inside.split(',').map(|t| t.trim().parse().ok()).collect::<Option<_>>()?;
        let [x, y, z]: [f64; 3] = numbers.try_into().ok()?;
        out.push(Some(DVec3::new(x, y, z)));
        rest = after.trim_start();
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::fields;
    use super::*;

    /// Returns the grid of a header with these sizes and space directions.
    fn grid_of(sizes: &str, directions: &str) -> Result<Grid> {
        let count = sizes.split(' ').count();
        let head = format!(
            "NRRD0004\ntype: short\ndimension: {count}\nsizes: {sizes}\nspace: left-posterior-superior\n\
             space directions: {directions}\nendian: little\nencoding: raw\n\n"
        );
        grid(&fields(Path::new("x"), head.as_bytes())?, &mut Vec::new())
    }

    #[test]
    fn frames_and_colours_are_refused() {
        let (x, y, z) = ("(1,0,0)", "(0,2,0)", "(0,0,3)");
        let whole = grid_of("4 3 2", &format!("{x} {y} {z}")).unwrap();
        assert_eq!((whole.dims(), whole.spacing()), ([4, 3, 2], DVec3::new(1.0, 2.0, 3.0)));
        // A list of one frame holds one volume.
        assert_eq!(grid_of("1 4 3 2", &format!("none {x} {y} {z}")).unwrap(), whole);
        for (sizes, directions) in [
            ("4 3 2 5", format!("{x} {y} {z} none")),
            ("3 4 3 2", format!("none {x} {y} {z}")),
            ("3 4 2", format!("none {x} {y}")),
        ] {
            let e = grid_of(sizes, &directions).unwrap_err();
            assert!(e.to_string().contains("several frames"), "{sizes}: {e}");
        }
    }

    #[test]
    fn the_spacing_and_the_origin_are_in_the_unit_of_the_space() {
        for (unit, mm) in [("mm", 1.0), ("cm", 10.0), ("m", 1000.0), ("um", 0.001)] {
            let head = format!(
                "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\nspace: right-anterior-superior\n\
                 space units: \"{unit}\" \"{unit}\" \"{unit}\"\nspace directions: (1,0,0) (0,2,0) (0,0,3)\n\
                 space origin: (10,-20,30)\nendian: little\nencoding: raw\n\n"
            );
            let read = grid(&fields(Path::new("x"), head.as_bytes()).unwrap(), &mut Vec::new()).unwrap();
            let (spacing, origin) = (DVec3::new(1.0, 2.0, 3.0) * mm, DVec3::new(-10.0, 20.0, 30.0) * mm);
            assert!(read.spacing().abs_diff_eq(spacing, 1e-9 * mm), "{unit}: {}", read.spacing());
            assert!(read.origin().abs_diff_eq(origin, 1e-9 * mm), "{unit}: {}", read.origin());
        }
    }

    #[test]
    fn the_ends_of_axes_tell_position_and_spacing() {
        let read = |lines: &str| {
            let head = format!(
                "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\nendian: little\nencoding: raw\n{lines}\n\n"
            );
            grid(&fields(Path::new("x"), head.as_bytes())?, &mut Vec::new()).map(|g| (g.origin(), g.spacing()))
        };
        let (spacing, cell) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(10.5, 21.0, 31.5));
        let mins = "axis mins: 10 20 30";
        assert_eq!(read(&format!("spacings: 1 2 3\n{mins}")).unwrap(), (cell, spacing));
        let node = format!("spacings: 1 2 3\ncenters: node node node\n{mins}");
        assert_eq!(read(&node).unwrap(), (DVec3::new(10.0, 20.0, 30.0), spacing));
        assert_eq!(read(&format!("{mins}\naxis maxs: 14 26 36")).unwrap(), (cell, spacing));
        let node = format!("{mins}\naxis maxs: 13 24 33\ncenters: node node node");
        assert_eq!(read(&node).unwrap(), (DVec3::new(10.0, 20.0, 30.0), spacing));
        for (lines, why) in [
            ("spacings: 1 2 3\naxis mins: 10 nan 30", "a number for each axis"),
            ("spacings: 1 2 3\naxis mins: 10 20", "3 finite numbers"),
            ("spacings: 1 2 3\naxis mins: 1 2 3\naxis maxs: 14 26 36", "axis mins and axis maxs give 3.25"),
            ("axis mins: 10 20 30\naxis maxs: 4 26 36", "axis maxs has spacing -1.5"),
            ("spacings: 1 2 3\ncenters: edge node node", "centers is"),
        ] {
            let e = read(lines).unwrap_err();
            assert!(e.to_string().contains(why), "{lines}: {e}");
        }
    }

    #[test]
    fn a_space_that_mirrors_is_refused() {
        let read = |space: &str| {
            let head = format!(
                "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\nspace: {space}\nendian: little\nencoding: raw\n\
                 space directions: (1,0,0) (0,2,0) (0,0,3)\nspace origin: (10,20,30)\n\n"
            );
            let mut notes = Vec::new();
            grid(&fields(Path::new("x"), head.as_bytes())?, &mut notes).map(|g| (g.origin(), notes.len()))
        };
        for space in ["scanner-xyz", "3D-right-handed"] {
            assert_eq!(read(space).unwrap(), (DVec3::new(10.0, 20.0, 30.0), 1), "{space}");
        }
        for (space, why) in [("3D-left-handed", "left from right"), ("LPST", "time axis"), ("RAI", "space is")] {
            assert!(read(space).unwrap_err().to_string().contains(why), "{space}");
        }
    }
}
