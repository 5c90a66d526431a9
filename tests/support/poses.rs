//! Poses along a flight, including those that are hard to render.

use colvis::math::hash;
use colvis::render::{PreparedVolume, first_crossing};
use colvis::report::flight::{Flown, Pose};
use glam::{DQuat, DVec3};

/// Steps before and after a pose between which a bend is measured: half a second of flight.
const AROUND: usize = 30;
/// Distance from the wall of a close camera, mm: the minimum and the range above it.
const CLOSE: [f64; 2] = [1.0, 2.0];

/// Returns `count` poses. Half of them are spread evenly over the flight. Of the rest, a third each are in its
/// narrowest bends, close to the wall, and turned to look elsewhere.
pub(crate) fn hard(flown: &Flown, volume: &PreparedVolume, count: usize) -> Vec<(&'static str, Pose)> {
    let last = flown.log.len() - 1;
    let third = count / 6;
    let even = count - 3 * third;
    let spread = |n: usize, of: usize| (last as f64 * (n as f64 + 0.5) / of as f64) as usize;
    let mut all: Vec<_> = (0..even).map(|n| ("flight", at(flown, spread(n, even)))).collect();
    all.extend(bends(flown, third).into_iter().map(|n| ("bend", at(flown, n))));
    for n in 0..third as u64 {
        let random = |k| hash::uniform(0x6A1D + n, k);
        let pose = at(flown, spread(n as usize, third));
        let right = pose.forward.cross(pose.up).normalize();
        let aside = DQuat::from_axis_angle(pose.forward, 6.3 * random(0)) * right;
        let gap = CLOSE[0] + CLOSE[1] * random(1);
        let shift = first_crossing(volume, pose.position, aside, 100.0).map_or(0.0, |mm| (mm - gap).max(0.0));
        let turn = DQuat::from_axis_angle(pose.forward.cross(aside).normalize(), 2.0 * random(2) - 0.7);
        let [forward, up] = [pose.forward, pose.up].map(|v| turn * v);
        all.push(("close", Pose { position: pose.position + aside * shift, forward, up }));
        let pose = at(flown, (random(3) * last as f64) as usize);
        let way = DVec3::new(random(4) - 0.5, random(5) - 0.5, random(6) - 0.5).normalize();
        let turn = DQuat::from_axis_angle(way, 6.3 * random(7));
        all.push(("turned", Pose { forward: turn * pose.forward, up: turn * pose.up, ..pose }));
    }
    all
}

fn at(flown: &Flown, n: usize) -> Pose {
    let line = &flown.log[n.min(flown.log.len() - 1)];
    let [position, forward, up] = [line.position, line.forward, line.up].map(DVec3::from_array);
    Pose { position, forward, up }
}

/// Returns the steps at which the view turns most, far enough apart to be different bends.
fn bends(flown: &Flown, count: usize) -> Vec<usize> {
    let last = flown.log.len() - 1;
    let turned =
        |n: usize| at(flown, n.saturating_sub(AROUND)).forward.angle_between(at(flown, (n + AROUND).min(last)).forward);
    let mut all: Vec<_> = (0..=last).step_by(AROUND / 4).map(|n| (turned(n), n)).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut chosen: Vec<usize> = Vec::new();
    for (_, n) in all {
        if chosen.len() < count && chosen.iter().all(|c| c.abs_diff(n) > 2 * AROUND) {
            chosen.push(n);
        }
    }
    chosen
}
