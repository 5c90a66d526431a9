//! The text, tables and plots of the report.

use crate::error::Result;
use crate::report::image::{WHITE_ERROR, error_map, rms};
use crate::report::page::Page;
use crate::report::plot::{Plot, Point, Series};
use crate::report::table::{Table, known, row, table};
use crate::report::{Effort, mean, median, quantile};

use super::claims::Claims;
use super::growth::{Growth, Row};
use super::motion::AdaptiveMeasurement;
use super::{Extent, Measured, Subject};

/// Longest side of a picture in an error map, pixels.
const PANEL: usize = 256;

/// Writes the introduction: what is shown and how it was measured.
pub(crate) fn introduction(page: &mut Page, extent: &Extent) {
    page.text(&format!(
        "Frames of {0} × {0} pixels, {1} threads, {2} poses along a headless flight and {3} after jumps and sudden turns \
         among them. All methods render a pose in turn before the next pose; a method that keeps data between frames first renders the {4} preceding frames of the flight. Times are without depth and after a warm-up; with fewer than a hundred frames, p99 is the slowest. Errors are against the reference: rays with steps of an \
         eighth of the smallest spacing (h), nothing skipped.",
        extent.pixels,
        rayon::current_num_threads(),
        extent.along,
        extent.jumps,
        extent.lead
    ));
    if extent.effort == Effort::Full {
        page.text(
            "The error of the reference itself, against infinitely small steps, is about its difference from \"brute h/16\", which \
             halves the step.",
        );
    }
    page.text(
        "Filtered density classifies by the regression's D as the paper does, and more samples a pixel smooth edges: both target a different image than the reference, so their difference is not an error, and they appear in the tables only. Wall \
         distance is compared for methods that compute their own depth; all others use the exact crossings.",
    );
}

/// Writes the section of a subject. Returns its finding.
pub(crate) fn subject(page: &mut Page, s: &Subject, measured: &[Measured], claims: &Claims) -> Result<Vec<String>> {
    let volume = s.volume.voxels();
    let dims = volume.grid().dims();
    page.section(&s.title);
    page.text(&format!(
        "{} × {} × {} voxels of {:.2} × {:.2} × {:.2} mm, {:.0} MiB at 16 bits.",
        dims[0],
        dims[1],
        dims[2],
        volume.grid().spacing().x,
        volume.grid().spacing().y,
        volume.grid().spacing().z,
        mib(volume.bytes())
    ));
    let findings = [finding(s, measured), indirect(s, measured)];
    let findings: Vec<String> = findings.into_iter().filter(|f| !f.is_empty()).collect();
    page.findings(&findings);
    let name = |what: &str| format!("{}-{what}", s.name);
    page.table(&name("methods"), &methods(measured, volume.bytes()))?;
    page.csv(&name("frames"), &frames(measured))?;
    for (what, plot, caption) in plots(s, measured) {
        page.plot(&name(what), &plot, caption)?;
    }
    let kept = reuse(measured);
    if !kept.is_empty() {
        page.text(
            "The error of reuse, separate from that of sampling: each frame against a fresh renderer's frame of the same pose, and the fresh frame against the reference.",
        );
        page.table(&name("reuse"), &kept)?;
    }
    page.section(&format!("{}: the paper's claims", s.title));
    let t = table!(for c in &claims.claims; "paper" => c.paper, "measured" => &c.measured);
    page.table(&name("claims"), &t)?;
    page.table(&name("preparations"), &preparations(s, claims))?;
    page.section(&format!("{}: worst frames", s.title));
    page.text(&format!(
        "Reference, method, and the largest error of the three colours: black is 0, white is {WHITE_ERROR} levels or more. The CSV \
         {}.csv has every frame.",
        name("frames")
    ));
    for m in measured {
        if let Some((stop, reference, frame)) = &m.worst {
            let caption = format!("{}: pose {stop}, {:.1} dB", m.method.name, m.worst_psnr());
            page.picture(&error_map(reference, frame, PANEL), &caption);
        }
    }
    Ok(findings)
}

/// Writes the section on adaptive detail. Returns the finding.
pub(crate) fn motion(page: &mut Page, s: &Subject, m: &AdaptiveMeasurement, extent: &Extent) -> Result<String> {
    let finding = format!("{}: {}", s.title, m.finding(2 * extent.pixels));
    page.section(&format!("{}: adaptive detail", s.title));
    page.finding(&finding);
    let t = table!(for (n, &ms) in m.ms.iter().enumerate(); "picture" => n, "ms" => known(ms, 2));
    page.csv(&format!("{}-moving", s.name), &t)?;
    page.text(&format!("A picture that is being refined takes at most {:.1} ms.", m.refining_ms));
    Ok(finding)
}

/// Writes how time grows with voxels, threads and SIMD levels. Returns the finding.
pub(crate) fn growth(page: &mut Page, s: &Subject, g: &Growth, extent: &Extent) -> Result<String> {
    let side = 2 * extent.pixels;
    page.section(&format!("{}: voxels, threads, SIMD levels", s.title));
    page.text(&format!(
        "The default renderer, {side} × {side} pixels, the same views. The body is resampled to cubic grids; preparation (flags and bricks) is one pass over the voxels. Differences are grey levels from the first row's images."
    ));
    let (least, most) = (g.volumes.first(), g.volumes.last());
    let ratio = least.zip(most).map_or(f64::NAN, |(a, b)| b.median() / a.median());
    let name = |r: Option<&Row>| r.map_or("", |r| r.name.as_str()).to_owned();
    let off = g.threads.iter().chain(&g.levels).map(|r| r.off).max().unwrap_or(0);
    let finding = format!(
        "{}: a frame at {} voxels takes {ratio:.2} times one at {}. Threads and SIMD levels change no picture by more than {off} grey levels, and the flight's log is {} for every number of threads.",
        s.title,
        name(most),
        name(least),
        if g.same_log { "the same" } else { "NOT the same" }
    );
    page.finding(&finding);
    for (what, rows) in [("voxels", &g.volumes), ("threads", &g.threads), ("simd", &g.levels)] {
        page.table(&format!("{}-{what}", s.name), &rows_of(what, rows, side))?;
    }
    Ok(finding)
}

fn rows_of(what: &str, rows: &[Row], side: usize) -> Table {
    let mut t = Table::new(&[
        what,
        "frame median / ms",
        "frame p99 / ms",
        "of the first",
        "rays a pixel",
        "samples a ray",
        "preparation / s",
        "ns a voxel",
        "memory / 16-bit volume",
        "largest difference",
    ]);
    let first = rows.first().map_or(f64::NAN, Row::median);
    for r in rows {
        let pixels = (r.ms.len() * side * side) as f64;
        t.row(row![
            &r.name,
            known(r.median(), 2),
            known(r.p99(), 2),
            known(r.median() / first, 2),
            known(r.rays as f64 / pixels, 3),
            known(r.samples as f64 / r.rays.max(1) as f64, 2),
            known(r.prepare_s, 3),
            known(r.prepare_s * 1e9 / r.voxels as f64, 2),
            known(r.bytes as f64 / (2 * r.voxels) as f64, 3),
            // Volumes with different voxels have different pictures.
            (what != "voxels").then_some(usize::from(r.off)),
        ]);
    }
    t
}

fn mib(bytes: usize) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}

fn all<T>(m: &Measured, f: impl Fn(&super::Fault) -> T) -> Vec<T> {
    m.faults.iter().map(f).collect()
}

/// Returns the share of displaced walls over all frames; `None` if the method does not compute its own depth.
fn displaced(m: &Measured) -> Option<f64> {
    let shares: Vec<f64> = m.faults.iter().filter_map(|f| f.displaced).collect();
    (!shares.is_empty()).then(|| mean(&shares))
}

fn methods(measured: &[Measured], volume: usize) -> Table {
    table!(for m in measured;
        let ssim = all(m, |f| f.ssim);
        "method" => m.method.name,
        "family" => m.method.family,
        "PSNR mean / dB" => known(mean(&m.psnr()), 1),
        "PSNR worst / dB" => known(m.worst_psnr(), 1),
        "SSIM mean" => known(mean(&ssim), 4),
        "SSIM worst" => known(ssim.iter().copied().fold(1.0, f64::min), 4),
        "walls off by > h/4 / %" => displaced(m).map(|s| known(100.0 * s, 3)),
        "frame median / ms" => known(median(&m.ms), 1),
        "frame p99 / ms" => known(quantile(&m.ms, 0.99), 1),
        "after a jump, median / ms" => known(median(&m.jump_ms), 1),
        "samples a ray" => known(mean(&all(m, |f| f.samples)), 2),
        "memory / 16-bit volume" => known(m.bytes as f64 / volume as f64, 3),
        "preparation / s" => known(m.prepare_s, 3),
    )
}

fn frames(measured: &[Measured]) -> Table {
    table!(for (m, f) in measured.iter().flat_map(|m| m.faults.iter().map(move |f| (m, f)));
        "method" => m.method.name,
        "pose" => f.stop,
        "jump" => f.jump,
        "psnr_db" => known(f.psnr, 1),
        "ssim" => known(f.ssim, 4),
        "displaced" => f.displaced.map(|d| known(d, 4)),
        "ms" => known(f.ms, 1),
        "samples_per_ray" => known(f.samples, 2),
        "reuse_psnr_db" => f.reuse.map(|r| known(r[0], 1)),
        "sampling_psnr_db" => f.reuse.map(|r| known(r[1], 1)),
    )
}

fn reuse(measured: &[Measured]) -> Table {
    let kept = measured.iter().filter(|m| m.method.traits.keeps);
    table!(for (m, k, part) in kept.flat_map(|m| [(m, 0, "reuse"), (m, 1, "sampling")]);
        let db = m.faults.iter().filter_map(|f| f.reuse).map(|r| r[k]).collect::<Vec<f64>>();
        "method" => m.method.name,
        "part" => part,
        "PSNR mean / dB" => known(mean(&db), 1),
        "PSNR worst / dB" => known(db.iter().copied().fold(f64::INFINITY, f64::min), 1),
    )
}

fn preparations(s: &Subject, claims: &Claims) -> Table {
    table!(for c in &claims.costs;
        "built before the first frame" => c.name,
        "time / s" => known(c.seconds, 4),
        "memory / MiB" => known(mib(c.bytes), 1),
        "memory / 16-bit volume" => known(c.bytes as f64 / s.volume.voxels().bytes() as f64, 3),
    )
}

/// Returns the plots: name, plot, caption.
fn plots(s: &Subject, measured: &[Measured]) -> Vec<(&'static str, Plot, &'static str)> {
    let compared: Vec<&Measured> = measured.iter().filter(|m| !m.method.traits.other_picture).collect();
    let plot = |what: &str, x: &str, y: &str, at: &dyn Fn(&Measured) -> (f64, f64)| {
        let points = compared.iter().map(|m| {
            let (x, y) = at(m);
            (m.method.family.to_owned(), false, Point { x, y, name: m.method.name.to_owned() })
        });
        Plot { front: true, ..Plot::new(format!("{}: {what}", s.title), x, y, Series::grouped(points)) }
    };
    let volume = s.volume.voxels().bytes() as f64;
    let time = "median frame / ms";
    let mut all = vec![
        (
            "error",
            plot("error against time", time, "RMS error, all frames / grey levels", &|m| (median(&m.ms), m.rms())),
            "40 dB are 2.55 grey levels, 45 dB 1.43. The reference itself has no error and is not on the plot; rays of its own step \
             (h/8) share the error of that step.",
        ),
        (
            "worst",
            plot(
                "worst frame against slowest frames",
                "p99 frame / ms",
                "RMS error, worst frame / grey levels",
                &|m| (quantile(&m.ms, 0.99), rms(m.worst_psnr())),
            ),
            "Each method's frame with the lowest PSNR, including poses after jumps.",
        ),
        (
            "ssim",
            plot("structural error against time", time, "1 − mean SSIM", &|m| {
                (median(&m.ms), 1.0 - mean(&all(m, |f| f.ssim)))
            }),
            "1 minus the mean SSIM.",
        ),
        (
            "memory",
            plot("memory against time", time, "memory in addition to the voxels / 16-bit volume", &|m| {
                (median(&m.ms), m.bytes as f64 / volume)
            }),
            "Methods that need no additional memory are not in the plot. The flags count for every ray caster.",
        ),
    ];
    if compared.iter().any(|m| displaced(m).is_some()) {
        all.push((
            "distance",
            plot("wall distance against time", time, "walls off by more than h/4 / %", &|m| {
                (median(&m.ms), displaced(m).map_or(0.0, |d| 100.0 * d))
            }),
            "Methods that compute their own depth.",
        ));
    }
    all
}

/// Returns the fastest method of sufficient quality, in numbers.
fn finding(s: &Subject, measured: &[Measured]) -> String {
    let Some(reference) = measured.first() else { return String::new() };
    let compared = || measured.iter().skip(1).filter(|m| !m.method.traits.other_picture);
    let faster = |a: &&Measured, b: &&Measured| median(&a.ms).total_cmp(&median(&b.ms));
    match compared().filter(|m| m.worst_psnr() >= 40.0).min_by(faster) {
        Some(m) => format!(
            "{}: the fastest method whose every frame keeps 40 dB is {}, with a median of {:.1} ms a frame, {:.0} times faster \
             than the reference ({:.0} ms), at {:.1} dB in the worst frame and {:.1} samples a ray.",
            s.title,
            m.method.name,
            median(&m.ms),
            median(&reference.ms) / median(&m.ms),
            median(&reference.ms),
            m.worst_psnr(),
            mean(&all(m, |f| f.samples))
        ),
        None => {
            let best = compared().max_by(|a, b| a.worst_psnr().total_cmp(&b.worst_psnr()));
            best.map_or_else(String::new, |m| {
                format!(
                    "{}: no method keeps 40 dB in every frame; the best, {}, has {:.1} dB in its worst frame and takes {:.1} ms.",
                    s.title,
                    m.method.name,
                    m.worst_psnr(),
                    median(&m.ms)
                )
            })
        }
    }
}

/// Returns the finding on the surface method.
fn indirect(s: &Subject, measured: &[Measured]) -> String {
    let Some(m) = measured.iter().find(|m| m.method.family == "indirect") else { return String::new() };
    let faster = |a: &&Measured, b: &&Measured| median(&a.ms).total_cmp(&median(&b.ms));
    let rays =
        measured.iter().filter(|m| m.method.family == "flags, trilinear" && m.worst_psnr() >= 40.0).min_by(faster);
    let beside = rays.map_or_else(String::new, |r| {
        format!(", {:.2} times the time of {}", median(&m.ms) / median(&r.ms), r.method.name)
    });
    format!(
        "{}: {} takes {:.2} s to build and {:.2} times the 16-bit volume's memory, draws a frame in {:.1} ms{beside}, and has \
         {:.1} dB in its worst frame with {:.2} % of the pixels' walls off by more than a quarter voxel.",
        s.title,
        m.method.name,
        m.prepare_s,
        m.bytes as f64 / s.volume.voxels().bytes() as f64,
        median(&m.ms),
        m.worst_psnr(),
        100.0 * displaced(m).unwrap_or(f64::NAN)
    )
}
