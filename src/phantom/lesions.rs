//! Polyps of every shape: a head, and what carries it.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::solid::{Ellipsoid, Rod, Surface, surface_of};

/// Fillet between a lesion and what it grows on, and between a head and its stalk, mm.
const FILLET_MM: f64 = 1.0;
const JOINT_MM: f64 = 2.0;

/// Shape of a polyp.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum PolypShape {
    /// A ball, or nearly, that grows on the surface.
    #[default]
    Sessile,
    /// A head on a stalk.
    Stalked,
    /// A plaque less than 3 mm high.
    Flat,
}

/// Where a polyp grows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PolypSite {
    /// On the wall, away from folds.
    #[default]
    Wall,
    /// On a fold.
    Fold,
    /// On the wall beside a fold, within 2 mm of the fold's face.
    Between,
}

/// A polyp of any shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lesion {
    pub shape: PolypShape,
    pub site: PolypSite,
    /// The head. A flat one's centre is on the surface that it grows on, and its third axis points into the lumen.
    pub head: Ellipsoid,
    /// The stalk, or the core that fills a sessile one down to the surface. A flat one has none.
    pub stem: Option<Rod>,
    /// The place on the surface that it grows from, world mm.
    pub root: DVec3,
}

impl Lesion {
    /// Adds the lesion to the tissue that it grows on.
    pub(crate) fn grow_on(&self, base: Surface, p: DVec3) -> Surface {
        base.join(self.surface(base, p), FILLET_MM)
    }

    /// Returns the lesion's own surface, for a position with the surface `base` of what it grows on.
    pub(crate) fn surface(&self, base: Surface, p: DVec3) -> Surface {
        match self.stem {
            None => self.draped(base, p),
            Some(stem) if self.shape == PolypShape::Stalked => self.head.surface(p).join(stem.surface(p), JOINT_MM),
            Some(stem) => self.head.surface(p).or(stem.surface(p)),
        }
    }

    /// Returns the surface of a half ellipsoid bent onto the base: its height is measured from the base, and its width along it.
    fn draped(&self, base: Surface, p: DVec3) -> Surface {
        let Ellipsoid { centre, axes, radii } = self.head;
        let most = radii.max_element();
        if p.distance(centre) > 1.5 * most + 10.0 {
            return Surface::about(centre, most, p);
        }
        let up = -base.normal;
        let off = p - base.normal * base.d - centre;
        let (x, y) = (off.dot(axes.x_axis), off.dot(axes.y_axis));
        // Along a bent surface the way is longer than in the plane, and much longer around an edge.
        let facing = up.dot(axes.z_axis);
        let longer = off.length() / x.hypot(y).max(1e-6) * (1.0 + 4.0 * (0.3 - facing).max(0.0));
        let longer = longer.min(20.0);
        let (height, below) = ((-base.d).max(0.0), base.d.max(0.0));
        let own = surface_of(radii, DVec3::new(x * longer, y * longer, height));
        let across = |axis: DVec3| (axis - up * axis.dot(up)).normalize_or_zero();
        let normal = across(axes.x_axis) * own.normal.x + across(axes.y_axis) * own.normal.y + up * own.normal.z;
        // Beneath the base there is only more tissue.
        let d = own.d + below * (-own.normal.z).max(0.0);
        Surface { d, normal: normal.normalize_or(base.normal) }
    }

    /// Returns the centre of the head; a flat one's is half its height above the base.
    pub(crate) fn position(&self) -> DVec3 {
        match self.shape {
            PolypShape::Flat => self.head.centre + self.head.axes.z_axis * (0.5 * self.head.radii.z),
            _ => self.head.centre,
        }
    }

    /// Returns the largest diameter of the head, mm.
    pub(crate) fn diameter_mm(&self) -> f64 {
        2.0 * self.head.radii.max_element()
    }

    /// Returns balls that together hold the lesion: centres (world mm) and radii (mm).
    pub(crate) fn balls(&self) -> [(DVec3, f64); 2] {
        let head = (self.head.centre, self.head.radii.max_element());
        match self.stem {
            Some(stem) if self.shape == PolypShape::Stalked => {
                [head, (0.5 * (self.root + stem.to), 0.5 * self.root.distance(stem.to))]
            }
            _ => [head, head],
        }
    }
}
