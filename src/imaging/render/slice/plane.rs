//! The planes that radiologists read, and the letters at an image's edges.

use std::f64::consts::PI;

use glam::DVec3;

/// Within this angle of the patient's long axis, radians, a normal leaves no superior direction in its plane.
const AXIAL: f64 = PI / 180.0;
/// A direction gets a second letter if that component is at least this large: about 6°.
const SECOND_LETTER: f64 = 0.1;

/// The plane of a cross-section, which also determines the side it is seen from.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum SlicePlane {
    /// Across the body, seen from the feet: the patient's left on the right, posterior at the bottom.
    #[default]
    Axial,
    /// Along the body, seen from the front: the patient's left on the right, superior at the top.
    Coronal,
    /// Along the body, seen from the patient's left: anterior on the left, superior at the top.
    Sagittal,
    /// Across this normal (world LPS, of any length but 0), seen against it: superior at the top, or anterior if the
    /// normal is within 1° of the patient's long axis.
    Oblique(DVec3),
}

impl SlicePlane {
    /// Returns the image's axes in the world.
    ///
    /// # Errors
    /// Returns a short reason if an oblique plane's normal is zero or not finite.
    pub fn frame(self) -> Result<PlaneFrame, String> {
        let normal = match self {
            Self::Axial => DVec3::NEG_Z,
            Self::Coronal => DVec3::NEG_Y,
            Self::Sagittal => DVec3::X,
            Self::Oblique(normal) => {
                if !normal.is_finite() {
                    return Err(format!("the normal {normal} is not finite"));
                }
                if normal == DVec3::ZERO {
                    return Err("the normal 0,0,0 has no direction".to_owned());
                }
                // Twice, so that neither denormal nor huge components lose the direction.
                let normal = normal / normal.abs().max_element();
                (normal / normal.abs().max_element()).normalize()
            }
        };
        Ok(PlaneFrame::facing(normal))
    }
}

/// The axes of an image: orthogonal unit vectors in the world (LPS), with right × down = −normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneFrame {
    right: DVec3,
    down: DVec3,
    normal: DVec3,
}

impl PlaneFrame {
    /// Returns the plane across a unit normal, seen against it.
    fn facing(normal: DVec3) -> Self {
        let tilt = normal.x.hypot(normal.y).atan2(normal.z.abs());
        let top = if tilt <= AXIAL { DVec3::NEG_Y } else { DVec3::Z };
        // The viewer looks along −normal; right = forward × up.
        let right = top.cross(normal).normalize();
        let down = right.cross(normal).normalize();
        // Without negative zeros, which would show up in text.
        Self { right: right + 0.0, down: down + 0.0, normal: normal + 0.0 }
    }

    /// Returns the plane across `forward`, seen along it, with the direction `up` at the top (both world).
    ///
    /// If `up` gives no direction across `forward`, the plane is oriented like an oblique plane.
    pub fn looking(forward: DVec3, up: DVec3) -> Self {
        let forward = forward.try_normalize().unwrap_or(DVec3::Z);
        let Some(right) = forward.cross(up).try_normalize().filter(|r| r.is_finite()) else {
            return Self::facing(-forward);
        };
        Self { right: right + 0.0, down: forward.cross(right) + 0.0, normal: -forward + 0.0 }
    }

    /// Returns the direction to the image's right.
    pub fn right(&self) -> DVec3 {
        self.right
    }

    /// Returns the direction down the image.
    pub fn down(&self) -> DVec3 {
        self.down
    }

    /// Returns the direction out of the image, towards the viewer.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// Returns the sides of the patient at the image's left, right, top and bottom edges, as [`letters`].
    pub fn edges(&self) -> [String; 4] {
        [-self.right, self.right, -self.down, self.down].map(letters)
    }
}

/// Returns where a direction (world LPS) points in the patient: `R` right, `L` left, `A` anterior, `P` posterior, `I`
/// inferior, `S` superior.
///
/// An oblique direction gets the letters of the two nearest axes, the nearer first.
pub fn letters(direction: DVec3) -> String {
    let d = direction.normalize_or_zero();
    let mut named = [(d.x, ['L', 'R']), (d.y, ['P', 'A']), (d.z, ['S', 'I'])];
    // A stable sort: of two components of the same size the first stays first.
    named.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
    let reported = named.iter().take(2).filter(|(c, _)| c.abs() >= SECOND_LETTER);
    reported.map(|(c, [plus, minus])| if *c > 0.0 { *plus } else { *minus }).collect()
}
