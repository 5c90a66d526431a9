//! The page of the report.

use std::path::Path;

use super::Measured;
use super::runs::{FISHEYE_FOV, PATH, Run};
use crate::components::flight::State;
use crate::error::Result;
use crate::render::camera::{CameraModel, fisheye};
use crate::report::dots::Dots;
use crate::report::page::Page;
use crate::report::table::{Table, table};

/// Shares seen in a study of 223 patients at 90°: one way, both ways, and after a second look at missed patches of at least 300 mm²
/// (Pickhardt, Taylor and Gopal, Gastroenterology, 2006).
const STUDY: [(f64, &str); 3] = [(0.77, "study, one way"), (0.94, "both ways"), (0.98, "after review")];
/// The shares plotted for each flight.
const SERIES: [&str; 6] = [
    "one way",
    "same places, both ways",
    "flown there and back",
    "one way, reviewed",
    "there and back, reviewed",
    "visible maximum",
];

/// Writes the report. Returns the findings, one sentence each.
pub(super) fn write(all: &[Measured], folder: &Path) -> Result<Vec<String>> {
    let mut page = Page::new(folder, "colvis: the share of the wall that flights see")?;
    page.text(
        "Coverage is the share of the wall's area that is seen. The wall is the surface of the gas that is flown: planned and \
         potential flights fly the scan cleansed, tentacles fly it as scanned. A triangle is seen if it is within \
         100 mm, in the picture, less than 85° from facing the camera, and not hidden. Flights start at the rectum.",
    );
    page.text(
        "The study (Pickhardt, Gastroenterology, 2006, 223 patients, 90°) saw 77 % one way, 94 % both ways, and 98 % after a second look \
         at missed patches of at least 300 mm². Its readers flew back, so compare its second figure with flights there and back. \
         In the plot, reviews are simulated: the camera looks at each missed patch from one place where it fits, in two rounds. After \
         the planned flight at 90°, the review is also flown.",
    );
    let mut findings: Vec<String> = all.iter().filter_map(shares).collect();
    findings.extend(all.iter().filter_map(one_pass));
    findings.extend(all.iter().map(|m| {
        let t = &m.toured;
        format!(
            "{}: the review flies past {} places in {:.0} mm and {:.0} s; {:.1} % of the wall is then seen.",
            m.title,
            t.stops,
            t.length_mm,
            t.seconds,
            100.0 * t.shares[1]
        )
    }));
    findings.extend(all.iter().map(|m| {
        let [live, after] = m.live.shares;
        let [[without, _], [with, _]] = m.live.steps_ms;
        format!(
            "{}: live coverage ends at {:.1} %; measured afterwards, it is {:.1} %. It adds {:.2} ms to a step of {without:.2} ms \
             (medians).",
            m.title,
            100.0 * live,
            100.0 * after,
            with - without
        )
    }));
    page.findings(&findings);
    page.section("Shares");
    page.dots("shares", &dots(all), "Dots of a flight share a line. Vertical lines are the study's values at 90°.")?;
    page.table("flights", &flights(all))?;
    page.section("Reviews as flown");
    page.text(
        "After the planned flight at 90°: the shortest tours past the missed patches. What is seen on the way counts. The length of an \
         order is measured over the lumen's cells.",
    );
    page.table("tours", &tours(all))?;
    page.section("Visible maximum");
    page.text(
        "The camera looks in all directions from each place of a grid in the flown gas where its body fits with 0.5 mm to spare, whether or \
         not it could fly there. The last column adds the places of the flights and of the review. The coarse grid is part of the fine one: \
         what the fine one adds shows how far the share is from its limit.",
    );
    page.table("visible", &visible(all))?;
    page.section("Where the unseen wall lies");
    for m in all {
        let text = paragraph(m, all);
        page.text(&text);
        if m.is_scan {
            findings.push(text);
        }
    }
    page.table("reasons", &reasons(all))?;
    page.text("The same wall by other criteria. Parts below 0.05 % of the wall are left out.");
    page.table("parts", &parts(all))?;
    page.section("Live coverage, and coverage afterwards");
    page.text(
        "Two flights on one path take steps in turn, one with live coverage and one without. The measurement afterwards includes the \
         extraction of the wall; its memory is the increase of the peak, where the system reports it.",
    );
    page.table("cost", &cost(all))?;
    page.finish()?;
    Ok(findings)
}

fn percent(share: f64) -> (f64, usize) {
    (100.0 * share, 1)
}

/// Returns the planned flight in pictures of 90°.
fn planned(m: &Measured) -> Option<&Run> {
    m.runs.iter().find(|r| r.guide == PATH)
}

/// Returns a sentence that compares a colon's shares with the study's.
fn shares(m: &Measured) -> Option<String> {
    let run = planned(m)?;
    let [one, back, reviewed, all] =
        [run.coverage.one_way, run.there_and_back, run.reviewed[1].share, m.visible.share].map(|s| 100.0 * s);
    Some(format!(
        "{}: a planned flight sees {one:.1} % of the wall one way (study: 77), {back:.1} % there and back (94) and {reviewed:.1} % after \
         review (98), at a view angle of 90°; the visible maximum is {all:.1} %.",
        m.title
    ))
}

/// Returns a sentence that compares one pass with a fisheye to two with a perspective camera.
fn one_pass(m: &Measured) -> Option<String> {
    let wide = m.runs.iter().find(|r| r.guide == PATH && r.camera == fisheye::MODEL)?;
    let flat = planned(m)?;
    let [once, one, two, both] =
        [wide.coverage.one_way, flat.coverage.one_way, flat.there_and_back, flat.coverage.both_ways].map(|s| 100.0 * s);
    Some(format!(
        "{}: one pass with a fisheye of {FISHEYE_FOV:.0}° sees {once:.1} % of the wall; pictures of 90° see {one:.1} % in one pass, {two:.1} % \
         there and back, and {both:.1} % from the same places looking both ways.",
        m.title
    ))
}

/// Names a camera that is not the usual one.
fn kind(r: &Run) -> String {
    if r.camera == CameraModel::default() { String::new() } else { format!("{} ", r.camera.name) }
}

fn dots(all: &[Measured]) -> Dots {
    let line = |m: &Measured, r: &Run| {
        let seen_at_all = (r.guide == PATH).then_some(m.visible.share);
        let [ahead, both] = [&r.reviewed[0], &r.reviewed[1]].map(|r| Some(r.share));
        let [one, two, flown] = [r.coverage.one_way, r.coverage.both_ways, r.there_and_back].map(Some);
        let shares = vec![one, two, flown, ahead, both, seen_at_all];
        (format!("{}, {}, {}{:.0}°", m.title, r.guide, kind(r), r.fov_degrees), shares)
    };
    Dots {
        title: "The share of the wall that is seen".to_owned(),
        x: "share of the wall's area".to_owned(),
        series: SERIES.to_vec(),
        lines: all.iter().flat_map(|m| m.runs.iter().map(move |r| line(m, r))).collect(),
        references: STUDY.to_vec(),
    }
}

fn flights(all: &[Measured]) -> Table {
    table!(for (m, r) in all.iter().flat_map(|m| m.runs.iter().map(move |r| (m, r)));
        "volume" => &m.title,
        "guide" => r.guide,
        "camera" => r.camera.name,
        "view angle / degrees" => (r.fov_degrees, 0),
        "arrives" => r.state == State::Arrived,
        "length / mm" => (r.length_mm, 0),
        "wall / cm²" => (0.01 * r.wall_mm2, 0),
        "one way / %" => percent(r.coverage.one_way),
        "same places, both ways / %" => percent(r.coverage.both_ways),
        "flown there and back / %" => percent(r.there_and_back),
        "missed patches of 300 mm² or more" => r.missed.0,
        "their area / cm²" => (0.01 * r.missed.1, 1),
        "one way, reviewed / %" => percent(r.reviewed[0].share),
        "views added" => r.reviewed[0].views.len(),
        "there and back, reviewed / %" => percent(r.reviewed[1].share),
        "views added, there and back" => r.reviewed[1].views.len(),
        "visible maximum / %" => (r.guide == PATH).then(|| percent(m.visible.share)),
    )
}

fn tours(all: &[Measured]) -> Table {
    table!(for m in all;
        let r = &m.toured;
        "volume" => &m.title,
        "seen before / %" => percent(r.shares[0]),
        "seen after / %" => percent(r.shares[1]),
        "tours" => r.tours,
        "places" => r.stops,
        "reached" => r.reached,
        "length / mm" => (r.length_mm, 0),
        "time / s" => (r.seconds, 0),
        "order / mm" => (r.orders_mm[0], 0),
        "best of 1,000 random orders / mm" => (r.orders_mm[1], 0),
        "planning time / s" => (r.planned_s, 2),
    )
}

fn visible(all: &[Measured]) -> Table {
    table!(for m in all;
        let (v, [coarse, fine]) = (&m.visible, &m.visible.grids);
        "volume" => &m.title,
        "coarse grid / mm" => (coarse.step_mm, 0),
        "places" => coarse.places,
        "seen / %" => (100.0 * coarse.share, 2),
        "fine grid / mm" => (fine.step_mm, 0),
        "places of the fine grid" => fine.places,
        "seen from there / %" => (100.0 * fine.share, 2),
        "with the flights' places / %" => (100.0 * v.share, 2),
        "time / s" => (v.seconds, 1),
    )
}

fn reasons(all: &[Measured]) -> Table {
    table!(for (m, r) in all.iter().flat_map(|m| m.rest.reasons.iter().map(move |r| (m, r)));
        "volume" => &m.title,
        "not seen one way" => r.name,
        "of the wall / %" => (100.0 * r.share, 2),
    )
}

fn parts(all: &[Measured]) -> Table {
    let parts = all.iter().flat_map(|m| m.rest.parts.iter().map(move |p| (m, p)));
    table!(for (m, p) in parts.filter(|(_, p)| p.share >= 5e-4);
        "volume" => &m.title,
        "criterion" => p.criterion,
        "part" => &p.name,
        "of the wall / %" => percent(p.share),
        "seen one way / %" => percent(p.seen[0]),
        "same places, both ways / %" => percent(p.seen[1]),
        "visible maximum / %" => percent(p.seen[2]),
        "of the wall not seen one way / %" => percent(p.of_rest),
    )
}

fn cost(all: &[Measured]) -> Table {
    let mb = |bytes: usize| (bytes as f64 / 1e6, 1);
    table!(for m in all;
        let (l, c) = (&m.live, &m.cost);
        let [without, with] = l.steps_ms;
        "volume" => &m.title,
        "guide" => l.guide,
        "live / %" => percent(l.shares[0]),
        "afterwards / %" => percent(l.shares[1]),
        "step without / ms" => (without[0], 2),
        "99 %" => (without[1], 2),
        "step with / ms" => (with[0], 2),
        "99 % with" => (with[1], 2),
        "live / MB" => mb(l.bytes),
        "places of the flight" => c.places,
        "triangles" => c.triangles,
        "wall / MB" => mb(c.wall_bytes),
        "time afterwards / s" => (c.seconds, 2),
        "memory afterwards / MB" => (c.megabytes, 0),
    )
}

/// Describes where the wall lies that the planned flight did not see at a view angle of 90°, from the numbers alone.
fn paragraph(m: &Measured, all: &[Measured]) -> String {
    let Some(run) = planned(m) else { return String::new() };
    let one = run.coverage.one_way;
    let r: Vec<f64> = m.rest.reasons.iter().map(|r| 100.0 * r.share).collect();
    let [back, folds, small, never] = [0, 1, 2, 3].map(|n| r.get(n).copied().unwrap_or(0.0));
    let girth_mm = |r: &Run| r.wall_mm2 / r.length_mm.max(1.0);
    let mut text = format!(
        "{}: the planned flight sees {:.1} % of {:.0} cm² in its direction and leaves {:.1} %. Shares of the whole wall: {back:.1} % is \
         seen by the same places looking back. {folds:.1} % lies behind folds and bends in patches of 300 mm² or more that a second look \
         from another place shows, {small:.1} % in smaller patches that only places off the path see, and {never:.1} % is hidden from all \
         sampled places where the camera fits.",
        m.title,
        100.0 * one,
        0.01 * run.wall_mm2,
        100.0 * (1.0 - one)
    );
    let parts = |criterion: &str, names: &[&str]| {
        let these = m.rest.parts.iter().filter(|p| p.criterion == criterion && names.contains(&p.name.as_str()));
        let (share, seen, rest) =
            these.fold((0.0, 0.0, 0.0), |a, p| (a.0 + p.share, a.1 + p.share * p.seen[0], a.2 + p.of_rest));
        [100.0 * share, if share > 0.0 { 100.0 * seen / share } else { 0.0 }, 100.0 * rest]
    };
    let [along, along_seen, along_rest] = parts("faces", &["along the flight"]);
    text += &format!(
        " {along:.0} % of the wall faces along the flight, such as the rear of folds; {along_seen:.0} % of that is seen, and \
         {along_rest:.0} % of the rest lies there."
    );
    let [far, far_seen, far_rest] =
        parts("distance to the nearest place of the flight", &["30 to 60 mm", "60 mm or more"]);
    if far >= 1.0 {
        text += &format!(
            " {far:.0} % of the wall is 30 mm or more from the path: {far_seen:.0} % of it is seen, and {far_rest:.0} % of the rest lies \
             there."
        );
    }
    let [narrow, _, narrow_rest] = parts("clearance at that place", &["below 6 mm"]);
    let [fluid, fluid_seen, _] = parts("as scanned", &["under tagged fluid"]);
    text += &format!(
        " Stretches with a clearance below 6 mm hold {narrow:.0} % of the wall and {narrow_rest:.0} % of the rest."
    );
    if fluid >= 0.5 {
        let dry_seen = parts("as scanned", &["dry"])[1];
        text += &format!(
            " Of the wall that was under tagged fluid ({fluid:.0} % of all), {fluid_seen:.0} % is seen; of the dry wall, {dry_seen:.0} %."
        );
    }
    if m.is_scan && one < STUDY[0].0 {
        let largest = [(back, "wall that is seen only on the way back"), (folds, "wall behind folds and bends")]
            .into_iter()
            .chain([(small, "wall in small patches"), (never, "wall that cannot be seen")])
            .reduce(|a, b| if b.0 > a.0 { b } else { a });
        text += &format!(
            " The study's 77 % is the mean of its patients (63 to 92 %). Here the largest part of the rest is {}.",
            largest.map_or("unknown", |l| l.1)
        );
        if let Some(other) = all.iter().filter(|o| !o.is_scan).find_map(planned).filter(|o| girth_mm(run) > girth_mm(o))
        {
            text += &format!(
                " Each millimetre of the flight has more wall than in the phantom ({:.0} mm² against {:.0}), as expected of a \
                 wide lumen with deep folds: the wider the lumen, the farther ahead the wall enters the picture, and the more wall lies \
                 hidden behind folds.",
                girth_mm(run),
                girth_mm(other)
            );
        }
    }
    text
}
