//! The search: finds candidates in a scan without tag, and keeps what shows and measures them. It runs on threads of its own.

use std::sync::Arc;

use glam::DVec3;

use crate::app::boxed::boxed;
use crate::app::look::{Looks, Subject};
use crate::components::camera::Pose;
use crate::dynamics::Attitude;
use crate::error::{Error, Result};
use crate::fields::{AlongColon, Lumen};
use crate::host::window::clean::{Before, Clean, Scanned};
use crate::panics::ask_plugin;
use crate::polyps::{self, Candidate, Coated, CoatedPlaces, Coats, Colon, Detector, Measurement, Wall, detectors};
use crate::progress::Progress;
use crate::render::{Frame, Preset, Quality, Reuse, Settings, renderer};
use crate::volume::Volume;

/// Candidates of the default method with a lower score are not listed. The scores of others have scales of their own.
const LEAST_SCORE: f64 = 0.2;
/// Maximum number of listed candidates.
const MOST: usize = 100;
/// Side of a candidate's picture, pixels.
pub(crate) const SIDE: usize = 160;

/// What the search looks at.
pub(crate) struct Input {
    /// The scan that is flown through.
    pub(crate) scan: Scanned,
    /// Renders the pictures.
    pub(crate) preset: Preset,
    /// Finds the candidates.
    pub(crate) detector: Detector,
}

/// A candidate in the list.
pub(crate) struct Entry {
    pub(crate) candidate: Candidate,
    /// Where it is along the colon.
    pub(crate) along: Option<AlongColon>,
    /// How much of it wears thin tag.
    pub(crate) coated: Coated,
    /// From where it is seen well in the scan without tag, world mm.
    pub(crate) pose: Pose,
    /// What is seen from there, [`SIDE`] pixels wide and high.
    pub(crate) picture: Vec<[u8; 3]>,
}

/// What a search found.
pub(crate) struct Found {
    /// The candidates, best first.
    pub(crate) list: Vec<Entry>,
    wall: Wall,
    /// The coated spots of the wall.
    pub(crate) coats: Arc<CoatedPlaces>,
    /// The scan without tag, or the part of it around the colon.
    volume: Arc<Volume>,
    before: Before,
    /// Size in memory of what nothing else in the window holds, bytes.
    pub(crate) bytes: usize,
}

/// Looks for polyps.
///
/// # Errors
/// Returns status 4 if there is no colon, or if cancelled.
pub(crate) fn search(input: Input, progress: &Progress) -> Result<Found> {
    if input.scan.lumen.segments.is_empty() {
        return Err(Error::incomplete("polyps", "no gas of a colon was found in the scan", "open a scan of a colon"));
    }
    let (preset, detector) = (input.preset, input.detector);
    let Clean { volume, lumen, before, around, bytes } = input.scan.clean(progress)?;
    let along = lumen.along(&volume, progress)?;
    let wall = Wall::new(&volume, &lumen, around.transfer().iso(), progress)?;
    let coats = coats(&wall, &before, &volume, &lumen, progress)?;
    let all = polyps::find(&detector, &Colon { volume: &volume, lumen: &lumen, wall: &wall }, progress)?;
    drop(volume);
    let looks = Looks::new(&around);
    let make = || Ok(renderer(&around, Settings::new(Quality::High), preset, Reuse::Never));
    let name = || format!("preset {}", preset.name);
    let mut renderer = ask_plugin(name, make)?;
    let mut frame = Frame::new(SIDE, SIDE);
    // The scores of other crates have scales of their own.
    let is_scaled = |c: &Candidate| c.lesion.is_some() && detectors::BUILT_IN.iter().any(|d| d.name == detector.name);
    let listed = all.into_iter().filter(|c| !is_scaled(c) || c.score >= LEAST_SCORE).take(MOST);
    let listed: Vec<Candidate> = listed.collect();
    let coated = coats.of_each(&wall, &listed);
    let mut list = Vec::new();
    progress.stage("rendering candidates", listed.len() as u64);
    for (candidate, coated) in listed.into_iter().zip(coated) {
        let (view, _) = looks.view(&Subject::of(&candidate, &wall), SIDE)?;
        ask_plugin(name, || Ok(renderer.render(&view, &mut frame)))?;
        let pose = Pose { position: view.position(), attitude: Attitude::new(view.forward(), view.up()) };
        let along = along.of(candidate.position);
        list.push(Entry { candidate, along, coated, pose, picture: frame.pixels().to_vec() });
        progress.advance(1)?;
    }
    let coats = Arc::new(CoatedPlaces::new(&coats, &wall));
    let bytes = bytes + wall.bytes() + coats.bytes() + list.len() * (SIDE * SIDE * 3 + size_of::<Entry>());
    Ok(Found { list, wall, coats, volume: around.shared_voxels(), before, bytes })
}

/// Finds the coated spots of the wall of a scan without tag.
fn coats(wall: &Wall, before: &Before, volume: &Volume, lumen: &Lumen, progress: &Progress) -> Result<Coats> {
    match before {
        Before::Same => Coats::find(wall, volume, None, progress),
        Before::Scan(scan, cleansed) => Coats::find(wall, scan, Some(cleansed), progress),
        Before::Changes(cleansed) => {
            Coats::find(wall, &boxed(volume, lumen, &cleansed.changes), Some(cleansed), progress)
        }
    }
}

impl Found {
    /// Measures the lesion at a place of the wall (world, mm).
    ///
    /// # Errors
    /// Returns status 4 if nothing bulges there.
    pub(crate) fn measure(&self, at: DVec3) -> Result<Measurement> {
        polyps::measure(&self.wall, &self.volume, at, |p| self.before.is_restored(&self.volume, p))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::{cleanse, lumen};
    use crate::host::window::cleansing::Tag;
    use crate::phantom::PhantomSettings;
    use crate::shared::shared;
    use crate::space::{PreparedVolume, TransferFunction};

    /// Tag that is taken out here and tag that was taken out before give the same candidates.
    #[test]
    #[ignore = "slow: candidates of a phantom with tag, twice"]
    fn the_same_is_found_whoever_takes_the_tag_out() {
        let progress = Progress::new();
        let scan = Arc::new(shared(&PhantomSettings { fluid: true, ..PhantomSettings::embedded(1) }).1);
        let lumen = Arc::new(lumen::find(&scan, &progress).unwrap());
        let cleansed = cleanse::cleanse(&scan, &lumen, &progress).unwrap();
        let volume = PreparedVolume::new(Arc::clone(&scan), TransferFunction::default());
        let part = volume.with_voxels(Arc::new(boxed(&scan, &lumen, &cleansed.changes)));
        let found = [Tag::Unknown, Tag::Beside(part, Arc::new(cleansed.without_values()))].map(|tag| {
            let (volume, lumen) = (volume.clone(), Arc::clone(&lumen));
            let (preset, detector) = (Preset::default(), detectors::BUILT_IN[0]);
            search(Input { scan: Scanned { volume, lumen, told: Vec::new(), tag }, preset, detector }, &progress)
                .unwrap()
        });
        let places = |f: &Found| f.list.iter().map(|e| (e.candidate.position, e.candidate.score)).collect::<Vec<_>>();
        assert!(!found[0].list.is_empty() && places(&found[0]) == places(&found[1]));
        assert!(found[0].list.windows(2).all(|w| w[0].candidate.score >= w[1].candidate.score));
        assert!(found[0].bytes > found[1].bytes, "the window holds the other part");
        for entry in &found[0].list {
            assert!(entry.candidate.score >= LEAST_SCORE && entry.picture.iter().any(|p| p[0] > 60));
            let to = entry.candidate.position - entry.pose.position;
            assert!(to.normalize().dot(entry.pose.attitude.forward) > 0.8, "it is in the middle");
        }
        // Candidates are measured where they were found.
        let first = &found[0].list[0];
        let measured = found[0].measure(first.candidate.position).unwrap();
        assert!(measured.lesion.position.distance(first.candidate.position) < 5.0);
        assert!(found[0].measure(DVec3::splat(1e4)).is_err());
    }

    #[test]
    fn a_detector_from_outside_finds_the_candidates_and_is_refused_by_name() {
        /// One place of the wall, with a score below that of the default method's candidates.
        fn first(colon: &Colon<'_>, _: &Progress) -> Result<Vec<Candidate>> {
            Ok(vec![Candidate::new(colon.wall.world(0), -3.0)])
        }
        fn astray(colon: &Colon<'_>, _: &Progress) -> Result<Vec<Candidate>> {
            Ok(vec![Candidate::new(colon.wall.world(0) + DVec3::X * 1e6, 1.0)])
        }
        let progress = Progress::new();
        let scan = Arc::new(shared(&PhantomSettings::embedded(1)).1);
        let lumen = Arc::new(lumen::find(&scan, &progress).unwrap());
        let volume = PreparedVolume::new(scan, TransferFunction::default());
        let searched = |detector: Detector| {
            let (volume, lumen, preset) = (volume.clone(), Arc::clone(&lumen), Preset::default());
            search(
                Input { scan: Scanned { volume, lumen, told: Vec::new(), tag: Tag::Absent }, preset, detector },
                &progress,
            )
        };
        let found = searched(Detector { name: "first", summary: "", find: first }).unwrap();
        let list: Vec<_> = found.list.iter().map(|e| (e.candidate.position, e.candidate.score)).collect();
        assert_eq!(list, [(found.wall.world(0), -3.0)]);
        let e = searched(Detector { name: "astray", summary: "", find: astray }).err().unwrap().to_string();
        assert!(e.starts_with("detector astray: returned a place outside the scan"), "{e}");
    }
}
