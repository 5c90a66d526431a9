//! The colon laid flat, in a window: unfolded in the background once somebody asks for it, first coarsely and then finely, and drawn into
//! the rectangle of its panel.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;

use super::background::{Background, BackgroundTask};
use super::clean::{Clean, Scanned};
use super::cleansing::Cleansing;
use super::job::Job;
use crate::app::FlightApp;
use crate::coverage::{CoveragePaint, INK, LiveCoverage, OVER};
use crate::error::{Error, Result};
use crate::fields::Lumen;
use crate::progress::Progress;
use crate::render::{Frame, ImageSize};
use crate::unfold::{Chart, Sheet, Unfolding, picture};

/// The sheet that is shown first, which takes a sixteenth of the time.
const COARSE: Sheet = Sheet { columns: None, step_mm: 1.6, from_mm: None, to_mm: None };
/// The colour of a wall that was under tag, red, green and blue, and its share.
const TAG: [f32; 3] = [255.0, 255.0, 235.0];
const TAG_SHARE: f32 = 0.6;
/// Tag was in front of the wall if it was within this of it, mm.
const BEFORE_MM: f64 = 1.0;
/// Pixels of the panel between two places whose paint is looked up.
const PAINTED: usize = 4;
/// Seconds of a flight after which the paint is looked up again.
const PAINT_S: f64 = 0.5;
/// A flight that moves on by this after the reader has scrolled is followed again, mm.
const MOVES_MM: f64 = 10.0;
/// Share of the panel's height that a place that is followed keeps from its edges.
const EDGE: f64 = 0.2;

/// A map with its picture.
pub(crate) struct FlatMap {
    pub(crate) map: Unfolding,
    rgb: Vec<[u8; 3]>,
    /// The same as scanned: with the colour of tag where tag was. `None` if there was none.
    scanned: Option<Vec<[u8; 3]>>,
    /// What a finer map is drawn from; `None` if it is fine.
    source: Option<Arc<Source>>,
}

/// The scan that a map is drawn from.
struct Source {
    clean: Clean,
    /// Of the wall, HU.
    iso: f64,
}

/// What is asked of the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum FlatInput {
    /// Show it; unfold the colon first if that was not done.
    Show,
    /// Scroll by a share of the panel's height, downwards.
    Scroll(f64),
    /// Look at the wall shown at a pixel of the panel, in all views.
    Visit([f64; 2]),
}

/// What a drawn picture depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Drawn {
    top: f64,
    size: ImageSize,
    is_scanned: bool,
    /// The time of the paint, in steps of [`PAINT_S`].
    painted: Option<i64>,
}

/// The colon laid flat.
pub(crate) struct Flat {
    task: BackgroundTask<FlatMap>,
    /// The lumen that was unfolded, or is.
    lumen: Option<Arc<Lumen>>,
    map: Option<Arc<FlatMap>>,
    /// The first row that is shown, in rows of the map, and the position that is followed, world mm, while it has not moved.
    top: f64,
    scrolled_at: Option<DVec3>,
    frame: Frame,
    drawn: Option<Drawn>,
}

impl Flat {
    pub(crate) fn new(now: Instant) -> Self {
        Self {
            task: BackgroundTask::new(now),
            lumen: None,
            map: None,
            top: 0.0,
            scrolled_at: None,
            frame: Frame::new(0, 0),
            drawn: None,
        }
    }

    /// Begins to unfold the colon, unless that was begun. Waits until it is known whether the scan has tag.
    pub(crate) fn want(&mut self, flight: &FlightApp, cleansing: &Cleansing, background: &Background, now: Instant) {
        let lumen = &flight.setup().lumen;
        if cleansing.is_under_way() || self.lumen.as_ref().is_some_and(|l| Arc::ptr_eq(l, lumen)) {
            return;
        }
        (self.lumen, self.map, self.drawn) = (Some(Arc::clone(lumen)), None, None);
        self.task.go_over(begin(Scanned::of(flight, cleansing), background), now);
    }

    /// Takes what was unfolded. Returns true if there is something new to show.
    pub(crate) fn take(&mut self, background: &Background, now: Instant) -> bool {
        let Some(done) = self.task.take(now) else { return false };
        if let Ok((made, _)) = done {
            let made = Arc::new(made);
            if let Some(before) = &self.map {
                // The same place stays on top.
                self.top = made.map.row(before.map.mm(self.top as usize));
            }
            if let Some(source) = made.source.clone() {
                self.task.go_over(refine(Arc::clone(&made), source, background), now);
            }
            (self.map, self.drawn) = (Some(made), None);
        }
        true
    }

    /// Returns when its progress has to be looked at.
    pub(crate) fn next(&self) -> Option<Instant> {
        self.task.next()
    }

    /// Returns what is shown.
    pub(crate) fn map(&self) -> Option<&FlatMap> {
        self.map.as_deref()
    }

    /// Returns what is done or why it failed, in words; `None` if nothing is to be said.
    pub(crate) fn told(&self) -> Option<String> {
        match (self.task.progress(), self.task.failed()) {
            (Some(progress), _) => {
                let stage = progress.snapshot().0;
                let stage = if stage.is_empty() { "unfolding".to_owned() } else { stage };
                Some(if self.map.is_some() { "refining ...".to_owned() } else { format!("{stage} ...") })
            }
            (None, Some(why)) => Some(why.to_owned()),
            (None, None) if self.lumen.is_none() => Some("waiting for cleansing ...".to_owned()),
            (None, None) => None,
        }
    }

    /// Returns how many rows, and columns, of the map a pixel of a panel shows that is so many pixels wide: the map's are square.
    fn pixel(&self, width: usize) -> f64 {
        self.map.as_ref().map_or(1.0, |made| made.map.columns() as f64 / width.max(1) as f64)
    }

    /// Scrolls by a share of the height of a panel. It does not follow the flight until that moves on; `at` is where it is, world mm.
    pub(crate) fn scroll(&mut self, share: f64, size: ImageSize, at: DVec3) {
        self.top += share * size.height as f64 * self.pixel(size.width);
        self.scrolled_at = Some(at);
    }

    /// Returns the place of the wall that is shown at a pixel of a panel, and the middle of the lumen there, world mm.
    pub(crate) fn place(&self, [x, y]: [f64; 2], width: usize) -> Option<[DVec3; 2]> {
        let made = self.map.as_ref()?;
        let each = self.pixel(width);
        let (row, column) = ((self.top + y * each).floor(), (x * each).floor());
        if row < 0.0 || column < 0.0 {
            return None;
        }
        let point = made.map.point(row as usize, column as usize)?;
        Some([point, made.map.middle(row as usize)?])
    }

    /// Returns where a place (world, mm) is in a panel, pixels; `None` if it is not on the map.
    pub(crate) fn pixel_of(&self, place: DVec3, width: usize) -> Option<[f64; 2]> {
        let at = self.map.as_ref()?.map.place(place)?;
        let each = self.pixel(width);
        Some([(at.column + 0.5) / each, (at.row + 0.5 - self.top) / each])
    }

    /// Keeps what is followed in sight: the row whose middle is nearest to `at`, world mm.
    fn follow(&mut self, at: DVec3, along_mm: Option<f64>, size: ImageSize) {
        if self.scrolled_at.is_some_and(|s| s.distance(at) > MOVES_MM) {
            self.scrolled_at = None;
        }
        let Some(made) = &self.map else { return };
        let count = made.map.rows() as f64;
        let shown = size.height as f64 * self.pixel(size.width);
        if let Some(mm) = along_mm.filter(|_| self.scrolled_at.is_none()) {
            let row = made.map.row(mm);
            self.top = self.top.clamp(row - (1.0 - EDGE) * shown, row - EDGE * shown);
        }
        self.top = self.top.clamp(0.0, (count - shown).max(0.0));
    }

    /// Draws the part that is shown. `at` is followed, `along_mm` from the rectum; the wall is as scanned where that is shown. Returns true if
    /// the picture is new.
    pub(crate) fn draw(
        &mut self,
        flight: &FlightApp,
        is_scanned: bool,
        (at, along_mm): (DVec3, Option<f64>),
        size: ImageSize,
    ) -> bool {
        self.follow(at, along_mm, size);
        let coverage = flight.camera::<LiveCoverage>().zip(flight.camera::<CoveragePaint>());
        let seconds = flight.clock().seconds();
        let painted = coverage.map(|_| (seconds / PAINT_S) as i64);
        let now = Drawn { top: self.top, size, is_scanned, painted };
        if self.drawn == Some(now) || size.pixels() == 0 {
            return false;
        }
        self.drawn = Some(now);
        self.frame.resize(size.width, size.height);
        let Some(made) = self.map.clone() else {
            self.frame.buffers().0.fill([0; 3]);
            return true;
        };
        let (each, top, map) = (self.pixel(size.width), self.top, &made.map);
        let rgb = made.scanned.as_ref().filter(|_| is_scanned).unwrap_or(&made.rgb);
        let (wide, high) = (map.columns(), map.rows());
        let pixel = |row: f64, column: f64| {
            let (r, c) = (row - 0.5, column - 0.5);
            let (r0, c0) = (r.floor(), c.floor());
            let at = |r: f64, c: f64| {
                let r = (r.max(0.0) as usize).min(high - 1);
                rgb[r * wide + (c as i64).rem_euclid(wide as i64) as usize].map(f32::from)
            };
            let (u, v) = ((c - c0) as f32, (r - r0) as f32);
            let mix = |a: [f32; 3], b: [f32; 3], t: f32| std::array::from_fn(|n| a[n] + (b[n] - a[n]) * t);
            mix(mix(at(r0, c0), at(r0, c0 + 1.0), u), mix(at(r0 + 1.0, c0), at(r0 + 1.0, c0 + 1.0), u), v)
        };
        self.frame.buffers().0.par_chunks_mut(size.width).enumerate().for_each(|(y, out)| {
            let row = top + (y as f64 + 0.5) * each;
            let is_on = row < high as f64;
            let mut paint = 0.0;
            for (x, out) in out.iter_mut().enumerate() {
                if !is_on {
                    *out = [0; 3];
                    continue;
                }
                let column = (x as f64 + 0.5) * each;
                let mut colour: [f32; 3] = pixel(row, column);
                if let Some((coverage, painter)) = coverage {
                    if x % PAINTED == 0 {
                        let (r, c) = (row as usize, column as usize);
                        paint = map.point(r, c).zip(map.normal(r, c)).map_or(0.0, |(point, normal)| {
                            OVER * painter.share_at(coverage, point, normal.as_vec3(), seconds)
                        });
                    }
                    let light = colour.iter().copied().fold(0.0, f32::max) / 255.0;
                    colour = std::array::from_fn(|n| colour[n] * (1.0 - paint) + INK[n] * light * paint);
                }
                *out = colour.map(|c| (c + 0.5) as u8);
            }
        });
        true
    }

    /// Returns the drawn part.
    pub(crate) fn frame(&self) -> &Frame {
        &self.frame
    }
}

/// Begins to unfold a colon coarsely.
///
/// # Errors
/// Returns status 1 if the system cannot start threads.
fn begin(scan: Scanned, background: &Background) -> Result<Job<FlatMap>> {
    background.start_apart("unfold", move |progress| {
        let iso = scan.volume.transfer().iso();
        let clean = scan.clean(progress)?;
        let along = clean.lumen.along(&clean.volume, progress)?;
        let none = || {
            let why = "no one line leads from the rectum to the cecum";
            Error::incomplete("the colon", why, "read it in flight and slices")
        };
        let line = along.line().ok_or_else(none)?;
        let chart = Chart::new(&clean.volume, &clean.lumen, line, iso, progress)?;
        let source = Arc::new(Source { clean, iso });
        made(chart, &source, &COARSE, progress)
    })
}

/// Begins to draw the same chart finely.
///
/// # Errors
/// Returns status 1 if the system cannot start threads.
fn refine(coarse: Arc<FlatMap>, source: Arc<Source>, background: &Background) -> Result<Job<FlatMap>> {
    background.start_apart("unfold", move |progress| {
        let fine = made(coarse.map.chart().clone(), &source, &Sheet::default(), progress)?;
        Ok(FlatMap { source: None, ..fine })
    })
}

/// Draws a chart.
fn made(chart: Chart, source: &Arc<Source>, sheet: &Sheet, progress: &Progress) -> Result<FlatMap> {
    let Source { clean, iso } = &**source;
    let map = Unfolding::new(chart, &clean.volume, *iso, sheet, progress)?;
    let rgb = picture(&map, *iso);
    let columns = map.columns();
    let was_tag: Vec<bool> = (0..rgb.len())
        .into_par_iter()
        .map(|n| {
            let (row, column) = (n / columns, n % columns);
            let at = map.point(row, column).zip(map.normal(row, column));
            at.is_some_and(|(point, inwards)| clean.before.is_restored(&clean.volume, point - inwards * BEFORE_MM))
        })
        .collect();
    let scanned = was_tag.contains(&true).then(|| {
        let colour = |(colour, was_tag): (&[u8; 3], &bool)| {
            let share = if *was_tag { TAG_SHARE } else { 0.0 };
            std::array::from_fn(|n| (f32::from(colour[n]) * (1.0 - share) + TAG[n] * share) as u8)
        };
        rgb.iter().zip(&was_tag).map(colour).collect()
    });
    // The first place that is asked for sorts the wall.
    map.place(DVec3::ZERO);
    Ok(FlatMap { map, rgb, scanned, source: Some(Arc::clone(source)) })
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::host::window::contract::WindowView;
    use crate::host::window::controller::FlightController;
    use crate::host::window::controller::tests::{cockpit_of, perform, phantom_flight, trace, wish};
    use crate::host::window::intent::Intent;
    use crate::phantom::PhantomSettings;

    const SIZE: ImageSize = ImageSize { width: 200, height: 300 };

    fn ask(c: &mut FlightController, input: FlatInput, now: Instant) {
        wish(c, Intent::Flat(input), now);
    }

    /// A paused flight whose colon is laid flat.
    fn flat() -> (FlightController, Instant) {
        let mut flight = phantom_flight(&PhantomSettings { fluid: true, ..PhantomSettings::embedded(1) });
        flight.fly(3.0).unwrap();
        let (mut c, mut now) = (cockpit_of(flight, 0.0, Vec::new()), Instant::now());
        perform(&mut c, "pause", now);
        trace(&mut c, now);
        let begun = Instant::now();
        while c.flat().map().is_none() || c.flat().told().is_some() {
            assert!(begun.elapsed() < Duration::from_secs(100), "{:?}", c.flat().told());
            now += Duration::from_millis(25);
            ask(&mut c, FlatInput::Show, now);
            c.advance(now).unwrap();
            std::thread::sleep(Duration::from_millis(2));
        }
        (c, now)
    }

    #[test]
    fn the_camera_is_in_sight_and_a_click_looks_at_what_is_shown_there() {
        let (mut c, now) = flat();
        assert!(c.flat().map().unwrap().source.is_none(), "the fine map");
        // Its measure along the colon is known with the state for display.
        let begun = Instant::now();
        while c.flat().frame().width() == 0 || !c.hud(now).place.contains(" of ") || c.hud(now).place.contains("about")
        {
            assert!(begun.elapsed() < Duration::from_secs(20), "{}", c.hud(now).place);
            c.advance(now).unwrap();
            c.draw_flat(SIZE);
            std::thread::sleep(Duration::from_millis(300));
        }
        c.draw_flat(SIZE);
        assert!(!c.draw_flat(SIZE), "nothing has changed");
        // Whatever is shown is where its place is.
        let mut shown = 0;
        for x in (4..SIZE.width).step_by(24) {
            for y in (4..SIZE.height).step_by(24) {
                let pixel = [x as f64, y as f64];
                let Some([place, middle]) = c.flat().place(pixel, SIZE.width) else { continue };
                let at = c.flat().pixel_of(place, SIZE.width).unwrap();
                let across = (at[0] - pixel[0]).rem_euclid(SIZE.width as f64);
                let across = across.min(SIZE.width as f64 - across);
                assert!(across < 2.5 && (at[1] - pixel[1]).abs() < 2.5, "{at:?} for {pixel:?}");
                assert!(place.distance(middle) < 60.0);
                shown += 1;
            }
        }
        assert!(shown > 40, "{shown}");
        // The wall beside the camera is in sight.
        let pose = c.flight().pose();
        let beside =
            crate::space::first_crossing(c.flight().shown_scan(), pose.position, pose.attitude.up, 80.0).unwrap();
        let at = c.flat().pixel_of(pose.position + pose.attitude.up * beside, SIZE.width).unwrap();
        assert!((0.0..SIZE.height as f64).contains(&at[1]), "{at:?}");

        // Scrolled away, it stays there; a click brings the camera there, which sees the place.
        ask(&mut c, FlatInput::Scroll(0.5), now);
        assert!(c.draw_flat(SIZE), "scrolled");
        let pixel = [100.0, 150.0];
        let [place, _] = c.flat().place(pixel, SIZE.width).unwrap();
        ask(&mut c, FlatInput::Visit(pixel), now);
        let pose = c.flight().pose();
        let towards = (place - pose.position).normalize();
        assert!(towards.dot(pose.attitude.forward) > 0.9, "{pose:?} {place}");
        assert_eq!(c.slices().cursor(), Some(place));
    }

    #[test]
    fn tag_is_on_the_map_as_scanned_and_nothing_is_made_before_somebody_asks() {
        let (mut c, _) = flat();
        let map = c.flat().map().unwrap();
        let scanned = map.scanned.as_ref().expect("a phantom with fluid");
        let differ = scanned.iter().zip(&map.rgb).filter(|(a, b)| a != b).count();
        let share = differ as f64 / scanned.len() as f64;
        assert!((0.005..0.6).contains(&share), "{share}");
        let fresh = cockpit_of(phantom_flight(&PhantomSettings::embedded(1)), 0.0, Vec::new());
        assert!(fresh.flat().map().is_none() && fresh.flat().next().is_none());
        // A panel without pixels is drawn without a fault.
        assert!(!c.draw_flat(ImageSize::default()));
        assert!(c.flat().place([5.0, -3.0], 0).is_none());
    }
}
