//! The lower parts of both lungs, with airways, and the heart between them.

use glam::DVec3;

use super::organ::{Organ, organ};
use super::paint::Paint;
use super::profile::smooth_min;
use super::stream::stream;
use super::texture::lung_texture;

/// A lung in an adult's mm LPS: the middle and half axes of its outline across the body, and the diaphragm beneath it, highest
/// in the middle.
struct Lung {
    middle: [f64; 2],
    half: [f64; 2],
    dome: f64,
    drop: f64,
}

/// The left and the right lung.
const LUNGS: [Lung; 2] = [
    Lung { middle: [86.0, 42.0], half: [50.0, 60.0], dome: 186.0, drop: 20.0 },
    Lung { middle: [-82.0, 28.0], half: [54.0, 72.0], dome: 172.0, drop: 24.0 },
];

/// The heart.
const HEART: Organ = organ([14.0, -38.0, 214.0], [52.0, 46.0, 30.0], 45.0);

/// Thickness of the diaphragm, mm.
const DIAPHRAGM_MM: f64 = 3.5;
/// Fillet between a lung's side and its base, an adult's mm.
const FILLET_MM: f64 = 10.0;
/// Thickness of an airway's wall, mm.
const WALL_MM: f64 = 1.2;

/// An airway: its ends in an adult's mm and the radius of its bore, mm.
#[derive(Clone, Copy, Debug)]
struct Airway {
    from: DVec3,
    to: DVec3,
    radius: f64,
}

/// The lungs of a body.
#[derive(Clone, Debug)]
pub(crate) struct Chest {
    seed: u64,
    /// Mean HU of both lungs, and how strong their texture is.
    hu: f64,
    strength: f64,
    /// Airways of the left and the right lung.
    airways: [Vec<Airway>; 2],
}

impl Chest {
    /// Creates the lungs; they have emphysema for seeds divisible by four. `texture` is the seed of their texture.
    pub(crate) fn new(texture: u64, seed: u64) -> Self {
        let sick = seed.is_multiple_of(4);
        let mut draw = stream(seed, 106);
        let mut airways = |side: f64| {
            let root = DVec3::new(side * 62.0, 26.0, 216.0);
            (0..4)
                .map(|i| {
                    let (x, y) = (draw.within(-10.0, 44.0), [-40.0, -12.0, 18.0, 46.0][i] + draw.within(-8.0, 8.0));
                    let to = DVec3::new(root.x + side * x, 28.0 + 0.7 * y, draw.within(186.0, 196.0));
                    Airway { from: root, to, radius: 0.5 * draw.within(4.2, 7.8) }
                })
                .collect()
        };
        let airways = [airways(1.0), airways(-1.0)];
        let (hu, strength) = if sick { (-935.0, 0.35) } else { (-870.0, 1.0) };
        Self { seed: texture, hu, strength, airways }
    }

    /// Returns the depth inside the nearer lung at `o` (an adult's mm), less the heart, in an adult's mm; negative outside.
    pub(crate) fn depth(&self, o: DVec3) -> f64 {
        let heart = HEART.depth(o);
        LUNGS[usize::from(o.x < 0.0)].depth(o).min(-heart - 2.0)
    }

    /// Paints both lungs at `p` (world, mm) in a body of `scale`.
    pub(crate) fn paint(&self, p: DVec3, scale: f64, paint: &mut Paint) {
        let o = p / scale;
        if o.z < LUNGS[1].dome - LUNGS[1].drop - 12.0 - paint.edge / scale {
            return;
        }
        let heart = HEART.depth(o) * scale;
        let side = usize::from(o.x < 0.0);
        let lung = LUNGS[side].depth(o) * scale;
        paint.over(lung + DIAPHRAGM_MM, 50.0);
        paint.over(heart, 45.0);
        let d = lung.min(-heart - 2.0 * scale);
        let inside = d > -paint.edge;
        // The texture's own mean is taken off.
        let texture = if inside { self.strength * (lung_texture(self.seed, p, side as u64) - TEXTURE_HU) } else { 0.0 };
        paint.over(d, self.hu + texture);
        if !inside {
            return;
        }
        paint.varies();
        for airway in &self.airways[side] {
            let along = airway.to - airway.from;
            let t = ((o - airway.from).dot(along) / along.length_squared()).clamp(0.0, 1.0);
            let bore = airway.radius * scale.max(0.75) - (o - airway.from - along * t).length() * scale;
            paint.over((bore + WALL_MM).min(d - 1.0), 0.0);
            paint.over(bore.min(d - 1.0 - WALL_MM), -1000.0);
        }
    }
}

/// Mean of the texture, HU.
const TEXTURE_HU: f64 = -10.0;

impl Lung {
    /// Returns the depth inside at `o`, in an adult's mm: a lower bound of the distance.
    fn depth(&self, o: DVec3) -> f64 {
        let (x, y) = ((o.x - self.middle[0]) / self.half[0], (o.y - self.middle[1]) / self.half[1]);
        let off = x * x + y * y;
        let side = (1.0 - off.sqrt()) * self.half[0].min(self.half[1]);
        // Beyond the outline the diaphragm continues level.
        let base = o.z - (self.dome - self.drop * off.min(1.0));
        let slope = 2.0 * self.drop / self.half[0].min(self.half[1]);
        smooth_min(side, base / (1.0 + slope * slope).sqrt(), FILLET_MM)
    }
}
