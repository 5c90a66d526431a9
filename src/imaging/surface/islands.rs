//! Removal of islands in the lumen: what the lumen encloses on all sides is not wall.

use glam::DVec3;

use super::lumen::LumenMesh;

/// Returns the connected component of every vertex, numbered from 0 in the order of their first vertices, and the
/// number of components.
pub(super) fn components(mesh: &LumenMesh) -> (Vec<u32>, usize) {
    let mut parent: Vec<u32> = (0..mesh.places.len() as u32).collect();
    let find = |parent: &mut [u32], mut v: u32| {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    };
    for &[a, b, c] in &mesh.triangles {
        for (p, q) in [(a, b), (b, c)] {
            let (p, q) = (find(&mut parent, p), find(&mut parent, q));
            parent[p.max(q) as usize] = p.min(q);
        }
    }
    let mut count = 0;
    for v in 0..parent.len() {
        // A root is the smallest vertex of its component. It was numbered before the others, and until then it is its own parent.
        let p = parent[v] as usize;
        parent[v] = if p == v {
            count += 1;
            count - 1
        } else {
            parent[p]
        };
    }
    (parent, count as usize)
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
