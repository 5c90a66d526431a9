//! Slices: cross-sections of the scan drawn beside the flight's picture.

use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::DVec3;
use rayon::prelude::*;

use super::camera::Pose;
use crate::render::Frame;
use crate::render::slice::{Near, Patched, PlaneFrame, Slab, Slice, SlicePlane, Tint, Windowing};
use crate::volume::{Grid, Volume};

/// The orientation of a slice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Orientation {
    /// Across the body.
    #[default]
    Axial,
    /// Along the body, seen from the front.
    Coronal,
    /// Along the body, seen from its left.
    Sagittal,
    /// Across the path: perpendicular to the camera's view, seen as the camera sees it.
    Across,
}

impl Orientation {
    /// All orientations.
    pub const ALL: [Self; 4] = [Self::Axial, Self::Coronal, Self::Sagittal, Self::Across];

    /// Returns the name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Axial => "axial",
            Self::Coronal => "coronal",
            Self::Sagittal => "sagittal",
            Self::Across => "across the path",
        }
    }

    /// Returns the axes of the image for a camera at `pose`.
    fn frame(self, pose: &Pose) -> PlaneFrame {
        let plane = match self {
            Self::Axial => SlicePlane::Axial,
            Self::Coronal => SlicePlane::Coronal,
            Self::Sagittal => SlicePlane::Sagittal,
            Self::Across => return PlaneFrame::looking(pose.attitude.forward, pose.attitude.up),
        };
        // These planes have axes for any camera pose.
        plane.frame().unwrap_or_else(|_| PlaneFrame::looking(DVec3::Z, DVec3::NEG_Y))
    }
}

/// A slice of the scan. It is redrawn in every frame in which it has changed.
///
/// It passes through a given place, or follows the flight's camera. The axis-aligned slices show the layer of voxels nearest to
/// that place, and the same part of the body until they are moved. The slice across the path is centred on the place.
#[derive(Component, Clone, Debug)]
pub struct SliceView {
    /// Orientation.
    pub orientation: Orientation,
    /// The place that the slice passes through, world mm; `None` for the camera's position.
    pub place: Option<DVec3>,
    /// Offset of the image, mm to the right and downwards.
    pub pan_mm: [f64; 2],
    /// Magnification: 1 shows the whole scan, or 100 mm around the place for the slice across the path.
    pub zoom: f64,
    /// Mapping from HU to grey levels.
    pub windowing: Windowing,
    /// Thickness and projection.
    pub slab: Slab,
    /// The entity whose [`Scan`](super::scan::Scan) is laid over the one that is flown through: a box of its voxels with other
    /// values.
    pub patch: Option<Entity>,
    /// Colours over the bodies of gas.
    pub tint: Option<Arc<Tint>>,
    /// The state of what a post-process draws over the image: another number redraws the image. `None` if there is none.
    pub marks: Option<u64>,
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Maximum samples of the scan per frame; `None` for no limit.
    ///
    /// A slab that needs more is drawn with larger pixels while it moves, and is refined over the next frames once it
    /// stays in place. Each frame draws one of the slices that have a budget, in turn.
    pub budget: Option<usize>,
    /// The image.
    pub frame: Frame,
    /// True if this frame has drawn the image.
    pub made: bool,
    /// HU values of the image, row by row.
    hu: Vec<f32>,
    grey: Vec<u8>,
    /// The slice, slab, greys and patch of the current image.
    shown: Option<(Slice, Slab, Windowing, Option<Entity>)>,
    /// The colours of the current image.
    tinted: Option<Arc<Tint>>,
    /// What was drawn over the current image.
    marked: Option<u64>,
    /// While the image has larger pixels: the values of the fine image, and the number of its rows done so far.
    finer: Vec<f32>,
    rows: Option<usize>,
    /// The voxels around the plane.
    near: Near,
}

/// Pixels of a task.
const PART: usize = 1 << 15;
/// Extent of a slice across the path, mm.
const ACROSS_MM: f64 = 100.0;
/// Maximum pixel size of a moving slice, as a multiple of the full-resolution pixel size.
const COARSEST: usize = 8;
/// Range of magnifications.
pub const ZOOMS: [f64; 2] = [0.25, 40.0];

impl SliceView {
    /// Creates a slice of the whole scan at the camera's position, windowed for the colon.
    pub fn new(orientation: Orientation, size: [usize; 2]) -> Self {
        Self {
            orientation,
            place: None,
            pan_mm: [0.0; 2],
            zoom: 1.0,
            windowing: Windowing::default(),
            slab: Slab::default(),
            patch: None,
            tint: None,
            marks: None,
            size,
            budget: None,
            frame: Frame::default(),
            made: false,
            hu: Vec::new(),
            grey: Vec::new(),
            shown: None,
            tinted: None,
            marked: None,
            finer: Vec::new(),
            rows: None,
            near: Near::default(),
        }
    }

    /// Returns the same slice without its image.
    pub fn without_image(&self) -> Self {
        Self {
            place: self.place,
            pan_mm: self.pan_mm,
            zoom: self.zoom,
            windowing: self.windowing,
            slab: self.slab,
            patch: self.patch,
            tint: self.tint.clone(),
            marks: self.marks,
            budget: self.budget,
            ..Self::new(self.orientation, self.size)
        }
    }

    /// Returns the plane to show, given the scan's grid and the camera's pose.
    pub fn slice(&self, grid: &Grid, pose: &Pose) -> Slice {
        let frame = self.orientation.frame(pose);
        let place = self.place.unwrap_or(pose.position);
        let [right, down, normal] = [frame.right(), frame.down(), frame.normal()];
        let (middle, [width, height]) = extent(grid, right, down);
        let across = self.orientation == Orientation::Across;
        let centre = if across {
            place
        } else {
            // Snap to a layer of voxels: nothing is interpolated between layers, and a slow flight seldom changes the image.
            let layer = snap(grid, place, normal);
            middle + normal * (layer - middle).dot(normal)
        };
        let [width, height] = if across { [ACROSS_MM; 2] } else { [width, height] };
        let fit = (width / self.size[0].max(1) as f64).max(height / self.size[1].max(1) as f64);
        let zoom = if self.zoom.is_finite() { self.zoom.clamp(ZOOMS[0], ZOOMS[1]) } else { 1.0 };
        let pan = self.pan_mm.map(|mm| if mm.is_finite() { mm.clamp(-1e4, 1e4) } else { 0.0 });
        Slice {
            centre: centre - right * pan[0] - down * pan[1],
            frame,
            mm_per_pixel: (fit / zoom).max(1e-6),
            size: self.size,
        }
    }

    /// Returns the plane that the image shows; `None` before the first one.
    pub fn shown(&self) -> Option<Slice> {
        self.shown.map(|s| s.0)
    }

    /// Returns the HU value at a pixel of the image; `None` outside it.
    pub fn hu_at(&self, [x, y]: [usize; 2]) -> Option<f32> {
        (x < self.size[0]).then(|| self.hu.get(y * self.size[0] + x).copied()).flatten()
    }

    /// Leaves the image unchanged in this frame.
    pub fn wait(&mut self) {
        self.made = false;
    }

    /// Returns true if the slice may wait for its turn: it has an image in its current size.
    pub fn may_wait(&self) -> bool {
        self.budget.is_some() && self.shown.is_some_and(|s| s.0.size == self.size)
    }

    /// Returns true if the image is out of date or not yet refined.
    pub fn is_stale(&self, grid: &Grid, pose: &Pose) -> bool {
        let wanted = (self.slice(grid, pose), self.slab, self.windowing, self.patch);
        self.rows.is_some() || self.shown != Some(wanted) || !self.has_its_colours()
    }

    /// True if the image has the colours and the marks that it should have.
    fn has_its_colours(&self) -> bool {
        self.marks == self.marked && self.tint.as_ref().map(Arc::as_ptr) == self.tinted.as_ref().map(Arc::as_ptr)
    }

    /// Draws the image if it is stale. `patch` is the volume of [`SliceView::patch`].
    pub fn make(&mut self, volume: &Volume, patch: Option<&Volume>, pose: &Pose) {
        let wanted = (self.slice(volume.grid(), pose), self.slab, self.windowing, self.patch);
        let (slice, slab) = (wanted.0, wanted.1);
        let scan = Patched { volume, patch };
        self.made = self.shown != Some(wanted) || !self.has_its_colours();
        // New grey levels need no new values.
        if self.shown.is_none_or(|s| (s.0, s.1, s.3) != (slice, slab, self.patch)) {
            self.fill(scan, slice, slab);
        } else if let Some(rows) = self.rows {
            self.made |= self.refine(scan, slice, slab, rows);
        }
        if !self.made {
            return;
        }
        self.grey.resize(self.hu.len(), 0);
        self.windowing.fill(&self.hu, &mut self.grey);
        let [width, height] = self.size;
        if (self.frame.width(), self.frame.height()) != (width, height) {
            self.frame.resize(width, height);
        }
        let parts = self.frame.buffers().0.par_chunks_mut(PART).zip(self.grey.par_chunks(PART));
        parts.for_each(|(pixels, greys)| pixels.iter_mut().zip(greys).for_each(|(pixel, grey)| *pixel = [*grey; 3]));
        if let Some(tint) = &self.tint {
            tint.paint(&slice, &mut self.frame);
        }
        self.tinted.clone_from(&self.tint);
        self.marked = self.marks;
        self.shown = Some(wanted);
    }

    /// Fills the image with the values of another plane: at full resolution, or with larger pixels if that takes too many samples.
    fn fill(&mut self, scan: Patched<'_>, slice: Slice, slab: Slab) {
        let samples = slice.size[0] * slice.size[1] * slab.samples_a_pixel(scan.volume.grid());
        let most = self.budget.filter(|_| slab.mm() > 0.0);
        let too_many = most.map_or(0, |most| samples / most.max(1));
        // The least whole number whose square is large enough.
        let larger = (1..COARSEST).find(|n| n * n > too_many).unwrap_or(COARSEST);
        self.rows = (larger > 1).then_some(0);
        if larger == 1 {
            self.hu.resize(slice.size[0] * slice.size[1], 0.0);
            return slice.fill_rows_patched(scan, slab, (0, &mut self.hu), &mut self.near);
        }
        let coarse = slice.with_larger_pixels(larger);
        self.finer.resize(coarse.size[0] * coarse.size[1], 0.0);
        coarse.fill_rows_patched(scan, slab, (0, &mut self.finer), &mut self.near);
        coarse.enlarge(&self.finer, larger, slice.size, &mut self.hu);
    }

    /// Computes more rows of the fine image. Returns true once the last row is done.
    fn refine(&mut self, scan: Patched<'_>, slice: Slice, slab: Slab, rows: usize) -> bool {
        let [width, height] = slice.size;
        let a_row = (width * slab.samples_a_pixel(scan.volume.grid())).max(1);
        let more = self.budget.map_or(height, |most| most / a_row).max(1).min(height - rows);
        self.finer.resize(width * height, 0.0);
        let fine = &mut self.finer[rows * width..(rows + more) * width];
        slice.fill_rows_patched(scan, slab, (rows, fine), &mut self.near);
        let done = rows + more == height;
        self.rows = (!done).then_some(rows + more);
        if done {
            std::mem::swap(&mut self.hu, &mut self.finer);
        }
        done
    }

    /// Returns the size in memory, bytes.
    pub fn bytes(&self) -> usize {
        (self.hu.capacity() + self.finer.capacity()) * size_of::<f32>()
            + self.grey.capacity()
            + self.near.bytes()
            + size_of_val(self.frame.pixels())
    }
}

/// Returns the centre of a scan and its extent along two directions, mm.
fn extent(grid: &Grid, right: DVec3, down: DVec3) -> (DVec3, [f64; 2]) {
    let dims = DVec3::from_array(grid.dims().map(|d| d as f64));
    let middle = grid.world((dims - DVec3::ONE) * 0.5);
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|a| grid.to_world().transform_vector3(a * dims));
    let reach = |d: DVec3| axes.iter().map(|a| a.dot(d).abs()).sum::<f64>().max(1e-3);
    (middle, [reach(right), reach(down)])
}

/// Moves the place along a normal to the nearest layer of voxels, if layers are perpendicular to it.
fn snap(grid: &Grid, place: DVec3, normal: DVec3) -> DVec3 {
    let voxel = grid.voxel(place);
    let along = grid.to_voxel().transform_vector3(normal);
    for axis in 0..3 {
        let others = [(axis + 1) % 3, (axis + 2) % 3].map(|o| along[o].abs());
        if along[axis] != 0.0 && others.iter().all(|o| *o < 1e-6 * along[axis].abs()) {
            let to = voxel[axis].round().clamp(0.0, (grid.dims()[axis].max(1) - 1) as f64);
            return place + normal * ((to - voxel[axis]) / along[axis]);
        }
    }
    place
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::Attitude;
    use crate::render::slice::SlabKind;
    use glam::DMat3;

    fn scan() -> Volume {
        let grid =
            Grid::new([20, 30, 40], DVec3::new(0.5, 1.0, 2.0), DVec3::new(-7.0, 3.0, 11.0), DMat3::IDENTITY).unwrap();
        let data = (0..20 * 30 * 40).map(|n| (n % 20) as i16 * 10 - 1000).collect();
        Volume::new(grid, data)
    }

    fn pose(position: DVec3) -> Pose {
        Pose { position, attitude: Attitude::new(DVec3::Y, DVec3::Z) }
    }

    #[test]
    fn axis_slices_follow_by_layers_and_keep_their_part_of_the_body() {
        let (volume, mut view) = (scan(), SliceView::new(Orientation::Axial, [64, 48]));
        let here = volume.grid().world(DVec3::new(3.0, 4.0, 10.2));
        view.make(&volume, None, &pose(here));
        assert!(
            view.made
                && (view.shown().unwrap().centre.z - volume.grid().world(DVec3::new(0.0, 0.0, 10.0)).z).abs() < 1e-12
        );
        view.make(&volume, None, &pose(here + DVec3::new(1.0, 2.0, 0.1)));
        assert!(!view.made, "the same layer");
        view.make(&volume, None, &pose(here + DVec3::Z));
        assert!(view.made);
        // The image maps the position back to itself.
        let slice = view.shown().unwrap();
        let (at, before) = slice.pixel(here);
        assert!((slice.world(at) - here).dot(slice.frame.right()).abs() < 1e-9 && before.abs() <= 2.0);
    }

    #[test]
    fn the_slice_across_the_way_is_seen_as_the_camera_sees_it() {
        let (volume, mut view) = (scan(), SliceView::new(Orientation::Across, [50, 50]));
        let here = pose(volume.grid().world(DVec3::new(10.0, 15.0, 20.0)));
        view.make(&volume, None, &here);
        let frame = view.shown().unwrap().frame;
        assert_eq!((frame.right(), frame.down(), frame.normal()), (DVec3::X, DVec3::NEG_Z, DVec3::NEG_Y));
        assert_eq!(view.shown().unwrap().centre, here.position);
        view.make(&volume, None, &pose(here.position + DVec3::X * 0.01));
        assert!(view.made);
    }

    #[test]
    fn another_window_of_greys_shows_the_same_values() {
        let (volume, mut view) = (scan(), SliceView::new(Orientation::Coronal, [40, 30]));
        let here = pose(volume.grid().world(DVec3::splat(9.0)));
        view.make(&volume, None, &here);
        let (hu, first) = (view.hu.clone(), view.frame.clone());
        view.windowing = Windowing::new(-900.0, 200.0).unwrap();
        assert!(view.is_stale(volume.grid(), &here));
        view.make(&volume, None, &here);
        assert!(view.made && view.hu == hu && view.frame != first && !view.is_stale(volume.grid(), &here));
        assert_eq!(view.hu_at([40, 0]), None);
        assert!(view.hu_at([20, 15]).is_some_and(|hu| hu > -1001.0));
    }

    #[test]
    fn a_thick_slab_is_coarse_while_it_moves_and_then_becomes_what_it_would_have_been() {
        let grid = Grid::new([60; 3], DVec3::ONE, DVec3::new(-7.0, 3.0, 11.0), DMat3::IDENTITY).unwrap();
        let value = |n: usize| (n % 60 + 2 * (n / 60 % 60) + n / 3600) as i16 * 4 - 1000;
        let volume = Volume::new(grid, (0..216_000).map(value).collect());
        let here = pose(volume.grid().world(DVec3::splat(29.0)));
        let slab = Slab::new(20.0, SlabKind::Mean).unwrap();
        for orientation in Orientation::ALL {
            for size in [[70, 50], [71, 53], [1, 1], [90, 70]] {
                let mut at_once = SliceView { slab, zoom: 3.0, ..SliceView::new(orientation, size) };
                at_once.make(&volume, None, &here);
                assert!(at_once.rows.is_none());
                let mut view = SliceView { budget: Some(20_000), ..at_once.without_image() };
                view.make(&volume, None, &here);
                assert!(view.made && view.shown() == at_once.shown() && view.hu.len() == at_once.hu.len());
                // Mirrored, shifted or black, it would be farther off: the values range from -1000 to -60.
                let off = view.hu.iter().zip(&at_once.hu);
                let (mut sum, mut count) = (0.0, 0);
                off.for_each(|(a, b)| (sum, count) = (sum + f64::from(a - b).abs(), count + 1));
                assert!(sum <= 2.0 * f64::from(count), "{orientation:?} {size:?}: {}", sum / f64::from(count));
                let (coarse, mut frames) = (view.rows.is_some(), 0);
                assert_eq!(coarse, size[0] * size[1] > 300);
                while view.is_stale(volume.grid(), &here) {
                    view.make(&volume, None, &here);
                    frames += 1;
                    assert!(frames < 60);
                    assert_eq!(view.made, view.rows.is_none(), "it is shown when it is whole");
                }
                assert!(frames > 2 || !coarse);
                assert!(view.hu == at_once.hu && view.frame == at_once.frame);
            }
        }
    }

    #[test]
    fn a_slice_that_moves_on_begins_anew_and_greys_change_at_any_time() {
        let volume = scan();
        let at = |x: f64| pose(volume.grid().world(DVec3::new(x, 15.0, 20.0)));
        let slab = Slab::new(10.0, SlabKind::Max).unwrap();
        let mut view = SliceView { slab, budget: Some(20_000), ..SliceView::new(Orientation::Sagittal, [70, 50]) };
        view.make(&volume, None, &at(10.0));
        view.make(&volume, None, &at(10.0));
        assert!(view.rows.is_some_and(|rows| rows > 0) && !view.made);
        view.windowing = Windowing::new(-900.0, 200.0).unwrap();
        view.make(&volume, None, &at(10.0));
        assert!(view.made, "other greys at once");
        view.make(&volume, None, &at(4.0));
        assert_eq!((view.rows, view.made), (Some(0), true));
        while view.is_stale(volume.grid(), &at(4.0)) {
            view.make(&volume, None, &at(4.0));
        }
        let mut at_once =
            SliceView { slab, windowing: view.windowing, ..SliceView::new(Orientation::Sagittal, [70, 50]) };
        at_once.make(&volume, None, &at(4.0));
        assert!(view.frame == at_once.frame);
    }

    #[test]
    fn what_is_no_number_shows_something() {
        let (volume, mut view) = (scan(), SliceView::new(Orientation::Sagittal, [4, 0]));
        for (place, zoom, pan, size) in [
            (DVec3::NAN, f64::NAN, f64::NAN, [4, 4]),
            (DVec3::splat(1e300), f64::INFINITY, f64::INFINITY, [0, 0]),
            (DVec3::ZERO, 0.0, -1e300, [1, 1]),
        ] {
            (view.place, view.zoom, view.pan_mm, view.size) = (Some(place), zoom, [pan; 2], size);
            view.make(&volume, None, &pose(DVec3::ZERO));
            assert_eq!(view.hu.len(), size[0] * size[1]);
            (view.budget, view.slab) = (Some(0), Slab::new(1.0, SlabKind::Min).unwrap());
            view.make(&volume, None, &pose(DVec3::ZERO));
            view.make(&volume, None, &pose(DVec3::ZERO));
            assert_eq!(view.hu.len(), size[0] * size[1]);
        }
    }

    #[test]
    fn orientations_have_the_names_that_readers_use() {
        assert_eq!(Orientation::ALL.map(Orientation::name), ["axial", "coronal", "sagittal", "across the path"]);
    }

    /// Another thickness or projection makes other values at once, and a refinement under way does not come back.
    #[test]
    fn another_slab_begins_anew() {
        let volume = scan();
        let here = pose(volume.grid().world(DVec3::new(10.0, 15.0, 20.0)));
        let thick = Slab::new(6.0, SlabKind::Max).unwrap();
        let at_once = |slab| {
            let mut view = SliceView { slab, ..SliceView::new(Orientation::Sagittal, [70, 50]) };
            view.make(&volume, None, &here);
            view.hu
        };
        let mut view = SliceView { slab: thick, ..SliceView::new(Orientation::Sagittal, [70, 50]) };
        view.make(&volume, None, &here);
        assert!(view.hu == at_once(thick));
        for slab in
            [Slab::new(6.0, SlabKind::Min).unwrap(), Slab::new(3.0, SlabKind::Min).unwrap(), Slab::default(), thick]
        {
            view.slab = slab;
            assert!(view.is_stale(volume.grid(), &here));
            view.make(&volume, None, &here);
            assert!(view.made && view.hu == at_once(slab), "{slab:?}");
        }
        assert!(at_once(thick) != at_once(Slab::default()));
        // Thin again in the middle of a refinement.
        view.budget = Some(20_000);
        view.slab = Slab::new(10.0, SlabKind::Mean).unwrap();
        view.make(&volume, None, &here);
        view.make(&volume, None, &here);
        assert!(view.rows.is_some_and(|rows| rows > 0));
        view.slab = Slab::default();
        for _ in 0..60 {
            view.make(&volume, None, &here);
        }
        assert!(!view.is_stale(volume.grid(), &here) && view.hu == at_once(Slab::default()));
    }
}
