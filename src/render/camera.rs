//! Where the camera stands, and the ray through each pixel.

use std::ops::Range;

use glam::DVec3;

use crate::error::{Error, Result};

/// The longest side of an image, pixels.
pub const MAX_SIDE: usize = 32_768;

/// A pinhole camera: square pixels, row 0 on top, right = forward × up, one ray through each pixel's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    position: DVec3,
    forward: DVec3,
    right: DVec3,
    up: DVec3,
    fov_degrees: f64,
    width: usize,
    height: usize,
    /// Side of a pixel in the plane at distance 1.
    pixel: f64,
    /// The point of the image that `forward` meets, pixels from its top left corner.
    centre: [f64; 2],
}

impl View {
    /// A camera at `position` (world, mm) that looks along `forward` with `up` upwards (world, of any length; `up` is
    /// made orthogonal to `forward`). `fov_degrees` spans the shorter side of the image from edge to edge.
    ///
    /// An `up` along `forward` tells nothing: superior takes its place, or anterior where that is along `forward` too.
    ///
    /// # Errors
    /// Wrong usage when a number is not finite, `forward` or `up` is zero, the field of view is not between 0 and 180°
    /// or the image has no pixels or a side beyond [`MAX_SIDE`].
    pub fn new(
        position: DVec3,
        forward: DVec3,
        up: DVec3,
        fov_degrees: f64,
        width: usize,
        height: usize,
    ) -> Result<Self> {
        if !position.is_finite() || position.abs().max_element() > 1e9 {
            return Err(Error::usage("camera", format!("position {position} mm is not a place"), "give x,y,z in mm"));
        }
        let unit = |name: &str, v: DVec3| {
            // Scaled first, so that neither denormal nor huge components lose the direction.
            Some((v / v.abs().max_element()).normalize_or_zero())
                .filter(|&u| v.is_finite() && u != DVec3::ZERO)
                .ok_or_else(|| {
                    Error::usage("camera", format!("{name} {v} is no direction"), "give three numbers, not all zero")
                })
        };
        let (forward, up) = (unit("forward", forward)?, unit("up", up)?);
        if !(fov_degrees > 0.0 && fov_degrees < 180.0) {
            let why = format!("{fov_degrees}° is not between 0 and 180");
            return Err(Error::usage("field of view", why, "give degrees, such as 90"));
        }
        let side = 1..=MAX_SIDE;
        if !side.contains(&width) || !side.contains(&height) {
            let why = format!("{width}x{height} is not within 1 to {MAX_SIDE}");
            return Err(Error::usage("image size", why, "give WxH in pixels, such as 1024x1024"));
        }
        let right = [up, DVec3::Z, DVec3::NEG_Y]
            .iter()
            .map(|&u| forward.cross(u))
            .find(|r| r.length() > 1e-6)
            .unwrap_or(DVec3::X)
            .normalize();
        let pixel = 2.0 * (0.5 * fov_degrees.to_radians()).tan() / width.min(height) as f64;
        let (up, centre) = (right.cross(forward), [0.5 * width as f64, 0.5 * height as f64]);
        Ok(Self { position, forward, right, up, fov_degrees, width, height, pixel, centre })
    }

    /// The image's `rows` as an image of their own, each ray moved by `shift` pixels to the right and downwards. As many
    /// rows as there are at the most, and at least one.
    pub fn strip(&self, rows: Range<usize>, [right, down]: [f64; 2]) -> Self {
        let first = rows.start.min(self.height - 1);
        let height = rows.end.min(self.height).saturating_sub(first).max(1);
        let [x, y] = self.centre;
        Self { height, centre: [x - right, y - first as f64 - down], ..*self }
    }

    /// The same image in `width` × `height` pixels (at least one each).
    pub fn resized(&self, width: usize, height: usize) -> Self {
        let (width, height) = (width.max(1), height.max(1));
        let [x, y] = self.centre;
        let (across, down) = (width as f64 / self.width as f64, height as f64 / self.height as f64);
        let pixel = self.pixel / if self.width <= self.height { across } else { down };
        Self { width, height, pixel, centre: [x * across, y * down], ..*self }
    }

    /// The camera's place, world, mm.
    pub fn position(&self) -> DVec3 {
        self.position
    }

    /// Where it looks, world, of unit length.
    pub fn forward(&self) -> DVec3 {
        self.forward
    }

    /// The image's right, world, of unit length.
    pub fn right(&self) -> DVec3 {
        self.right
    }

    /// The image's top, world, of unit length and orthogonal to `forward`.
    pub fn up(&self) -> DVec3 {
        self.up
    }

    /// Angle of the shorter side, edge to edge.
    pub fn fov_degrees(&self) -> f64 {
        self.fov_degrees
    }

    /// Side of a pixel in the plane at distance 1 from the camera.
    pub fn pixel(&self) -> f64 {
        self.pixel
    }

    /// The point of the image that [`View::forward`] meets, in pixels from its top left corner: the middle, but for a
    /// [`View::strip`].
    pub fn centre(&self) -> [f64; 2] {
        self.centre
    }

    /// Pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// World direction, of unit length, through the centre of the pixel in column `x` of row `y`.
    pub fn ray(&self, x: usize, y: usize) -> DVec3 {
        self.ray_at(x as f64 + 0.5, y as f64 + 0.5)
    }

    /// World direction, of unit length, through the point (`x`, `y`) of the image, in pixels from its top left corner.
    pub fn ray_at(&self, x: f64, y: f64) -> DVec3 {
        let (x, y) = (x - self.centre[0], self.centre[1] - y);
        (self.forward + (self.right * x + self.up * y) * self.pixel).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(forward: DVec3, up: DVec3, w: usize, h: usize) -> View {
        View::new(DVec3::ZERO, forward, up, 90.0, w, h).unwrap()
    }

    #[test]
    fn right_is_forward_cross_up() {
        // Looking to posterior, superior on top: the patient's left is on the right.
        let v = view(DVec3::Y, DVec3::Z, 101, 101);
        assert!((v.right() - DVec3::X).length() < 1e-15);
        assert!(v.ray(100, 50).x > 0.5 && v.ray(50, 0).z > 0.5);
        assert!((v.ray(50, 50) - DVec3::Y).length() < 1e-15);
    }

    #[test]
    fn fov_spans_the_shorter_side() {
        for (w, h) in [(200, 100), (100, 200), (100, 100)] {
            let v = view(DVec3::X, DVec3::Z, w, h);
            let (top, bottom) = if w >= h {
                (v.ray_at(0.5 * w as f64, 0.0), v.ray_at(0.5 * w as f64, h as f64))
            } else {
                (v.ray_at(0.0, 0.5 * h as f64), v.ray_at(w as f64, 0.5 * h as f64))
            };
            assert!(top.dot(bottom).abs() < 1e-12);
        }
    }

    #[test]
    fn strips_and_sizes_are_of_the_same_image() {
        let v = view(DVec3::X, DVec3::Z, 80, 60);
        let strip = v.strip(16..40, [0.25, -0.125]);
        assert_eq!((strip.width(), strip.height()), (80, 24));
        assert!((strip.ray(7, 3) - v.ray_at(7.75, 19.375)).length() < 1e-15);
        assert_eq!(v.strip(48..100, [0.0; 2]).height(), 12);
        let small = v.resized(40, 30);
        assert!((small.ray_at(10.0, 20.0) - v.ray_at(20.0, 40.0)).length() < 1e-15);
        assert_eq!(v.strip(0..60, [0.0; 2]), v);
    }

    #[test]
    fn up_is_made_orthogonal_or_found() {
        let v = view(DVec3::X * 7.0, DVec3::new(3.0, 0.0, 0.1), 9, 9);
        assert!((v.up() - DVec3::Z).length() < 1e-12);
        assert!((view(DVec3::X, DVec3::NEG_X, 9, 9).up() - DVec3::Z).length() < 1e-12);
        assert!((view(DVec3::Z, DVec3::Z, 9, 9).up() - DVec3::NEG_Y).length() < 1e-12);
        assert!((view(DVec3::X * 1e-310, DVec3::Z * 1e300, 9, 9).up() - DVec3::Z).length() < 1e-12);
    }

    #[test]
    fn refuses_what_is_no_view() {
        let new = |p, f, u, fov, w| View::new(p, f, u, fov, w, 10);
        let (zero, nan, x, z) = (DVec3::ZERO, DVec3::NAN, DVec3::X, DVec3::Z);
        assert!(new(zero, x, z, 90.0, 10).is_ok());
        assert!(new(nan, x, z, 90.0, 10).is_err());
        assert!(new(zero, zero, z, 90.0, 10).is_err());
        assert!(new(zero, x, zero, 90.0, 10).is_err());
        assert!(new(zero, nan, z, 90.0, 10).is_err());
        assert!(new(zero, x, DVec3::splat(f64::INFINITY), 90.0, 10).is_err());
        for fov in [0.0, -1.0, 180.0, f64::NAN] {
            assert!(new(zero, x, z, fov, 10).is_err());
        }
        assert!(new(zero, x, z, 90.0, 0).is_err());
        assert!(new(zero, x, z, 90.0, MAX_SIDE + 1).is_err());
    }
}
