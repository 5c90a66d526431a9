//! Test signals whose gradient is known at every point.

use std::f64::consts::{PI, SQRT_2, TAU};

use glam::{DMat3, DVec3};

use crate::error::Result;
use crate::math::hash;
use crate::phantom::{self, Phantom};
use crate::progress::Progress;
use crate::volume::{Grid, Volume};

/// Voxels along the finest axis of the analytic signals.
const SIDE: usize = 64;
/// Radius of tube and sphere, mm (and voxels of the finest axis).
const RADIUS: f64 = 20.0;
/// Half the width of the Marschner–Lobb signal, mm: 41 voxels across, as in its authors' publication.
const HALF: f64 = 20.0;
/// Frequency and amplitude of the Marschner–Lobb signal.
const FREQUENCY: f64 = 6.0;
const ALPHA: f64 = 0.25;

/// A point and its unit gradient, both world.
type Known = (DVec3, DVec3);

/// A sampled signal.
pub(crate) struct Signal {
    /// Its name.
    pub name: &'static str,
    /// True if it resembles the wall of a colon.
    pub wall: bool,
    /// Its noise-free samples.
    pub volume: Volume,
    /// Returns a random point of the signal by number; `None` if that number yields none.
    known: Box<dyn Fn(u64) -> Option<Known> + Sync>,
}

impl Signal {
    /// Returns `count` points.
    pub(crate) fn points(&self, count: usize) -> Vec<Known> {
        // Every signal accepts at least one number in ten.
        (0..20 * count as u64).filter_map(|n| (self.known)(n)).take(count).collect()
    }
}

/// Creates all signals, sampled with voxels of the given shape (with a smallest spacing of 1).
pub(crate) fn all(shape: DVec3, progress: &Progress) -> Result<Vec<Signal>> {
    Ok(vec![tube(shape), sphere(shape), phantom_wall(shape, progress)?, marschner_lobb(shape)])
}

/// Creates a grid around the world's origin, slightly shifted so that the origin is not on a voxel.
fn grid(shape: DVec3) -> Grid {
    let dims = shape.to_array().map(|s| (SIDE as f64 / s).round() as usize);
    let last = DVec3::from_array(dims.map(|n| n as f64 - 1.0));
    let origin = -0.5 * last * shape + DVec3::new(0.17, 0.31, 0.23);
    Grid::new(dims, shape, origin, DMat3::IDENTITY).unwrap_or_else(|_| unreachable!("the shapes are constants"))
}

fn sampled(shape: DVec3, value: impl Fn(DVec3) -> f64) -> Volume {
    let grid = grid(shape);
    let [nx, ny, _] = grid.dims();
    let place = |n: usize| DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64);
    let data = (0..grid.len()).map(|n| value(grid.world(place(n))).round() as i16).collect();
    Volume::new(grid, data)
}

/// Returns the value of an edge of 1000 HU, blurred by 1 mm, `d` mm outside the wall.
fn edge(d: f64) -> f64 {
    -500.0 + 500.0 * erf(d / SQRT_2)
}

/// The error function by its series, accurate to at least 10⁻⁷.
fn erf(x: f64) -> f64 {
    if x.abs() > 4.0 {
        return x.signum();
    }
    let (mut term, mut sum) = (x, x);
    for n in 1..80 {
        term *= -x * x / f64::from(n);
        sum += term / f64::from(2 * n + 1);
    }
    sum * 2.0 / PI.sqrt()
}

/// Returns a random point of the cube −1 … 1.
fn cube(n: u64) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|k| 2.0 * hash::uniform(n, k) - 1.0))
}

/// Returns a random direction; `None` for points outside the ball.
fn direction(n: u64) -> Option<DVec3> {
    Some(cube(n)).filter(|p| p.length() < 1.0 && p.length() > 0.01).map(DVec3::normalize)
}

fn tube(shape: DVec3) -> Signal {
    let axis = DVec3::new(0.3, 0.2, 1.0).normalize();
    let across = move |p: DVec3| p - axis * p.dot(axis);
    Signal {
        name: "tube",
        wall: true,
        volume: sampled(shape, |p| edge(across(p).length() - RADIUS)),
        known: Box::new(move |n| {
            let out = across(direction(n)?).normalize_or_zero();
            let p = out * RADIUS + axis * (20.0 * (2.0 * hash::uniform(n, 3) - 1.0));
            (out != DVec3::ZERO && p.abs().max_element() < 26.0).then_some((p, out))
        }),
    }
}

fn sphere(shape: DVec3) -> Signal {
    Signal {
        name: "sphere",
        wall: true,
        volume: sampled(shape, |p| edge(p.length() - RADIUS)),
        known: Box::new(|n| direction(n).map(|out| (out * RADIUS, out))),
    }
}

/// Returns the Marschner–Lobb signal (1994) from −1000 to 0 HU: value, and gradient in HU/mm.
fn ml(p: DVec3) -> (f64, DVec3) {
    let q = p / HALF;
    let r = q.truncate().length();
    let inner = TAU * FREQUENCY * (0.5 * PI * r).cos();
    let share = 1000.0 / (2.0 * (1.0 + ALPHA));
    let value = share * ((1.0 - (0.5 * PI * q.z).sin()) + ALPHA * (1.0 + inner.cos())) - 1000.0;
    let along_r = share * ALPHA * inner.sin() * TAU * FREQUENCY * 0.5 * PI * (0.5 * PI * r).sin() / HALF;
    let along_z = -share * 0.5 * PI * (0.5 * PI * q.z).cos() / HALF;
    (value, (q.truncate().normalize_or_zero() * along_r).extend(along_z))
}

fn marschner_lobb(shape: DVec3) -> Signal {
    Signal {
        name: "Marschner–Lobb",
        wall: false,
        volume: sampled(shape, |p| ml(p).0),
        known: Box::new(|n| {
            let p = cube(n) * (0.9 * HALF);
            let g = ml(p).1;
            (g.length() > 1.0).then(|| (p, g.normalize()))
        }),
    }
}

/// Creates a piece of the phantom's folded wall without noise, with voxels of the given shape and the small phantom's resolution.
fn phantom_wall(shape: DVec3, progress: &Progress) -> Result<Signal> {
    let settings =
        phantom::PhantomSettings { size: phantom::Size::Small, noise: false, ..phantom::PhantomSettings::default() };
    let phantom = Phantom::new(&settings);
    let line = phantom.truth().centerline;
    let centre = line[line.len() / 2];
    let spacing = shape * 0.9;
    let dims = shape.to_array().map(|s| (SIDE as f64 / s).round() as usize);
    let last = DVec3::from_array(dims.map(|n| n as f64 - 1.0));
    let grid = Grid::new(dims, spacing, centre - 0.5 * last * spacing, DMat3::IDENTITY)
        .unwrap_or_else(|_| unreachable!("the shapes are constants"));
    let volume = phantom.voxelise(&grid, progress)?;
    let known = move |n| {
        let out = direction(n)?;
        // The first crossing from the centre outwards, refined by bisection.
        let wall = |t: f64| phantom.wall(centre + out * t);
        let step = (1..100).map(|k| 0.25 * f64::from(k)).find(|&t| wall(t) > 0.0)?;
        let (mut low, mut high) = (step - 0.25, step);
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            if wall(middle) > 0.0 { high = middle } else { low = middle }
        }
        let g = phantom.gradient(centre + out * high);
        (g.length() > 50.0).then(|| (centre + out * high, g.normalize()))
    };
    Ok(Signal { name: "phantom", wall: true, volume, known: Box::new(known) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_are_those_of_the_values() {
        for n in 0..200 {
            let p = cube(n) * 18.0;
            let h = 1e-5;
            let f = |a: DVec3| (ml(p + a * h).0 - ml(p - a * h).0) / (2.0 * h);
            let g = DVec3::new(f(DVec3::X), f(DVec3::Y), f(DVec3::Z));
            assert!((g - ml(p).1).length() < 1e-3 * (1.0 + g.length()), "{p}: {g} {}", ml(p).1);
            assert!((-1000.001..=0.001).contains(&ml(p).0));
        }
    }

    #[test]
    #[ignore = "slow: all signals of the report on gradients"]
    fn points_lie_within_the_samples_where_the_value_is_that_of_the_wall() {
        for shape in [DVec3::ONE, DVec3::new(1.0, 1.0, 3.0)] {
            for s in all(shape, &Progress::new()).unwrap() {
                let points = s.points(300);
                assert_eq!(points.len(), 300, "{}", s.name);
                let dims = s.volume.grid().dims();
                for (p, g) in points {
                    let v = s.volume.grid().voxel(p);
                    assert!((0..3).all(|a| v[a] > 1.0 && v[a] < dims[a] as f64 - 2.0), "{}: {v}", s.name);
                    assert!((g.length() - 1.0).abs() < 1e-9);
                }
            }
        }
    }
}
