//! The slices of a window: which are shown, their positions, and their grey-level window.

use std::collections::BTreeMap;
use std::sync::Arc;

use bevy_ecs::prelude::Entity;
use glam::DVec3;

use super::framing::{self, Framing, TARGET_MM};
use super::intent::SliceInput;
use crate::app::FlightApp;
use crate::components::slices::{Orientation, SliceView};
use crate::error::Result;
use crate::render::slice::{Slab, SlabKind, Tint, Windowing};

/// Distance that the camera moves before the slices leave a place pointed at and follow the flight again, mm.
const LEAVES_MM: f64 = 2.0;
/// Pixels of a drag that double the width of the grey-level window.
const DOUBLES: f64 = 150.0;
/// Limits of the width of the grey-level window, HU.
const WIDTHS: [f64; 2] = [1.0, 8000.0];
/// Limits of its level, HU.
const LEVELS: [f64; 2] = [-2000.0, 6000.0];
/// Slab thicknesses that a key steps through, mm.
const SLABS_MM: [f64; 5] = [0.0, 3.0, 5.0, 10.0, 20.0];
/// Maximum samples per frame of a thick slab while it moves: some ms of two cores.
const SAMPLES: usize = 1 << 20;
/// Magnification per notch of the wheel.
const CLOSER: f64 = 1.15;

/// The slices of a window.
#[derive(Debug, Default)]
pub(crate) struct Slices {
    entities: BTreeMap<Orientation, Entity>,
    /// The place pointed at and the camera's position at that time; `None` while the slices follow the flight.
    cursor: Option<(DVec3, DVec3)>,
    framing: Framing,
    windowing: Windowing,
    slab: Slab,
    /// What lies over the scan that is flown through.
    patch: Option<Entity>,
    /// Colours of the bodies of gas.
    tint: Option<Arc<Tint>>,
    /// The state of what is drawn over them.
    marks: Option<u64>,
    /// Fraction of a notch scrolled so far, in the slice that was scrolled last.
    scrolled: Option<(Orientation, f64)>,
}

impl Slices {
    /// Returns the entity of a slice that is shown.
    pub(crate) fn entity(&self, orientation: Orientation) -> Option<Entity> {
        self.entities.get(&orientation).copied()
    }

    /// Returns a slice that is shown.
    pub(crate) fn view<'a>(&self, flight: &'a FlightApp, orientation: Orientation) -> Option<&'a SliceView> {
        flight.app().world.get(self.entity(orientation)?)
    }

    /// Returns the place pointed at, world mm; `None` while everything follows the flight.
    pub(crate) fn cursor(&self) -> Option<DVec3> {
        self.cursor.map(|c| c.0)
    }

    /// Points at a place, world mm.
    pub(crate) fn point(&mut self, flight: &FlightApp, place: DVec3) {
        if place.is_finite() {
            self.cursor = Some((place, flight.pose().position));
        }
    }

    /// Goes to a place, world mm: points at it, in the middle of every slice, with at least `span_mm` across it. When the slices
    /// follow the flight again, they show what they showed before.
    pub(crate) fn aim(&mut self, flight: &FlightApp, place: DVec3, span_mm: f64) {
        if place.is_finite() {
            self.point(flight, place);
            self.framing.aim(span_mm.max(TARGET_MM));
        }
    }

    /// Follows the flight again.
    pub(crate) fn follow(&mut self) {
        self.cursor = None;
        self.framing.leave();
    }

    /// Lays another scan's box over that which is flown through.
    pub(crate) fn patch(&mut self, patch: Option<Entity>) {
        self.patch = patch;
    }

    /// Lays colours over the bodies of gas.
    pub(crate) fn tint(&mut self, tint: Option<Arc<Tint>>) {
        self.tint = tint;
    }

    /// Draws over them anew if the number is another one.
    pub(crate) fn mark(&mut self, marks: Option<u64>) {
        self.marks = marks;
    }

    /// Shows exactly these slices, in these sizes, with their state for the next frame. A camera that is `held` may still drift
    /// to rest; it does not leave the place pointed at. Returns true if one is not drawn yet.
    ///
    /// # Errors
    /// Returns the errors of any change of the schedule.
    pub(crate) fn show(
        &mut self,
        flight: &mut FlightApp,
        wanted: &[(Orientation, [usize; 2])],
        held: bool,
    ) -> Result<bool> {
        let pose = flight.pose();
        if let Some((_, from)) = self.cursor.as_mut().filter(|_| held) {
            *from = pose.position;
        }
        if self.cursor.is_some_and(|c| c.1.distance(pose.position) > LEAVES_MM) {
            self.follow();
        }
        let gone: Vec<Orientation> =
            self.entities.keys().copied().filter(|o| !wanted.iter().any(|w| w.0 == *o)).collect();
        for entity in gone.into_iter().filter_map(|o| {
            self.framing.forget(o);
            self.entities.remove(&o)
        }) {
            flight.app_mut().world.despawn(entity);
        }
        for (orientation, size) in wanted {
            if !self.entities.contains_key(orientation) {
                let mut view = SliceView::new(*orientation, *size);
                view.budget = Some(SAMPLES);
                let entity = flight.views().add_slice(view)?;
                self.entities.insert(*orientation, entity);
            }
        }
        let (mut stale, place) = (false, self.cursor());
        let grid = flight.setup().volume.voxels().grid().clone();
        for (orientation, size) in wanted {
            let world = &mut flight.app_mut().world;
            let view = self.entities.get(orientation).and_then(|e| world.get_mut::<SliceView>(*e));
            let Some(mut view) = view else { continue };
            (view.size, view.place, view.windowing) = (*size, place, self.windowing);
            (view.slab, view.patch) = (self.slab, self.patch);
            view.tint.clone_from(&self.tint);
            view.marks = self.marks;
            self.framing.apply(&mut view, &grid, &pose);
            stale |= view.is_stale(&grid, &pose);
        }
        Ok(stale)
    }

    /// Executes a panel's request.
    pub(crate) fn ask(&mut self, flight: &mut FlightApp, request: SliceInput) {
        match request {
            SliceInput::Click(place) | SliceInput::Point(place) | SliceInput::SetOut(place) => {
                self.point(flight, place);
            }
            SliceInput::GoTo(place, span_mm) => self.aim(flight, place, span_mm),
            SliceInput::Scroll(orientation, notches) => self.scroll(flight, orientation, notches),
            SliceInput::Pan(orientation, [right, down]) => self.change(flight, orientation, |view| {
                view.pan_mm = [view.pan_mm[0] + right, view.pan_mm[1] + down];
            }),
            SliceInput::Zoom(orientation, notches, about) => {
                let (grid, pose) = (flight.setup().volume.voxels().grid().clone(), flight.pose());
                self.change(flight, orientation, |view| {
                    framing::zoom_about(view, &grid, &pose, CLOSER.powf(notches), about);
                });
            }
            SliceInput::Window([right, up]) => {
                let width = (self.windowing.width() * (right / DOUBLES).exp2()).clamp(WIDTHS[0], WIDTHS[1]);
                let level = self.windowing.level() + up * self.windowing.width() / (4.0 * DOUBLES);
                self.window(level.clamp(LEVELS[0], LEVELS[1]), width);
            }
        }
    }

    fn change(&self, flight: &mut FlightApp, orientation: Orientation, change: impl FnOnce(&mut SliceView)) {
        let entity = self.entity(orientation);
        if let Some(mut view) = entity.and_then(|e| flight.app_mut().world.get_mut::<SliceView>(e)) {
            change(&mut view);
        }
    }

    /// Scrolls by a number of layers of the scan.
    fn scroll(&mut self, flight: &FlightApp, orientation: Orientation, notches: f64) {
        let Some(view) = self.view(flight, orientation) else { return };
        let grid = flight.setup().volume.voxels().grid();
        // Use the requested state, not the last drawn one: several notches may arrive between two pictures.
        let mut view = view.without_image();
        view.place = self.cursor();
        let slice = view.slice(grid, &flight.pose());
        let normal = slice.frame.normal();
        // Voxels per mm along the normal.
        let voxels = grid.to_voxel().transform_vector3(normal).length().max(1e-9);
        let place = self.cursor().unwrap_or(flight.pose().position);
        // Start at the displayed layer: a place between two layers would be rounded to one of them twice.
        let layer = place + normal * (slice.centre - place).dot(normal);
        // Smooth scrolling arrives in fractions of a notch.
        let (scrolled, left) = self.scrolled.filter(|s| s.0 == orientation).unwrap_or((orientation, 0.0));
        let notches = left + notches;
        self.scrolled = Some((scrolled, notches - notches.trunc()));
        if notches.trunc() != 0.0 {
            self.point(flight, layer + normal * (notches.trunc() / voxels));
        }
    }

    /// Sets the grey-level window, level and width in HU. Invalid values change nothing.
    pub(crate) fn window(&mut self, level: f64, width: f64) {
        if let Ok(windowing) = Windowing::new(level, width) {
            self.windowing = windowing;
        }
    }

    /// Resets window, slab, magnification and pan.
    pub(crate) fn reset(&mut self, flight: &mut FlightApp) {
        (self.windowing, self.slab) = (Windowing::default(), Slab::default());
        self.framing.settle();
        for orientation in Orientation::ALL {
            self.change(flight, orientation, |view| (view.pan_mm, view.zoom) = ([0.0; 2], 1.0));
        }
    }

    /// Switches to the next thickness.
    pub(crate) fn next_slab(&mut self) {
        let next = SLABS_MM.into_iter().find(|mm| *mm > self.slab.mm()).unwrap_or(0.0);
        self.slab = Slab::new(next, self.slab.kind()).unwrap_or_default();
    }

    /// Switches to the next of mean, maximum and minimum.
    pub(crate) fn next_slab_kind(&mut self) {
        let kind = match self.slab.kind() {
            SlabKind::Mean => SlabKind::Max,
            SlabKind::Max => SlabKind::Min,
            SlabKind::Min => SlabKind::Mean,
        };
        self.slab = Slab::new(self.slab.mm(), kind).unwrap_or_default();
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;
    use crate::host::window::contract::WindowView;
    use crate::host::window::controller::FlightController;
    use crate::host::window::controller::tests::{controller, perform};
    use crate::render::ImageSize;

    const SHOWN: [(Orientation, [usize; 2]); 2] = [(Orientation::Axial, [64, 48]), (Orientation::Coronal, [64, 48])];

    /// Draws the slices. Returns what they show: mm per pixel, and where `place` is, pixels.
    fn drawn(c: &mut FlightController, place: DVec3, now: Instant) -> Vec<(f64, [f64; 2])> {
        // Each frame draws one of them.
        for _ in SHOWN {
            let due = c.prepare(ImageSize::new(32, 24), &SHOWN, now).unwrap();
            c.show(due).unwrap();
        }
        let slices = SHOWN.map(|s| c.slices().view(c.flight(), s.0).unwrap().shown().unwrap());
        slices.map(|s| (s.mm_per_pixel, s.pixel(place).0)).to_vec()
    }

    #[test]
    fn a_place_that_is_gone_to_is_in_the_middle_at_its_own_scale_until_the_flight_goes_on() {
        let (mut c, now) = (controller("tentacles"), Instant::now());
        let place = DVec3::new(9.0, 30.0, 22.0);
        let before = drawn(&mut c, place, now);
        c.slice(SliceInput::GoTo(place, 0.0), now);
        let there = drawn(&mut c, place, now);
        for (n, (mm_per_pixel, [x, y])) in there.iter().enumerate() {
            assert!((x - 32.0).abs() < 1e-6 && (y - 24.0).abs() < 1e-6, "{x} {y}");
            // The scan of this flight is 32 mm wide: less than 60 mm, it is not made smaller.
            assert!((mm_per_pixel - before[n].0.min(60.0 / 48.0)).abs() < 1e-6, "{mm_per_pixel}");
        }
        assert_ne!(there, before);
        // The flight has been paused in its next step.
        for n in 1..4 {
            c.advance(now + Duration::from_millis(20 * n)).unwrap();
        }
        assert_eq!(drawn(&mut c, place, now), there);
        perform(&mut c, "pause", now);
        assert_eq!(drawn(&mut c, place, now), before);
        // By the wheel, the point under the pointer stays.
        let pixel = before[0].1;
        c.slice(SliceInput::Zoom(Orientation::Axial, 5.0, place), now);
        let closer = drawn(&mut c, place, now)[0];
        assert!((closer.1[0] - pixel[0]).abs() < 1e-6 && (closer.1[1] - pixel[1]).abs() < 1e-6);
        assert!(closer.0 < before[0].0 * 0.6);
    }
}
