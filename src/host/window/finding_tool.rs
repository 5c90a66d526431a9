//! What a window makes of findings in the background: their measures, a view that shows them, and pictures.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use super::background::{Background, BackgroundTask};
use super::cleansing::AsScanned;
use super::job::Job;
use crate::app::findings::{Finding, FindingPicture, View, lesion_at};
use crate::error::Result;
use crate::polyps::{Measurement, RESTORED_HU};
use crate::render::Preset;
use crate::space::PreparedVolume;

/// Side of a picture, pixels.
pub(crate) const SIDE: usize = 240;

/// The scans that findings are measured in and shown in.
pub(crate) struct Scans {
    /// The one in whose wall they are: cleansed, if that is known.
    pub(crate) cleansed: PreparedVolume,
    /// The same with its tag, if it has some.
    pub(crate) scanned: AsScanned,
    /// The one that is shown: its wall was pointed at.
    pub(crate) shown: PreparedVolume,
    /// Renders the pictures.
    pub(crate) preset: Preset,
}

/// What is to be made of a finding. It waits as long as that is deleted, which can be undone.
struct Order {
    id: String,
    /// Where that finding is, world mm.
    place: DVec3,
    /// True if the lesion there is to be measured, too.
    measures: bool,
}

/// What was made of a finding.
pub(crate) struct Made {
    pub(crate) id: String,
    /// Where that finding is, world mm.
    pub(crate) place: DVec3,
    /// The lesion, if that was asked for; why not, if nothing bulges there.
    pub(crate) measured: Option<std::result::Result<Measurement, String>>,
    pub(crate) view: View,
    pictures: Pictures,
}

/// The pictures of a finding.
#[derive(Clone)]
struct Pictures {
    /// The ends of its diameter that they show, world mm.
    ends: Option<[DVec3; 2]>,
    list: Arc<[FindingPicture]>,
}

/// The findings of a window beside their document.
pub(crate) struct FindingTool {
    /// The id of the finding that is chosen.
    current: Option<String>,
    /// True if the next distance is the diameter of the chosen one.
    pub(crate) takes_distance: bool,
    waiting: VecDeque<Order>,
    task: BackgroundTask<Made>,
    pictures: BTreeMap<String, Pictures>,
}

impl FindingTool {
    pub(crate) fn new(now: Instant) -> Self {
        Self {
            current: None,
            takes_distance: false,
            waiting: VecDeque::new(),
            task: BackgroundTask::new(now),
            pictures: BTreeMap::new(),
        }
    }

    /// Chooses a finding.
    pub(crate) fn choose(&mut self, id: Option<String>) {
        self.takes_distance &= self.current == id;
        self.current = id;
    }

    /// Returns the number of the chosen one in a list.
    pub(crate) fn current(&self, list: &[Finding]) -> Option<usize> {
        let id = self.current.as_deref()?;
        list.iter().position(|f| f.id == id)
    }

    /// Returns the pictures of a finding, once they are made. After a correction, they are those before until there are others.
    pub(crate) fn pictures(&self, id: &str) -> Option<&Arc<[FindingPicture]>> {
        Some(&self.pictures.get(id)?.list)
    }

    /// True if there is no picture of a finding as it is now.
    fn lacks(&self, finding: &Finding) -> bool {
        self.pictures.get(&finding.id).is_none_or(|p| p.ends != finding.ends)
    }

    /// Asks for the pictures of a new finding, and its measures.
    pub(crate) fn order(&mut self, id: &str, place: DVec3, measures: bool) {
        self.pictures.remove(id);
        // Another one that was at the same place and deleted.
        self.waiting.retain(|o| o.id != id || o.place != place);
        self.waiting.push_back(Order { id: id.to_owned(), place, measures });
    }

    /// Returns which order is due next: the first for a finding that is there.
    fn due(&self, list: &[Finding]) -> Option<usize> {
        self.waiting.iter().position(|o| list.iter().any(|f| f.is_at(&o.id, o.place)))
    }

    /// True if there are findings without pictures, or corrected since, and none is being made.
    pub(crate) fn lacks_pictures(&self, list: &[Finding]) -> bool {
        let is_idle = self.due(list).is_none() && !self.task.is_working() && self.task.failed().is_none();
        is_idle && list.iter().any(|f| self.lacks(f))
    }

    /// Asks for the pictures of those that have none.
    pub(crate) fn order_missing(&mut self, list: &[Finding]) {
        if self.lacks_pictures(list) {
            let without: Vec<&Finding> = list.iter().filter(|f| self.lacks(f)).collect();
            self.waiting.extend(without.iter().map(|f| Order { id: f.id.clone(), place: f.place, measures: false }));
        }
    }

    /// Begins with what is due next. `scans` is called if something is.
    pub(crate) fn begin(
        &mut self,
        list: &[Finding],
        scans: impl FnOnce() -> Scans,
        background: &Background,
        now: Instant,
    ) {
        if self.task.is_working() {
            return;
        }
        let Some(Order { id, place, measures }) = self.due(list).and_then(|n| self.waiting.remove(n)) else { return };
        if let Some(finding) = list.iter().find(|f| f.is_at(&id, place)) {
            self.task.go_over(start(finding.clone(), measures, scans(), background), now);
        }
    }

    /// Takes what was made of a finding, once it is there. `list` has those that there are now.
    pub(crate) fn take(&mut self, list: &[Finding], now: Instant) -> Option<Made> {
        let (made, _) = self.task.take(now)?.ok()?;
        // It may have been deleted, and another one have its id.
        if list.iter().all(|f| f.id != made.id || f.is_at(&made.id, made.place)) {
            self.pictures.insert(made.id.clone(), made.pictures.clone());
        }
        Some(made)
    }

    /// Returns when its progress has to be looked at. `list` has the findings that there are.
    pub(crate) fn next(&self, list: &[Finding], now: Instant) -> Option<Instant> {
        self.task.next().or_else(|| self.due(list).map(|_| now))
    }
}

/// Measures and draws a finding.
///
/// # Errors
/// Returns status 1 if the system cannot start a thread.
fn start(mut finding: Finding, measures: bool, scans: Scans, background: &Background) -> Result<Job<Made>> {
    background.start_apart("finding", move |progress| {
        let Scans { cleansed, scanned, shown, preset } = scans;
        let scanned = scanned.beside(&cleansed);
        let is_restored = |place| {
            let hu = |volume: &PreparedVolume| {
                let [i, j, k] = volume.voxels().grid().voxel(place).round().to_array().map(|x| x as i64);
                i32::from(volume.voxels().get(i, j, k))
            };
            scanned.as_ref().is_some_and(|scanned| (hu(scanned) - hu(&shown)).abs() > RESTORED_HU)
        };
        let measured = measures.then(|| {
            let iso = shown.transfer().iso();
            lesion_at(shown.voxels(), iso, finding.place, is_restored, progress)
        });
        progress.check()?;
        if let Some(Ok(measured)) = &measured {
            finding.measure(measured);
        }
        let view = finding.view_in(&cleansed)?;
        finding.view = Some(view);
        let list = finding.pictures(&cleansed, scanned.as_ref(), preset, SIDE)?.into();
        Ok(Made {
            id: finding.id,
            place: finding.place,
            measured: measured.map(|m| m.map_err(|e| e.why)),
            view,
            pictures: Pictures { ends: finding.ends, list },
        })
    })
}
