//! The colon laid flat, in a window: unfolded in the background once somebody asks for it, first coarsely and then finely, outwards from
//! where the reader looks, and drawn into the rectangle of its panel.

mod map;

use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;

use super::background::{Background, BackgroundTask, LOOKS};
use super::clean::Scanned;
use super::cleansing::Cleansing;
use crate::app::FlightApp;
use crate::coverage::{CoveragePaint, INK, LiveCoverage, OVER};
use crate::error::Error;
use crate::fields::Lumen;
use crate::render::{Frame, ImageSize};
use map::{FlatMap, Focus, Piece};

/// Pixels of the panel between two places whose paint is looked up.
const PAINTED: usize = 4;
/// Seconds of a flight after which the paint is looked up again.
const PAINT_S: f64 = 0.5;
/// A flight that moves on by this after the reader has scrolled is followed again, mm.
const MOVES_MM: f64 = 10.0;
/// Share of the panel's height that a place that is followed keeps from its edges.
const EDGE: f64 = 0.2;

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
    task: BackgroundTask<()>,
    /// What the task has made so far.
    pieces: Option<Receiver<Piece>>,
    /// What the task is to make next.
    focus: Arc<Focus>,
    /// When the panel is to be laid out again without the words about the task, which is over.
    last_look: Option<Instant>,
    /// The lumen that was unfolded, or is.
    lumen: Option<Arc<Lumen>>,
    map: Option<FlatMap>,
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
            pieces: None,
            focus: Arc::new(Focus::new()),
            last_look: None,
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
        let (scan, place) = (Scanned::of(flight, cleansing), flight.pose().position);
        let ((send, pieces), focus, wake) = (channel(), Arc::new(Focus::new()), background.wake());
        (self.pieces, self.focus) = (Some(pieces), Arc::clone(&focus));
        let job = background.start_apart("unfold", move |progress| {
            map::make(scan, (&focus, place), progress, &|piece| {
                // Without a receiver, nobody wants the map any more.
                send.send(piece).map_err(|_| Error::cancelled("unfolding"))?;
                wake();
                Ok(())
            })
        });
        self.task.go_over(job, now);
    }

    /// Takes what was unfolded. Returns true if there is something new to show.
    pub(crate) fn take(&mut self, now: Instant) -> bool {
        // In this order, nothing that the task has made is left behind.
        let is_done = self.task.take(now).is_some();
        let mut is_new = is_done;
        while let Some(piece) = self.pieces.as_ref().and_then(|pieces| pieces.try_recv().ok()) {
            is_new |= self.put(piece);
        }
        self.last_look = self.last_look.filter(|look| *look > now);
        if is_done {
            (self.pieces, self.last_look) = (None, Some(now + LOOKS));
        }
        is_new
    }

    /// Takes a piece. Returns true if it is in sight.
    fn put(&mut self, piece: Piece) -> bool {
        let rows = match (piece, &mut self.map) {
            (Piece::Map(made), map) => {
                let rows = 0..made.map.rows();
                *map = Some(made);
                rows
            }
            (Piece::Band(band), Some(made)) => {
                made.put(&band);
                band.rows()
            }
            (Piece::Band(_), None) => 0..0,
        };
        let shown = self.frame.height() as f64 * self.pixel(self.frame.width());
        // The last pixels blend with the row beside what is shown.
        let is_in_sight = rows.start as f64 <= self.top + shown + 1.0 && rows.end as f64 + 1.0 >= self.top;
        if is_in_sight {
            self.drawn = None;
        }
        is_in_sight
    }

    /// Returns when its progress has to be looked at.
    pub(crate) fn next(&self) -> Option<Instant> {
        self.task.next().or(self.last_look)
    }

    /// Returns what is shown.
    pub(crate) fn map(&self) -> Option<&FlatMap> {
        self.map.as_ref()
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
        let along_mm = along_mm.filter(|_| self.scrolled_at.is_none());
        if let Some(mm) = along_mm {
            self.focus.set(mm);
        }
        let Some(made) = &self.map else { return };
        let count = made.map.rows() as f64;
        let shown = size.height as f64 * self.pixel(size.width);
        if let Some(mm) = along_mm {
            let row = made.map.row(mm);
            self.top = self.top.clamp(row - (1.0 - EDGE) * shown, row - EDGE * shown);
        }
        self.top = self.top.clamp(0.0, (count - shown).max(0.0));
        if self.scrolled_at.is_some() {
            self.focus.set(made.map.mm_at((self.top + 0.5 * shown).min(count - 1.0)));
        }
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
        let (each, top) = (self.pixel(size.width), self.top);
        let Some(made) = &self.map else {
            self.frame.buffers().0.fill([0; 3]);
            return true;
        };
        let map = &made.map;
        let rgb = made.scanned.as_ref().filter(|_| is_scanned).unwrap_or(&made.rgb);
        let high = map.rows();
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
                let mut colour = map.colour(rgb, row - 0.5, column - 0.5);
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

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::time::Duration;

    use super::*;
    use crate::host::window::cleansing::Tag;
    use crate::host::window::contract::WindowView;
    use crate::host::window::controller::FlightController;
    use crate::host::window::controller::tests::{cockpit_of, perform, phantom_flight, trace, wish};
    use crate::host::window::intent::Intent;
    use crate::phantom::PhantomSettings;
    use crate::progress::Progress;
    use crate::unfold::{Sheet, Unfolding, picture};

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

    /// While the fine map comes in bands, outwards from the camera, a click goes to about the same place; at the end the map is the one that
    /// is drawn at once.
    #[test]
    fn bands_come_outwards_from_the_camera_and_a_click_means_the_same_meanwhile() {
        let mut flight = phantom_flight(&PhantomSettings::embedded(1));
        flight.fly(8.0).unwrap();
        let setup = flight.setup();
        let (volume, lumen, told) = (setup.volume.clone(), Arc::clone(&setup.lumen), setup.told.clone());
        let scan = Scanned { volume: volume.clone(), lumen: Arc::clone(&lumen), told, tag: Tag::Absent };
        let (pieces, progress) = (Mutex::new(Vec::new()), Progress::new());
        let here = flight.pose().position;
        // With one thread, bands come in the order in which they are begun.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let ready = |piece| {
            pieces.lock().unwrap().push(piece);
            Ok(())
        };
        pool.install(|| map::make(scan, (&Focus::new(), here), &progress, &ready)).unwrap();
        let mm = lumen.along(volume.voxels(), &progress).unwrap().of(here).unwrap().mm;
        let mut flat = Flat::new(Instant::now());
        let grid: Vec<[f64; 2]> =
            (0..SIZE.pixels()).step_by(97).map(|n| [n % SIZE.width, n / SIZE.width].map(|x| x as f64)).collect();
        let clicked = |flat: &Flat| grid.iter().map(|at| flat.place(*at, SIZE.width)).collect::<Vec<_>>();
        let (mut before, mut away, mut first_in_sight) = (Vec::new(), Vec::new(), 0);
        for piece in pieces.into_inner().unwrap() {
            let is_first = matches!(piece, Piece::Map(_));
            if let Piece::Band(band) = &piece {
                let row = flat.map.as_ref().unwrap().map.row(mm);
                let rows = band.rows();
                away.push((rows.start as f64 - row).max(row - (rows.end - 1) as f64).max(0.0));
            }
            let is_in_sight = flat.put(piece);
            first_in_sight += usize::from(is_in_sight && first_in_sight + 1 == away.len());
            // A part in sight is drawn anew, another is not.
            assert_eq!(flat.draw(&flight, false, (here, Some(mm)), SIZE), is_in_sight);
            if is_first {
                before = clicked(&flat);
            }
        }
        assert!(away.len() > 10 && away[0] == 0.0 && away.is_sorted(), "{away:?}");
        assert!(first_in_sight > 4, "what is in sight comes first");
        let after = clicked(&flat);
        let far: Vec<f64> =
            before.iter().zip(&after).filter_map(|(a, b)| Some(a.as_ref()?[0].distance(b.as_ref()?[0]))).collect();
        let near = far.iter().filter(|mm| **mm < 2.5).count();
        assert!(far.len() * 10 > grid.len() * 8 && near * 100 > far.len() * 95, "{near} of {} near", far.len());
        let made = flat.map.as_ref().unwrap();
        let iso = volume.transfer().iso();
        let whole =
            Unfolding::new(made.map.chart().clone(), volume.voxels(), iso, &Sheet::default(), &progress).unwrap();
        assert!(made.rgb == picture(&whole, iso) && made.scanned.is_none());
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
