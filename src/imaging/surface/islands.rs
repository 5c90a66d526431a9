//! Removal of islands in the lumen: what the lumen encloses on all sides is not wall.

use glam::DVec3;

use super::lumen::LumenMesh;
use crate::math::sets::Sets;

/// Returns the connected component of every vertex, numbered from 0 in the order of their first vertices, and the
/// number of components.
pub(super) fn components(mesh: &LumenMesh) -> (Vec<u32>, usize) {
    let mut sets = Sets::new(mesh.places.len());
    for &[a, b, c] in &mesh.triangles {
        sets.join(a, b);
        sets.join(b, c);
    }
    sets.numbered()
}

impl LumenMesh {
    /// Removes the components that enclose something other than lumen (specks in the fluid, floating residue), and
    /// returns the surface with their number. They are wound in the opposite direction, so their volume is negative.
    #[must_use]
    pub fn without_islands(self) -> (Self, usize) {
        let (piece, count) = components(&self);
        let mut volume = vec![0.0; count];
        for t in &self.triangles {
            let [a, b, c]: [DVec3; 3] = t.map(|v| self.places[v as usize].as_dvec3());
            volume[piece[t[0] as usize] as usize] += a.dot(b.cross(c));
        }
        let islands = volume.iter().filter(|&&v| v < 0.0).count();
        if islands == 0 {
            return (self, 0);
        }
        let is_kept = |v: usize| volume[piece[v] as usize] >= 0.0;
        let mut number = vec![0u32; self.places.len()];
        let mut places = Vec::with_capacity(self.places.len());
        for (v, &p) in self.places.iter().enumerate().filter(|&(v, _)| is_kept(v)) {
            number[v] = places.len() as u32;
            places.push(p);
        }
        let kept = self.triangles.iter().filter(|t| is_kept(t[0] as usize));
        let triangles = kept.map(|t| t.map(|v| number[v as usize])).collect();
        (Self { origin: self.origin, places, triangles }, islands)
    }
}
