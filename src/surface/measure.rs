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
