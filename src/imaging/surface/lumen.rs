//! The surface of the colon's lumen as a closed mesh, for other programs.
//!
//! It is built by marching cubes over the set of the lumen's voxels, with vertices on the edges of the grid where the
//! values place the wall. Nothing outside the grid is lumen: where the lumen meets the scan's faces it is capped, along
//! the outer faces of the outermost voxels. Where the values do not determine a vertex's position on its edge
//! (everywhere on a mask), it is smoothed between its neighbours (see [`relax`](super::relax)).

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::extract::{check_count, each_crossed, triangles};
use super::relax::relax;
use super::signs::{Numbers, Signs};
use super::slider::{KEEP_OFF, Slider};
use crate::error::Result;
use crate::fields::lumen::Interior;
use crate::progress::Progress;

/// A closed surface. Every side has one triangle on either side, and the triangles around a vertex form one fan.
///
/// Positions are single-precision offsets (mm, world directions) from an origin near the volume.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LumenMesh {
    pub(super) origin: DVec3,
    pub(super) places: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl LumenMesh {
    /// Extracts the surface of a lumen on all of rayon's threads. The result is the same for every number of threads.
    ///
    /// # Errors
    /// Returns status 4 if there are more vertices than 32 bits can count, or if interrupted.
    pub fn new(interior: &Interior<'_>, progress: &Progress) -> Result<Self> {
        progress.stage("making the surface", 0);
        let grid = interior.grid();
        let signs = Signs::of_set(interior.set());
        let numbers = Numbers::new(&signs);
        check_count(&numbers)?;
        progress.check()?;
        let steps = [0, 1, 2].map(|a| grid.to_world().matrix3.col(a).as_vec3());
        let (mut places, free) = vertices(interior, &signs, &numbers, &steps);
        progress.check()?;
        let above = |v: [usize; 3]| interior.above(v.map(|x| x as i64 - 1));
        let (triangles, _) = triangles(grid, above, &signs, &numbers, None);
        drop((signs, numbers));
        progress.check()?;
        relax((&mut places, free), &steps, &triangles, progress)?;
        Ok(Self { origin: grid.origin(), places, triangles })
    }

    /// Returns the number of vertices.
    pub fn vertices(&self) -> usize {
        self.places.len()
    }

    /// Returns the world position of a vertex, mm LPS.
    pub fn world(&self, vertex: u32) -> DVec3 {
        self.origin + self.places[vertex as usize].as_dvec3()
    }

    /// Takes the mesh apart: its origin, its vertices as offsets from there, mm, and its triangles.
    #[doc(hidden)]
    pub fn into_parts(self) -> (DVec3, Vec<Vec3>, Vec<[u32; 3]>) {
        (self.origin, self.places, self.triangles)
    }

    /// Returns the triangles, three vertices each, counter-clockwise as seen from outside the lumen. Normals point out
    /// of the lumen, into the tissue.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }
}

/// Creates a vertex for each crossed edge, in their order, as an offset in mm. Those that the values do not place are returned as sliders,
/// too. `steps` are the vectors along the grid's edges.
fn vertices(interior: &Interior<'_>, signs: &Signs, numbers: &Numbers, steps: &[Vec3; 3]) -> (Vec<Vec3>, Vec<Slider>) {
    let grid = interior.grid();
    let dims = grid.dims().map(|n| n as i64);
    let planes: Vec<(Vec<Vec3>, Vec<Slider>)> = (0..signs.dims[2])
        .into_par_iter()
        .map(|z| {
            let first = numbers.before_plane(signs, z);
            let mut places = Vec::with_capacity(numbers.before_plane(signs, z + 1) - first);
            let mut free = Vec::new();
            each_crossed(signs, z, |from, axis| {
                let low = from.map(|x| x as i64 - 1);
                let mut high = low;
                high[axis] += 1;
                let first_inside = interior.set().contains(low);
                let (inside, outside) = if first_inside { (low, high) } else { (high, low) };
                let scanned = (0..dims[axis]).contains(&outside[axis]);
                let reported = if scanned { interior.crossing(inside, outside) } else { Some(0.5) };
                let share = reported.unwrap_or(0.5);
                let t = if first_inside { share } else { 1.0 - share } as f32;
                let base = DVec3::from_array(low.map(|x| x as f64));
                let slider = Slider {
                    vertex: (first + places.len()) as u32,
                    base: grid.to_world().transform_vector3(base).as_vec3(),
                    axis: axis as u8,
                    t: t.clamp(KEEP_OFF, 1.0 - KEEP_OFF),
                };
                places.push(slider.place(steps));
                free.extend(reported.is_none().then_some(slider));
            });
            (places, free)
        })
        .collect();
    let (mut places, mut free) = (Vec::with_capacity(numbers.total() as usize), Vec::new());
    // One after the other, so that they are not in memory twice.
    for (own, sliders) in planes {
        places.extend(own);
        free.extend(sliders);
    }
    (places, free)
}
