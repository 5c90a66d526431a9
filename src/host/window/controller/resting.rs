//! A scan without a flight: its slices are looked at, and a double click into gas asks for a flight there.

use std::time::Instant;

use glam::DVec3;

use super::FlightController;
use crate::components::input::HandCommand;
use crate::host::window::intent::{Intent, WhyNot};
use crate::space::value;

impl FlightController {
    /// Lets the camera rest, because the scan cannot be flown. `why` is shown in place of its picture.
    pub(crate) fn rest(&mut self, why: String, now: Instant) {
        self.act(HandCommand::Pause(true), now);
        self.message = None;
        self.cleansing.leave_out("there is no flight");
        self.unflown = Some(why);
    }

    /// Checks whether there is a flight. The error tells why not.
    pub(crate) fn may_fly(&self) -> Result<(), WhyNot> {
        if self.unflown.is_some() { Err("there is no flight".into()) } else { Ok(()) }
    }

    /// Tells why the camera did not go to a place of a slice (world, mm), unless it did. Without a flight, returns that one starts there.
    pub(super) fn set_out_at(&mut self, place: DVec3, now: Instant) -> Option<Intent> {
        self.attention = true;
        // As slices show them: the scan without tag is a box within the other one.
        let scans = [self.flight.shown_scan(), &self.flight.setup().volume];
        let volume = scans.into_iter().find(|v| v.voxels().grid().contains(place));
        let is_gas = volume.is_some_and(|v| f64::from(value(v, place)) < v.transfer().iso());
        let told = if self.flight.setup().scene.play().is_some() {
            "a log is replayed: the camera goes where it went".to_owned()
        } else if !is_gas {
            let there =
                if self.unflown.is_some() { "the flight starts in gas" } else { "the camera stays where it is" };
            format!("no gas there: {there}")
        } else if self.unflown.is_some() {
            return Some(Intent::StartAt(place));
        } else if self.flight.setup().lumen.segment_at(place).is_none() {
            format!("this gas is not part of the colon{}", self.actions.hint("kinds", "shows which gas is"))
        } else if self.flight.pose().position.distance(place) > ARRIVED_MM {
            "too narrow there: the camera stays where it is".to_owned()
        } else {
            return None;
        };
        self.say(told, now);
        None
    }
}

/// A camera that is nearer than this to a place has gone there, mm: it may drift away from a wall.
const ARRIVED_MM: f64 = 2.0;

#[cfg(test)]
mod tests {
    use std::rc::Rc;
    use std::sync::Arc;

    use glam::DMat3;

    use super::*;
    use crate::app::{OpenOptions, Scan, Scene};
    use crate::components::output::Picture;
    use crate::components::slices::Orientation;
    use crate::host::window::contract::WindowView;
    use crate::host::window::controller::tests::{cockpit_of, controller};
    use crate::host::window::intent::{ActionContext, SliceInput};
    use crate::render::ImageSize;
    use crate::space::PreparedVolume;
    use crate::volume::{Grid, Volume};

    /// The middle of a bubble of gas of 8 mm, too small for a colon.
    const BUBBLE: DVec3 = DVec3::new(30.0, 24.0, 20.0);

    fn without_colon() -> FlightController {
        let grid = Grid::new([48, 48, 40], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let at = |n: usize| DVec3::new((n % 48) as f64, (n / 48 % 48) as f64, (n / (48 * 48)) as f64);
        let data = (0..48 * 48 * 40).map(|n| if at(n).distance(BUBBLE) < 4.0 { -1000 } else { 40 }).collect();
        let mut scan = Scan::of(Volume::new(grid, data), &OpenOptions::default()).unwrap();
        let scene = Scene { picture: true, operator: true, ..Scene::guided_by("tentacles") };
        assert!(scan.flight(scene.clone(), &Default::default()).is_err());
        let mut c = cockpit_of(scan.at_rest(scene).unwrap(), 0.0, Vec::new());
        c.rest("No colon was found.".to_owned(), Instant::now());
        c
    }

    #[test]
    fn slices_of_a_scan_without_a_colon_are_shown_and_a_flight_is_asked_for_in_gas() {
        let (mut c, now) = (without_colon(), Instant::now());
        let slices = Orientation::ALL.map(|o| (o, [40, 30]));
        let drawn = |c: &mut FlightController, now: Instant| {
            c.advance(now).unwrap();
            let due = c.prepare(ImageSize::new(0, 0), &slices, now).unwrap();
            let any = due.is_some();
            c.show(due).unwrap();
            any
        };
        assert!(drawn(&mut c, now));
        for (orientation, _) in slices {
            let view = c.slices().view(c.flight(), orientation).unwrap();
            assert!(view.frame.pixels().iter().any(|p| p[0] > 60), "{orientation:?}");
        }
        assert_eq!(c.hud(now).state, "no flight");
        // Clicks point at places, and only a double click into gas asks for a flight.
        let tissue = DVec3::new(10.0, 10.0, 10.0);
        let left = c.slice(SliceInput::Click(BUBBLE), now);
        assert_eq!((c.slices().cursor(), left), (Some(BUBBLE), None));
        for place in [tissue, DVec3::splat(-500.0), DVec3::NAN] {
            assert_eq!(c.slice(SliceInput::SetOut(place), now), None);
            assert_eq!(c.hud(now).message.as_deref(), Some("no gas there: the flight starts in gas"));
        }
        assert_eq!(c.slice(SliceInput::SetOut(BUBBLE), now), Some(Intent::StartAt(BUBBLE)));
        // At rest, nothing is computed.
        let mut late = now;
        for _ in 0..200 {
            late += std::time::Duration::from_millis(25);
            drawn(&mut c, late);
        }
        assert!(c.rests(), "it sleeps");
    }

    #[test]
    fn every_action_is_harmless_without_a_flight() {
        let (mut c, mut now) = (without_colon(), Instant::now());
        let actions = Rc::clone(&c.actions);
        let before = c.flight().pose().position;
        for action in actions.list() {
            let action = actions.named(&action[0]).unwrap();
            c.execute(action.intent.clone(), ActionContext { window: ImageSize::new(0, 0), now });
            now += std::time::Duration::from_millis(25);
            c.advance(now).unwrap();
            c.hud(now);
        }
        assert!(c.flight().pose().position.distance(before) < 1e-9);
    }

    #[test]
    fn what_only_a_flight_follows_is_refused_without_one() {
        let (mut c, now) = (without_colon(), Instant::now());
        let actions = Rc::clone(&c.actions);
        let ids =
            "pause reverse whole next faster slower narrower wider usual-angle wide-view detail light guide picture";
        for id in ids.split(' ') {
            let action = actions.named(id).unwrap();
            let at = ActionContext { window: ImageSize::new(0, 0), now };
            assert!(c.execute(action.intent.clone(), at).is_none(), "{id}");
            assert!(c.hud(now).message.unwrap().ends_with(" is unavailable: there is no flight"), "{id}");
        }
        assert!(!c.is_on(&Intent::Pause), "nothing is paused");
        for id in ["open", "help", "screenshot", "quit", "window-soft"] {
            let why_not = c.why_not(&actions.named(id).unwrap().intent);
            assert!(why_not.is_none_or(|w| !w.contains("no flight")), "{id}");
        }
    }

    #[test]
    fn a_double_click_that_leads_nowhere_is_told() {
        let (mut c, now) = (controller("tentacles"), Instant::now());
        let told = |c: &mut FlightController, place: [f64; 3]| {
            c.message = None;
            c.slice(SliceInput::SetOut(DVec3::from_array(place)), now);
            c.hud(now).message
        };
        let tissue = told(&mut c, [2.0, 40.0, 16.0]);
        assert_eq!(tissue.as_deref(), Some("no gas there: the camera stays where it is"));
        assert_eq!(told(&mut c, [17.0, 40.0, 15.0]), None, "it went there");
        assert!(told(&mut c, [6.2, 60.0, 15.0]).is_some_and(|t| t.starts_with("too narrow there")));
        // The scan without tag is a box within the other one, which the slices show around it.
        let grid = Grid::new([4, 4, 4], DVec3::ONE, DVec3::new(8.0, 8.0, 8.0), DMat3::IDENTITY).unwrap();
        let transfer = c.flight().setup().volume.transfer();
        let inner = PreparedVolume::new(Arc::new(Volume::new(grid, vec![-1000; 64])), transfer);
        let inner = c.flight.app_mut().world.spawn(crate::components::scan::Scan(inner)).id();
        c.flight.camera_mut::<Picture>().unwrap().scan = Some(inner);
        assert_eq!(told(&mut c, [17.0, 42.0, 15.0]), None, "it went there");
        assert_eq!(told(&mut c, [2.0, 40.0, 16.0]), tissue);
        // In the flight's picture, a ray that meets no wall.
        c.message = None;
        c.execute(Intent::LookAt([f64::NAN, 0.0]), ActionContext { window: ImageSize::new(8, 8), now });
        assert_eq!(c.hud(now).message.as_deref(), Some("no wall there to fly to"));
    }
}
