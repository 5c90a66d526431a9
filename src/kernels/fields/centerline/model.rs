//! A line through the lumen, and where a body does not fit along it.

use glam::DVec3;

/// Radius of the body that an opening should let pass, mm: the camera's.
pub const BODY_MM: f64 = 1.5;
/// What is narrow this close to an end of a line is the end's own place, mm.
const END_MM: f64 = 3.0;

/// A line through the lumen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Centerline {
    /// World positions, mm, about 1 mm apart.
    pub points: Vec<DVec3>,
    /// Distance to the wall at each point, mm; 0 on guessed stretches.
    pub radius_mm: Vec<f64>,
    /// Length, mm.
    pub length_mm: f64,
    /// Stretches (from, to; mm along the line) where the lumen is collapsed and the line is only a guess.
    pub guessed: Vec<[f64; 2]>,
}

/// A stretch of a line that a body does not fit through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Narrow {
    /// Its narrowest place, world, mm.
    pub at: DVec3,
    /// Distance of that place from the line's start, mm.
    pub along_mm: f64,
    /// Distance to the wall there, mm.
    pub radius_mm: f64,
}

impl Centerline {
    /// Returns the stretches where the wall is nearer than `least_mm`, in order, without guessed stretches.
    pub fn narrows(&self, least_mm: f64) -> Vec<Narrow> {
        let mut found: Vec<Narrow> = Vec::new();
        let (mut along_mm, mut is_narrow) = (0.0, false);
        for (n, (&at, &radius_mm)) in self.points.iter().zip(&self.radius_mm).enumerate() {
            along_mm += n.checked_sub(1).map_or(0.0, |before| self.points[before].distance(at));
            let is_guessed = self.guessed.iter().any(|[a, b]| (*a..=*b).contains(&along_mm));
            let was_narrow = std::mem::replace(&mut is_narrow, radius_mm < least_mm && !is_guessed);
            if is_narrow {
                let here = Narrow { at, along_mm, radius_mm };
                match found.last_mut().filter(|_| was_narrow) {
                    Some(last) if last.radius_mm <= radius_mm => {}
                    Some(last) => *last = here,
                    None => found.push(here),
                }
            }
        }
        found
    }

    /// Returns the stretches through which the camera does not fit, in order. Narrow stretches at the line's ends do not count: a line may
    /// begin at the wall.
    pub fn impassable(&self) -> Vec<Narrow> {
        let is_inner = |n: &Narrow| n.along_mm > END_MM && n.along_mm < self.length_mm - END_MM;
        self.narrows(BODY_MM).into_iter().filter(is_inner).collect()
    }
}
