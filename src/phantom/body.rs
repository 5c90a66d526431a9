//! The body around the colon: abdominal layers and organs, the spine, the lung bases and the air outside.

use glam::DVec3;

use super::chest::Chest;
use super::kinds::Content;
use super::organ::{Organ, organ};
use super::paint::Paint;
use super::pelvis;
use super::profile::{FAT, GAS, mix, smooth_min, smooth_step};
use super::settings::{PhantomSettings, Position};
use super::texture::lung_texture;

/// Organs in an adult's mm; later ones are painted over earlier ones: liver, spleen, stomach wall, kidneys, psoas
/// muscles, aorta, vena cava, bladder, iliac muscles.
const ORGANS: [Organ; 13] = [
    organ([-62.0, -2.0, 168.0], [84.0, 86.0, 52.0], 62.0),
    organ([112.0, 58.0, 182.0], [30.0, 40.0, 34.0], 50.0),
    organ([40.0, -34.0, 178.0], [46.0, 44.0, 30.0], 42.0),
    organ([58.0, 60.0, 70.0], [26.0, 24.0, 56.0], 36.0),
    organ([-60.0, 62.0, 58.0], [26.0, 24.0, 54.0], 36.0),
    organ([38.0, 70.0, -30.0], [20.0, 20.0, 110.0], 55.0),
    organ([-38.0, 70.0, -30.0], [20.0, 20.0, 110.0], 55.0),
    organ([10.0, 42.0, 90.0], [10.0, 10.0, 160.0], 45.0),
    organ([-16.0, 44.0, 90.0], [11.0, 9.0, 160.0], 42.0),
    organ([0.0, -8.0, -176.0], [38.0, 36.0, 26.0], 8.0),
    organ([92.0, 84.0, -100.0], [34.0, 26.0, 80.0], 55.0),
    organ([-92.0, 84.0, -100.0], [34.0, 26.0, 80.0], 55.0),
    organ([0.0, 122.0, -30.0], [58.0, 14.0, 260.0], 52.0),
];

/// The bit of the stomach's wall among the organs.
const STOMACH: u32 = 1 << 2;

/// The bases of the two lungs. The diaphragm is a shell around them.
const LUNGS: [Organ; 2] =
    [organ([84.0, 24.0, 226.0], [56.0, 72.0, 38.0], -860.0), organ([-84.0, 24.0, 228.0], [56.0, 72.0, 38.0], -860.0)];

const CENTRE: DVec3 = DVec3::new(0.0, 5.0, 0.0);
/// Half axes of the skin, side to side and front to back, mm.
const HALF: [f64; 2] = [164.0, 128.0];

/// Thickness of the diaphragm, mm.
const DIAPHRAGM_MM: f64 = 3.5;

/// The parts of the body that reach into a region.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Near {
    /// One bit for each organ.
    organs: u32,
    lungs: bool,
    spine: bool,
    pelvis: bool,
}

/// The body at a given scale, with edges blurred over a few tenths of a millimetre.
#[derive(Clone, Debug)]
pub(crate) struct Body {
    scale: f64,
    sigma: f64,
    seed: u64,
    position: Position,
    /// The lungs, instead of their bases.
    chest: Option<Chest>,
    pelvis: bool,
    /// One bit for each organ that there is.
    organs: u32,
}

/// A value and the distance over which it stays constant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// HU.
    pub hu: f64,
    /// Radius within which the value is constant, mm; 0 if unknown.
    pub constant_mm: f64,
}

impl Body {
    /// Creates a body of `scale` (1 is an adult) with edges of `sigma` mm.
    pub(crate) fn new(scale: f64, sigma: f64, seed: u64) -> Self {
        let organs = (1 << ORGANS.len()) - 1;
        Self { scale, sigma, seed, position: Position::Supine, chest: None, pelvis: false, organs }
    }

    /// Returns the body of a phantom with these settings: its position on the table and its organs.
    pub(crate) fn with(self, settings: &PhantomSettings) -> Self {
        let chest = settings.lungs.then(|| Chest::new(self.seed, settings.seed));
        let organs = if settings.stomach { self.organs & !STOMACH } else { self.organs };
        Self { position: settings.position, chest, pelvis: settings.pelvis, organs, ..self }
    }

    fn all(&self) -> Near {
        Near { organs: self.organs, lungs: true, spine: true, pelvis: self.pelvis }
    }

    /// Returns what is at `p` (world, mm), without the gut.
    pub(crate) fn content(&self, p: DVec3) -> Content {
        let o = p / self.scale;
        if self.skin(o) < 0.0 {
            let table = (5.0 * self.scale - self.tray(o).abs()) > 0.0;
            return if table { Content::Tissue } else { Content::Outside };
        }
        if self.lung_depth(p) > 0.0 { Content::Lung } else { Content::Tissue }
    }

    /// Returns the depth inside a lung at `p` (world, mm), mm; negative outside.
    pub(crate) fn lung_depth(&self, p: DVec3) -> f64 {
        let o = p / self.scale;
        let depth = match &self.chest {
            Some(chest) => chest.depth(o),
            None => LUNGS.iter().map(|lung| lung.depth(o)).fold(f64::NEG_INFINITY, f64::max),
        };
        depth * self.scale
    }

    /// Returns the depth below the skin at `p` (world, mm), mm: a lower bound of the distance.
    pub(crate) fn skin_depth(&self, p: DVec3) -> f64 {
        self.skin(p / self.scale)
    }

    /// Returns the depth below the skin at `o` (an adult's mm), mm. The side that is down is flat.
    fn skin(&self, o: DVec3) -> f64 {
        let q = o - CENTRE;
        let round =
            (1.0 - ((q.x / HALF[0]).powi(2) + (q.y / HALF[1]).powi(2)).sqrt()) * HALF[0].min(HALF[1]) * self.scale;
        match self.position {
            Position::Supine => round,
            Position::Prone => smooth_min(round, (122.0 + q.y) * self.scale, 12.0 * self.scale),
            Position::Left | Position::Right => {
                smooth_min(round, (158.0 - q.dot(self.position.down())) * self.scale, 12.0 * self.scale)
            }
        }
    }

    /// Returns the signed distance of `o` (an adult's mm) to the middle of the table, a shallow tray on the side that is down, mm.
    fn tray(&self, o: DVec3) -> f64 {
        let q = o - CENTRE;
        let (down, across, away) = match self.position {
            Position::Supine => (q.y, q.x, 141.0),
            Position::Prone => (-q.y, q.x, 135.0),
            Position::Left => (q.x, q.y, 169.0),
            Position::Right => (-q.x, q.y, 169.0),
        };
        (down - away - 0.0006 * across * across) * self.scale
    }

    /// Returns the value at `p` (world, mm) without the colon, HU.
    pub(crate) fn value(&self, p: DVec3) -> f64 {
        self.paint(p, self.all()).hu
    }

    /// Same as [`Body::value`], restricted to the parts in `near`.
    pub(crate) fn value_among(&self, p: DVec3, near: Near) -> f64 {
        self.paint(p, near).hu
    }

    /// Returns the value at `p` (world, mm) and the distance over which it stays constant.
    pub(crate) fn sample(&self, p: DVec3) -> Sample {
        let paint = self.paint(p, self.all());
        Sample { hu: paint.hu, constant_mm: paint.free.max(0.0) }
    }

    /// Returns the parts that positions within `reach` mm of `centre` depend on.
    pub(crate) fn near(&self, centre: DVec3, reach: f64) -> Near {
        let (o, more) = (centre / self.scale, (reach + 2.0 * self.sigma) / self.scale);
        let touches = |organ: &Organ, more: f64| organ.depth(o) > -more;
        let organs = (0..ORGANS.len()).filter(|&i| touches(&ORGANS[i], more)).fold(0, |bits, i| bits | 1 << i);
        let organs = organs & self.organs;
        let lungs = self.chest.is_some() || LUNGS.iter().any(|l| touches(l, more + DIAPHRAGM_MM / self.scale));
        // A generous box around the spine.
        let spine = o.x.abs() < 30.0 + more && o.y > 54.0 - more;
        let pelvis = self.pelvis && o.z < pelvis::TOP + more;
        Near { organs, lungs, spine, pelvis }
    }

    /// Paints the layers from the outside in, each over the previous ones.
    fn paint(&self, p: DVec3, near: Near) -> Paint {
        let (o, scale, edge) = (p / self.scale, self.scale, 2.0 * self.sigma);
        let mut paint = Paint { hu: GAS, edge, free: f64::INFINITY };
        let skin = self.skin(o);
        if skin < -edge {
            // The table. 1.04 bounds how much steeper it is than level.
            paint.over((5.0 * scale - self.tray(o).abs()) / 1.04, -720.0);
            paint.free = paint.free.min(-skin - edge);
            return paint;
        }
        // Where the innermost layer is complete, it hides the layers outside it.
        if skin - 22.0 * scale < edge {
            paint.over(skin, 15.0);
            paint.over(skin - 2.0, FAT);
            paint.over(skin - 13.0 * scale, 55.0);
        }
        paint.over(skin - 22.0 * scale, FAT);
        let mut left = near.organs;
        while left != 0 {
            let organ = &ORGANS[left.trailing_zeros() as usize];
            left &= left - 1;
            paint.over((organ.depth(o) * scale).min(skin - 7.0 * scale), organ.hu);
        }
        if near.spine {
            self.spine(o, &mut paint);
        }
        if near.pelvis {
            let bone = (pelvis::depth(o) * scale).min(skin - 6.0 * scale);
            paint.over(bone, 420.0);
            paint.over(bone - 2.2 * scale, 175.0);
        }
        if let Some(chest) = self.chest.as_ref().filter(|_| near.lungs) {
            chest.paint(p, scale, &mut paint);
            return paint;
        }
        for (i, lung) in LUNGS.iter().enumerate().filter(|_| near.lungs) {
            let d = lung.depth(o) * scale;
            paint.over(d + DIAPHRAGM_MM, 50.0);
            let inside = d > -edge;
            paint.over(d, lung.hu + if inside { lung_texture(self.seed, p, i as u64) } else { 0.0 });
            if inside {
                paint.varies();
            }
        }
        paint
    }

    /// Paints the vertebral column: vertebral bodies with a dense shell, discs between them and a spinous process
    /// behind. In the pelvis it recedes like the sacrum.
    fn spine(&self, o: DVec3, paint: &mut Paint) {
        let back = smooth_step(-10.0, -110.0, o.z);
        let y = o.y - mix(84.0, 114.0, back);
        let radius = mix(23.0, 12.0, back);
        // The shift changes by at most 0.45 mm per mm of z, the radius by less than 0.17.
        let shrink = self.scale / 1.3;
        let d = (radius - (o.x * o.x + 1.44 * y * y).sqrt() / 1.2) * shrink;
        let process = (0.9 - ((o.x / 7.0).powi(2) + ((y - 27.0) / 18.0).powi(2)).sqrt()) * 7.0 * shrink;
        paint.over(process, 330.0);
        paint.over(d, 430.0);
        paint.over(d - 2.5 * self.scale, 190.0);
        // One disc every 34 mm, 9 mm high.
        let z = o.z / 34.0;
        let disc = (4.5 - 34.0 * (z - z.floor() - 0.5).abs()) * self.scale;
        paint.over(disc.min(d + 0.5 * self.scale), 90.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash;

    #[test]
    fn what_is_called_constant_is() {
        let body = Body::new(1.0, 0.5, 1);
        for n in 0..4000u64 {
            let u = |k| hash::uniform(3, 8 * n + k);
            let p = DVec3::new(360.0 * u(0) - 180.0, 360.0 * u(1) - 180.0, 400.0 * u(2) - 200.0);
            let s = body.sample(p);
            let step = DVec3::new(u(3) - 0.5, u(4) - 0.5, u(5) - 0.5).normalize_or_zero();
            let near = body.near(p + step * 4.0, 4.1);
            assert_eq!(s.hu.to_bits(), body.value_among(p, near).to_bits(), "what is left out changes nothing: {p}");
            let q = body.sample(p + step * s.constant_mm.min(50.0) * 0.999);
            assert!((q.hu - s.hu).abs() < 1e-9, "{p}: {s:?}, {q:?}");
        }
    }

    #[test]
    fn the_lung_is_rougher_than_gas() {
        let body = Body::new(1.0, 0.5, 1);
        let n = 4000;
        let at = |i: u64| {
            let u = |k| hash::uniform(5, 4 * i + k) - 0.5;
            body.sample(DVec3::new(84.0 + 50.0 * u(0), 24.0 + 60.0 * u(1), 206.0 + 14.0 * u(2))).hu
        };
        let mean = (0..n).map(at).sum::<f64>() / n as f64;
        let sd = ((0..n).map(|i| (at(i) - mean).powi(2)).sum::<f64>() / n as f64).sqrt();
        assert!((-900.0..-800.0).contains(&mean), "mean {mean}");
        assert!((55.0..90.0).contains(&sd), "sd {sd}");
    }

    #[test]
    fn the_table_is_as_thick_as_the_body_is_large() {
        for scale in [1.0, 0.58] {
            let body = Body::new(scale, 0.1, 1);
            // Its middle is 141 mm behind that of an adult, and it is 10 mm thick.
            let at = |y: f64| body.value(DVec3::new(0.0, (CENTRE.y + 141.0 + y) * scale, 0.0));
            for y in [-4.0, 0.0, 4.0] {
                assert!((at(y) + 720.0).abs() < 1e-9, "{scale}, {y}: {}", at(y));
            }
            assert_eq!([at(-6.0), at(6.0)], [GAS, GAS], "{scale}");
        }
    }

    #[test]
    fn a_vertebra_is_marrow_in_a_dense_shell_however_little_is_looked_at() {
        let body = Body::new(1.0, 0.1, 1);
        // At z = 10 there is no disc, and the shell is 2.5 mm thick: x / 1.2 from 23 − 1.3 · 2.5 to 23 mm.
        for (x, hu) in [(0.0, 190.0), (22.0, 190.0), (25.65, 430.0)] {
            let p = DVec3::new(x, 84.0, 10.0);
            assert!((body.value(p) - hu).abs() < 1e-9, "{x}: {}", body.value(p));
            assert_eq!(body.value_among(p, body.near(p, 0.1)), body.value(p), "{x}");
        }
    }

    #[test]
    fn an_organ_is_near_as_far_as_its_blur_reaches() {
        for sigma in [0.5, 4.0] {
            let body = Body::new(1.0, sigma, 1);
            // Beside the left kidney, in fat. Its half axis to this side is 26 mm, and its shortest one 24 mm.
            let p = DVec3::new(58.0 + 26.0 * (1.0 + 1.75 * sigma / 24.0), 60.0, 70.0);
            assert!(body.value(p) > FAT + 1.0, "some of the kidney is seen: {}", body.value(p));
            assert_eq!(body.value_among(p, body.near(p, 0.0)), body.value(p), "blurred by {sigma} mm");
        }
    }
}
