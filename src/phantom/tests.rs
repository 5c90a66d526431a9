use super::*;

fn make(size: Size, seed: u64) -> Phantom {
    Phantom::new(&Settings { size, seed, ..Settings::default() })
}

/// Places on the wall, found by bisection from the axis outwards, with the direction they were found in.
fn wall_points(phantom: &Phantom, count: u64) -> Vec<(DVec3, DVec3)> {
    let axis = &phantom.shape.axis;
    let find = |n: u64| {
        let u = |k| hash::uniform(11, 4 * n + k);
        let frame = axis.frame(10.0 + (axis.length() - 20.0) * u(0));
        let out = frame.direction(6.3 * u(1));
        let (mut lo, mut hi) = (0.0, 40.0);
        while hi - lo > 1e-13 * 40.0 {
            let mid = 0.5 * (lo + hi);
            if phantom.wall(frame.at + out * mid) < 0.0 { lo = mid } else { hi = mid }
        }
        (frame.at + out * lo, out)
    };
    (0..count).map(find).collect()
}

#[test]
fn the_wall_is_where_the_value_is() {
    let phantom = make(Size::Standard, 1);
    for (p, out) in wall_points(&phantom, 300) {
        assert!((phantom.value(p) - profile::WALL_HU).abs() < 1e-6, "{p}: {}", phantom.value(p));
        assert!(phantom.value(p - out * 1e-4) < profile::WALL_HU && phantom.value(p + out * 1e-4) > profile::WALL_HU);
    }
}
