//! The values that arguments take: points, sizes, lists of numbers.

use std::str::FromStr;

use glam::DVec3;

use crate::render::slice::{Slab, SlabKind, SlicePlane};

/// A point of the colon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Point {
    /// The rectal end.
    Rectum,
    /// The cecal end.
    Cecum,
    /// World, mm LPS.
    World(DVec3),
}

impl FromStr for Point {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        match s.to_ascii_lowercase().as_str() {
            "rectum" => Ok(Self::Rectum),
            "cecum" => Ok(Self::Cecum),
            _ => Ok(Self::World(s.parse::<Triple>().map_err(|e| format!("is not rectum, cecum or X,Y,Z: {e}"))?.0)),
        }
    }
}

/// Two finite numbers, `A,B`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair(pub f64, pub f64);

impl FromStr for Pair {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let [a, b] = numbers(s)?;
        Ok(Self(a, b))
    }
}

/// Three finite numbers, `X,Y,Z`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triple(pub DVec3);

impl FromStr for Triple {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        numbers(s).map(|n| Self(DVec3::from_array(n)))
    }
}

fn numbers<const N: usize>(s: &str) -> Result<[f64; N], String> {
    let mut out = [0.0; N];
    let mut parts = s.split(',');
    for o in &mut out {
        let t = parts.next().ok_or_else(|| format!("needs {N} numbers"))?.trim();
        *o = t.parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(|| format!("{t:?} is not a finite number"))?;
    }
    if parts.next().is_some() { Err(format!("needs {N} numbers, no more")) } else { Ok(out) }
}

/// More threads than this take longer to start than they save.
pub(crate) const MOST_THREADS: usize = 256;

/// A finite number.
pub(crate) fn number(s: &str) -> Result<f64, String> {
    numbers(s).map(|[n]| n)
}

/// The plane of a slice: a name, or the normal `NX,NY,NZ`.
pub(crate) fn plane(s: &str) -> Result<SlicePlane, String> {
    let plane = match s.to_ascii_lowercase().as_str() {
        "axial" => SlicePlane::Axial,
        "coronal" => SlicePlane::Coronal,
        "sagittal" => SlicePlane::Sagittal,
        _ => {
            let normal = numbers(s).map_err(|e| format!("is not axial, coronal, sagittal or NX,NY,NZ: {e}"))?;
            SlicePlane::Oblique(DVec3::from_array(normal))
        }
    };
    plane.frame().map(|_| plane)
}

/// A slab, `MM,mean|max|min`.
pub(crate) fn slab(s: &str) -> Result<Slab, String> {
    let (mm, kind) = s.split_once(',').ok_or("is not MM,mean|max|min")?;
    let kind = match kind.trim().to_ascii_lowercase().as_str() {
        "mean" => SlabKind::Mean,
        "max" => SlabKind::Max,
        "min" => SlabKind::Min,
        other => return Err(format!("{other:?} is not mean, max or min")),
    };
    Slab::new(number(mm)?, kind)
}

/// A number of threads, from 1 to [`MOST_THREADS`].
pub(crate) fn threads(s: &str) -> Result<usize, String> {
    let valid = s.parse().ok().filter(|n| (1..=MOST_THREADS).contains(n));
    valid.ok_or_else(|| format!("must be a whole number from 1 to {MOST_THREADS}"))
}

/// A count from 1 to 4096.
pub(crate) fn count(s: &str) -> Result<usize, String> {
    s.parse().ok().filter(|n| (1..=4096).contains(n)).ok_or_else(|| "must be a whole number from 1 to 4096".to_owned())
}

/// A number of steps, 1 or more.
pub(crate) fn steps(s: &str) -> Result<u64, String> {
    s.parse().ok().filter(|n| *n > 0).ok_or_else(|| "must be a whole number, 1 or more".to_owned())
}

/// A random seed, 0 or more.
pub(crate) fn seed(s: &str) -> Result<u64, String> {
    s.parse().map_err(|_| format!("must be a whole number from 0 to {}", u64::MAX))
}
