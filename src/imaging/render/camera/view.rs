//! A camera with a pose, and its pixels.

use std::ops::Range;
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::model::{Camera, CameraModel, CameraRay};
use super::perspective::Perspective;
use crate::error::{Error, Result};

/// How far a camera, and the origins of its rays, may be from the world's origin, mm.
const FARTHEST_MM: f64 = 1e9;

/// The longest side of an image, pixels.
pub const MAX_SIDE: usize = 32_768;

/// A camera in the world: square pixels, row 0 at the top, right = forward × up, one ray through each pixel's centre.
///
/// ```
/// # use colvis_imaging as colvis;
/// use colvis::render::View;
/// use glam::DVec3;
///
/// // Looking to posterior with superior on top: the patient's left is on the right, as on a coronal slice.
/// let view = View::new(DVec3::ZERO, DVec3::Y, DVec3::Z, 90.0, 101, 101)?;
/// assert_eq!(view.right(), DVec3::X);
/// let middle = view.ray(50, 50).expect("every pixel has a ray");
/// assert!((middle.direction - DVec3::Y).length() < 1e-12);
/// let [x, y] = view.project(DVec3::new(10.0, 10.0, 0.0)).expect("before the camera");
/// assert!((x - 101.0).abs() < 1e-9 && (y - 50.5).abs() < 1e-9, "45° to the right is the right edge");
/// # Ok::<(), colvis::error::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct View {
    position: DVec3,
    forward: DVec3,
    right: DVec3,
    up: DVec3,
    camera: Arc<dyn Camera>,
    width: usize,
    height: usize,
    /// Width and height of a pixel, in halves of the image's shorter side.
    unit: DVec2,
    /// For a perspective camera, the side of a pixel in the plane at distance 1.
    pixel: Option<f64>,
    /// The middle of the camera's image, pixels from the top left corner.
    centre: [f64; 2],
}

impl PartialEq for View {
    fn eq(&self, o: &Self) -> bool {
        let pose = |v: &Self| [v.position, v.forward, v.right, v.up];
        let image = |v: &Self| (v.width, v.height, v.unit, v.pixel, v.centre);
        pose(self) == pose(o) && image(self) == image(o) && self.camera() == o.camera()
    }
}

impl View {
    /// Creates a perspective camera at `position` (world, mm) that looks along `forward` with `up` upwards.
    ///
    /// `forward` and `up` are in the world frame, of any length; `up` is made orthogonal to `forward`. `fov_degrees`
    /// spans the shorter side of the image from edge to edge.
    ///
    /// If `up` is along `forward`, it is replaced by superior, or by anterior if superior is along `forward` too.
    ///
    /// # Errors
    /// Returns status 2 if a number is not finite, the position is too far from the origin, `forward` or `up` is zero,
    /// the field of view is not between 0 and 180°, or the image has no pixels or a side beyond [`MAX_SIDE`].
    pub fn new(
        position: DVec3,
        forward: DVec3,
        up: DVec3,
        fov_degrees: f64,
        width: usize,
        height: usize,
    ) -> Result<Self> {
        Self::made(position, [forward, up], || Ok(Arc::new(Perspective::new(fov_degrees)?)), width, height)
    }

    /// Like [`View::new`], with a camera of a model.
    ///
    /// # Errors
    /// As for [`View::new`], with the model's own limits of the view angle.
    pub fn with_model(
        position: DVec3,
        forward: DVec3,
        up: DVec3,
        model: CameraModel,
        fov_degrees: f64,
        width: usize,
        height: usize,
    ) -> Result<Self> {
        let camera = || model.camera(fov_degrees, width as f64 / height as f64);
        Self::made(position, [forward, up], camera, width, height)
    }

    /// Like [`View::new`], with any camera.
    ///
    /// # Errors
    /// As for [`View::new`].
    pub fn with_camera(
        position: DVec3,
        forward: DVec3,
        up: DVec3,
        camera: Arc<dyn Camera>,
        width: usize,
        height: usize,
    ) -> Result<Self> {
        Self::made(position, [forward, up], || Ok(camera), width, height)
    }

    fn made(
        position: DVec3,
        [forward, up]: [DVec3; 2],
        camera: impl FnOnce() -> Result<Arc<dyn Camera>>,
        width: usize,
        height: usize,
    ) -> Result<Self> {
        if !position.is_finite() || position.abs().max_element() > FARTHEST_MM {
            return Err(Error::usage("camera", format!("position {position} mm is out of range"), "give x,y,z in mm"));
        }
        let unit = |name: &str, v: DVec3| {
            // Scaled first, so that neither denormal nor huge components lose the direction.
            Some((v / v.abs().max_element()).normalize_or_zero())
                .filter(|&u| v.is_finite() && u != DVec3::ZERO)
                .ok_or_else(|| {
                    Error::usage("camera", format!("{name} {v} is not a direction"), "give three numbers, not all zero")
                })
        };
        let (forward, up) = (unit("forward", forward)?, unit("up", up)?);
        let camera = camera()?;
        let side = 1..=MAX_SIDE;
        if !side.contains(&width) || !side.contains(&height) {
            let why = format!("{width}x{height} is not within 1 to {MAX_SIDE}");
            return Err(Error::usage("image size", why, "give WxH in pixels, such as 1024x1024"));
        }
        if let Some(aspect) = camera.aspect().filter(|a| (width as f64 - a * height as f64).abs() > 1e-6) {
            let why = format!("{width}x{height} is not {aspect}:1, as this camera's pictures are");
            return Err(Error::usage("image size", why, format!("give {:.0}x{height}", aspect * height as f64)));
        }
        let right = [up, DVec3::Z, DVec3::NEG_Y]
            .iter()
            .map(|&u| forward.cross(u))
            .find(|r| r.length() > 1e-6)
            .unwrap_or(DVec3::X)
            .normalize();
        let shorter = width.min(height) as f64;
        // An invalid tangent is not relied upon.
        let tangent = camera.tangent().filter(|t| t.is_finite() && (1e-9..1e9).contains(t));
        let pixel = tangent.map(|tangent| 2.0 * tangent / shorter);
        let (up, centre) = (right.cross(forward), [0.5 * width as f64, 0.5 * height as f64]);
        let unit = DVec2::splat(2.0 / shorter);
        Ok(Self { position, forward, right, up, camera, width, height, unit, pixel, centre })
    }

    /// Returns the image's `rows` as a separate image, with each ray moved by `shift` pixels to the right and downwards.
    ///
    /// Has at most as many rows as the image, and at least one.
    pub fn strip(&self, rows: Range<usize>, [right, down]: [f64; 2]) -> Self {
        let first = rows.start.min(self.height - 1);
        let height = rows.end.min(self.height).saturating_sub(first).max(1);
        let [x, y] = self.centre;
        Self { height, centre: [x - right, y - first as f64 - down], ..self.clone() }
    }

    /// Returns the same image in `width` × `height` pixels (at least one each).
    pub fn resized(&self, width: usize, height: usize) -> Self {
        let (width, height) = (width.max(1), height.max(1));
        let [x, y] = self.centre;
        let (across, down) = (width as f64 / self.width as f64, height as f64 / self.height as f64);
        let pixel = self.pixel.map(|pixel| pixel / if self.width <= self.height { across } else { down });
        let unit = self.unit / DVec2::new(across, down);
        Self { width, height, unit, pixel, centre: [x * across, y * down], ..self.clone() }
    }

    /// Returns the camera's position, world, mm.
    pub fn position(&self) -> DVec3 {
        self.position
    }

    /// Returns the viewing direction, world, of unit length.
    pub fn forward(&self) -> DVec3 {
        self.forward
    }

    /// Returns the direction to the image's right, world, of unit length.
    pub fn right(&self) -> DVec3 {
        self.right
    }

    /// Returns the direction to the image's top, world, of unit length and orthogonal to `forward`.
    pub fn up(&self) -> DVec3 {
        self.up
    }

    /// Returns the camera's geometry.
    pub fn camera(&self) -> &dyn Camera {
        &*self.camera
    }

    /// Returns the side of a pixel in the plane at distance 1 from the camera; `None` unless the camera is perspective.
    ///
    /// The rays through the points (x, y) of the image (pixels, from the [middle](View::centre) to the right and
    /// upwards) run along `forward` + `right`·x·side + `up`·y·side.
    pub fn pixel(&self) -> Option<f64> {
        self.pixel
    }

    /// Returns by how much unit directions of neighbouring pixels in a row or column differ at most; `None` if unknown.
    pub fn pixel_turn(&self) -> Option<f64> {
        // A value that is NaN, negative, or larger than any two unit directions can differ is ignored.
        let most_turn = || self.camera.most_turn().filter(|t| (0.0..1e6).contains(t));
        self.pixel.or_else(|| Some(most_turn()? * self.unit.max_element()))
    }

    /// Returns width and height of a pixel, in halves of the shorter side of the camera's image.
    pub(crate) fn unit(&self) -> DVec2 {
        self.unit
    }

    /// Returns the middle of the camera's image, in pixels from the top left corner: that of this image, except for a
    /// [`View::strip`].
    pub fn centre(&self) -> [f64; 2] {
        self.centre
    }

    /// Returns the number of pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns the world ray through the centre of the pixel in column `x` of row `y`: see [`View::ray_at`].
    pub fn ray(&self, x: usize, y: usize) -> Option<CameraRay> {
        self.ray_at(x as f64 + 0.5, y as f64 + 0.5)
    }

    /// Returns the world ray through the point (`x`, `y`) of the image, in pixels from its top left corner; `None`
    /// where the camera shows nothing.
    #[inline]
    pub fn ray_at(&self, x: f64, y: f64) -> Option<CameraRay> {
        let (x, y) = (x - self.centre[0], self.centre[1] - y);
        if let Some(pixel) = self.pixel {
            let direction = (self.forward + (self.right * x + self.up * y) * pixel).normalize();
            return Some(CameraRay { origin: self.position, direction });
        }
        let ray = self.camera.ray(DVec2::new(x, y) * self.unit)?;
        let world = |v: DVec3| self.right * v.x + self.up * v.y + self.forward * v.z;
        // Scaled first, so that neither denormal nor huge components lose the direction. Without a direction the pixel
        // shows nothing.
        let direction = (ray.direction / ray.direction.abs().max_element()).try_normalize()?;
        let origin = self.position + world(ray.origin);
        let near = origin.is_finite() && origin.abs().max_element() <= FARTHEST_MM;
        near.then(|| CameraRay { origin, direction: world(direction).normalize() })
    }

    /// Returns the point of the image, in pixels from its top left corner, at which a `place` (world, mm) is seen if
    /// nothing is in front of it.
    ///
    /// The point may be beyond the edges. `None` where no ray goes.
    pub fn project(&self, place: DVec3) -> Option<[f64; 2]> {
        let p = place - self.position;
        let local = DVec3::new(p.dot(self.right), p.dot(self.up), p.dot(self.forward));
        let at = self.camera.project(local)?;
        let [x, y] = self.centre;
        let found = match self.pixel {
            Some(pixel) => {
                let scale = 1.0 / (local.z * pixel);
                [x + local.x * scale, y - local.y * scale]
            }
            None => [x + at.x / self.unit.x, y - at.y / self.unit.y],
        };
        found.iter().all(|c| c.is_finite()).then_some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(forward: DVec3, up: DVec3, w: usize, h: usize) -> View {
        View::new(DVec3::ZERO, forward, up, 90.0, w, h).unwrap()
    }

    /// The direction of the ray through a point.
    fn direction(view: &View, x: f64, y: f64) -> DVec3 {
        view.ray_at(x, y).unwrap().direction
    }

    #[test]
    fn right_is_forward_cross_up() {
        // Looking to posterior, superior at the top: the patient's left is on the right.
        let v = view(DVec3::Y, DVec3::Z, 101, 101);
        assert!((v.right() - DVec3::X).length() < 1e-15);
        assert!(direction(&v, 100.5, 50.5).x > 0.5 && direction(&v, 50.5, 0.5).z > 0.5);
        assert!((v.ray(50, 50).unwrap().direction - DVec3::Y).length() < 1e-15);
    }

    #[test]
    fn fov_spans_the_shorter_side() {
        for (w, h) in [(200, 100), (100, 200), (100, 100)] {
            let v = view(DVec3::X, DVec3::Z, w, h);
            let (top, bottom) = if w >= h {
                (direction(&v, 0.5 * w as f64, 0.0), direction(&v, 0.5 * w as f64, h as f64))
            } else {
                (direction(&v, 0.0, 0.5 * h as f64), direction(&v, w as f64, 0.5 * h as f64))
            };
            assert!(top.dot(bottom).abs() < 1e-12);
        }
    }

    #[test]
    fn strips_and_sizes_are_of_the_same_image() {
        let v = view(DVec3::X, DVec3::Z, 80, 60);
        let strip = v.strip(16..40, [0.25, -0.125]);
        assert_eq!((strip.width(), strip.height()), (80, 24));
        assert!((strip.ray(7, 3).unwrap().direction - direction(&v, 7.75, 19.375)).length() < 1e-15);
        assert_eq!(v.strip(48..100, [0.0; 2]).height(), 12);
        let small = v.resized(40, 30);
        assert!((direction(&small, 10.0, 20.0) - direction(&v, 20.0, 40.0)).length() < 1e-15);
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
