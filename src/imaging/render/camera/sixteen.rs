//! Sixteen pixels or places of a view at once: of a pinhole camera without branches, so that a few are computed with each instruction.

use glam::DVec3;

use super::perspective::GRAZING;
use super::view::View;

/// x, y and z of sixteen places or directions.
pub type Sixteen = [[f64; 16]; 3];

impl View {
    /// Returns the directions of the rays through sixteen points of the image (pixels from its top left corner), world, of unit length,
    /// if all rays start at the camera: see [`View::ray_at`]. NaN where the camera shows nothing; `None` if a ray starts elsewhere.
    #[inline(always)]
    pub fn directions(&self, at: &[[f64; 16]; 2]) -> Option<Sixteen> {
        let mut out = [[f64::NAN; 16]; 3];
        let Some(pixel) = self.pixel() else {
            for k in 0..16 {
                let Some(ray) = self.ray_at(at[0][k], at[1][k]) else { continue };
                if ray.origin != self.position() {
                    return None;
                }
                (out[0][k], out[1][k], out[2][k]) = ray.direction.into();
            }
            return Some(out);
        };
        let (centre, forward, right, up) = (self.centre(), self.forward(), self.right(), self.up());
        for k in 0..16 {
            let (x, y) = (at[0][k] - centre[0], centre[1] - at[1][k]);
            let along = |f: f64, r: f64, u: f64| f + (r * x + u * y) * pixel;
            let [a, b, c] =
                [along(forward.x, right.x, up.x), along(forward.y, right.y, up.y), along(forward.z, right.z, up.z)];
            let short = 1.0 / (a * a + b * b + c * c).sqrt();
            (out[0][k], out[1][k], out[2][k]) = (a * short, b * short, c * short);
        }
        Some(out)
    }

    /// Returns where sixteen places (world, mm) are seen, pixels from the image's top left corner: see [`View::project`]. NaN where none is.
    #[inline(always)]
    pub fn places(&self, places: &Sixteen) -> [[f64; 16]; 2] {
        let mut out = [[f64::NAN; 16]; 2];
        let Some(pixel) = self.pixel() else {
            for k in 0..16 {
                if let Some([x, y]) = self.project(DVec3::new(places[0][k], places[1][k], places[2][k])) {
                    (out[0][k], out[1][k]) = (x, y);
                }
            }
            return out;
        };
        let (eye, centre) = (self.position(), self.centre());
        let (forward, right, up) = (self.forward(), self.right(), self.up());
        for k in 0..16 {
            let (x, y, z) = (places[0][k] - eye.x, places[1][k] - eye.y, places[2][k] - eye.z);
            let along = |d: DVec3| x * d.x + y * d.y + z * d.z;
            let (x, y, z) = (along(right), along(up), along(forward));
            let scale = 1.0 / (z * pixel);
            let is_before = z > GRAZING * (x * x + y * y + z * z).sqrt();
            out[0][k] = if is_before { centre[0] + x * scale } else { f64::NAN };
            out[1][k] = if is_before { centre[1] - y * scale } else { f64::NAN };
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use std::array::from_fn;
    use std::sync::Arc;

    use super::*;
    use crate::math::hash::Stream;
    use crate::render::camera::Panorama;

    #[test]
    fn sixteen_are_as_one() {
        let mut draw = Stream::new(3, 0);
        let (eye, forward) = (DVec3::new(3.0, -70.0, 12.0), DVec3::new(1.0, 2.0, -0.4));
        let panorama = View::with_camera(eye, forward, DVec3::Z, Arc::new(Panorama), 200, 100).unwrap();
        for view in [View::new(eye, forward, DVec3::Z, 95.0, 120, 90).unwrap(), panorama] {
            for _ in 0..500 {
                let at: [[f64; 16]; 2] = from_fn(|_| from_fn(|_| draw.within(-5.0, 150.0)));
                let directions = view.directions(&at).unwrap();
                let place: Sixteen = from_fn(|a| from_fn(|_| eye[a] + draw.within(-50.0, 50.0)));
                let seen = view.places(&place);
                for k in 0..16 {
                    let one = view.ray_at(at[0][k], at[1][k]).map(|r| r.direction);
                    let d = DVec3::from_array(directions.map(|d| d[k]));
                    assert!(one.map_or(!d.is_finite(), |one| one == d), "{one:?} {d}");
                    let one = view.project(DVec3::from_array(place.map(|p| p[k])));
                    let is_same = |[x, y]: [f64; 2]| (x - seen[0][k]).abs() < 1e-9 && (y - seen[1][k]).abs() < 1e-9;
                    assert!(one.map_or(seen[0][k].is_nan(), is_same), "{one:?} {seen:?}");
                }
            }
        }
    }
}
