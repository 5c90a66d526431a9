//! Pictures of a finding: from the lumen and in two slices, and the same as scanned.

use glam::DVec3;

use super::{Finding, View};
use crate::error::{Error, Result};
use crate::look::{Looks, Subject};
use crate::panics::ask_plugin;
use crate::render::slice::Windowing;
use crate::render::{Frame, Preset, Quality, Reuse, Settings, View as CameraView, renderer};
use crate::space::PreparedVolume;

/// Window of the slices, HU: gas is dark but not black, fat and soft tissue differ, and tag is white.
pub const LEVEL_HU: f64 = -200.0;
/// Width of that window, HU.
pub const WIDTH_HU: f64 = 1500.0;

/// A picture of a finding.
#[derive(Clone, Debug, PartialEq)]
pub struct FindingPicture {
    /// What it shows: `view`, `axial` or `along`, and `-scanned` after it for the scan with its tag.
    pub name: &'static str,
    /// Side, pixels.
    pub side: usize,
    /// Its pixels, row by row.
    pub rgb: Vec<[u8; 3]>,
    /// Where the ends of the finding's diameter are, pixels from the top left corner; `None` if it has none, or they are behind the camera.
    pub ends: Option<[[f64; 2]; 2]>,
    /// The letters at the left, right, top and bottom edge of a slice: the patient's directions.
    pub edges: Option<[String; 4]>,
}

impl Finding {
    /// Returns a view that shows the finding well: that of the file, or one from where there is room in front of it.
    ///
    /// # Errors
    /// Returns status 2 if it is nowhere.
    pub fn view_in(&self, volume: &PreparedVolume) -> Result<View> {
        if let Some(view) = self.view {
            return Ok(view);
        }
        let subject = self.subject(volume);
        let (position, fov_degrees) = Looks::new(volume).camera(&subject);
        let view = CameraView::new(position, subject.middle - position, DVec3::Z, fov_degrees, 1, 1)?;
        Ok(View { position, forward: view.forward(), up: view.up(), fov_degrees })
    }

    fn subject(&self, volume: &PreparedVolume) -> Subject {
        let normal = self.normal.or_else(|| super::normal_at(volume, self.place));
        Subject::at(self.place, normal.unwrap_or(DVec3::NEG_Y), self.ends)
    }

    /// Makes the pictures, `side` pixels wide and high: three of `shown`, and of `scanned`, the same scan with its tag, if that differs.
    ///
    /// # Errors
    /// Returns status 2 if the finding is nowhere, or status 1 if the preset's renderer fails.
    pub fn pictures(
        &self,
        shown: &PreparedVolume,
        scanned: Option<&PreparedVolume>,
        preset: Preset,
        side: usize,
    ) -> Result<Vec<FindingPicture>> {
        let at = self.view_in(shown)?;
        let view = CameraView::new(at.position, at.forward, at.up, at.fov_degrees, side, side)?;
        let [axial, _, along] = self.subject(shown).slices();
        let windowing = Windowing::new(LEVEL_HU, WIDTH_HU).map_err(|why| Error::fault("pictures", why, "report it"))?;
        let scans =
            [(Some(shown), ["view", "axial", "along"]), (scanned, ["view-scanned", "axial-scanned", "along-scanned"])];
        let mut pictures = Vec::new();
        for (volume, [of_view, of_axial, of_along]) in scans.into_iter().filter_map(|(v, names)| Some((v?, names))) {
            let name = || format!("preset {}", preset.name);
            let mut frame = Frame::new(side, side);
            let draw = || {
                renderer(volume, Settings::new(Quality::High), preset, Reuse::Never).render(&view, &mut frame);
                Ok(())
            };
            ask_plugin(name, draw)?;
            let ends = self.ends.and_then(|ends| Some([view.project(ends[0])?, view.project(ends[1])?]));
            pictures.push(FindingPicture { name: of_view, side, rgb: frame.pixels().to_vec(), ends, edges: None });
            let (mut hu, mut grey) = (Vec::new(), vec![0; side * side]);
            for (name, slice) in [(of_axial, axial), (of_along, along)] {
                let mm_per_pixel = slice.mm_per_pixel * slice.size[0] as f64 / side as f64;
                let slice = crate::render::slice::Slice { size: [side; 2], mm_per_pixel, ..slice };
                slice.fill(volume.voxels(), &mut hu);
                windowing.fill(&hu, &mut grey);
                let ends = self.ends.map(|ends| ends.map(|end| slice.pixel(end).0));
                let rgb = grey.iter().map(|&g| [g; 3]).collect();
                let edges = slice.frame.edges();
                pictures.push(FindingPicture { name, side, rgb, ends, edges: Some(edges) });
            }
        }
        Ok(pictures)
    }
}
