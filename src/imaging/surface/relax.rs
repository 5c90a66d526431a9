//! Smoothing of vertices whose positions the values do not determine.
//!
//! Half-way between two voxels of a mask, vertices form steps. Each may slide along its own grid edge, so every voxel's centre
//! stays on its side of the surface and no triangle turns over (the constrained surfaces of Gibson 1998, Whitaker 2000). Steps of
//! the umbrella operator alone would shrink round shapes; every second step goes back slightly farther (Taubin 1995).

use glam::Vec3;
use rayon::prelude::*;

use super::slider::{KEEP_OFF, Slider};
use crate::error::Result;
use crate::progress::Progress;

/// Forward and backward step factors: Taubin's λ and μ.
const STEPS: [f32; 2] = [0.5, -0.52];
/// Number of rounds of both steps.
const ROUNDS: usize = 12;

/// Slides the `free` vertices of closed `triangles` along their edges. `steps` are the vectors along the grid's edges, mm, and `places` those of
/// all vertices.
pub(super) fn relax(
    (places, mut free): (&mut [Vec3], Vec<Slider>),
    steps: &[Vec3; 3],
    triangles: &[[u32; 3]],
    progress: &Progress,
) -> Result<()> {
    if free.is_empty() {
        return Ok(());
    }
    let (begins, beside) = neighbours(&free, places.len(), triangles);
    progress.check()?;
    for _ in 0..ROUNDS {
        progress.check()?;
        for factor in STEPS {
            let moved: Vec<f32> = free
                .par_iter()
                .enumerate()
                .map(|(n, slider)| {
                    let own = places[slider.vertex as usize];
                    let near = &beside[begins[n] as usize..begins[n + 1] as usize];
                    let mean = near.iter().map(|&m| places[m as usize] - own).sum::<Vec3>() / near.len().max(1) as f32;
                    let along = steps[usize::from(slider.axis)];
                    let t = slider.t + factor * mean.dot(along) / along.length_squared();
                    t.clamp(KEEP_OFF, 1.0 - KEEP_OFF)
                })
                .collect();
            for (slider, t) in free.iter_mut().zip(moved) {
                slider.t = t;
                places[slider.vertex as usize] = slider.place(steps);
            }
        }
    }
    Ok(())
}

/// Returns where the neighbours of each vertex of `free` begin, and the neighbours. On a closed mesh each side that
/// leaves a vertex leads to one.
fn neighbours(free: &[Slider], vertices: usize, triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<u32>) {
    const NONE: u32 = u32::MAX;
    let mut number = vec![NONE; vertices];
    for (n, slider) in free.iter().enumerate() {
        number[slider.vertex as usize] = n as u32;
    }
    let sides = || triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
    let mut begins = vec![0u32; free.len() + 1];
    for n in sides().map(|s| number[s.0 as usize]).filter(|&n| n != NONE) {
        begins[n as usize + 1] += 1;
    }
    for n in 1..begins.len() {
        begins[n] += begins[n - 1];
    }
    let mut next = begins.clone();
    let mut beside = vec![0u32; begins[free.len()] as usize];
    for (a, b) in sides() {
        let n = number[a as usize];
        if n != NONE {
            beside[next[n as usize] as usize] = b;
            next[n as usize] += 1;
        }
    }
    (begins, beside)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_free_vertex_nears_the_mean_of_its_neighbours_and_the_others_stay() {
        // An octahedron: a ring of four at height 0.4 mm, the free tip at 0.9, another tip below.
        let ring = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)].map(|(x, y)| Vec3::new(x, y, 0.4));
        let tip = Slider { vertex: 4, base: Vec3::ZERO, axis: 2, t: 0.9 };
        let mut places = ring.to_vec();
        places.extend([Vec3::Z * 0.9, Vec3::Z * -0.5]);
        let before = places.clone();
        let triangles: Vec<[u32; 3]> = (0..4).flat_map(|k| [[k, (k + 1) % 4, 4], [(k + 1) % 4, k, 5]]).collect();
        let steps = [Vec3::X, Vec3::Y, Vec3::Z];
        relax((&mut places, vec![tip]), &steps, &triangles, &Progress::new()).unwrap();
        // A step forward halves the distance to the mean, a step back makes it 1.52 times as long.
        let height = 0.4 + 0.5 * (0.5f32 * 1.52).powi(ROUNDS as i32);
        assert!(places[4].distance(Vec3::Z * height) < 1e-4, "{} instead of {height}", places[4]);
        assert!([0, 1, 2, 3, 5].iter().all(|&v: &usize| places[v] == before[v]), "what the values determine stays");
    }
}
