//! Coverage measured during a flight, compared with that measured after it.

use std::time::Instant;

use crate::app::{FlightApp, FlightRequest, Scan, Scene};
use crate::components::flight::State;
use crate::coverage::LiveCoverage;
use crate::error::Result;
use crate::progress::Progress;
use crate::report::{median, quantile};

use super::runs::{FOV, SECONDS};

/// Cost and result of live coverage.
pub(super) struct Live {
    pub guide: &'static str,
    /// Share of the wall measured live, at the end of the flight, and afterwards, at a view angle of 90°.
    pub shares: [f64; 2],
    /// Time of a step, ms, without and with it: median and 99th percentile.
    pub steps_ms: [[f64; 2]; 2],
    pub bytes: usize,
}

/// Flies twice at once, without and with live coverage, in alternation, so that load on the machine slows both alike. Fails with
/// status 4 if there is no colon to fly or if interrupted.
pub(super) fn live(scan: &mut Scan, guide: &'static str, progress: &Progress) -> Result<Live> {
    let mut flights = Vec::new();
    for coverage in [false, true] {
        flights.push(scan.flight(Scene { coverage, ..Scene::guided_by(guide) }, &FlightRequest::default())?);
    }
    let mut times = [Vec::new(), Vec::new()];
    let flies = |f: &FlightApp| f.flight().state == State::Flying && f.clock().seconds() < SECONDS;
    let mut turn = 0;
    while flights.iter().all(flies) {
        progress.check()?;
        for k in [turn, 1 - turn] {
            let begun = Instant::now();
            flights[k].step()?;
            times[k].push(1000.0 * begun.elapsed().as_secs_f64());
        }
        turn = 1 - turn;
    }
    let flight = &flights[1];
    let live = flight.camera::<LiveCoverage>();
    let after = flight.survey().coverage(FOV, false)?.map_or(0.0, |c| c.coverage.one_way);
    Ok(Live {
        guide,
        shares: [live.map_or(0.0, LiveCoverage::share), after],
        steps_ms: times.map(|t| [median(&t), quantile(&t, 0.99)]),
        bytes: live.map_or(0, LiveCoverage::bytes),
    })
}
