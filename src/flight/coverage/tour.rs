//! The shortest tour: the order in which to visit the places that were missed.
//!
//! The tour is open. It starts where the camera is, visits each stop once, and ends at the last one. Up to [`EXACT`] stops, it is
//! the shortest of all: the dynamic programme over subsets of Held and Karp (1962), `O(2ⁿ n²)`. Above that, it begins with the cheapest
//! insertion (Rosenkrantz, Stearns and Lewis 1977), is improved by 2-opt (Croes 1958) and Or-opt (Or 1976, runs of up to three stops,
//! also reversed) until neither finds a shorter one, and is then perturbed by double bridges and improved again (iterated local search,
//! Martin, Otto and Felten 1991). A round of either improvement takes `O(n²)`. Nothing depends on a clock or on threads.

use crate::math::hash;

/// Up to this many stops the order is the best of all.
pub const EXACT: usize = 11;
/// Longest run of stops that Or-opt moves.
const RUN: usize = 3;
/// Maximum number of perturbations, and the work that bounds them for many stops: perturbations times the square of the number of
/// stops.
const KICKS: usize = 50;
const WORK: usize = 2_000_000;
/// Smaller improvements do not count, mm: rounding must not cause endless exchanges.
const LEAST_MM: f64 = 1e-7;

/// An order of stops.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Order {
    /// The stops in the order of the tour, counted from 0.
    pub stops: Vec<usize>,
    /// Stops that cannot be reached, ascending.
    pub left_out: Vec<usize>,
    /// Length of the tour, mm.
    pub length_mm: f64,
}

/// Distances between the start and the stops, mm, symmetric. Place 0 is the start, place `n + 1` is stop `n`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Distances {
    places: usize,
    mm: Vec<f64>,
}

impl Distances {
    /// Tabulates the distance between each two of `places` places, the start among them. Infinite if there is no path.
    pub fn new(places: usize, mm: impl Fn(usize, usize) -> f64) -> Self {
        let mut all = vec![0.0; places * places];
        for a in 0..places {
            for b in a + 1..places {
                let d = mm(a, b);
                let d = if d >= 0.0 { d } else { f64::INFINITY };
                (all[a * places + b], all[b * places + a]) = (d, d);
            }
        }
        Self { places, mm: all }
    }

    /// Returns the number of stops.
    pub fn stops(&self) -> usize {
        self.places.saturating_sub(1)
    }

    /// Returns the distance between two places, mm.
    pub fn mm(&self, a: usize, b: usize) -> f64 {
        self.mm[a * self.places + b]
    }

    /// Returns the length of the tour from the start through places in this order, mm.
    fn length(&self, tour: &[usize]) -> f64 {
        let mut at = 0;
        let mut sum = 0.0;
        for &n in tour {
            sum += self.mm(at, n);
            at = n;
        }
        sum
    }
}

/// Returns the shortest tour that was found: see the [module](self).
pub fn shortest(distances: &Distances) -> Order {
    let is_reached = |n: &usize| distances.mm(0, *n).is_finite();
    let (reached, out): (Vec<usize>, Vec<usize>) = (1..=distances.stops()).partition(is_reached);
    let tour = if reached.len() <= EXACT { exact(distances, &reached) } else { improved(distances, &reached) };
    let length_mm = distances.length(&tour);
    let stop = |n: usize| n - 1;
    Order { stops: tour.into_iter().map(stop).collect(), left_out: out.into_iter().map(stop).collect(), length_mm }
}

/// Returns the length of the shortest of `count` random orders of the stops that can be reached, mm: what [`shortest`] is measured
/// against.
pub fn best_of_random(distances: &Distances, count: u64, seed: u64) -> f64 {
    let reached: Vec<usize> = (1..=distances.stops()).filter(|n| distances.mm(0, *n).is_finite()).collect();
    let orders = (0..count).map(|k| distances.length(&shuffled(&reached, hash::bits(seed, k))));
    orders.fold(f64::INFINITY, f64::min)
}

/// Returns the places in a random order (Fisher and Yates).
fn shuffled(places: &[usize], seed: u64) -> Vec<usize> {
    let mut order = places.to_vec();
    for n in (1..order.len()).rev() {
        order.swap(n, below(seed, n as u64, n + 1));
    }
    order
}

/// Returns a random number below `most`.
fn below(seed: u64, counter: u64, most: usize) -> usize {
    ((hash::uniform(seed, counter) * most as f64) as usize).min(most.saturating_sub(1))
}

/// The shortest of all orders. `cost[set][last]` is the length of the shortest tour through a set of places that ends at one of them.
fn exact(distances: &Distances, places: &[usize]) -> Vec<usize> {
    let n = places.len();
    if n == 0 {
        return Vec::new();
    }
    let sets = 1usize << n;
    let mut cost = vec![f64::INFINITY; sets * n];
    let mut before = vec![0u8; sets * n];
    for (k, &place) in places.iter().enumerate() {
        cost[(1 << k) * n + k] = distances.mm(0, place);
    }
    for set in 1..sets {
        for last in (0..n).filter(|l| set >> l & 1 == 1) {
            let here = cost[set * n + last];
            if here == f64::INFINITY {
                continue;
            }
            for next in (0..n).filter(|m| set >> m & 1 == 0) {
                let to = (set | 1 << next) * n + next;
                let there = here + distances.mm(places[last], places[next]);
                if there < cost[to] {
                    (cost[to], before[to]) = (there, last as u8);
                }
            }
        }
    }
    let mut set = sets - 1;
    let ends = |l: &usize| cost[set * n + *l];
    let mut last = (0..n).min_by(|a, b| ends(a).total_cmp(&ends(b))).unwrap_or(0);
    let mut tour = Vec::with_capacity(n);
    loop {
        tour.push(places[last]);
        let from = usize::from(before[set * n + last]);
        set &= !(1 << last);
        if set == 0 {
            tour.reverse();
            return tour;
        }
        last = from;
    }
}

/// A good order of many places.
fn improved(distances: &Distances, places: &[usize]) -> Vec<usize> {
    let mut tour = inserted(distances, places);
    improve(distances, &mut tour);
    let mut best = distances.length(&tour);
    let n = tour.len();
    for kick in 0..KICKS.min(WORK / (n * n).max(1)) as u64 {
        // The double bridge: a b c d becomes a c b d, which no 2-opt undoes.
        let mut cuts = [0, 1, 2].map(|k| below(0x0074_6f75_7273, 3 * kick + k, n + 1));
        cuts.sort_unstable();
        let [x, y, z] = cuts;
        let mut other = [&tour[..x], &tour[y..z], &tour[x..y], &tour[z..]].concat();
        improve(distances, &mut other);
        let length = distances.length(&other);
        if length < best - LEAST_MM {
            (tour, best) = (other, length);
        }
    }
    tour
}

/// Inserts one place after the other where that costs least, always the cheapest next.
fn inserted(distances: &Distances, places: &[usize]) -> Vec<usize> {
    let mut left = places.to_vec();
    let mut tour: Vec<usize> = Vec::with_capacity(places.len());
    while !left.is_empty() {
        let mut best = (f64::INFINITY, 0, 0);
        for (k, &place) in left.iter().enumerate() {
            for at in 0..=tour.len() {
                let before = if at == 0 { 0 } else { tour[at - 1] };
                let through = distances.mm(before, place);
                let more = match tour.get(at) {
                    Some(&after) => through + distances.mm(place, after) - distances.mm(before, after),
                    None => through,
                };
                if more < best.0 {
                    best = (more, k, at);
                }
            }
        }
        let (_, k, at) = best;
        tour.insert(at, left.remove(k));
    }
    tour
}

/// Shortens a tour by 2-opt and Or-opt until neither helps.
fn improve(distances: &Distances, tour: &mut Vec<usize>) {
    while reverse_a_part(distances, tour) || move_a_run(distances, tour) {}
}

/// Reverses the first part whose reversal shortens the tour.
fn reverse_a_part(distances: &Distances, tour: &mut [usize]) -> bool {
    let n = tour.len();
    for i in 0..n {
        let before = if i == 0 { 0 } else { tour[i - 1] };
        for j in i + 1..n {
            let (old, new) = (distances.mm(before, tour[i]), distances.mm(before, tour[j]));
            // After the last stop the tour is over.
            let (old, new) = match tour.get(j + 1) {
                Some(&after) => (old + distances.mm(tour[j], after), new + distances.mm(tour[i], after)),
                None => (old, new),
            };
            if new < old - LEAST_MM {
                tour[i..=j].reverse();
                return true;
            }
        }
    }
    false
}

/// Moves the first run of a few stops, as it is or reversed, whose move shortens the tour.
fn move_a_run(distances: &Distances, tour: &mut Vec<usize>) -> bool {
    let n = tour.len();
    for length in 1..=RUN.min(n.saturating_sub(1)) {
        for i in 0..=n - length {
            let (first, last) = (tour[i], tour[i + length - 1]);
            let before = if i == 0 { 0 } else { tour[i - 1] };
            let after = tour.get(i + length).copied();
            let gain =
                distances.mm(before, first) + after.map_or(0.0, |a| distances.mm(last, a) - distances.mm(before, a));
            // Between the places `at − 1` and `at` of the rest.
            for at in (0..=n - length).filter(|&at| at != i) {
                let rest = |k: usize| if k < i { tour[k] } else { tour[k + length] };
                let left = if at == 0 { 0 } else { rest(at - 1) };
                let right = (at < n - length).then(|| rest(at));
                for (a, b, is_reversed) in [(first, last, false), (last, first, true)] {
                    let more =
                        distances.mm(left, a) + right.map_or(0.0, |r| distances.mm(b, r) - distances.mm(left, r));
                    if more < gain - LEAST_MM {
                        let mut run: Vec<usize> = tour.drain(i..i + length).collect();
                        if is_reversed {
                            run.reverse();
                        }
                        tour.splice(at..at, run);
                        return true;
                    }
                }
            }
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn in_a_plane(points: &[(f64, f64)]) -> Distances {
        Distances::new(points.len(), |a, b| (points[a].0 - points[b].0).hypot(points[a].1 - points[b].1))
    }

    /// The shortest of all orders, each tried.
    fn by_force(distances: &Distances, done: &mut Vec<usize>, best: &mut f64) {
        if done.len() == distances.stops() {
            *best = best.min(distances.length(done));
            return;
        }
        for n in 1..=distances.stops() {
            if !done.contains(&n) {
                done.push(n);
                by_force(distances, done, best);
                done.pop();
            }
        }
    }

    fn is_order(order: &Order, count: usize) -> bool {
        let mut all = [&order.stops[..], &order.left_out].concat();
        all.sort_unstable();
        all == (0..count).collect::<Vec<_>>()
    }

    #[test]
    fn no_stop_and_one() {
        for none in [Distances::default(), in_a_plane(&[(1.0, 1.0)])] {
            assert_eq!(shortest(&none), Order::default());
            assert!(best_of_random(&none, 0, 1).is_infinite());
        }
        let one = shortest(&in_a_plane(&[(0.0, 0.0), (3.0, 4.0)]));
        assert_eq!(one, Order { stops: vec![0], left_out: Vec::new(), length_mm: 5.0 });
    }

    #[test]
    fn stops_that_no_way_leads_to_are_left_out() {
        for count in [5, 30] {
            let far = |n: usize| n == 2 || n == 4;
            let d = Distances::new(count + 1, |a, b| {
                let apart = (a as f64 - b as f64).abs();
                if far(a) == far(b) { apart } else { f64::INFINITY }
            });
            let order = shortest(&d);
            assert_eq!(order.left_out, [1, 3]);
            assert!(is_order(&order, count) && order.stops.is_sorted() && order.length_mm == count as f64);
        }
        // Invalid distances count as infinite.
        let order = shortest(&Distances::new(3, |_, b| if b == 1 { f64::NAN } else { -1.0 }));
        assert!(order.stops.is_empty() && order.left_out == [0, 1]);
    }

    #[test]
    fn along_a_tube_with_pockets_the_tour_goes_through_once() {
        // Places along a line, each a little off it; the start in the middle, nearer to one end.
        let along = |n: usize| if n == 0 { 420.0 } else { 25.0 * ((n * 17) % 41) as f64 };
        let off = |n: usize| (n % 5) as f64 * 3.0;
        let d = Distances::new(42, |a, b| (along(a) - along(b)).abs() + off(a) + off(b));
        let order = shortest(&d);
        let pockets: f64 = 2.0 * (1..42).map(off).sum::<f64>() - off(order.stops[40] + 1);
        assert!(is_order(&order, 41) && (order.length_mm - (420.0 + 1000.0 + pockets)).abs() < 1e-6, "{order:?}");
        assert!(order.length_mm < 0.2 * best_of_random(&d, 1000, 7));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn few_stops_are_visited_in_the_best_order(points in prop::collection::vec((0.0f64..100.0, 0.0f64..100.0), 1..8)) {
            let d = in_a_plane(&points);
            let mut best = f64::INFINITY;
            by_force(&d, &mut Vec::new(), &mut best);
            let order = shortest(&d);
            prop_assert!(is_order(&order, points.len() - 1));
            prop_assert!((order.length_mm - best).abs() < 1e-9, "{} for {best}", order.length_mm);
            // What many stops are ordered by finds nearly the same.
            let places: Vec<usize> = (1..points.len()).collect();
            let close = d.length(&improved(&d, &places));
            prop_assert!(places.is_empty() || close <= 1.05 * best + 1e-9, "{close} for {best}");
        }

        #[test]
        fn many_stops_never_take_longer_than_random_orders(
            mut points in prop::collection::vec((0.0f64..300.0, 0.0f64..40.0), 2..60), twice in any::<bool>(),
        ) {
            if twice {
                points.extend_from_within(1..);
            }
            let d = in_a_plane(&points);
            let order = shortest(&d);
            prop_assert!(is_order(&order, points.len() - 1) && order == shortest(&d));
            prop_assert!(order.length_mm <= best_of_random(&d, 1000, 3) + 1e-9);
            let tour: Vec<usize> = order.stops.iter().map(|n| n + 1).collect();
            prop_assert!((d.length(&tour) - order.length_mm).abs() < 1e-9);
        }
    }
}
