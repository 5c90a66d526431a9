//! Clipping of triangles and projection to the screen.
//!
//! The camera is inside the mesh, so triangles extend behind it. They are clipped at a plane just in front of it. A
//! side that two triangles share is cut at the same point in both, because it is always traversed from its front end.

use glam::Vec3;

/// Subpixels per pixel.
pub(crate) const SUB: i64 = 256;
/// Screen positions are kept within this many pixels of the screen's corner, so that products of differences fit 64 bits.
const FAR_OFF: f32 = (1 << 21) as f32;

/// The projection from camera coordinates (x to the right, y down, z ahead, mm) to screen positions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Screen {
    /// Pixels per unit of x / z.
    pub focal: f32,
    /// The middle of the screen, pixels.
    pub middle: [f32; 2],
    /// The near plane: nothing nearer is drawn, mm.
    pub near: f32,
}

/// A corner on the screen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Corner {
    /// Position in subpixels.
    pub at: [i64; 2],
    /// 1 / z, which is linear over the screen.
    pub inverse: f32,
}

impl Screen {
    #[inline]
    fn corner(&self, p: Vec3) -> Corner {
        let inverse = 1.0 / p.z;
        let at = |c: f32, middle: f32| {
            let pixels = (c * inverse * self.focal + middle).clamp(-FAR_OFF, FAR_OFF);
            // Rounds by truncating a value that is never negative, which is much cheaper than calling round.
            const SHIFT: f64 = FAR_OFF as f64 * SUB as f64;
            (f64::from(pixels) * SUB as f64 + (SHIFT + 0.5)) as i64 - SHIFT as i64
        };
        Corner { at: [at(p.x, self.middle[0]), at(p.y, self.middle[1])], inverse }
    }

    /// Clips a triangle (camera coordinates) at the near plane and returns the number of corners: nothing, a triangle
    /// or a quadrilateral.
    pub(crate) fn clip(&self, triangle: [Vec3; 3], out: &mut [Corner; 4]) -> usize {
        let is_front = |p: Vec3| p.z >= self.near;
        if triangle.iter().all(|&p| is_front(p)) {
            for (o, p) in out.iter_mut().zip(triangle) {
                *o = self.corner(p);
            }
            return 3;
        }
        let mut n = 0;
        for i in 0..3 {
            let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
            if is_front(a) {
                out[n] = self.corner(a);
                n += 1;
            }
            if is_front(a) != is_front(b) {
                let (front, behind) = if is_front(a) { (a, b) } else { (b, a) };
                let t = (front.z - self.near) / (front.z - behind.z);
                let cut = front + (behind - front) * t;
                out[n] = self.corner(Vec3::new(cut.x, cut.y, self.near));
                n += 1;
            }
        }
        n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCREEN: Screen = Screen { focal: 100.0, middle: [50.0, 50.0], near: 0.1 };

    #[test]
    fn what_reaches_behind_the_camera_is_cut_off() {
        let mut out = [Corner::default(); 4];
        let front = Vec3::new(0.0, 0.0, 1.0);
        assert_eq!(SCREEN.clip([front, front + Vec3::X, front + Vec3::Y], &mut out), 3);
        assert_eq!(out[0].at, [50 * SUB, 50 * SUB]);
        assert_eq!(out[1].at, [150 * SUB, 50 * SUB]);
        let behind = Vec3::new(0.3, 0.2, -1.0);
        assert_eq!(SCREEN.clip([behind, behind + Vec3::X, behind], &mut out), 0);
        assert_eq!(SCREEN.clip([front, behind, behind + Vec3::X], &mut out), 3);
        assert_eq!(SCREEN.clip([front, front + Vec3::X, behind], &mut out), 4);
        assert!(out.iter().all(|c| c.inverse > 0.0 && c.inverse <= 10.0));
    }

    #[test]
    fn a_shared_side_is_cut_at_one_point() {
        let (a, b) = (Vec3::new(0.123, -0.7, 3.7), Vec3::new(0.911, 0.13, -2.9));
        let cut = |t: [Vec3; 3]| {
            let mut out = [Corner::default(); 4];
            let n = SCREEN.clip(t, &mut out);
            out[..n].to_vec()
        };
        let (one, other) = (cut([a, b, Vec3::new(5.0, 0.0, -1.0)]), cut([b, a, Vec3::new(-5.0, 1.0, 2.0)]));
        assert!(one.iter().any(|c| (c.inverse - 10.0).abs() < 1e-4 && other.contains(c)), "{one:?} {other:?}");
    }

    #[test]
    fn places_far_off_the_screen_stay_in_range() {
        let mut out = [Corner::default(); 4];
        let wild = [Vec3::new(1e30, -1e30, 0.1), Vec3::new(-1e30, 1e30, 0.1), Vec3::new(f32::MAX, 0.0, 1e30)];
        assert_eq!(SCREEN.clip(wild, &mut out), 3);
        assert!(out[..3].iter().flat_map(|c| c.at).all(|c| c.abs() <= FAR_OFF as i64 * SUB));
    }
}
