use glam::{DMat3, DVec3, IVec3};

use super::*;
use crate::math::hash;
use crate::volume::Grid;

fn sampled(dims: [usize; 3], spacing: DVec3, direction: DMat3, f: impl Fn(DVec3) -> f64) -> Volume {
    let grid = Grid::new(dims, spacing, DVec3::ZERO, direction).unwrap();
    let mut data = Vec::new();
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                data.push(f(grid.world(DVec3::new(i as f64, j as f64, k as f64))).round() as i16);
            }
        }
    }
    Volume::new(grid, data)
}

/// The paper's form: a regression by the definition of the sums at each of the eight voxels, then interpolated.
fn naive(volume: &Volume, p: DVec3, spacing: DVec3) -> (DVec3, f64) {
    let base = p.floor();
    let t = p - base;
    let (mut gradient, mut density) = (DVec3::ZERO, 0.0);
    for n in 0..8 {
        let corner = IVec3::new(n & 1, n >> 1 & 1, n >> 2).as_dvec3();
        let share: f64 = (0..3).map(|a| if corner[a] == 1.0 { t[a] } else { 1.0 - t[a] }).product();
        let (mut wfx, mut wxx, mut wf, mut w_all) = (DVec3::ZERO, DVec3::ZERO, 0.0, 0.0);
        for o in 0..27 {
            let offset = IVec3::new(o % 3 - 1, o / 3 % 3 - 1, o / 9 - 1).as_dvec3();
            if offset == DVec3::ZERO {
                continue;
            }
            let x = offset * spacing;
            let w = 1.0 / x.length_squared();
            let at = base + corner + offset;
            let f = f64::from(volume.get(at.x as i64, at.y as i64, at.z as i64));
            wfx += w * f * x;
            wxx += w * x * x;
            wf += w * f;
            w_all += w;
        }
        gradient += share * wfx / wxx;
        density += share * wf / w_all;
    }
    (gradient, density)
}

fn place(p: DVec3) -> ([i32; 3], Vec3) {
    (p.floor().to_array().map(|c| c as i32 - 1), (p - p.floor()).as_vec3())
}

#[test]
fn interpolating_first_is_the_same() {
    let spacing = DVec3::new(0.7, 0.5, 2.5);
    let v = sampled([7, 8, 6], spacing, DMat3::IDENTITY, |p| {
        2000.0 * hash::uniform(4, p.x.to_bits() ^ p.y.to_bits() << 1 ^ p.z.to_bits() << 2) - 1000.0
    });
    let regression = Regression::new(spacing, Weighting::InverseSquare);
    for n in 0..500 {
        let u = |k| hash::uniform(n, k);
        // Includes places beyond the border, where air takes part.
        let p = DVec3::new(9.0 * u(0) - 1.0, 10.0 * u(1) - 1.0, 8.0 * u(2) - 1.0);
        let (first, t) = place(p);
        let fit = regression.fit(&block(&v, first), t);
        let (gradient, density) = naive(&v, p, spacing);
        assert!((fit.gradient.as_dvec3() - gradient).length() < 2e-3, "{p}: {:?} {gradient}", fit.gradient);
        assert!((f64::from(fit.density) - density).abs() < 1e-3);
    }
}

#[test]
fn linear_values_are_fitted_exactly_in_the_world() {
    // Sheared, rotated, left-handed, and with slices far apart.
    let shear = DMat3::from_cols(DVec3::NEG_X, DVec3::new(0.0, 0.8, 0.6), DVec3::new(0.1, -0.6, 0.9));
    for spacing in [DVec3::ONE, DVec3::new(0.3, 0.3, 10.0), DVec3::new(1.0, 2.0, 0.5)] {
        let g = DVec3::new(80.0, -50.0, 30.0);
        let v = sampled([6; 3], spacing, shear, |p| g.dot(p));
        for weighting in [Weighting::InverseSquare, Weighting::Inverse] {
            let fit = Regression::new(spacing, weighting).fit(&block(&v, [1, 1, 1]), Vec3::new(0.2, 0.7, 0.4));
            let world = to_world(&v) * fit.gradient;
            assert!((world.as_dvec3() - g).length() < 2.0, "{spacing} {weighting:?}: {world}");
            let at = v.grid().world(DVec3::new(2.2, 2.7, 2.4));
            assert!((f64::from(fit.density) - g.dot(at)).abs() < 0.6);
        }
        let central = central_differences(&block(&v, [1, 1, 1]), Vec3::new(0.2, 0.7, 0.4), spacing.as_vec3());
        assert!(((to_world(&v) * central).as_dvec3() - g).length() < 2.5);
    }
}

/// The error function, by its series and the asymptote of its continued fraction, to 1e-7: accurate enough for an edge of 1000 HU.
fn erf(x: f64) -> f64 {
    if x.abs() > 4.0 {
        return x.signum();
    }
    let (mut term, mut sum) = (x, x);
    for n in 1..80 {
        term *= -x * x / f64::from(n);
        sum += term / f64::from(2 * n + 1);
    }
    sum * 2.0 / std::f64::consts::PI.sqrt()
}

/// Mean angular error in degrees on a tube of 20 voxels radius with an edge of 1000 HU blurred by one voxel, for the
/// noise levels 0, 30 and 100 HU: central differences, then 1/d², then 1/d.
fn tube_errors() -> [[f64; 3]; 3] {
    let axis = DVec3::new(0.3, 0.2, 1.0).normalize();
    let centre = DVec3::splat(31.7);
    let radial = |p: DVec3| (p - centre) - axis * (p - centre).dot(axis);
    [0.0, 30.0, 100.0].map(|noise| {
        let v = sampled([64; 3], DVec3::ONE, DMat3::IDENTITY, |p| {
            let n = (p.x + 64.0 * (p.y + 64.0 * p.z)) as u64;
            -500.0 + 500.0 * erf((radial(p).length() - 20.0) / 2f64.sqrt()) + noise * hash::normal(11, n)
        });
        let regressions = [Weighting::InverseSquare, Weighting::Inverse].map(|w| Regression::new(DVec3::ONE, w));
        let mut errors = [0.0; 3];
        let mut count = 0.0;
        for n in 0..20_000 {
            let u = |k| hash::uniform(n, k);
            let d = DVec3::new(u(0) - 0.5, u(1) - 0.5, u(2) - 0.5);
            let across = (d - axis * d.dot(axis)).normalize();
            let p = centre + axis * (40.0 * u(3) - 20.0) + across * 20.0;
            if p.min_element() < 2.0 || p.max_element() > 61.0 {
                continue;
            }
            let (first, t) = place(p);
            let b = block(&v, first);
            let central = central_differences(&b, t, Vec3::ONE);
            for (e, g) in
                errors.iter_mut().zip([central, regressions[0].fit(&b, t).gradient, regressions[1].fit(&b, t).gradient])
            {
                *e += g.as_dvec3().angle_between(across).to_degrees();
            }
            count += 1.0;
        }
        errors.map(|e| e / count)
    })
}

#[test]
fn estimators_are_ordered_by_their_error() {
    let errors = tube_errors();
    println!("noise HU   central   1/d²   1/d (degrees)");
    for (noise, e) in [0, 30, 100].iter().zip(errors) {
        println!("{noise:8} {:9.2} {:6.2} {:6.2}", e[0], e[1], e[2]);
    }
    let [clean, some, much] = errors;
    assert!(clean[1] < clean[2] && clean[2] < clean[0]);
    assert!(some[1] < some[2] && some[2] < some[0]);
    assert!(much[2] < much[1] && much[1] < much[0]);
    assert!(clean[1] < 1.0 && some[1] < 2.5 && much[1] < 7.0);
}
