use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};

use super::Mesh;
use crate::math::hash;
use crate::space::{PreparedVolume, TransferFunction, value};
use crate::volume::{Grid, Volume};

fn volume(dims: [usize; 3], spacing: DVec3, direction: DMat3, f: impl Fn(DVec3) -> f64) -> PreparedVolume {
    let grid = Grid::new(dims, spacing, DVec3::new(-7.0, 11.0, 3.0), direction).unwrap();
    let place = |n: usize| {
        grid.world(DVec3::new((n % dims[0]) as f64, (n / dims[0] % dims[1]) as f64, (n / dims[0] / dims[1]) as f64))
    };
    let data = (0..grid.len()).map(|n| f(place(n)).round().clamp(-32768.0, 32767.0) as i16).collect();
    PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default())
}

/// A ball of tissue of radius `r` mm in the middle of a cube of `n` voxels of `h` mm. Its values are linear in the
/// distance from the centre.
fn ball(n: usize, h: f64, r: f64, slope: f64) -> (PreparedVolume, DVec3) {
    let centre = DVec3::new(-7.0, 11.0, 3.0) + 0.5 * (n as f64 - 1.0) * h + DVec3::new(0.03, 0.11, 0.07);
    let f = |p: DVec3| -650.0 - slope * (p.distance(centre) - r);
    (volume([n; 3], DVec3::splat(h), DMat3::IDENTITY, f), centre)
}

/// Checks that every side is traversed once in each direction, and returns vertices − sides + triangles.
fn euler(mesh: &Mesh) -> i64 {
    let mut sides: BTreeMap<(u32, u32), i32> = BTreeMap::new();
    for &[a, b, c] in mesh.triangles() {
        assert!(a != b && b != c && c != a);
        for s in [(a, b), (b, c), (c, a)] {
            *sides.entry(s).or_default() += 1;
        }
    }
    for (&(a, b), &n) in &sides {
        assert_eq!((n, sides.get(&(b, a))), (1, Some(&1)), "the side from {a} to {b} has one triangle on either hand");
    }
    let mut used: Vec<u32> = mesh.triangles().as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    assert_eq!(used.len(), mesh.places().len(), "every vertex is used");
    mesh.places().len() as i64 - sides.len() as i64 / 2 + mesh.triangles().len() as i64
}

fn area_and_volume(mesh: &Mesh) -> (f64, f64) {
    let corner = |t: &[u32; 3]| t.map(|v| mesh.places()[v as usize].as_dvec3());
    let area = |t: &[u32; 3]| {
        let [a, b, c] = corner(t);
        0.5 * (b - a).cross(c - a).length()
    };
    let volume = |t: &[u32; 3]| {
        let [a, b, c] = corner(t);
        a.dot(b.cross(c)) / 6.0
    };
    (mesh.triangles().iter().map(area).sum(), mesh.triangles().iter().map(volume).sum())
}

#[test]
fn a_ball_is_closed_and_its_area_converges_at_order_two() {
    let r = 10.0;
    let exact = 4.0 * std::f64::consts::PI * r * r;
    let errors: Vec<f64> = [16, 32, 64]
        .iter()
        .map(|&n| {
            let (volume, centre) = ball(n, 26.0 / n as f64, r, 1000.0);
            let mesh = Mesh::new(&volume).unwrap();
            assert_eq!(euler(&mesh), 2, "a sphere");
            let (area, volume) = area_and_volume(&mesh);
            assert!(volume > 0.0, "wound so that the tissue is inside");
            for v in 0..mesh.places().len() as u32 {
                let out = (mesh.world(v) - centre).normalize();
                assert!((mesh.world(v).distance(centre) - r).abs() < 0.03 * (26.0 / n as f64).powi(2));
                assert!(mesh.normal(v).as_dvec3().angle_between(-out).to_degrees() < 0.5, "it points into the tissue");
            }
            (area - exact).abs()
        })
        .collect();
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((1.8..2.3).contains(&order), "{errors:?}: {order}");
    }
}

#[test]
fn vertices_lie_on_the_wall_that_rays_see() {
    let shear = DMat3::from_cols(DVec3::NEG_X, DVec3::new(0.0, 0.8, 0.6), DVec3::new(0.1, -0.6, 0.9));
    for direction in [DMat3::IDENTITY, shear, DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0))] {
        let s = volume([9, 8, 7], DVec3::new(0.5, 0.7, 2.0), direction, |p| {
            2000.0 * hash::uniform(3, p.x.to_bits() ^ p.y.to_bits() << 1 ^ p.z.to_bits() << 2) - 1400.0
        });
        let mesh = Mesh::new(&s).unwrap();
        for v in 0..mesh.places().len() as u32 {
            assert!((f64::from(value(&s, mesh.world(v))) + 650.0).abs() < 0.1);
        }
        assert!(area_and_volume(&mesh).1 > 0.0, "mirrored grids too are wound towards the gas");
        assert_eq!(euler(&mesh) % 2, 0, "closed, orientable");
    }
}

#[test]
fn noise_makes_no_crack() {
    // These volumes contain every ambiguous face and every border.
    for seed in 0..20u64 {
        let s = volume([13, 17, 11], DVec3::ONE, DMat3::IDENTITY, |p| {
            let share = [0.5, 0.1, 0.9][seed as usize % 3];
            let u = |k: u64| hash::uniform(seed + k, (p.x * 1.0 + p.y * 100.0 + p.z * 10_000.0).to_bits());
            // Some values are exactly at the wall.
            if u(900) < 0.1 {
                -650.0
            } else if u(0) < share {
                -650.0 - 300.0 * u(77)
            } else {
                -650.0 + 500.0 * u(99)
            }
        });
        assert_eq!(euler(&Mesh::new(&s).unwrap()) % 2, 0);
    }
}

#[test]
fn a_ring_has_a_hole_and_two_balls_are_two() {
    let c = DVec3::new(-7.0, 11.0, 3.0) + 15.0;
    let ring = volume([31; 3], DVec3::ONE, DMat3::IDENTITY, |p| {
        let d = p - c;
        let tube = (d.truncate().length() - 8.0).hypot(d.z);
        -650.0 - 200.0 * (tube - 3.3)
    });
    assert_eq!(euler(&Mesh::new(&ring).unwrap()), 0);
    let two = volume([31; 3], DVec3::ONE, DMat3::IDENTITY, |p| {
        let d = (p - c - DVec3::X * 7.0).length().min((p - c + DVec3::X * 7.0).length());
        -650.0 - 200.0 * (d - 4.6)
    });
    assert_eq!(euler(&Mesh::new(&two).unwrap()), 4);
}

#[test]
fn a_diagonal_pair_meets_where_the_saddle_is_solid() {
    // Two solid voxels across a face, with neighbours slightly or far below the wall.
    let pair = |gas: f64| {
        volume([2, 2, 1], DVec3::ONE, DMat3::IDENTITY, |p| {
            let d = p - DVec3::new(-7.0, 11.0, 3.0);
            if (d.x > 0.5) == (d.y > 0.5) { -600.0 } else { gas }
        })
    };
    assert_eq!(euler(&Mesh::new(&pair(-655.0)).unwrap()), 2, "one body");
    assert_eq!(euler(&Mesh::new(&pair(-1000.0)).unwrap()), 4, "two bodies");
}

#[test]
fn volumes_without_a_wall_or_of_a_few_voxels() {
    let flat = |dims, hu: f64| Mesh::new(&volume(dims, DVec3::ONE, DMat3::IDENTITY, |_| hu)).unwrap();
    for dims in [[1, 1, 1], [2, 2, 2], [5, 1, 1], [70, 3, 2]] {
        assert!(flat(dims, -1000.0).triangles().is_empty() && flat(dims, -1000.0).bytes() == 0);
        // The air outside closes tissue that reaches the border.
        for hu in [-650.0, 40.0, 32767.0] {
            assert_eq!(euler(&flat(dims, hu)), 2, "{dims:?} {hu}");
        }
    }
    // If even air is wall, gas in it is a bubble.
    let volume = flat_volume(-2000);
    let solid_air = PreparedVolume::new(volume, TransferFunction::new(-1500.0, -1400.0).unwrap());
    assert_eq!(euler(&Mesh::new(&solid_air).unwrap()), 2);
}

fn flat_volume(hu: i16) -> Arc<Volume> {
    let grid = Grid::new([3; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    Arc::new(Volume::new(grid, vec![hu; 27]))
}

#[test]
fn blocks_hold_all_triangles_and_any_number_of_threads_makes_the_same() {
    let (s, _) = ball(80, 0.4, 12.0, 300.0);
    let mesh = Mesh::new(&s).unwrap();
    let mut next = 0;
    for b in mesh.blocks() {
        assert_eq!(b.first, next);
        next += b.count;
        for v in mesh.triangles()[b.first as usize..next as usize].as_flattened() {
            assert!(mesh.places()[*v as usize].distance(b.centre) <= b.radius);
        }
    }
    assert_eq!(next as usize, mesh.triangles().len());
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool.install(|| Mesh::new(&s).unwrap()), mesh);
    }
    assert!(mesh.places().iter().all(|p: &Vec3| p.is_finite()));
}
