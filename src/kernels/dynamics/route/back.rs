//! The way back over a body's own trail: where a body has been, it can fly again.

use glam::DVec3;

use crate::fields::Clearances;

/// Longest distance between two places of a trail that were flown one after the other, mm. A trail is recorded every 2 mm, and a longer
/// gap is a jump.
const GAP_MM: f64 = 3.0;
/// Places nearer to each other than this are one, mm: the loop between them is cut off.
const SAME_MM: f64 = 1.0;
/// Maximum number of places that are followed back.
const PLACES: usize = 2000;

/// Returns the places from `at` (world mm) back over the `trail` (world mm, in the order flown), `at` among them, without loops.
///
/// It ends where the trail begins or where the body was moved there by a jump: no flight connects the two places.
pub fn way_back(trail: &[DVec3], walls: &impl Clearances, at: DVec3) -> Vec<DVec3> {
    let trail = &trail[trail.len().saturating_sub(PLACES)..];
    let mut begin = trail.len();
    let mut here = at;
    while let Some(&before) = begin.checked_sub(1).and_then(|n| trail.get(n))
        && here.distance(before) <= GAP_MM
        && !walls.enters(here, before)
    {
        (begin, here) = (begin - 1, before);
    }
    let mut left = &trail[begin..];
    let mut way = vec![at];
    let mut here = at;
    while !left.is_empty() {
        let same = left.iter().position(|p| p.distance(here) <= SAME_MM && !walls.enters(here, *p));
        let next = same.unwrap_or(left.len() - 1);
        here = left[next];
        way.push(here);
        left = &left[..next];
    }
    way
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::Clearance;

    /// A wall at x = 0.
    struct Wall;

    impl Clearances for Wall {
        fn clearance(&self, at: DVec3) -> Clearance {
            Clearance { mm: at.x.abs(), toward: -DVec3::X * at.x.signum() }
        }

        fn enters(&self, from: DVec3, to: DVec3) -> bool {
            (from.x < 0.0) != (to.x < 0.0)
        }
    }

    fn line(from: DVec3, to: DVec3) -> impl Iterator<Item = DVec3> {
        let count = (from.distance(to) / 2.0).round() as i32;
        (0..=count).map(move |n| from.lerp(to, f64::from(n) / f64::from(count)))
    }

    #[test]
    fn it_leads_back_without_loops_and_not_over_a_jump() {
        let p = DVec3::new;
        let far = line(p(5.0, 0.0, 90.0), p(5.0, 0.0, 120.0));
        let main = line(p(5.0, 0.0, 0.0), p(5.0, 0.0, 40.0));
        let aside = line(p(5.0, 0.0, 40.0), p(25.0, 0.0, 40.0)).chain(line(p(25.0, 0.0, 40.0), p(5.0, 0.4, 40.0)));
        let on = line(p(5.0, 0.4, 40.0), p(5.0, 0.0, 60.0));
        let trail: Vec<_> = far.chain(main).chain(aside).chain(on).collect();
        let way = way_back(&trail, &Wall, p(5.0, 0.0, 61.0));
        assert!(way[0] == p(5.0, 0.0, 61.0) && way.iter().all(|w| w.x == 5.0), "{way:?}");
        assert!(way[way.len() - 1] == p(5.0, 0.0, 0.0), "it ends at the jump");
        assert!(way.windows(2).all(|w| w[0].distance(w[1]) <= GAP_MM));
        let mm: f64 = way.windows(2).map(|w| w[0].distance(w[1])).sum();
        assert!(mm < 63.0, "{mm}");
    }

    #[test]
    fn a_trail_behind_a_wall_or_far_away_is_none_of_it() {
        let trail: Vec<_> = line(DVec3::X, DVec3::new(1.0, 0.0, 20.0)).collect();
        for at in [DVec3::new(-1.0, 0.0, 20.0), DVec3::new(1.0, 0.0, 25.0)] {
            assert_eq!(way_back(&trail, &Wall, at), [at]);
        }
        assert_eq!(way_back(&[], &Wall, DVec3::X), [DVec3::X]);
        assert_eq!(way_back(&trail, &Wall, DVec3::new(1.0, 0.0, 21.0)).len(), trail.len() + 1);
    }
}
