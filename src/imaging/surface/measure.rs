//! Measurements of a closed surface.

use glam::DVec3;

use super::islands;
use super::lumen::LumenMesh;

/// Measures of a closed surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Measures {
    /// Number of triangles.
    pub triangles: usize,
    /// Number of vertices.
    pub vertices: usize,
    /// Area, mm².
    pub area_mm2: f64,
    /// Enclosed volume, ml (divergence theorem).
    pub volume_ml: f64,
    /// Number of connected components.
    pub components: usize,
    /// Number of sides that do not have one triangle on either side: 0.
    pub boundary_edges: usize,
}

impl Measures {
    /// Measures a surface.
    pub fn of(mesh: &LumenMesh) -> Self {
        // Measured from a point near the surface, so that no digits are lost.
        let place = |v: u32| mesh.places[v as usize].as_dvec3();
        let (mut area, mut volume) = (0.0, 0.0);
        for t in &mesh.triangles {
            let [a, b, c] = t.map(place);
            area += 0.5 * (b - a).cross(c - a).length();
            volume += tetrahedron(a, b, c);
        }
        Self {
            triangles: mesh.triangles.len(),
            vertices: mesh.places.len(),
            area_mm2: area,
            volume_ml: volume / 1000.0,
            components: islands::components(mesh).1,
            boundary_edges: boundary_edges(mesh),
        }
    }
}

/// Returns the signed volume between a triangle and the origin.
fn tetrahedron(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    a.dot(b.cross(c)) / 6.0
}

/// Returns the number of sides that are not traversed once in each direction.
fn boundary_edges(mesh: &LumenMesh) -> usize {
    let mut begins = vec![0u32; mesh.places.len() + 1];
    let sides = || mesh.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
    for (a, _) in sides() {
        begins[a as usize + 1] += 1;
    }
    for n in 1..begins.len() {
        begins[n] += begins[n - 1];
    }
    let (mut next, mut ends) = (begins.clone(), vec![0u32; 3 * mesh.triangles.len()]);
    for (a, b) in sides() {
        ends[next[a as usize] as usize] = b;
        next[a as usize] += 1;
    }
    let times = |a: u32, b: u32| {
        ends[begins[a as usize] as usize..begins[a as usize + 1] as usize].iter().filter(|&&e| e == b).count()
    };
    sides().filter(|&(a, b)| times(a, b) != 1 || times(b, a) != 1).count()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn a_tetrahedron_has_its_area_and_volume() {
        // Three sides of 3, 4 and 5 mm meet at right angles, away from the origin.
        let corner = Vec3::new(10.0, 20.0, 30.0);
        let places = [Vec3::ZERO, Vec3::X * 3.0, Vec3::Y * 4.0, Vec3::Z * 5.0].map(|p| corner + p).to_vec();
        let triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let mut mesh = LumenMesh { origin: DVec3::splat(1e4), places, triangles };
        let m = Measures::of(&mesh);
        assert_eq!((m.triangles, m.vertices, m.components, m.boundary_edges), (4, 4, 1, 0));
        // 3 · 4 / 2 + 3 · 5 / 2 + 4 · 5 / 2, and half the length of (20, 15, 12).
        assert!((m.area_mm2 - (23.5 + 0.5 * 769f64.sqrt())).abs() < 1e-9, "{}", m.area_mm2);
        assert!((m.volume_ml - 0.01).abs() < 1e-12, "{}: 3 · 4 · 5 / 6 mm³", m.volume_ml);
        mesh.triangles.pop();
        assert_eq!(Measures::of(&mesh).boundary_edges, 3, "open where a triangle is missing");
    }
}
