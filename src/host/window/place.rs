//! Where the camera is along the colon, in a window: by the measure that all lists and files use, once the background has computed it,
//! and by the distance flown until then.

use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::DVec3;

use super::background::Background;
use super::job::Job;
use crate::app::{FlightApp, Setup};
use crate::components::flight::State;
use crate::components::still::StillViews;
use crate::components::trail::Trail;
use crate::error::Result;
use crate::fields::lumen::Part;
use crate::fields::{Along, AlongColon, Lumen};
use crate::progress::Progress;

/// Time between two places.
const LOOKS: Duration = Duration::from_millis(250);
/// Two places farther apart than this along the line are not joined by a flight between them, mm.
const STRIDE_MM: f64 = 40.0;
/// Less of a part than this is no reason to go back to it, mm: the ends of a flight stay short of the ends of the colon.
const WORTH_MM: f64 = 60.0;
/// The shortest stretch without gas that is told, mm.
const GAP_MM: f64 = 10.0;
/// Stretches nearer than this are one, mm.
const TOUCHING_MM: f64 = 5.0;

/// The camera's place along the colon.
pub(crate) struct Place {
    /// The lumen that is flown, and what is known of the measure along it.
    flown: Option<(Arc<Lumen>, Known)>,
    at: Option<AlongColon>,
    /// Stretches of the line that were flown, from and to, mm; apart and in order.
    read: Vec<[f64; 2]>,
    /// How many views of the flight's trail are among them, and where the last one is, mm.
    followed: (usize, Option<f64>),
    /// Length of the line that they are stretches of, mm.
    length_mm: f64,
    looked: Instant,
}

/// The bar of a flight. Numbers are per mille of its length.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Bar {
    /// The camera.
    pub camera: u32,
    /// Stretches that were flown.
    pub read: Vec<[u32; 2]>,
    /// Stretches without gas, whose course is a guess.
    pub guessed: Vec<[u32; 2]>,
    /// The ends of the colon's parts, with their names, from the rectum.
    pub parts: Vec<(u32, &'static str)>,
    /// Where the guide called the operator.
    pub calls: Vec<u32>,
    /// The stretch where the other position's camera is, with a probability of 90 %.
    pub expected: Option<[u32; 2]>,
}

/// A place of the line that the bar was clicked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Chosen {
    /// World, mm.
    pub at: DVec3,
    /// The direction towards the flight's goal.
    pub forward: DVec3,
    /// The segment there.
    pub segment: usize,
    /// True where there is no gas to fly through.
    pub is_guessed: bool,
}

/// The measure along a lumen, and the stretches of its line that were flown before it was known, as [`Place::read`].
type Measured = (Arc<Along>, Vec<[f64; 2]>);

enum Known {
    Computing(Job<Measured>),
    Yes(Arc<Along>),
    /// It failed: the distance flown has to do.
    No,
}

impl Place {
    pub(crate) fn new(now: Instant) -> Self {
        Self { flown: None, at: None, read: Vec::new(), followed: (0, None), length_mm: 0.0, looked: now }
    }

    /// Looks where the camera is, if it is time. Starts the computation for a lumen that is new.
    pub(crate) fn update(&mut self, flight: &FlightApp, background: &Background, now: Instant) {
        // What has been computed is shown at once: the job wakes the window up, and nothing else may do so afterwards.
        let is_computing = matches!(self.flown, Some((_, Known::Computing(_))));
        if self.flown.is_some() && !is_computing && now.saturating_duration_since(self.looked) < LOOKS {
            return;
        }
        self.looked = now;
        let Setup { lumen, plan, .. } = flight.setup();
        let gas = plan.gas.as_ref().unwrap_or(lumen);
        if self.flown.as_ref().is_none_or(|f| !Arc::ptr_eq(&f.0, gas)) {
            let known = begin(flight, gas, background).map_or(Known::No, Known::Computing);
            self.flown = Some((Arc::clone(gas), known));
            self.at = None;
        }
        let Some((_, known)) = &mut self.flown else { return };
        if let Known::Computing(job) = known
            && let Some(done) = job.take()
        {
            *known = match done {
                Ok((along, read)) => {
                    // The measure is that of the scan, with its tag or without; another kind of its gas may change it.
                    if (along.length_mm() - self.length_mm).abs() > TOUCHING_MM {
                        self.length_mm = along.length_mm();
                        self.read.clear();
                        self.followed = (0, None);
                    }
                    read.into_iter().for_each(|stretch| add(&mut self.read, stretch));
                    Known::Yes(along)
                }
                Err(_) => Known::No,
            };
        }
        let Known::Yes(along) = known else {
            self.at = None;
            return;
        };
        self.at = along.of(flight.pose().position);
        let along = Arc::clone(along);
        self.follow(flight, &along);
    }

    /// Adds what was flown since the last look. The trail has it all, however late the measure is known and however fast the flight is.
    fn follow(&mut self, flight: &FlightApp, along: &Along) {
        let views = flight.survey().trail().map_or(&[][..], Trail::views);
        let (from, mut last) = self.followed;
        let new = views.get(from..).unwrap_or_default().iter().filter_map(|v| along.of(v.0));
        for mm in new.chain(self.at).map(|a| a.mm) {
            go_on(&mut self.read, last, mm);
            last = Some(mm);
        }
        self.followed = (views.len(), last);
    }

    /// Returns the part of the colon that the camera is in, if the parts are known.
    pub(crate) fn part(&self) -> Option<&'static str> {
        self.at?.part
    }

    /// Returns the measure along the lumen that is flown, if it is known.
    pub(crate) fn along(&self) -> Option<&Arc<Along>> {
        match &self.flown {
            Some((_, Known::Yes(along))) => Some(along),
            _ => None,
        }
    }

    /// Returns where a place (world, mm) is along the colon, if that is known.
    pub(crate) fn along_of(&self, place: DVec3) -> Option<AlongColon> {
        self.along()?.of(place)
    }

    /// Returns the measure along the colon, if it is known from the rectum to the cecum and a log is not replayed, whose bar is that of
    /// the log.
    fn whole(&self, flight: &FlightApp) -> Option<&Along> {
        match &self.flown {
            Some((_, Known::Yes(along))) if along.is_whole() && flight.setup().scene.play().is_none() => Some(along),
            _ => None,
        }
    }

    /// Returns the bar: the whole colon, from the rectum; `None` if its measure is not known.
    pub(crate) fn bar(&self, flight: &FlightApp) -> Option<Bar> {
        let (along, at) = (self.whole(flight)?, self.at?);
        let length = along.length_mm().max(1.0);
        let share = |mm: f64| (mm / length * 1000.0).round().clamp(0.0, 1000.0) as u32;
        let stretches = |list: &[[f64; 2]]| list.iter().map(|s| s.map(share)).collect();
        let trail = flight.survey().trail();
        let call = |share: &f64| trail.and_then(|t| t.at(*share)).and_then(|p| along.of(p.0)).map(|a| a.mm);
        let calls = trail.map_or(&[][..], |t| t.calls()).iter().filter_map(call).map(share).collect();
        Some(Bar {
            camera: share(at.mm),
            read: stretches(&self.read),
            guessed: stretches(along.guessed()),
            parts: along.parts().iter().map(|p| (share(p.to_mm), p.name)).collect(),
            calls,
            expected: None,
        })
    }

    /// Returns a stretch of the bar, from and to in mm along the colon; `None` if the measure is not known.
    pub(crate) fn stretch(&self, flight: &FlightApp, mm: [f64; 2]) -> Option<[u32; 2]> {
        let length = self.whole(flight)?.length_mm().max(1.0);
        Some(mm.map(|mm| (mm / length * 1000.0).round().clamp(0.0, 1000.0) as u32))
    }

    /// Returns the place at a share of the bar; `None` if the measure is not known.
    pub(crate) fn at_share(&self, flight: &FlightApp, share: f64) -> Option<Chosen> {
        let along = self.whole(flight)?;
        let mm = along.length_mm() * share.clamp(0.0, 1.0);
        let (at, towards_cecum) = along.point(mm)?;
        let plan = &flight.setup().plan;
        let end = |at: DVec3| along.of(at).map(|a| a.mm);
        let returns = end(plan.goal().at).zip(end(plan.other_end().at)).is_some_and(|(goal, start)| goal < start);
        let AlongColon { segment, is_guessed, .. } = along.of(at)?;
        let forward = if returns { -towards_cecum } else { towards_cecum };
        Some(Chosen { at, forward, segment, is_guessed })
    }

    /// Returns what of the colon was not read, once a flight has arrived: "not read: rectum, sigmoid (380 mm)". `None` if nothing is
    /// left, or the measure is not known.
    fn unread(&self, flight: &FlightApp) -> Option<String> {
        let along = self.whole(flight).filter(|_| flight.flight().state == State::Arrived)?;
        unread(along.length_mm(), &self.read, along.guessed(), along.parts())
    }

    /// Returns the part of the colon around the camera, and "840 of 2050 mm": the distance from the rectum and the length of the
    /// whole colon. `None` if the measure is not known yet, or no line leads from the rectum to the cecum.
    ///
    /// Once the flight has arrived, what of the colon was not read follows.
    pub(crate) fn text(&self, flight: &FlightApp) -> Option<String> {
        let (Some((_, Known::Yes(along))), Some(at)) = (&self.flown, self.at) else { return None };
        let length = along.length_mm();
        if !along.is_whole() {
            return None;
        }
        let round = |mm: f64| (mm / 10.0).round() * 10.0;
        let guessed = if at.is_guessed { ", a guess" } else { "" };
        let part = at.part.map_or_else(String::new, |p| format!("{p}, "));
        let unread = self.unread(flight).map_or_else(String::new, |u| format!("; {u}"));
        Some(format!("{part}{:.0} of {:.0} mm{guessed}{unread}", round(at.mm), round(length)))
    }
}

/// Returns what of a colon was not flown, for its reader: the parts with more than [`WORTH_MM`] of it, and the stretches without gas,
/// which no flight shows. `None` if nothing is left.
fn unread(length_mm: f64, read: &[[f64; 2]], guessed: &[[f64; 2]], parts: &[Part]) -> Option<String> {
    let shared = |a: [f64; 2], b: [f64; 2]| (a[1].min(b[1]) - a[0].max(b[0])).max(0.0);
    let of = |stretches: &[[f64; 2]], within: [f64; 2]| stretches.iter().map(|s| shared(*s, within)).sum::<f64>();
    let (mut names, mut left) = (Vec::new(), 0.0);
    for part in parts {
        let within = [part.from_mm, part.to_mm.min(length_mm)];
        // A guess is not flown, but it is told by itself.
        let gas = within[1] - within[0] - of(guessed, within);
        let flown = read
            .iter()
            .map(|r| shared(*r, within) - of(guessed, [r[0].max(within[0]), r[1].min(within[1])]))
            .sum::<f64>();
        if gas - flown > WORTH_MM {
            names.push(part.name);
            left += gas - flown;
        }
    }
    let mut told = Vec::new();
    if !names.is_empty() {
        told.push(format!("not read: {} ({:.0} mm)", names.join(", "), (left / 10.0).round() * 10.0));
    }
    for stretch in guessed.iter().filter(|g| g[1] - g[0] >= GAP_MM) {
        let middle = (stretch[0] + stretch[1]) * 0.5;
        let name = parts.iter().find(|p| p.to_mm >= middle).map_or("colon", |p| p.name);
        told.push(format!("{name} without gas for {:.0} mm: read it in slices", stretch[1] - stretch[0]));
    }
    (!told.is_empty()).then(|| told.join("; "))
}

/// Names a segment by its place among all of them, "2nd of 3 segments", since files number them from 0; "only segment".
pub(super) fn which_segment(index: usize, count: usize) -> String {
    let n = index + 1;
    let ending = match (n % 10, n % 100) {
        (1, r) if r != 11 => "st",
        (2, r) if r != 12 => "nd",
        (3, r) if r != 13 => "rd",
        _ => "th",
    };
    if count == 1 { "only segment".to_owned() } else { format!("{n}{ending} of {count} segments") }
}

/// Adds a stretch to those that are apart and in order.
fn add(list: &mut Vec<[f64; 2]>, [mut from, mut to]: [f64; 2]) {
    let first = list.partition_point(|s| s[1] + TOUCHING_MM < from);
    let last = list.partition_point(|s| s[0] - TOUCHING_MM <= to);
    for s in &list[first..last] {
        (from, to) = (from.min(s[0]), to.max(s[1]));
    }
    list.splice(first..last, [[from, to]]);
}

/// Adds the stretch from the place before to this one, mm, if they are joined by a flight.
fn go_on(list: &mut Vec<[f64; 2]>, before: Option<f64>, mm: f64) {
    let from = before.filter(|b| (b - mm).abs() < STRIDE_MM).unwrap_or(mm);
    add(list, [from.min(mm), from.max(mm)]);
}

/// Computes the measure along the gas that is flown, and what of it was read until now and in an earlier sitting, in the background.
fn begin(flight: &FlightApp, gas: &Arc<Lumen>, background: &Background) -> Result<Job<Measured>> {
    let (volume, gas) = (flight.setup().volume.clone(), Arc::clone(gas));
    let earlier = flight.camera::<StillViews>().map_or(&[][..], StillViews::earlier);
    let trail = flight.survey().trail().map_or(&[][..], Trail::views);
    let ways = [earlier.iter().map(|v| v.position).collect(), trail.iter().map(|v| v.0).collect::<Vec<_>>()];
    let work = move |progress: &Arc<Progress>| {
        let (along, mut read) = (gas.along(volume.voxels(), progress)?, Vec::new());
        for way in ways {
            let mut before = None;
            for at in way {
                let mm = along.of(at).map(|a| a.mm);
                mm.into_iter().for_each(|mm| go_on(&mut read, before, mm));
                before = mm;
            }
        }
        Ok((along, read))
    };
    background.start("along", work)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::{FlightRequest, OpenOptions, Scan, Scene};
    use crate::components::still::StillView;
    use crate::host::window::contract::WindowView;
    use crate::host::window::controller::tests::{cockpit_of, trace};
    use crate::phantom::PhantomSettings;
    use crate::shared::shared;

    #[test]
    fn segments_are_named_by_their_place_among_all() {
        let all =
            [0, 1, 2, 3, 10, 11, 12, 20, 21, 110].map(|n| which_segment(n, 200).split(' ').next().unwrap().to_owned());
        assert_eq!(all, ["1st", "2nd", "3rd", "4th", "11th", "12th", "13th", "21st", "22nd", "111th"]);
    }

    #[test]
    fn what_was_not_read_is_told_by_its_parts() {
        let ends =
            [("rectum", 0.0, 150.0), ("sigmoid", 150.0, 500.0), ("descending", 500.0, 800.0), ("cecum", 800.0, 900.0)];
        let parts = ends.map(|(name, from_mm, to_mm)| Part { name, from_mm, to_mm, uncertainty_mm: 0.0 });
        let told = |read: &[[f64; 2]], guessed: &[[f64; 2]]| unread(900.0, read, guessed, &parts);
        assert_eq!(told(&[[10.0, 880.0]], &[]), None);
        assert_eq!(told(&[[450.0, 880.0]], &[]).unwrap(), "not read: rectum, sigmoid (450 mm)");
        assert_eq!(told(&[[0.0, 300.0], [600.0, 900.0]], &[]).unwrap(), "not read: sigmoid, descending (300 mm)");
        let gap = "sigmoid without gas for 42 mm: read it in slices";
        assert_eq!(told(&[[0.0, 900.0]], &[[300.0, 342.0], [600.0, 604.0]]).unwrap(), gap);
        assert_eq!(
            told(&[], &[[300.0, 342.0]]).unwrap(),
            format!("not read: rectum, sigmoid, descending, cecum (860 mm); {gap}")
        );
    }

    #[test]
    fn stretches_that_touch_are_one() {
        let mut list = Vec::new();
        for stretch in [[100.0, 120.0], [300.0, 310.0], [0.0, 10.0], [118.0, 150.0], [14.0, 20.0], [290.0, 296.0]] {
            add(&mut list, stretch);
        }
        assert_eq!(list, [[0.0, 20.0], [100.0, 150.0], [290.0, 310.0]]);
        add(&mut list, [5.0, 400.0]);
        assert_eq!(list, [[0.0, 400.0]]);
    }

    /// A flight in a window, and the measure along its scan as that is in its file. `path` takes the tag out of it.
    fn bar_of(guide: &'static str, fluid: bool) {
        let progress = Progress::new();
        let settings = PhantomSettings { fluid, ..PhantomSettings::embedded(1) };
        let open = || Scan::of(shared(&settings).1, &OpenOptions::default()).unwrap();
        let mut in_file = open();
        let lumen = in_file.lumen().unwrap();
        let along = lumen.along(in_file.volume().voxels(), &progress).unwrap();

        let scene = Scene { picture: true, ..Scene::guided_by(guide) };
        let mut c = cockpit_of(open().flight(scene, &FlightRequest::default()).unwrap(), 0.0, Vec::new());
        let begun = Instant::now();
        trace(&mut c, begun);
        while c.cleansing().is_waiting() {
            c.advance(begun).unwrap();
        }
        let mut now = begun;
        // Until it is known, the distance flown is told.
        assert!(c.hud(now).place.contains(" of about "), "{}", c.hud(now).place);
        while c.hud(now).place.contains(" of about ") {
            assert!(begun.elapsed() < Duration::from_secs(120), "{}", c.hud(now).place);
            std::thread::sleep(Duration::from_millis(20));
            now = Instant::now();
        }
        let at = along.of(c.flight().pose().position).unwrap();
        let [mm, length] = [at.mm, along.length_mm()].map(|mm| (mm / 10.0).round() * 10.0);
        let hud = c.hud(now);
        assert_eq!(hud.place, format!("{}, {mm} of {length} mm", at.part.unwrap()));
        // The bar has the same measure, and a click on it goes there.
        let per_mille = |mm: f64| (mm / along.length_mm() * 1000.0).round() as u32;
        assert_eq!((hud.bar.camera, hud.bar.parts.last().map(|p| p.0)), (per_mille(at.mm), Some(1000)));
        for share in [0.25, 0.8] {
            c.seek(share, now);
            now += Duration::from_secs(1);
            let bar = c.hud(now).bar;
            let read = bar.read.iter().any(|r| (r[0]..=r[1]).contains(&bar.camera));
            assert!((f64::from(bar.camera) - share * 1000.0).abs() < 12.0 && read, "{share}: {bar:?}");
        }
    }

    /// Fails if what was read in an earlier sitting, or before the measure was known, counts as not read.
    #[test]
    #[ignore = "slow: measures along a phantom"]
    fn what_was_read_before_the_measure_is_known_counts() {
        let (_, volume) = shared(&PhantomSettings::embedded(1));
        let mut scan = Scan::of(volume, &OpenOptions::default()).unwrap();
        let mut open = || scan.flight(Scene::guided_by("path"), &FlightRequest::default()).unwrap();
        let read = |flight: &FlightApp| {
            let mut place = Place::new(Instant::now());
            let background = Background::new(Arc::new(|| {}));
            let begun = Instant::now();
            while place.length_mm == 0.0 {
                assert!(begun.elapsed() < Duration::from_secs(100));
                place.update(flight, &background, Instant::now());
                std::thread::sleep(Duration::from_millis(2));
            }
            place.read.iter().map(|r| r[1] - r[0]).sum::<f64>()
        };
        let mut first = open();
        first.fly(5.0).unwrap();
        let flown = first.survey().trail().unwrap().views().to_vec();
        assert!(flown.len() > 40);
        let mm = read(&first);
        assert!(mm > flown.len() as f64, "{mm} of {}", flown.len());
        // Opened again, at its start.
        let mut again = open();
        assert!(read(&again) < 10.0);
        let view = |&(position, attitude): &_| StillView { position, attitude, fov_degrees: 90.0 };
        again.app_mut().camera().insert(flown.iter().map(view).collect::<StillViews>());
        assert!((read(&again) - mm).abs() < 10.0, "{} and {mm}", read(&again));
    }

    #[test]
    #[ignore = "slow: measures along two phantoms"]
    fn the_bar_tells_the_place_that_lists_and_files_tell() {
        bar_of("tentacles", false);
        bar_of("tentacles", true);
    }

    #[test]
    #[ignore = "slow: a phantom whose tag is taken out"]
    fn the_bar_tells_the_place_in_the_scan_as_it_was_where_its_tag_is_taken_out() {
        bar_of("path", true);
    }
}
