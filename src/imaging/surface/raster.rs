//! Rendering of the mesh with a z-buffer.
//!
//! Blocks of triangles outside the view are culled. The others are sorted from near to far and assigned to the screen
//! tiles that they may touch. A tile is finished when the next block is farther than everything in it, so triangles
//! behind the wall cost nothing. Pixels are shaded at the end, once each, by the ray through their centre.

use std::sync::Arc;

use glam::{DMat3, DVec3, Mat3A, Vec3, Vec3A};
use rayon::prelude::*;

use super::clip::{Corner, Screen};
use super::mesh::{Block, Mesh};
use super::tile::{NONE, TILE, Tile};
use crate::error::Result;
use crate::render::regression::to_world;
use crate::render::sampler::{Sampler, Trilinear};
use crate::render::shaders::headlight::{AMBIENT, DIFFUSE};
use crate::render::transfer::Palette;
use crate::render::{CameraRay, Frame, MemoryPart, Renderer, Settings, View, Work, render};
use crate::space::{PreparedVolume, value};

/// The near plane, as a share of the smallest spacing.
const NEAR: f64 = 0.02;

/// The indirect method as a renderer.
///
/// Opacity is that of a surface: full at the wall. Triangles stay straight only in the images of perspective cameras,
/// so the direct method renders images of other cameras, ray by ray.
pub struct Rasteriser {
    volume: PreparedVolume,
    mesh: Arc<Mesh>,
    colour: Vec3,
}

/// A block that may be visible.
struct Seen {
    /// Smallest z of its ball, mm.
    nearest: f32,
    block: u32,
    /// First and last tile along x and y.
    tiles: [[u16; 2]; 2],
}

/// The camera in mesh coordinates.
struct Eye {
    /// Position relative to the mesh's origin, mm.
    at: DVec3,
    /// The same in single precision, accurate to a thousandth of a voxel within a patient.
    near_at: Vec3A,
    /// Rotation, with the rows right, down and ahead.
    turn: Mat3A,
    screen: Screen,
    size: [usize; 2],
}

impl Eye {
    fn new(view: &View, tangent: f64, mesh: &Mesh, near: f32) -> Self {
        let size = [view.width(), view.height()];
        let focal = 0.5 * size[0].min(size[1]) as f64 / tangent;
        let at = view.position() - mesh.origin();
        Self {
            at,
            near_at: at.as_vec3a(),
            turn: Mat3A::from(DMat3::from_cols(view.right(), -view.up(), view.forward()).transpose().as_mat3()),
            screen: Screen { focal: focal as f32, middle: size.map(|n| 0.5 * n as f32), near },
            size,
        }
    }

    /// Returns the camera coordinates of a vertex.
    #[inline(always)]
    fn see(&self, place: Vec3) -> Vec3 {
        (self.turn * (Vec3A::from(place) - self.near_at)).into()
    }

    /// Returns the tiles that a block may touch, or `None` if it is out of view.
    fn look(&self, number: usize, block: &Block) -> Option<Seen> {
        let c = self.see(block.centre);
        let r = block.radius;
        if c.z + r < self.screen.near {
            return None;
        }
        let nearest = c.z - r;
        let mut tiles = [[0; 2]; 2];
        for a in 0..2 {
            let pixels = self.size[a] as f32;
            let (low, high) = if nearest <= self.screen.near {
                (0.0, pixels)
            } else {
                // The ball's bounding box, seen at the end that extends farther outwards.
                let edge = |v: f32, outward: bool| {
                    let z = if outward { nearest } else { c.z + r };
                    v / z * self.screen.focal + self.screen.middle[a]
                };
                let (low, high) = (c[a] - r, c[a] + r);
                (edge(low, low < 0.0) - 1.0, edge(high, high > 0.0) + 1.0)
            };
            if high < 0.0 || low > pixels {
                return None;
            }
            tiles[a] = [low.max(0.0), high.min(pixels - 1.0)].map(|p| (p as usize / TILE) as u16);
        }
        Some(Seen { nearest: nearest.max(self.screen.near), block: number as u32, tiles })
    }
}

impl Rasteriser {
    /// Extracts the mesh of the wall of `volume` and creates a renderer for it.
    ///
    /// # Errors
    /// Fails as [`Mesh::new`] does.
    pub fn new(volume: &PreparedVolume) -> Result<Self> {
        Ok(Self::of(volume, Arc::new(Mesh::new(volume)?)))
    }

    /// Creates a renderer of `mesh`, the wall of `volume`.
    pub fn of(volume: &PreparedVolume, mesh: Arc<Mesh>) -> Self {
        let colour = Palette::default().colour(volume.transfer().iso() as f32);
        Self { volume: volume.clone(), mesh, colour }
    }

    /// Returns the mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Returns the headlight's colour for the wall normal `normal` (any length; zero in a homogeneous region).
    fn shade(&self, normal: Vec3, direction: Vec3) -> [u8; 3] {
        let normal = normal.normalize_or_zero();
        let facing = if normal == Vec3::ZERO { 1.0 } else { normal.dot(direction).max(0.0) };
        (self.colour * (AMBIENT + DIFFUSE * facing)).to_array().map(|c| (c * 255.0 + 0.5) as u8)
    }

    /// Renders the picture from within the tissue, shaded by the gradient at the camera.
    fn blind(&self, view: &View, frame: &mut Frame) -> Work {
        let voxels = self.volume.voxels();
        let q = voxels.grid().voxel(view.position()) + DVec3::ONE;
        let normal = to_world(voxels) * Trilinear::new(&self.volume).fit(q.as_vec3()).gradient;
        let (width, rays) = (view.width(), (view.width() * view.height()) as u64);
        let (pixels, depth) = frame.buffers();
        for (n, p) in pixels.iter_mut().enumerate() {
            *p = view.ray(n % width, n / width).map_or([0; 3], |ray| self.shade(normal, ray.direction.as_vec3()));
        }
        if let Some(depth) = depth {
            depth.fill(0.0);
        }
        Work { rays, ..Work::default() }
    }

    /// Draws a tile from the blocks that may touch it, nearest first.
    fn draw(&self, eye: &Eye, seen: &[Seen], list: &[u32], [tx, ty]: [usize; 2]) -> Tile {
        let mut tile = Tile::new(tx * TILE, ty * TILE, [eye.size[0] - tx * TILE, eye.size[1] - ty * TILE]);
        let mut farthest = f32::INFINITY;
        for &n in list {
            let s = &seen[n as usize];
            if s.nearest > farthest {
                break;
            }
            let block = self.mesh.blocks[s.block as usize];
            let mut changed = false;
            for id in block.first..block.first + block.count {
                let corners = self.mesh.triangles[id as usize].map(|v| eye.see(self.mesh.places[v as usize]));
                let mut out = [Corner::default(); 4];
                let n = eye.screen.clip(corners, &mut out);
                changed |= tile.draw(&out, n, id);
            }
            if changed {
                farthest = tile.farthest();
            }
        }
        tile
    }

    /// Returns colour and depth of a pixel that shows triangle `id`.
    fn pixel(&self, eye: &Eye, view: &View, id: u32, x: usize, y: usize) -> ([u8; 3], f32) {
        let Some(CameraRay { direction, .. }) = view.ray(x, y) else { return ([0; 3], f32::INFINITY) };
        let vertices = self.mesh.triangles[id as usize];
        let [a, b, c] = vertices.map(|v| self.mesh.places[v as usize].as_dvec3() - eye.at);
        // The ray meets the triangle's plane where these three volumes balance (Möller and Trumbore 1997).
        let shares = [direction.dot(b.cross(c)), direction.dot(c.cross(a)), direction.dot(a.cross(b))];
        let sum: f64 = shares.iter().sum();
        let distance = a.dot(b.cross(c)) / sum;
        // A triangle seen exactly edge-on has no such point. A pixel on its rim must not be placed beyond its corners either.
        let bounds = [a, b, c].map(DVec3::length);
        let (near, far) = (bounds[0].min(bounds[1]).min(bounds[2]), bounds[0].max(bounds[1]).max(bounds[2]));
        let distance = if distance.is_finite() { distance.clamp(0.0, far) } else { near };
        let share = shares.map(|s| if sum == 0.0 { 1.0 / 3.0 } else { (s / sum).clamp(0.0, 1.0) as f32 });
        let normals = vertices.map(|v| self.mesh.normals[v as usize].vector());
        let normal = normals[0] * share[0] + normals[1] * share[1] + normals[2] * share[2];
        (self.shade(normal, direction.as_vec3()), distance as f32)
    }
}

impl Renderer for Rasteriser {
    fn render(&mut self, view: &View, frame: &mut Frame) -> Work {
        let Some(tangent) = view.camera().tangent() else {
            return render(&self.volume, view, &Settings::default(), frame);
        };
        frame.resize(view.width(), view.height());
        if f64::from(value(&self.volume, view.position())) >= self.volume.transfer().iso() {
            return self.blind(view, frame);
        }
        let near = (self.volume.voxels().grid().min_spacing() * NEAR) as f32;
        let eye = Eye::new(view, tangent, &self.mesh, near);
        let look = |(n, block)| eye.look(n, block);
        let mut seen: Vec<Seen> = self.mesh.blocks.par_iter().enumerate().filter_map(look).collect();
        seen.par_sort_unstable_by(|a, b| a.nearest.total_cmp(&b.nearest).then(a.block.cmp(&b.block)));
        let across = view.width().div_ceil(TILE);
        let mut lists = vec![Vec::new(); across * view.height().div_ceil(TILE)];
        for (n, s) in seen.iter().enumerate() {
            let [x, y] = s.tiles.map(|[low, high]| usize::from(low)..=usize::from(high));
            for ty in y {
                for tx in x.clone() {
                    lists[ty * across + tx].push(n as u32);
                }
            }
        }
        let (pixels, depth) = frame.buffers();
        let band = TILE * view.width();
        // Depth is optional: empty bands stand in if it was not requested.
        let mut none = vec![Vec::new(); lists.len() / across];
        let depths: Vec<&mut [f32]> = match depth {
            Some(depth) => depth.chunks_mut(band).collect(),
            None => none.iter_mut().map(Vec::as_mut_slice).collect(),
        };
        let bands = pixels.par_chunks_mut(band).zip(depths).enumerate();
        let work = bands.map(|(ty, (pixels, depth))| {
            let rows = pixels.len() / view.width();
            let mut work = Work::default();
            let tiles: Vec<Tile> = (0..across)
                .into_par_iter()
                .map(|tx| self.draw(&eye, &seen, &lists[ty * across + tx], [tx, ty]))
                .collect();
            work.samples = tiles.iter().map(|t| t.tests).sum();
            work.rays = pixels.len() as u64;
            for (n, out) in pixels.iter_mut().enumerate() {
                let (x, y) = (n % view.width(), n / view.width());
                debug_assert!(y < rows);
                let id = tiles[x / TILE].triangle(x % TILE, y);
                let (colour, distance) = match id {
                    NONE => ([0; 3], f32::INFINITY),
                    id => self.pixel(&eye, view, id, x, ty * TILE + y),
                };
                *out = colour;
                if let Some(d) = depth.get_mut(n) {
                    *d = distance;
                }
            }
            work
        });
        work.reduce(Work::default, |a, b| a + b)
    }

    fn parts(&self) -> Vec<(MemoryPart, usize)> {
        vec![(MemoryPart::Mesh, self.mesh.bytes())]
    }
}
