//! A planned path: a smooth curve with frames, a speed at each position, and the guidance that keeps a body on it.
//!
//! Automated flight planning (paper, section 3): start and goal determine the path, and the camera flies it with mass,
//! with bounded acceleration and jerk. The body still moves by forces alone ([`follower`]), so an operator may push it
//! off the plan at any time and release it anywhere.

pub mod back;
pub mod follower;
pub mod frames;
pub mod profile;

use glam::DVec3;

use crate::fields::Clearances;

/// Path length between two control points of a route, mm.
pub const STEP_MM: f64 = 1.0;
/// Number of positions along the route tried when looking for one that the body can reach.
const REACHABLE_TRIED: usize = 6;
/// Difference of distance up to which two positions along the route are passes of the same place, mm.
const PASS_MM: f64 = 4.0;
/// Distance ahead that is searched for narrow places, mm.
const NARROW_AHEAD_MM: f64 = 15.0;
/// The path is narrow where it leaves the body no more than this on each side, mm.
const NARROW_MM: f64 = 0.5;

/// A path through the lumen, world mm: a uniform cubic B-spline through points [`STEP_MM`] apart.
///
/// Its curvature is continuous, and it lies inside the hull of any four neighbours.
///
/// ```
/// # use colvis_kernels as colvis;
/// use colvis::dynamics::Route;
/// use glam::DVec3;
///
/// let line: Vec<DVec3> = (0..=100).map(|n| DVec3::X * f64::from(n)).collect();
/// let route = Route::along(&line, &[8.0; 101], DVec3::Z).expect("two places or more");
/// assert!((route.length_mm() - 100.0).abs() < 1e-6);
/// assert!(route.place(40.0).distance(DVec3::X * 40.0) < 1e-6 && route.look(40.0, 20.0).dot(DVec3::X) > 0.999);
/// assert!(route.reversed().tangent(10.0).dot(DVec3::NEG_X) > 0.999);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Route {
    /// Control points, at least two, about [`STEP_MM`] apart.
    points: Vec<DVec3>,
    /// Path length between two of them, mm.
    step: f64,
    /// Distance from each control point to the nearest wall, mm.
    clearance: Vec<f64>,
    /// Unit up vector of the rotation-minimising frame at each control point.
    ups: Vec<DVec3>,
}

impl Route {
    /// Creates a route along a polyline (world mm) whose points are `clearance` (mm) from the wall. The frames start with `up`.
    ///
    /// Points that are not finite or that repeat another are dropped. Returns `None` if fewer than two remain.
    pub fn along(line: &[DVec3], clearance: &[f64], up: DVec3) -> Option<Self> {
        let mut kept: Vec<(DVec3, f64)> = Vec::with_capacity(line.len());
        for (n, &p) in line.iter().enumerate() {
            let c = clearance.get(n).copied().filter(|c| c.is_finite()).unwrap_or(0.0).max(0.0);
            if p.is_finite() && kept.last().is_none_or(|l| l.0.distance(p) > 1e-6) {
                kept.push((p, c));
            }
        }
        let mut along = vec![0.0];
        for w in kept.windows(2) {
            along.push(along[along.len() - 1] + w[0].0.distance(w[1].0));
        }
        let length = along[along.len() - 1];
        if kept.len() < 2 || !length.is_finite() {
            return None;
        }
        let cells = (length / STEP_MM).ceil().clamp(1.0, 1e6) as usize;
        let step = length / cells as f64;
        let mut at = 0;
        let (points, clearance): (Vec<_>, Vec<_>) = (0..=cells)
            .map(|n| {
                let s = step * n as f64;
                while at + 2 < along.len() && along[at + 1] < s {
                    at += 1;
                }
                let t = ((s - along[at]) / (along[at + 1] - along[at])).clamp(0.0, 1.0);
                (kept[at].0.lerp(kept[at + 1].0, t), kept[at].1 + (kept[at + 1].1 - kept[at].1) * t)
            })
            .unzip();
        let mut route = Self { points, step, clearance, ups: Vec::new() };
        let tangents: Vec<_> = (0..=cells).map(|n| route.tangent(step * n as f64)).collect();
        route.ups = frames::rotation_minimising(&route.points, &tangents, up);
        Some(route)
    }

    /// Returns the route from its end to its start.
    pub fn reversed(&self) -> Self {
        let back = |v: &[DVec3]| v.iter().rev().copied().collect();
        Self {
            points: back(&self.points),
            step: self.step,
            clearance: self.clearance.iter().rev().copied().collect(),
            ups: back(&self.ups),
        }
    }

    /// Returns the length, mm.
    pub fn length_mm(&self) -> f64 {
        self.step * (self.points.len() - 1) as f64
    }

    /// Returns the control points, world mm, evenly spaced along the path.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        self.points.len() * (2 * size_of::<DVec3>() + size_of::<f64>())
    }

    /// Returns a control point. Beyond the ends, points are mirrored, so that the curve starts and ends at the outermost ones.
    fn control(&self, n: i64) -> DVec3 {
        let last = self.points.len() as i64 - 1;
        if n < 0 {
            2.0 * self.points[0] - self.points[(-n).min(last) as usize]
        } else if n > last {
            2.0 * self.points[last as usize] - self.points[(2 * last - n).max(0) as usize]
        } else {
            self.points[n as usize]
        }
    }

    /// Returns the cell of a position along the path, and the position within it, 0 to 1.
    fn cell(&self, s: f64) -> (i64, f64) {
        let u = if s.is_finite() { (s / self.step).clamp(0.0, (self.points.len() - 1) as f64) } else { 0.0 };
        let n = u.floor().min((self.points.len() - 2) as f64);
        (n as i64, u - n)
    }

    fn blend(&self, s: f64, weights: impl Fn(f64) -> [f64; 4]) -> DVec3 {
        let (n, t) = self.cell(s);
        let w = weights(t);
        (0..4).map(|k| self.control(n - 1 + k as i64) * w[k]).sum()
    }

    /// Returns the point after `s` mm of the path, world mm; clamped to its start and end.
    pub fn place(&self, s: f64) -> DVec3 {
        self.blend(s, |t| {
            let r = 1.0 - t;
            [r * r * r, 3.0 * t * t * t - 6.0 * t * t + 4.0, 3.0 * r * r * r - 6.0 * r * r + 4.0, t * t * t]
                .map(|w| w / 6.0)
        })
    }

    /// Returns the point after `s` mm of the path, world mm. Beyond its end the path goes straight on.
    pub fn beyond(&self, s: f64) -> DVec3 {
        let more = (s - self.length_mm()).max(0.0);
        if more > 0.0 { self.place(s) + self.tangent(s) * more } else { self.place(s) }
    }

    /// Returns the unit direction of the path at `s` mm, world; z if it has none.
    pub fn tangent(&self, s: f64) -> DVec3 {
        let derivative = self.blend(s, |t| {
            let r = 1.0 - t;
            [-r * r, 3.0 * t * t - 4.0 * t, -3.0 * r * r + 4.0 * r, t * t].map(|w| w / 2.0)
        });
        derivative.try_normalize().unwrap_or(DVec3::Z)
    }

    /// Returns the curvature around `s` mm, 1/mm: the turn of the tangent over `window` mm.
    pub fn bend(&self, s: f64, window: f64) -> f64 {
        let (a, b) = ((s - window / 2.0).max(0.0), (s + window / 2.0).min(self.length_mm()));
        if b > a { self.tangent(a).angle_between(self.tangent(b)) / (b - a) } else { 0.0 }
    }

    /// Returns the distance from the path to the nearest wall at `s` mm, mm.
    pub fn clearance(&self, s: f64) -> f64 {
        let (n, t) = self.cell(s);
        let n = n as usize;
        self.clearance[n] + (self.clearance[n + 1] - self.clearance[n]) * t
    }

    /// Returns the unit up vector of the rotation-minimising frame at `s` mm, world.
    pub fn up(&self, s: f64) -> DVec3 {
        let (n, t) = self.cell(s);
        let tangent = self.tangent(s);
        let up = self.ups[n as usize].lerp(self.ups[n as usize + 1], t);
        (up - tangent * up.dot(tangent)).try_normalize().unwrap_or_else(|| tangent.any_orthonormal_vector())
    }

    /// Returns the view direction at `s` mm: a unit vector (world) towards the path ahead.
    ///
    /// It is averaged over the next `ahead` mm, so it turns smoothly. At the end it is the tangent.
    pub fn look(&self, s: f64, ahead: f64) -> DVec3 {
        let end = (s + ahead).min(self.length_mm());
        if end - s < self.step {
            return self.tangent(s);
        }
        // Average over all positions, including the nearer half: looking at one far point would cut every corner.
        let n = ((end - s) / (2.0 * self.step)).ceil().clamp(1.0, 64.0) as usize;
        let here = self.place(s);
        let sum: DVec3 =
            (1..=n).map(|i| (self.place(s + (end - s) * i as f64 / n as f64) - here).normalize_or_zero()).sum();
        sum.try_normalize().unwrap_or_else(|| self.tangent(s))
    }

    /// Returns the positions along the path, mm, that are nearest to `at` (world mm) among their neighbours, nearest first.
    ///
    /// Loops of the colon touch, so the nearest of all may be in another loop.
    pub fn nearest(&self, at: DVec3) -> Vec<f64> {
        let d: Vec<f64> = self.points.iter().map(|p| p.distance_squared(at)).collect();
        let last = d.len() - 1;
        let mut found: Vec<(f64, f64)> = (0..=last)
            .filter(|&n| (n == 0 || d[n] < d[n - 1]) && (n == last || d[n] <= d[n + 1]))
            .map(|n| {
                // The foot of the perpendicular on the two cells around it.
                let along = (at - self.points[n]).dot(self.tangent(self.step * n as f64));
                let s = (self.step * n as f64 + along.clamp(-self.step, self.step)).clamp(0.0, self.length_mm());
                (d[n], s)
            })
            .collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        found.into_iter().map(|f| f.1).collect()
    }

    /// Returns the nearest position along the path, mm, that a free straight line from `at` (world mm) reaches.
    ///
    /// Returns `None` if no line is free: a body that flies towards a place behind a wall hangs there. Its own trail leads back, see
    /// [`back::way_back`].
    pub fn nearest_reachable(&self, walls: &impl Clearances, at: DVec3) -> Option<f64> {
        let free = |&s: &f64| !walls.enters(at, self.place(s));
        self.nearest(at).into_iter().take(REACHABLE_TRIED).find(free)
    }

    /// Returns the position along the path, mm, that a free straight line from `at` (world mm) reaches, near the path and nearest to
    /// `s` mm along it.
    ///
    /// For a path that passes the same places several times: positions up to 4 mm farther than the nearest one count as passes of the
    /// same place. Returns `None` if no line is free.
    pub fn nearest_pass(&self, walls: &impl Clearances, at: DVec3, s: f64) -> Option<f64> {
        let nearest = self.nearest_reachable(walls, at)?;
        let far = self.place(nearest).distance(at) + PASS_MM;
        let passes = self.nearest(at).into_iter().take_while(|&p| self.place(p).distance(at) <= far + STEP_MM);
        let free = passes.filter(|&p| self.place(p).distance(at) <= far && !walls.enters(at, self.place(p)));
        free.min_by(|a, b| (a - s).abs().total_cmp(&(b - s).abs())).or(Some(nearest))
    }

    /// Returns the least distance from the path to the nearest wall over the next 15 mm after `s` mm, mm.
    pub fn narrowest_ahead(&self, s: f64) -> f64 {
        let ahead = (0..(NARROW_AHEAD_MM as i32)).map(|n| self.clearance(s + f64::from(n)));
        ahead.fold(f64::INFINITY, f64::min)
    }

    /// Returns a message for the operator if the path soon after `s` mm is too narrow for a body of `radius_mm`.
    ///
    /// A place is too narrow if less than 0.5 mm is free on each side.
    pub fn narrow_place(&self, s: f64, radius_mm: f64) -> Option<String> {
        let least = self.narrowest_ahead(s);
        (least < radius_mm + NARROW_MM).then(|| {
            format!(
                "the path ahead narrows to {:.1} mm across; the camera needs {:.1} mm",
                2.0 * least,
                2.0 * radius_mm
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circle(radius: f64, points: usize) -> Vec<DVec3> {
        let at = |n: usize| n as f64 * std::f64::consts::TAU * 0.8 / (points - 1) as f64;
        (0..points).map(|n| DVec3::new(radius * at(n).cos(), radius * at(n).sin(), 5.0)).collect()
    }

    #[test]
    fn a_circle_is_followed_smoothly() {
        let radius = 20.0;
        let line = circle(radius, 400);
        let r = Route::along(&line, &vec![7.0; 400], DVec3::Z).unwrap();
        assert!((r.length_mm() - 0.8 * std::f64::consts::TAU * radius).abs() < 0.1);
        assert!(r.place(0.0).distance(line[0]) < 1e-9 && r.place(1e9).distance(line[399]) < 1e-9);
        assert_eq!(r.place(f64::NAN), r.place(0.0));
        let (end, beyond) = (r.length_mm(), r.beyond(r.length_mm() + 7.0));
        assert!(r.beyond(3.0) == r.place(3.0) && beyond.distance(r.place(end) + r.tangent(end) * 7.0) < 1e-9);
        for n in 0..=300 {
            let s = r.length_mm() * f64::from(n) / 300.0;
            let p = r.place(s);
            assert!((p.truncate().length() - radius).abs() < 0.02, "{p}");
            assert!(r.tangent(s).dot(p - DVec3::Z * 5.0) / radius < 0.03 && r.up(s).dot(DVec3::Z) > 0.9999);
            if s > 5.0 && s < r.length_mm() - 5.0 {
                assert!((r.bend(s, 6.0) - 1.0 / radius).abs() < 0.002);
            }
            assert!((r.clearance(s) - 7.0).abs() < 1e-9);
            let near = r.nearest(p)[0];
            assert!((near - s).abs() < 0.1, "{near} for {s}");
        }
        // The second derivative is continuous: the change of the tangent never jumps.
        let h = 0.01;
        let turn = |s: f64| (r.tangent(s + h) - r.tangent(s)) / h;
        for n in 0..2000 {
            let s = 5.0 + 0.04 * f64::from(n);
            assert!((turn(s + h) - turn(s)).length() < 2e-3, "at {s}");
        }
    }

    #[test]
    fn there_and_back_are_one_way() {
        let r = Route::along(&circle(15.0, 90), &[4.0; 90], DVec3::Z).unwrap();
        let b = r.reversed();
        for s in [0.0, 3.3, 20.0, r.length_mm()] {
            assert!(r.place(s).distance(b.place(r.length_mm() - s)) < 1e-9);
            assert!((r.tangent(s) + b.tangent(r.length_mm() - s)).length() < 1e-9);
        }
        assert!(r.look(10.0, 20.0).dot(r.tangent(10.0)) > 0.8);
    }

    /// A wall at y = 1; everything above it is hidden.
    struct RouteCache;

    impl Clearances for RouteCache {
        fn clearance(&self, at: DVec3) -> crate::fields::Clearance {
            crate::fields::Clearance { mm: (1.0 - at.y).max(0.0), toward: DVec3::Y }
        }

        fn enters(&self, from: DVec3, to: DVec3) -> bool {
            (from.y < 1.0) != (to.y < 1.0)
        }
    }

    #[test]
    fn a_loop_behind_a_wall_is_no_place_to_join() {
        // There at y = 0, back at y = 3: the return path is nearer, but behind the shelf.
        let line: Vec<_> = (0..=40)
            .map(|n| DVec3::new(f64::from(n), 0.0, 0.0))
            .chain((0..=40).map(|n| DVec3::new(40.0 - f64::from(n), 3.0, 0.0)))
            .collect();
        let r = Route::along(&line, &vec![2.0; line.len()], DVec3::Z).unwrap();
        let at = DVec3::new(10.0, 0.9, 2.0);
        assert!((r.nearest_reachable(&RouteCache, at).unwrap() - 10.0).abs() < 0.1);
        let above = DVec3::new(10.0, 2.5, 0.0);
        assert!((r.nearest_reachable(&RouteCache, above).unwrap() - 73.0).abs() < 1.0);
        // Behind the shelf of a path that stays below it, there is no place to join.
        let below = Route::along(&line[..41], &[2.0; 41], DVec3::Z).unwrap();
        assert_eq!(below.nearest_reachable(&RouteCache, above), None);
        assert_eq!(below.nearest_pass(&RouteCache, above, 10.0), None);
    }

    #[test]
    fn a_path_that_returns_is_joined_on_the_same_pass() {
        // There at y = 0, back at y = −1.
        let line: Vec<_> = (0..=40)
            .map(|n| DVec3::new(f64::from(n), 0.0, 0.0))
            .chain((0..=40).map(|n| DVec3::new(40.0 - f64::from(n), -1.0, 0.0)))
            .collect();
        let r = Route::along(&line, &vec![2.0; line.len()], DVec3::Z).unwrap();
        let at = DVec3::new(10.0, 0.3, 0.0);
        assert!((r.nearest_pass(&RouteCache, at, 12.0).unwrap() - 10.0).abs() < 0.2);
        assert!((r.nearest_pass(&RouteCache, at, 75.0).unwrap() - 71.0).abs() < 1.0);
        assert!((r.nearest_pass(&RouteCache, at - DVec3::Y * 20.0, 12.0).unwrap() - 10.0).abs() < 0.2);
    }

    #[test]
    fn a_narrow_place_ahead_is_told() {
        let line: Vec<_> = (0..=100).map(|n| DVec3::X * f64::from(n)).collect();
        let clearance: Vec<_> = (0..=100).map(|n| if n == 50 { 1.2 } else { 6.0 }).collect();
        let r = Route::along(&line, &clearance, DVec3::Z).unwrap();
        assert!((r.narrowest_ahead(40.0) - 1.2).abs() < 1e-9 && r.narrowest_ahead(20.0) == 6.0);
        let reported = r.narrow_place(40.0, 1.5).unwrap();
        assert_eq!(reported, "the path ahead narrows to 2.4 mm across; the camera needs 3.0 mm");
        assert!(r.narrow_place(40.0, 0.5).is_none() && r.narrow_place(20.0, 1.5).is_none());
    }

    #[test]
    fn what_is_no_line_is_none() {
        assert!(Route::along(&[], &[], DVec3::Z).is_none());
        assert!(Route::along(&[DVec3::X; 9], &[1.0; 9], DVec3::Z).is_none());
        assert!(Route::along(&[DVec3::NAN, DVec3::X], &[1.0; 2], DVec3::Z).is_none());
        let r = Route::along(&[DVec3::ZERO, DVec3::NAN, DVec3::X * 1e-3], &[], DVec3::NAN).unwrap();
        assert!(r.place(0.5e-3).is_finite() && r.up(0.0).is_finite() && r.look(0.0, 9.0).is_finite());
        assert_eq!(r.clearance(0.0), 0.0);
        // Straight there and back: no tangent at the turn, but all values stay finite.
        let r = Route::along(&[DVec3::ZERO, DVec3::X * 5.0, DVec3::ZERO], &[1.0; 3], DVec3::Y).unwrap();
        for n in 0..100 {
            let s = 0.1 * f64::from(n);
            assert!(r.up(s).is_normalized() && r.tangent(s).is_normalized() && r.look(s, 4.0).is_normalized());
        }
    }
}
