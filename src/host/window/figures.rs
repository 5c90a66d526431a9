//! Speed and guide, and for developers frame time, clearance and detail, averaged over a moment and updated at a readable rate.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::style::angle;
use super::view_renderer::{ViewRenderer, quality_of, refined};
use crate::app::FlightApp;
use crate::components::camera::{Contact, Velocity};
use crate::components::input::Hand;
use crate::components::output::Picture;
use crate::fields::lumen::{Lumen, Names};
use crate::render::ImageSize;
use crate::schedule::PluginTime;

/// Minimum time between two updates of the figures.
const READ_EVERY: Duration = Duration::from_millis(250);

/// The displayed figures of a flight.
#[derive(Clone, Debug)]
pub(crate) struct Figures {
    since: Instant,
    /// Number of images counted already.
    counted: usize,
    /// True if those that only a developer needs are shown, too.
    are_all: bool,
    /// The figures that only a developer needs: time of a picture, clearance and detail.
    own: [String; 3],
    lines: Vec<String>,
    /// Position along the path, per mille.
    per_mille: u32,
    /// Names of the colon's parts, of the lumen that is flown, and that of the part around the camera.
    names: Option<(Arc<Lumen>, Names)>,
    part: Option<&'static str>,
    stale: bool,
}

impl Figures {
    /// Creates figures without values.
    pub(crate) fn new(now: Instant) -> Self {
        Self {
            since: now,
            counted: 0,
            are_all: false,
            own: Default::default(),
            lines: Vec::new(),
            per_mille: 0,
            names: None,
            part: None,
            stale: true,
        }
    }

    /// Shows or hides the figures that only a developer needs. Returns true if they are shown.
    pub(crate) fn switch_all(&mut self) -> bool {
        (self.are_all, self.stale) = (!self.are_all, true);
        self.lines.clear();
        self.are_all
    }

    /// True if the figures that only a developer needs are shown.
    pub(crate) fn are_all(&self) -> bool {
        self.are_all
    }

    /// Marks the figures as changed.
    pub(crate) fn touch(&mut self) {
        self.stale = true;
    }

    /// Returns when they should be read again; `None` if nothing has changed.
    pub(crate) fn next(&self) -> Option<Instant> {
        self.stale.then_some(self.since + READ_EVERY)
    }

    /// Returns the position along the path when the figures were read, per mille. It changes as rarely as they do, since each
    /// change is painted.
    pub(crate) fn per_mille(&self) -> u32 {
        self.per_mille
    }

    /// Returns the name of the colon's part around the camera, if it is known.
    pub(crate) fn part(&self) -> Option<&'static str> {
        self.part
    }

    /// Names the part around the camera.
    fn name(&mut self, flight: &FlightApp) {
        let lumen = &flight.setup().lumen;
        if self.names.as_ref().is_none_or(|n| !Arc::ptr_eq(&n.0, lumen)) {
            self.names = Some((Arc::clone(lumen), lumen.names()));
        }
        // Gas that is no segment has no part of the colon around it.
        let position = flight.pose().position;
        let names = self.names.as_ref().filter(|n| n.0.segment_at(position).is_some());
        self.part = names.and_then(|n| n.1.at(position)).map(|p| p.name);
    }

    /// Returns the figures, one per line. Updates them if it is time.
    pub(crate) fn read(&mut self, flight: &FlightApp, view_renderer: &ViewRenderer, now: Instant) -> &[String] {
        self.stale |= view_renderer.frames().len() > self.counted;
        let elapsed = now.saturating_duration_since(self.since);
        if !self.stale || (elapsed < READ_EVERY && !self.lines.is_empty()) {
            return &self.lines;
        }
        let new = view_renderer.frames().get(self.counted..).unwrap_or_default();
        if !new.is_empty() {
            let count = new.len() as f64;
            let ms = new.iter().map(|f| f.ms).sum::<f64>() / count;
            let fps = count / elapsed.as_secs_f64().max(1e-3);
            let detail = view_renderer.detail(flight);
            let ImageSize { width, height } = detail.map_or(ImageSize::default(), |d| d.size);
            // A rate is meaningless for a still picture.
            let rate = detail.and_then(refined).unwrap_or_else(|| format!("{fps:.0} fps"));
            self.own[0] = format!("{ms:.0} ms, {rate} ({width}x{height})");
        }
        self.name(flight);
        self.per_mille = (flight.survey().progress().0 * 1000.0).round() as u32;
        (self.counted, self.since, self.stale) = (view_renderer.frames().len(), now, false);
        let hand: Hand = flight.camera().copied().unwrap_or_default();
        let speed = flight.camera::<Velocity>().map_or(0.0, |v| v.0.length());
        let cruise = flight.setup().scene.cruise_mm_s() * hand.speed;
        let clearance = flight.camera::<Contact>().map_or(0.0, |c| c.clearance_mm);
        // Beyond the finder's reach a clearance is a lower bound.
        let bound = if clearance > 10.0 { "over 10".to_owned() } else { format!("{clearance:.1}") };
        self.own[1] = format!("clearance {bound} mm");
        self.own[2] = format!("detail {}", quality_of(flight).unwrap_or_default().name());
        let usual = flight.setup().scene.image.fov_degrees;
        let other = flight.camera::<Picture>().map(|p| p.fov_degrees).filter(|&d| d != usual);
        let view = other.map_or_else(String::new, |d| format!(", view {}", angle(d)));
        self.lines.clear();
        self.lines.push(format!("{speed:.0} mm/s (cruise {cruise:.0})"));
        self.lines.push(format!("guide {}{view}", flight.setup().scene.guide_name()));
        if self.are_all {
            self.lines.extend(self.own.iter().filter(|l| !l.is_empty()).cloned());
        }
        let slow = flight.app().inspect().plugin_times().into_iter().filter(PluginTime::is_slow);
        self.lines.extend(slow.map(|p| p.text()));
        &self.lines
    }
}
