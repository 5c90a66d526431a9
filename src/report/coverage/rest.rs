//! Where the wall lies that a flight did not see.

use glam::DVec3;
use rayon::prelude::*;

use super::runs::{Flight, Review, share};
use super::visible::Visible;
use crate::error::Result;
use crate::fields::{ClearanceFinder, Lumen};
use crate::progress::Progress;

/// Distance from a triangle at which its gas, in front, and its fluid, behind, are looked up, mm.
const ASIDE_MM: f64 = 0.8;
/// A triangle faces along the flight, or against it, if its normal is less than about 70° from that.
const FACING: f64 = 0.34;
/// Limits of the distance to the flight's nearest place, and of the clearance there, mm.
const AWAY_MM: [f64; 3] = [15.0, 30.0, 60.0];
const RADII_MM: [f64; 3] = [6.0, 10.0, 15.0];

/// A reason why some of the wall was not seen.
#[derive(Clone, Debug)]
pub(super) struct Reason {
    pub name: &'static str,
    /// Share of the wall's area.
    pub share: f64,
}

/// The reasons, in the order of the columns of [`Rest::reasons`].
pub(super) const REASONS: [&str; 4] = [
    "seen from the same places looking back",
    "behind folds: seen by a second look at missed patches of 300 mm² or more",
    "in smaller patches: seen only from places off the path",
    "not seen from any sampled place where the camera fits",
];

/// A part of the wall that shares a property.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub criterion: &'static str,
    pub name: String,
    /// Share of the wall's area.
    pub share: f64,
    /// Shares of the part's area that are seen one way, both ways, and from anywhere.
    pub seen: [f64; 3],
    /// Share of the wall not seen one way that lies in this part.
    pub of_rest: f64,
}

/// The wall that a flight did not see at a view angle of 90°, by reason and by part.
pub(super) struct Rest {
    pub reasons: Vec<Reason>,
    pub parts: Vec<Part>,
}

/// Divides the wall that was not seen one way. `tagged` is the lumen of the scan before cleansing.
///
/// # Errors
/// Returns status 4 if interrupted.
pub(super) fn rest(
    flight: &Flight,
    review: Option<&Review>,
    visible: &Visible,
    tagged: &Lumen,
    progress: &Progress,
) -> Result<Rest> {
    let (wall, sights) = (&flight.wall, &flight.sights[0]);
    let reason = |n: usize| match () {
        () if sights[n].ahead > 0 => None,
        () if sights[n].either => Some(0),
        () if review.is_some_and(|r| r.seen[n]) => Some(1),
        () if visible.seen[n] => Some(2),
        () => Some(3),
    };
    let of = |r: usize| share(wall, |n| reason(n) == Some(r));
    let reasons = REASONS.iter().enumerate().map(|(r, &name)| Reason { name, share: of(r) }).collect();
    let mut parts = Vec::new();
    for (criterion, names, which) in criteria(flight, tagged, progress)? {
        for (k, name) in names.into_iter().enumerate() {
            progress.check()?;
            let of = |seen: &dyn Fn(usize) -> bool| share(wall, |n| usize::from(which[n]) == k && seen(n));
            let part = of(&|_| true);
            if part == 0.0 {
                continue;
            }
            let ahead = of(&|n| sights[n].ahead > 0);
            let seen = [ahead, of(&|n| sights[n].either), of(&|n| visible.seen[n])].map(|s| s / part);
            let rest = share(wall, |n| sights[n].ahead == 0).max(f64::MIN_POSITIVE);
            parts.push(Part { criterion, name, share: part, seen, of_rest: (part - ahead) / rest });
        }
    }
    Ok(Rest { reasons, parts })
}

/// A criterion, the names of its classes, and the class of each triangle.
type Criterion = (&'static str, Vec<String>, Vec<u8>);

fn criteria(flight: &Flight, tagged: &Lumen, progress: &Progress) -> Result<Vec<Criterion>> {
    let (wall, views, setup) = (&flight.wall, flight.views(), flight.app.setup());
    let gas = setup.plan.gas.as_ref().unwrap_or(&setup.lumen);
    let iso = setup.volume.transfer().iso() as f32;
    let walls = ClearanceFinder::new(setup.volume.shared_voxels(), iso, RADII_MM[2] + 1.0);
    let radii: Vec<f64> = views.iter().map(|v| walls.at(v.0).mm).collect();
    // Each triangle with each view: seconds.
    let nearest = |n: usize| progress.check().map(|()| nearest(wall.centroid(n), views));
    let nearest = (0..wall.len()).into_par_iter().map(nearest).collect::<Result<Vec<(f64, usize)>>>()?;
    let class = |limits: [f64; 3], v: f64| limits.iter().filter(|l| v >= **l).count() as u8;
    let each = |of: &(dyn Fn(usize) -> u8 + Sync)| (0..wall.len()).into_par_iter().map(of).collect::<Vec<u8>>();
    let within = |[a, b, c]: [f64; 3]| {
        vec![
            format!("below {a:.0} mm"),
            format!("{a:.0} to {b:.0} mm"),
            format!("{b:.0} to {c:.0} mm"),
            format!("{c:.0} mm or more"),
        ]
    };
    let facing = |n: usize| {
        let along = views.get(nearest[n].1).map_or(0.0, |v| v.1.forward.dot(wall.normal(n)));
        u8::from(along > -FACING) + u8::from(along > FACING)
    };
    let was_fluid = |n: usize| {
        let (at, normal) = (wall.centroid(n), wall.normal(n));
        u8::from([1.0, 2.0].iter().any(|k| tagged.is_fluid(at + normal * (k * ASIDE_MM))))
    };
    let segment = |n: usize| {
        let found = gas.segment_at(wall.centroid(n) + wall.normal(n) * ASIDE_MM);
        found.map_or(u8::MAX, |s| s.min(usize::from(u8::MAX)) as u8)
    };
    let segments = gas.segments.iter().enumerate().map(|(n, s)| format!("{} ({:.0} ml)", n + 1, s.ml)).collect();
    Ok(vec![
        ("faces", ["against the flight", "sideways", "along the flight"].map(str::to_owned).to_vec(), each(&facing)),
        ("distance to the nearest place of the flight", within(AWAY_MM), each(&|n| class(AWAY_MM, nearest[n].0))),
        (
            "clearance at that place",
            within(RADII_MM),
            each(&|n| class(RADII_MM, radii.get(nearest[n].1).copied().unwrap_or(0.0))),
        ),
        ("as scanned", ["dry", "under tagged fluid"].map(str::to_owned).to_vec(), each(&was_fluid)),
        ("segment of gas", segments, each(&segment)),
    ])
}

/// Returns the distance to the nearest view, mm, and its number.
fn nearest(at: DVec3, views: &[(DVec3, crate::dynamics::Attitude)]) -> (f64, usize) {
    let squares = views.iter().map(|v| v.0.distance_squared(at));
    let least = squares.enumerate().fold((f64::INFINITY, 0), |a, (n, d)| if d < a.0 { (d, n) } else { a });
    (least.0.sqrt(), least.1)
}
