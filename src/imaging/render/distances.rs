//! Distances to the wall that a renderer has found while it made a picture.

use super::ImageSize;

/// Four inverse distances that differ by more than this factor belong to different surfaces: nothing lies between them.
const ALIKE: f32 = 1.25;
/// A point this close to a ray, in distances between rays, is on it.
const ON: f32 = 1e-3;

/// Distances from the camera to the wall along some rays of a picture: those through every few pixels.
///
/// They are those that the picture itself was made from, so they cost nothing, and they are as exact as it is: where its rays met
/// the wall on average.
#[derive(Clone, Copy, Debug)]
pub struct Distances<'a> {
    /// For each ray, the inverse of its distance; 0 where it meets nothing, NaN where the distance is not known.
    near: &'a [f32],
    /// Numbers from one row of rays to the next.
    stride: usize,
    /// Rays across and down.
    count: [usize; 2],
    /// Pixels of the traced picture from one ray to the next. The first goes through the middle of the first pixel.
    step: f32,
    /// A distance of 1, mm.
    unit_mm: f32,
    /// Pixels of the traced picture for each pixel of the shown one.
    scale: [f32; 2],
}

impl<'a> Distances<'a> {
    /// Creates the distances of rays that are `step` pixels apart, the first through the middle of the picture's first pixel.
    ///
    /// There are `count` rays across and down, and `stride` numbers from one row of `near` to the next. Each number is the inverse of a
    /// distance in units of `unit_mm` mm: 0 where a ray meets nothing, NaN where the distance is not known.
    pub fn new(near: &'a [f32], stride: usize, count: [usize; 2], step: usize, unit_mm: f32) -> Self {
        Self { near, stride, count, step: step as f32, unit_mm, scale: [1.0; 2] }
    }

    /// Returns the distances for a picture of the size `shown` that was stretched from one of the size `traced`.
    #[must_use]
    pub fn stretched(self, traced: ImageSize, shown: ImageSize) -> Self {
        let share = |traced: usize, shown: usize| traced as f32 / shown.max(1) as f32;
        let [across, down] = [share(traced.width, shown.width), share(traced.height, shown.height)];
        Self { scale: [self.scale[0] * across, self.scale[1] * down], ..self }
    }

    /// Returns the pixels of the shown picture between two rays in a row.
    pub fn pixels_apart(&self) -> f32 {
        self.step / self.scale[0]
    }

    /// Returns the distance along the ray through the point (`x`, `y`) of the picture, in pixels from its top left corner, mm. It is
    /// infinite where that ray meets nothing, and NaN where the distance is not known.
    ///
    /// Between rays that meet the same surface, the inverse distance is bilinear, as it is over a plane.
    #[inline]
    pub fn at(&self, x: f32, y: f32) -> f32 {
        self.unit_mm / self.inverse_at(x, y)
    }

    /// Returns a distance of 1, mm.
    #[inline]
    pub(super) fn unit_mm(&self) -> f32 {
        self.unit_mm
    }

    #[inline]
    fn inverse_at(&self, x: f32, y: f32) -> f32 {
        let place = |x: f32, scale: f32| ((x * scale - 0.5) / self.step).max(0.0);
        let (u, v) = (place(x, self.scale[0]), place(y, self.scale[1]));
        let (i, j) = ((u + ON) as usize, (v + ON) as usize);
        let (s, t) = (u - i as f32, v - j as f32);
        match (s > ON, t > ON) {
            (false, false) => self.ray(i, j),
            (true, false) => between([self.ray(i, j), self.ray(i + 1, j)], [1.0 - s, s]),
            (false, true) => between([self.ray(i, j), self.ray(i, j + 1)], [1.0 - t, t]),
            (true, true) => between(
                [self.ray(i, j), self.ray(i + 1, j), self.ray(i, j + 1), self.ray(i + 1, j + 1)],
                [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t],
            ),
        }
    }

    /// Finds the inverse distances at some points of a row, `step` pixels apart from `from` on, in units of 1 / [`Distances::unit_mm`]:
    /// see [`Distances::at`].
    #[inline]
    pub(super) fn inverse_row(&self, [x, y]: [f32; 2], step: f32, inverse: &mut [f32]) {
        let place = |x: f32, scale: f32| (x * scale - 0.5) / self.step;
        let (u, v, rays) = (place(x, self.scale[0]), place(y, self.scale[1]), step * self.scale[0] / self.step);
        // Most pictures are not stretched: there is a ray at each of these points.
        let (first, row, apart) = (u as usize, v as usize, rays as usize);
        if [first as f32, row as f32, apart as f32] == [u, v, rays] && apart > 0 && row < self.count[1] {
            let last = first + inverse.len().saturating_sub(1) * apart;
            let near = self.near.get(row * self.stride..).and_then(|near| near.get(first..=last));
            if let Some(near) = near.filter(|_| last < self.count[0]) {
                for (inverse, near) in inverse.iter_mut().zip(near.iter().step_by(apart)) {
                    *inverse = *near;
                }
                return;
            }
        }
        for (n, inverse) in inverse.iter_mut().enumerate() {
            *inverse = self.inverse_at(x + n as f32 * step, y);
        }
    }

    #[inline]
    fn ray(&self, i: usize, j: usize) -> f32 {
        if i >= self.count[0] || j >= self.count[1] {
            return f32::NAN;
        }
        self.near.get(j * self.stride + i).copied().unwrap_or(f32::NAN)
    }
}

/// Returns the mean of inverse distances with these weights; NaN where they are not those of one surface.
#[inline]
fn between<const N: usize>(near: [f32; N], weights: [f32; N]) -> f32 {
    let (mut sum, mut least, mut most) = (0.0, f32::INFINITY, 0.0f32);
    for (near, weight) in near.into_iter().zip(weights) {
        sum += near * weight;
        (least, most) = (least.min(near), most.max(near));
    }
    // The sum alone knows of a NaN.
    if most > least * ALIKE { f32::NAN } else { sum }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_are_those_of_the_rays_and_of_planes_in_between() {
        let (nan, none) = (f32::NAN, 0.0);
        // Two fields in a row of five: the second is not read.
        let near = [0.50, 0.44, none, none, 9.0, 0.46, 0.40, none, nan, 9.0];
        let of = Distances::new(&near, 5, [4, 2], 4, 10.0);
        let at = |x: f32, y: f32| of.at(x + 0.5, y + 0.5);
        assert_eq!([at(0.0, 0.0), at(4.0, 0.0), at(0.0, 4.0)], [20.0, 10.0 / 0.44, 10.0 / 0.46]);
        assert!((at(2.0, 0.0) - 10.0 / 0.47).abs() < 1e-4, "the inverse is linear");
        assert!((at(2.0, 2.0) - 10.0 / 0.45).abs() < 1e-4);
        assert_eq!([at(8.0, 0.0), at(10.0, 0.0)], [f32::INFINITY; 2], "nothing");
        assert!(at(6.0, 0.0).is_nan(), "between the wall and nothing");
        assert!(at(12.0, 4.0).is_nan() && at(11.0, 4.0).is_nan(), "not known");
        assert!(at(16.0, 0.0).is_nan() && at(0.0, 8.0).is_nan(), "beyond");
        // Twice as large, a pixel's middle lies between those of the traced picture.
        let of = of.stretched(ImageSize::new(16, 8), ImageSize::new(32, 16));
        assert_eq!((of.at(1.0, 1.0), of.pixels_apart()), (20.0, 8.0));
        assert!((of.at(9.0, 1.0) - 10.0 / 0.44).abs() < 1e-4 && (of.at(5.0, 1.0) - 10.0 / 0.47).abs() < 1e-4);
        assert!(Distances::new(&[], 0, [0, 0], 4, 1.0).at(3.0, 3.0).is_nan());
    }

    #[test]
    fn a_row_has_what_each_of_its_points_has() {
        let near: Vec<f32> = (0..40 * 9).map(|n| if n % 7 == 0 { f32::NAN } else { (n % 5) as f32 * 0.1 }).collect();
        let of = Distances::new(&near, 40, [38, 9], 4, 10.0);
        let wide = of.stretched(ImageSize::new(16, 8), ImageSize::new(32, 16));
        for (of, [x, y], step, len) in [
            (of, [0.5, 0.5], 8.0, 16),
            (of, [64.5, 32.5], 8.0, 16),
            (of, [144.5, 8.5], 8.0, 1),
            (of, [144.5, 8.5], 8.0, 2),
            (of, [4.5, 40.5], 8.0, 3),
            (of, [3.5, 4.5], 8.0, 7),
            (of, [0.5, 4.5], 2.0, 9),
            (wide, [0.5, 8.5], 8.0, 16),
        ] {
            let mut row = vec![9.0; len];
            of.inverse_row([x, y], step, &mut row);
            for (n, inverse) in row.into_iter().enumerate() {
                let (got, expected) = (of.unit_mm() / inverse, of.at(x + n as f32 * step, y));
                assert_eq!(got.to_bits(), expected.to_bits(), "{x} {y} {step} {n}");
            }
        }
    }
}
