//! Places for lesions on the wall of a scan.

use glam::{DVec3, Vec3};

use super::form::Root;
use crate::math::hash::Stream;
use crate::phantom::PolypSite;
use crate::polyps::Wall;

/// The crest of a fold is sharp one way and straight the other way: limits of the curvatures, 1/mm, and of their ratio.
const CREST: f32 = 0.16;
const STRAIGHT: f32 = 0.35;
/// Without a crest within this distance of its rim, a lesion is on the plain wall, mm; with one within the second, it is beside a fold.
const AWAY_MM: f64 = 4.0;
const BESIDE_MM: f64 = 5.0;
/// Places tried for one wish.
const TRIES: usize = 60;
/// The wall's direction is the mean over this share of a lesion's radius, at least so many mm; on a crest, over the second.
const SHARE: f64 = 0.7;
const LEAST_MM: f64 = 1.5;
const CREST_MM: f64 = 2.5;

/// The wall with what the search for places needs of it.
pub(super) struct Sites<'a> {
    wall: &'a Wall,
    crests: Vec<u32>,
    is_crest: Vec<bool>,
}

impl<'a> Sites<'a> {
    pub(super) fn new(wall: &'a Wall) -> Self {
        let is_crest: Vec<bool> = (0..wall.len() as u32)
            .map(|v| {
                let [k1, k2] = wall.curvatures(v);
                k1 > CREST && k2.abs() < STRAIGHT * k1
            })
            .collect();
        let crests = (0..wall.len() as u32).filter(|&v| is_crest[v as usize]).collect();
        Self { wall, crests, is_crest }
    }

    /// Draws a place of a kind for a lesion of this radius, mm; `accepts` says whether a place on the wall (world, mm) may be taken.
    pub(super) fn draw(
        &self,
        site: PolypSite,
        radius_mm: f64,
        draw: &mut Stream,
        accepts: impl Fn(DVec3) -> bool,
    ) -> Option<Root> {
        let wall = self.wall;
        for _ in 0..TRIES {
            let v = match site {
                PolypSite::Fold if self.crests.is_empty() => return None,
                PolypSite::Fold => self.crests[draw.below(self.crests.len())],
                _ => draw.below(wall.len()) as u32,
            };
            let place = wall.world(v);
            if !accepts(place) {
                continue;
            }
            let away = radius_mm + if site == PolypSite::Between { BESIDE_MM } else { AWAY_MM };
            let around = self.around(v, away);
            let near = around.iter().filter(|&&n| self.is_crest[n as usize]);
            let nearest = near.map(|&n| wall.world(n).distance(place)).fold(f64::INFINITY, f64::min);
            let fits = match site {
                PolypSite::Fold => true,
                PolypSite::Wall => nearest > away,
                PolypSite::Between => (radius_mm..=away).contains(&nearest),
            };
            if !fits {
                continue;
            }
            let over = if site == PolypSite::Fold { CREST_MM } else { (SHARE * radius_mm).max(LEAST_MM) };
            let near = around.iter().filter(|&&n| wall.world(n).distance(place) <= over);
            let up = near.map(|&n| wall.normal(n) * wall.area(n)).sum::<Vec3>().as_dvec3().normalize_or_zero();
            if up != DVec3::ZERO && up.dot(wall.normal(v).as_dvec3()) > 0.7 {
                return Some(Root { place, up, site });
            }
        }
        None
    }

    /// Returns the vertices that are joined to one by vertices within a distance of it, mm.
    fn around(&self, vertex: u32, mm: f64) -> Vec<u32> {
        let from = self.wall.world(vertex);
        let (mut out, mut seen) = (vec![vertex], std::collections::BTreeSet::from([vertex]));
        let mut next = 0;
        while next < out.len() {
            for &n in self.wall.beside(out[next]) {
                if self.wall.world(n).distance(from) <= mm && seen.insert(n) {
                    out.push(n);
                }
            }
            next += 1;
        }
        out
    }
}
