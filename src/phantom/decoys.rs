//! Decoys: structures that are not polyps and mislead detectors.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::profile::{mix, smooth_step};
use super::solid::{Ellipsoid, Plate, Rod, Surface};
use super::texture::lattice;

/// Fillet between a decoy and the wall, and between the parts of a lump, mm.
const FILLET_MM: f64 = 1.0;
/// HU of the parts that are not tissue.
const FAT_HU: f64 = -70.0;
const TUBE_HU: f64 = 250.0;
const BALLOON_HU: f64 = 60.0;
/// Deviation of stool from its mean, HU, and the size of its patches, mm.
const PATCHY_HU: f64 = 60.0;
const PATCH_MM: f64 = 2.0;

/// Kind of a decoy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum DecoyKind {
    /// A short and stubby fold, or a fold whose edge is thickened on one side.
    FoldTip,
    /// Two folds that cross.
    FoldJunction,
    /// The ileocecal valve: two lips with fat in them.
    Valve,
    /// A rectal tube with its balloon.
    Tube,
    /// Untagged stool that clings to the wall, with bubbles.
    Stool,
    /// Tagged stool.
    TaggedStool,
}

/// A decoy of the ground truth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueDecoy {
    /// Kind.
    pub kind: DecoyKind,
    /// Its middle, world mm LPS; of folds that cross, the place where they do.
    pub position: DVec3,
    /// Its largest extent, mm; of folds that cross, the diameter within which both are.
    pub diameter_mm: f64,
}

/// A decoy.
#[derive(Clone, Debug)]
pub(crate) struct Decoy {
    pub truth: TrueDecoy,
    /// Arc length around which it changes the wall, and how far from there, mm.
    pub s: f64,
    pub span_mm: f64,
    pub body: Body,
}

/// What a decoy consists of, besides folds, which are among the other folds.
#[derive(Clone, Debug)]
pub(crate) enum Body {
    Folds,
    Bulge(Ellipsoid),
    Valve([Plate; 2]),
    /// The lips of the valve that small bowel opens through.
    Lips(Plate),
    Tube(Tube),
    Stool(Lump),
}

/// A rectal tube and its balloon.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tube {
    /// Axis: from within the end wall to the middle of the rim at the tip, world mm.
    pub from: DVec3,
    pub to: DVec3,
    /// Radius midway between the bore and the outside, and thickness of the wall, mm.
    pub radius: f64,
    pub wall: f64,
    /// Centre of the balloon, its outer radius, and the thickness of its skin.
    pub balloon: (DVec3, f64, f64),
}

/// A lump of untagged stool.
#[derive(Clone, Debug)]
pub(crate) struct Lump {
    pub balls: Vec<(DVec3, f64)>,
    pub bubbles: Vec<(DVec3, f64)>,
    /// Mean HU.
    pub hu: f64,
    /// Seed of the patches.
    pub seed: u64,
}

impl Tube {
    /// Returns the bore.
    fn bore(&self) -> Rod {
        let along = (self.to - self.from).normalize_or_zero();
        Rod { from: self.from + along * 3.0, to: self.to, radius: self.radius - 0.5 * self.wall }
    }

    /// Returns the pipe with its round rim.
    fn pipe(&self, p: DVec3) -> Surface {
        let along = (self.to - self.from).normalize_or_zero();
        let off = p - self.from;
        let x = off.dot(along);
        let out = (off - along * x).normalize_or(along.any_orthonormal_vector());
        let x = x.clamp(0.0, self.from.distance(self.to) - 0.5 * self.wall);
        Surface::about(self.from + along * x + out * self.radius, 0.5 * self.wall, p)
    }

    /// Returns the balloon's skin.
    fn skin(&self, p: DVec3) -> Surface {
        let (centre, radius, skin) = self.balloon;
        let out = (p - centre).normalize_or(DVec3::X);
        Surface::about(centre + out * (radius - 0.5 * skin), 0.5 * skin, p)
    }

    fn grow_on(&self, base: Surface, p: DVec3) -> Surface {
        let base = base.join(self.skin(p), FILLET_MM);
        base.without(self.bore().surface(p), 0.3).join(self.pipe(p), 0.3)
    }
}

impl Lump {
    fn surface(&self, p: DVec3) -> Surface {
        let mut own = Surface { d: -100.0, normal: DVec3::X };
        for &(centre, radius) in &self.balls {
            own = own.join(Surface::about(centre, radius, p), FILLET_MM);
        }
        for &(centre, radius) in &self.bubbles {
            own = own.without(Surface::about(centre, radius, p), 0.3);
        }
        own
    }

    fn texture(&self, p: DVec3) -> f64 {
        self.hu + PATCHY_HU * (2.0 * lattice(self.seed, p / PATCH_MM) - 1.0)
    }
}

impl Decoy {
    /// Adds the decoy to the tissue that it grows on.
    pub(crate) fn grow_on(&self, base: Surface, p: DVec3) -> Surface {
        match &self.body {
            Body::Folds => base,
            Body::Bulge(bulge) => base.join(bulge.surface(p), FILLET_MM),
            Body::Valve([a, b]) => base.join(a.surface(p).or(b.surface(p)), FILLET_MM),
            Body::Lips(lips) => base.join(lips.surface(p), FILLET_MM),
            Body::Tube(tube) => tube.grow_on(base, p),
            Body::Stool(lump) => base.join(lump.surface(p), FILLET_MM),
        }
    }

    /// Returns the HU of the decoy's material at `p`, where that of the wall is `tissue`.
    pub(crate) fn material(&self, p: DVec3, tissue: f64) -> f64 {
        // The decoy's material reaches its own surface.
        let within = |surface: Surface| smooth_step(-1.0, 0.0, surface.d);
        match &self.body {
            Body::Folds | Body::Bulge(_) | Body::Lips(_) => tissue,
            Body::Valve([a, b]) => mix(tissue, FAT_HU, smooth_step(1.0, 2.0, a.surface(p).or(b.surface(p)).d)),
            Body::Tube(tube) => mix(mix(tissue, BALLOON_HU, within(tube.skin(p))), TUBE_HU, within(tube.pipe(p))),
            Body::Stool(lump) => {
                let share = within(lump.surface(p));
                if share > 0.0 { mix(tissue, lump.texture(p), share) } else { tissue }
            }
        }
    }

    /// Returns the share of gas that no fluid displaces at `p`: 1 within bubbles and the balloon, 0 outside.
    pub(crate) fn enclosed_gas(&self, p: DVec3) -> f64 {
        let within = |centre: DVec3, radius: f64| smooth_step(-0.6, 0.0, radius - p.distance(centre));
        match &self.body {
            Body::Tube(Tube { balloon: (centre, radius, skin), .. }) => within(*centre, radius - skin),
            Body::Stool(lump) => lump.bubbles.iter().map(|(c, r)| within(*c, *r)).fold(0.0, f64::max),
            _ => 0.0,
        }
    }
}
