//! The part of the scan that each slice of a window shows: it is magnified about the pointer, keeps the camera in view, and shows a
//! place that was gone to at its own scale.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use crate::components::camera::Pose;
use crate::components::slices::{Orientation, SliceView, ZOOMS};
use crate::render::slice::Slice;
use crate::volume::Grid;

/// What a slice shows of a place that was gone to, mm across its shorter side: a lesion of 4 mm is seen in its fold.
pub(crate) const TARGET_MM: f64 = 60.0;
/// Share of a magnified slice at each edge that the camera does not fly into.
const EDGE: f64 = 0.15;
/// A place that moved less than this has not moved, mm.
const MOVED_MM: f64 = 1e-6;

/// The parts of the scan that the slices show.
#[derive(Debug, Default)]
pub(crate) struct Framing {
    /// What was gone to.
    target: Option<Target>,
    /// Pan, mm, and magnification of the slices before they showed it.
    before: BTreeMap<Orientation, ([f64; 2], f64)>,
    /// The place that each slice had in view, world mm.
    kept: BTreeMap<Orientation, DVec3>,
}

/// A place that was gone to.
#[derive(Debug)]
struct Target {
    /// What a slice shows of it, mm across its shorter side.
    span_mm: f64,
    /// The slices that show it already.
    shown: BTreeSet<Orientation>,
}

impl Framing {
    /// Centres the slices on the place that they pass through, with `span_mm` across their shorter sides.
    pub(crate) fn aim(&mut self, span_mm: f64) {
        self.target = Some(Target { span_mm, shown: BTreeSet::new() });
    }

    /// Returns to what the slices showed before they were aimed.
    pub(crate) fn leave(&mut self) {
        self.target = None;
    }

    /// Forgets a slice, because it is hidden.
    pub(crate) fn forget(&mut self, orientation: Orientation) {
        self.before.remove(&orientation);
        self.kept.remove(&orientation);
        if let Some(target) = &mut self.target {
            target.shown.remove(&orientation);
        }
    }

    /// Keeps what the slices show now, because the operator has reset it.
    pub(crate) fn settle(&mut self) {
        self.target = None;
        self.before.clear();
    }

    /// Moves and magnifies a slice so that it shows what it should.
    ///
    /// A slice moves only as far as the place that it passes through requires, and only if that place has moved: what the operator
    /// looks at beside it stays where it is.
    pub(crate) fn apply(&mut self, view: &mut SliceView, grid: &Grid, pose: &Pose) {
        let orientation = view.orientation;
        let place = view.place.unwrap_or(pose.position);
        let last = self.kept.insert(orientation, place);
        if let Some(target) = &mut self.target {
            if target.shown.insert(orientation) {
                self.before.entry(orientation).or_insert((view.pan_mm, view.zoom));
                magnify_to(view, grid, pose, target.span_mm);
                return centre(view, grid, pose, place);
            }
        } else if let Some((pan_mm, zoom)) = self.before.remove(&orientation) {
            (view.pan_mm, view.zoom) = (pan_mm, zoom);
            return keep_in_view(view, grid, pose, place);
        }
        if last.is_some_and(|last| last.distance(place) > MOVED_MM) {
            keep_in_view(view, grid, pose, place);
        }
    }
}

/// Multiplies the magnification of a slice. A place of it, world mm, stays where it is in the image.
pub(crate) fn zoom_about(view: &mut SliceView, grid: &Grid, pose: &Pose, factor: f64, place: DVec3) {
    let before = view.slice(grid, pose);
    view.zoom = (view.zoom * factor).clamp(ZOOMS[0], ZOOMS[1]);
    let share = 1.0 - view.slice(grid, pose).mm_per_pixel / before.mm_per_pixel;
    let off = in_plane(&before, place - before.centre);
    if off.iter().all(|mm| mm.is_finite()) {
        view.pan_mm = [0, 1].map(|a| view.pan_mm[a] - off[a] * share);
    }
}

/// Returns the components of a direction to the right and downwards.
fn in_plane(slice: &Slice, d: DVec3) -> [f64; 2] {
    [d.dot(slice.frame.right()), d.dot(slice.frame.down())]
}

/// Magnifies a slice to show at most `span_mm` across its shorter side.
fn magnify_to(view: &mut SliceView, grid: &Grid, pose: &Pose, span_mm: f64) {
    let shorter = view.size[0].min(view.size[1]).max(1) as f64;
    let shown_mm = view.slice(grid, pose).mm_per_pixel * shorter;
    view.zoom = (view.zoom * (shown_mm / span_mm.max(1.0)).max(1.0)).clamp(ZOOMS[0], ZOOMS[1]);
}

/// Moves a slice so that a place, world mm, is in its middle.
fn centre(view: &mut SliceView, grid: &Grid, pose: &Pose, place: DVec3) {
    let slice = view.slice(grid, pose);
    let off = in_plane(&slice, place - slice.centre);
    if off.iter().all(|mm| mm.is_finite()) {
        view.pan_mm = [0, 1].map(|a| view.pan_mm[a] - off[a]);
    }
}

/// Moves a slice as little as keeps a place, world mm, in view. A place that is out of view comes to the middle.
fn keep_in_view(view: &mut SliceView, grid: &Grid, pose: &Pose, place: DVec3) {
    let slice = view.slice(grid, pose);
    let at = slice.pixel(place).0;
    let size = view.size.map(|s| s as f64);
    let is_magnified = view.zoom > 1.0;
    if (0..2).any(|a| !(0.0..=size[a]).contains(&at[a])) {
        return if is_magnified { centre(view, grid, pose, place) } else { view.pan_mm = [0.0; 2] };
    }
    // A place that was pointed at is under the pointer, where the image must not move.
    if is_magnified && view.place.is_none() {
        for a in 0..2 {
            let edge = EDGE * size[a];
            view.pan_mm[a] += (at[a].clamp(edge, size[a] - edge) - at[a]) * slice.mm_per_pixel;
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::dynamics::Attitude;

    fn grid() -> Grid {
        Grid::new([200, 300, 400], DVec3::new(1.0, 1.0, 0.8), DVec3::new(-90.0, 20.0, 5.0), DMat3::IDENTITY).unwrap()
    }

    fn pose(at: [f64; 3]) -> Pose {
        Pose { position: grid().world(DVec3::from_array(at)), attitude: Attitude::new(DVec3::X, DVec3::NEG_Y) }
    }

    fn at(view: &SliceView, pose: &Pose, place: DVec3) -> [f64; 2] {
        view.slice(&grid(), pose).pixel(place).0
    }

    fn near(a: [f64; 2], b: [f64; 2]) -> bool {
        (0..2).all(|n| (a[n] - b[n]).abs() < 1e-6)
    }

    #[test]
    fn the_place_under_the_pointer_stays_there() {
        let here = pose([100.0, 150.0, 200.0]);
        for orientation in Orientation::ALL {
            let mut view = SliceView::new(orientation, [160, 120]);
            for (pixel, factor) in [([20.0, 110.0], 3.0), ([150.0, 4.0], 1.15), ([80.0, 60.0], 90.0), ([9.0, 9.0], 0.2)]
            {
                let place = view.slice(&grid(), &here).world(pixel);
                let before = view.zoom;
                zoom_about(&mut view, &grid(), &here, factor, place);
                assert!(near(at(&view, &here, place), pixel), "{orientation:?} {pixel:?}");
                assert_eq!(view.zoom, (before * factor).clamp(ZOOMS[0], ZOOMS[1]));
            }
            zoom_about(&mut view, &grid(), &here, 2.0, DVec3::NAN);
            assert!(view.pan_mm.iter().all(|mm| mm.is_finite()));
        }
    }

    #[test]
    fn a_magnified_slice_goes_with_the_camera_and_an_unmagnified_one_stays() {
        for orientation in Orientation::ALL {
            let (mut framing, mut view) = (Framing::default(), SliceView::new(orientation, [160, 120]));
            let along = |n: u32| pose([100.0, 60.0 + 0.6 * f64::from(n), 100.0 + 0.7 * f64::from(n)]);
            framing.apply(&mut view, &grid(), &along(0));
            (1..200).for_each(|n| framing.apply(&mut view, &grid(), &along(n)));
            assert_eq!(view.pan_mm, [0.0; 2], "{orientation:?}");
            view.zoom = 6.0;
            let mut last = None;
            for n in 0..200 {
                let here = along(n);
                framing.apply(&mut view, &grid(), &here);
                let [x, y] = at(&view, &here, here.position);
                let [left, top] = [EDGE * 160.0 - 1e-6, EDGE * 120.0 - 1e-6];
                assert!(
                    (left..=160.0 - left).contains(&x) && (top..=120.0 - top).contains(&y),
                    "{orientation:?} {x} {y}"
                );
                // Calmly: no farther than the camera itself moved.
                let moved = last.map_or(0.0, |l: [f64; 2]| (view.pan_mm[0] - l[0]).hypot(view.pan_mm[1] - l[1]));
                assert!(n < 2 || moved < 1.0, "{orientation:?} {n}: {moved}");
                last = Some(view.pan_mm);
            }
        }
    }

    #[test]
    fn what_the_operator_looks_at_beside_a_resting_camera_stays() {
        let here = pose([100.0, 150.0, 200.0]);
        let (mut framing, mut view) = (Framing::default(), SliceView::new(Orientation::Coronal, [160, 120]));
        framing.apply(&mut view, &grid(), &here);
        (view.zoom, view.pan_mm) = (8.0, [300.0, 40.0]);
        framing.apply(&mut view, &grid(), &here);
        assert_eq!(view.pan_mm, [300.0, 40.0]);
        // A place that is pointed at in view does not move the image under the pointer; one out of view is brought there.
        let edge = view.slice(&grid(), &here).world([2.0, 3.0]);
        view.place = Some(edge);
        framing.apply(&mut view, &grid(), &here);
        assert_eq!(view.pan_mm, [300.0, 40.0]);
        view.place = Some(here.position);
        framing.apply(&mut view, &grid(), &here);
        assert!(near(at(&view, &here, here.position), [80.0, 60.0]));
    }

    #[test]
    fn a_target_is_shown_at_its_own_scale_and_left_as_it_was() {
        let here = pose([100.0, 150.0, 200.0]);
        for orientation in Orientation::ALL {
            let (mut framing, mut view) = (Framing::default(), SliceView::new(orientation, [160, 120]));
            (view.zoom, view.pan_mm) = (1.2, [3.0, -2.0]);
            framing.apply(&mut view, &grid(), &here);
            for target in [here.position + DVec3::new(30.0, -20.0, 9.0), here.position - DVec3::splat(40.0)] {
                view.place = Some(target);
                framing.aim(TARGET_MM);
                framing.apply(&mut view, &grid(), &here);
                assert!(near(at(&view, &here, target), [80.0, 60.0]), "{orientation:?}");
                let span_mm = view.slice(&grid(), &here).mm_per_pixel * 120.0;
                assert!((span_mm - TARGET_MM).abs() < 1e-6, "{orientation:?} {span_mm}");
                // What is changed there stays.
                view.zoom *= 2.0;
                framing.apply(&mut view, &grid(), &here);
                assert!(near(at(&view, &here, target), [80.0, 60.0]) || orientation != Orientation::Across);
                // Larger than asked for, it stays so at the next target.
                framing.aim(TARGET_MM);
                framing.apply(&mut view, &grid(), &here);
                let closer_mm = view.slice(&grid(), &here).mm_per_pixel * 120.0;
                assert!((closer_mm - TARGET_MM / 2.0).abs() < 1e-6);
                view.zoom /= 2.0;
            }
            framing.leave();
            view.place = None;
            framing.apply(&mut view, &grid(), &here);
            assert_eq!((view.zoom, view.pan_mm), (1.2, [3.0, -2.0]), "{orientation:?}");
            // Reset on the target, it stays reset.
            view.place = Some(here.position);
            framing.aim(TARGET_MM);
            framing.apply(&mut view, &grid(), &here);
            (view.zoom, view.pan_mm) = (1.0, [0.0; 2]);
            framing.settle();
            view.place = None;
            framing.apply(&mut view, &grid(), &here);
            assert_eq!((view.zoom, view.pan_mm), (1.0, [0.0; 2]));
        }
    }
}
