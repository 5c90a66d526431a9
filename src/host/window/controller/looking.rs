//! What is looked at while nothing moves: at rest, after arriving, and between two movements of the hand.

use std::time::{Duration, Instant};

use super::FlightController;
use crate::components::output::Picture;
use crate::components::still::{StillView, StillViews};
use crate::coverage::{LiveCoverage, VIEWS_AT_ONCE};

/// A view that is shown for so long was looked at.
const LOOKED: Duration = Duration::from_millis(200);
/// How long the paint of what was seen at rest stays.
const FADES: Duration = Duration::from_secs(3);
/// A camera at rest may drift by so much, mm, and as the cosine of an angle.
const DRIFT_MM: f64 = 0.1;
const DRIFT_COS: f64 = 0.999_99;

/// The view that is shown.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Looking {
    /// The view and when it was first shown, and whether it has been counted.
    view: Option<(StillView, Instant, bool)>,
    /// When the paint of what was seen at rest fades.
    fades: Option<Instant>,
}

impl Looking {
    /// Returns when there is something to do although nothing moves.
    pub(super) fn next(&self) -> Option<Instant> {
        let counts = self.view.filter(|v| !v.2).map(|v| v.1 + LOOKED);
        counts.into_iter().chain(self.fades).min()
    }
}

/// True if nobody would see a difference.
fn is_same(a: &StillView, b: &StillView) -> bool {
    a.position.distance(b.position) < DRIFT_MM
        && a.attitude.forward.dot(b.attitude.forward) > DRIFT_COS
        && a.attitude.up.dot(b.attitude.up) > DRIFT_COS
        && a.fov_degrees == b.fov_degrees
}

impl FlightController {
    /// Counts the view that is shown once it has been shown long enough.
    pub(super) fn look_at_rest(&mut self, now: Instant) {
        if self.looking.fades.is_some_and(|at| at <= now) {
            self.looking.fades = None;
            if let Some(mut coverage) = self.flight.camera_mut::<LiveCoverage>() {
                coverage.rest(FADES.as_secs_f32());
            }
            self.flight.mark_picture();
            self.attention = true;
        }
        match (self.shown_view(), self.looking.view) {
            (None, _) => self.looking.view = None,
            (Some(view), Some((before, since, is_counted))) if is_same(&view, &before) => {
                if !is_counted && now.saturating_duration_since(since) >= LOOKED {
                    self.looking.view = Some((before, since, true));
                    self.count(before);
                }
            }
            (Some(view), _) => self.looking.view = Some((view, now, false)),
        }
        self.look_again(now);
    }

    /// Returns the camera's view if the picture that is shown was made from there.
    fn shown_view(&self) -> Option<StillView> {
        let (pose, picture) = (self.flight.pose(), self.flight.camera::<Picture>()?);
        let shown = picture.view.as_ref()?;
        let view = |position, forward, up| StillView {
            position,
            attitude: crate::dynamics::Attitude { forward, up },
            fov_degrees: picture.fov_degrees,
        };
        let own = view(pose.position, pose.attitude.forward, pose.attitude.up);
        is_same(&own, &view(shown.position(), shown.forward(), shown.up())).then_some(own)
    }

    /// Counts a view, unless the trail has it or it was counted last.
    fn count(&mut self, view: StillView) {
        let usual = self.flight.setup().scene.image.fov_degrees;
        let flown = self.flight.survey().trail().and_then(|t| t.views().last());
        let flown = flown.map(|v| StillView { position: v.0, attitude: v.1, fov_degrees: usual });
        let still = self.flight.camera::<StillViews>().and_then(|s| s.views().last());
        if flown.iter().chain(still).any(|known| is_same(known, &view)) {
            return;
        }
        let mut camera = self.flight.app_mut().camera();
        if let Some(mut views) = camera.insert_if_new(StillViews::default()).get_mut::<StillViews>() {
            views.add(view);
        }
    }

    /// Looks at the wall from the views that have not been taken. Many of them, those of an earlier sitting, are for the background.
    fn look_again(&mut self, now: Instant) {
        let Some(coverage) = self.flight.camera::<LiveCoverage>() else { return };
        let still = self.flight.camera::<StillViews>().map_or(&[][..], StillViews::views);
        let more = still.get(coverage.looked()..).unwrap_or(&[]);
        if more.len() > VIEWS_AT_ONCE {
            return self.seen.look_again(&self.flight, &self.background, now);
        }
        if more.is_empty() {
            return;
        }
        let (before, seconds, more) = (coverage.share(), self.flight.clock().seconds(), more.to_vec());
        let volume = self.flight.setup().volume.clone();
        let Some(mut coverage) = self.flight.camera_mut::<LiveCoverage>() else { return };
        coverage.look_on(&volume, &more, seconds);
        if coverage.share() > before {
            self.flight.mark_picture();
            self.attention = true;
            self.looking.fades = Some(now + FADES);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::host::window::contract::WindowView;
    use crate::host::window::controller::tests::{cockpit_of, perform, phantom_flight, trace};
    use crate::phantom::PhantomSettings;
    use crate::render::ImageSize;

    const FRAME: Duration = Duration::from_millis(25);

    /// A paused flight in a window, whose coverage is watched.
    fn paused() -> (FlightController, Instant) {
        let mut flight = phantom_flight(&PhantomSettings::embedded(1));
        flight.fly(4.0).unwrap();
        let mut c = cockpit_of(flight, 0.0, Vec::new());
        let mut now = Instant::now();
        perform(&mut c, "pause", now);
        trace(&mut c, now);
        c.show_seen(true, now);
        let begun = Instant::now();
        while c.seen().list().is_none() || c.cleansing().is_under_way() {
            assert!(begun.elapsed() < Duration::from_secs(100), "{:?}", c.seen().state());
            pass(&mut c, &mut now, 1, true);
            std::thread::sleep(Duration::from_millis(2));
        }
        pass(&mut c, &mut now, 200, true);
        (c, now)
    }

    /// Lets frames pass, which are shown or not.
    fn pass(c: &mut FlightController, now: &mut Instant, frames: usize, is_shown: bool) {
        for _ in 0..frames {
            *now += FRAME;
            c.advance(*now).unwrap();
            if is_shown {
                trace(c, *now);
            }
        }
    }

    fn counted(c: &FlightController) -> (usize, usize, f64) {
        let trail = c.flight().survey().trail().unwrap().views().len();
        let still = c.flight().camera::<StillViews>().map_or(0, |s| s.views().len());
        (trail, still, c.flight().camera::<LiveCoverage>().unwrap().share())
    }

    /// Fails if thousands of views are looked at in a frame, while nothing is shown.
    #[test]
    fn what_was_looked_at_in_an_earlier_sitting_is_for_the_background() {
        let (mut c, mut now) = paused();
        let (_, _, share) = counted(&c);
        let trail = c.flight().survey().trail().unwrap().views().to_vec();
        let turned = |v: &(glam::DVec3, crate::dynamics::Attitude)| StillView {
            position: v.0,
            attitude: crate::dynamics::Attitude::new(-v.1.forward, v.1.up),
            fov_degrees: 90.0,
        };
        let earlier: StillViews = trail.iter().map(turned).collect();
        let all = earlier.views().len();
        assert!(all > VIEWS_AT_ONCE);
        c.flight_mut().app_mut().camera().insert(earlier);
        // As in a flight that is watched from its start.
        let anew = c.flight().camera::<LiveCoverage>().unwrap().afresh();
        c.flight_mut().app_mut().camera().insert(anew);
        pass(&mut c, &mut now, 1, true);
        assert_eq!(c.flight().camera::<LiveCoverage>().unwrap().looked(), 0);
        let begun = Instant::now();
        while c.flight().camera::<LiveCoverage>().unwrap().looked() == 0 {
            assert!(begun.elapsed() < Duration::from_secs(100), "{:?}", c.seen().state());
            std::thread::sleep(Duration::from_millis(2));
            pass(&mut c, &mut now, 1, true);
        }
        let live = c.flight().camera::<LiveCoverage>().unwrap();
        assert!(live.looked() >= all && live.share() > share, "{} and {share}", live.share());
        assert!(!live.lags(c.flight().survey().trail().unwrap().views()));
    }

    /// Fails if only the views of the trail count: it has none of a wider picture, nor of a turn of a few degrees.
    #[test]
    fn what_is_looked_at_at_rest_counts_once_it_was_shown_long_enough() {
        let (mut c, mut now) = paused();
        let (trail, still, share) = counted(&c);
        c.zoom(-4.0);
        pass(&mut c, &mut now, 4, true);
        assert_eq!(counted(&c), (trail, still, share), "it was shown for a moment");
        pass(&mut c, &mut now, 20, true);
        let wide = counted(&c);
        assert!(wide.0 == trail && wide.1 == still + 1 && wide.2 > share, "{wide:?} after {still} and {share}");
        // A turn of some degrees that nobody is shown does not count, and counts once it is.
        c.drag((4.0, 0.0), ImageSize::new(96, 72));
        pass(&mut c, &mut now, 40, false);
        assert_eq!(counted(&c), wide);
        pass(&mut c, &mut now, 20, true);
        let turned = counted(&c);
        assert!(turned.0 == trail && turned.1 == wide.1 + 1 && turned.2 >= wide.2, "{turned:?}");
        // Then nothing is left to do.
        pass(&mut c, &mut now, 200, true);
        assert!(c.rests() && c.looking.next().is_none() && counted(&c) == turned);
        assert!(!trace(&mut c, now), "no picture is due");
    }
}
