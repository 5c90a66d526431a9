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

/// A share of many cases, `I/N`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which, from 1.
    pub number: u64,
    /// How many there are.
    pub count: u64,
}

/// A shard, `I/N` with I from 1 to N.
pub(crate) fn shard(s: &str) -> Result<Shard, String> {
    let parts = s.split_once('/').and_then(|(i, n)| Some((i.trim().parse().ok()?, n.trim().parse().ok()?)));
    match parts {
        Some((number, count)) if number >= 1 && number <= count => Ok(Shard { number, count }),
        _ => Err("is not I/N with I from 1 to N".to_owned()),
    }
}

/// A number of bytes, with K, M, G or T for powers of 1024.
pub(crate) fn bytes(s: &str) -> Result<u64, String> {
    let text = s.trim();
    let unit = text.chars().last().and_then(|c| "KMGT".find(c.to_ascii_uppercase())).map(|n| 10 * (n as u32 + 1));
    let number = if unit.is_some() { &text[..text.len() - 1] } else { text };
    let number: f64 = number.trim().parse().map_err(|_| "is not a number of bytes such as 4G".to_owned())?;
    let bytes = number * 2f64.powi(unit.unwrap_or(0) as i32);
    if (1.0..1e18).contains(&bytes) { Ok(bytes as u64) } else { Err("is not a number of bytes such as 4G".to_owned()) }
}

/// A positive number of seconds.
pub(crate) fn seconds(s: &str) -> Result<f64, String> {
    number(s).and_then(|s| if s > 0.0 && s <= 1e9 { Ok(s) } else { Err("is not above 0".to_owned()) })
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

/// Seeds from the first to the last, both included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SeedRange {
    /// The first.
    pub first: u64,
    /// The last.
    pub last: u64,
}

/// Seeds, `A..B`.
pub(crate) fn seed_range(s: &str) -> Result<SeedRange, String> {
    let ends = s.split_once("..").and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    let (first, last) = ends.ok_or("is not A..B, such as 1..50")?;
    if first > last || last - first >= 10_000 {
        return Err("is not a range of at most 10,000 seeds, the least first".to_owned());
    }
    Ok(SeedRange { first, last })
}

/// Which series of an input, or of an archive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SeriesChoice {
    /// Its number, from 1, among the series of a folder.
    Number(usize),
    /// Its identifier.
    Uid(String),
}

/// A series: a number, or an identifier, which has dots.
pub(crate) fn series(s: &str) -> Result<SeriesChoice, String> {
    let is_uid = s.contains('.') && s.bytes().all(|b| b == b'.' || b.is_ascii_digit());
    if is_uid { Ok(SeriesChoice::Uid(s.to_owned())) } else { count(s).map(SeriesChoice::Number) }
}

/// A number of steps, 1 or more.
pub(crate) fn steps(s: &str) -> Result<u64, String> {
    s.parse().ok().filter(|n| *n > 0).ok_or_else(|| "must be a whole number, 1 or more".to_owned())
}

/// A random seed, 0 or more.
pub(crate) fn seed(s: &str) -> Result<u64, String> {
    s.parse().map_err(|_| format!("must be a whole number from 0 to {}", u64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::ImageSize;

    #[test]
    fn numbers_are_as_many_as_asked_and_finite() {
        assert_eq!("1,-2.5".parse(), Ok(Pair(1.0, -2.5)));
        assert_eq!(" 1e2 , 0,-3".parse(), Ok(Triple(DVec3::new(100.0, 0.0, -3.0))));
        assert_eq!(number("0.25"), Ok(0.25));
        for wrong in ["", "1", "1,2,3", "1,", "x,1", "NaN,1", "1,inf"] {
            assert!(wrong.parse::<Pair>().is_err(), "{wrong}");
        }
        assert_eq!("1,2,3,4".parse::<Triple>(), Err("needs 3 numbers, no more".to_owned()));
        assert_eq!("1,2".parse::<Triple>(), Err("needs 3 numbers".to_owned()));
        assert_eq!("1,2,z".parse::<Triple>(), Err("\"z\" is not a finite number".to_owned()));
    }

    #[test]
    fn points_are_named_or_given() {
        assert_eq!(("Rectum".parse(), "CECUM".parse()), (Ok(Point::Rectum), Ok(Point::Cecum)));
        assert_eq!("1,2,3".parse(), Ok(Point::World(DVec3::new(1.0, 2.0, 3.0))));
        let why = "colon".parse::<Point>().unwrap_err();
        assert!(why.starts_with("is not rectum, cecum or X,Y,Z: "), "{why}");
    }

    #[test]
    fn planes_have_names_or_a_normal() {
        for (text, named) in
            [("axial", SlicePlane::Axial), ("Coronal", SlicePlane::Coronal), ("SAGITTAL", SlicePlane::Sagittal)]
        {
            assert_eq!(plane(text), Ok(named));
        }
        assert_eq!(plane("1,0,2"), Ok(SlicePlane::Oblique(DVec3::new(1.0, 0.0, 2.0))));
        assert!(plane("0,0,0").is_err(), "no direction");
        assert!(plane("oblique").unwrap_err().starts_with("is not axial, coronal, sagittal or NX,NY,NZ: "));
    }

    #[test]
    fn slabs_have_a_thickness_and_a_kind() {
        for (text, kind) in [("5,mean", SlabKind::Mean), ("5, MAX", SlabKind::Max), ("5,min", SlabKind::Min)] {
            assert_eq!(slab(text), Slab::new(5.0, kind));
        }
        for wrong in ["5", "5,median", "x,max", "-1,mean"] {
            assert!(slab(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn counts_have_their_limits() {
        assert_eq!((threads("1"), threads("256")), (Ok(1), Ok(256)));
        assert_eq!((count("1"), count("4096")), (Ok(1), Ok(4096)));
        assert_eq!((steps("1"), steps("18446744073709551615")), (Ok(1), Ok(u64::MAX)));
        assert_eq!((seed("0"), seed("7")), (Ok(0), Ok(7)));
        assert!(["0", "257", "-1", "1.5", ""].iter().all(|s| threads(s).is_err()));
        assert!(["0", "4097", "x"].iter().all(|s| count(s).is_err() && series(s).is_err()));
        assert_eq!(series("2"), Ok(SeriesChoice::Number(2)));
        assert_eq!(series("1.2.3"), Ok(SeriesChoice::Uid("1.2.3".to_owned())));
        assert!(steps("0").is_err() && seed("-1").is_err());
    }

    #[test]
    fn sizes_are_two_sides() {
        assert_eq!("640x480".parse(), Ok(ImageSize::new(640, 480)));
        assert_eq!("1X16384".parse(), Ok(ImageSize::new(1, 16384)));
        for wrong in ["", "640", "0x5", "5x0", "5x16385", "-5x5", "5x5x5", "axb"] {
            assert!(wrong.parse::<ImageSize>().is_err(), "{wrong}");
        }
        let size = ImageSize::new(3, 7);
        assert_eq!((size.pixels(), size.shorter(), size.to_string().as_str()), (21, 3, "3x7"));
    }
}
