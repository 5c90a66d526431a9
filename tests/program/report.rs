//! The reports: their files, columns, and plausible numbers.

use std::path::Path;

use colvis::phantom::Phantom;
use colvis::progress::Progress;
use colvis::render::{PreparedVolume, TransferFunction};
use colvis::report::render::{Extent, Subject, report};

use crate::support::run::run;

/// Returns a CSV's columns and its rows, and checks that each row is as wide as the columns.
fn csv(path: &Path) -> (Vec<String>, Vec<Vec<String>>) {
    let text = std::fs::read_to_string(path).unwrap();
    let mut rows = text.lines().map(|line| {
        let (mut cells, mut cell, mut quoted) = (Vec::new(), String::new(), false);
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                ',' if !quoted => cells.push(std::mem::take(&mut cell)),
                c => cell.push(c),
            }
        }
        cells.push(cell);
        cells
    });
    let columns = rows.next().unwrap();
    let rows: Vec<_> = rows.collect();
    assert!(!rows.is_empty() && rows.iter().all(|r| r.len() == columns.len()), "{}", path.display());
    (columns, rows)
}

/// Checks a complete, self-contained page with this number of plots.
fn page(folder: &Path, plots: usize) -> String {
    let html = std::fs::read_to_string(folder.join("report.html")).unwrap();
    assert!(html.starts_with("<!DOCTYPE html>") && html.trim_end().ends_with("</html>"));
    assert_eq!(html.matches("<svg").count(), plots);
    for outside in ["src=\"http", "href=\"http", "<script", "@import"] {
        assert!(!html.contains(outside), "{outside}");
    }
    // Leaves out the pictures, whose letters are arbitrary.
    let words: String = html.split("base64,").map(|part| part.split_once('"').map_or(part, |(_, rest)| rest)).collect();
    assert!(!words.contains("NaN") && !words.contains(">inf<"));
    html
}

#[test]
#[ignore = "slow: a quick report"]
fn gradients_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("g");
    let said = run(&["report", "gradients", "--quick", "--out", out.to_str().unwrap()], 0);
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    let html = page(&out, 4);
    let (columns, rows) = csv(&out.join("gradients.csv"));
    assert_eq!(columns, ["signal", "voxels", "noise / HU", "estimator", "mean error / degrees", "time / ns"]);
    assert_eq!(rows.len(), 4 * 2 * 4 * 6, "signals, shapes, noise, estimators");
    let number = |r: &[String], c: usize| r[c].parse::<f64>().unwrap();
    assert!(rows.iter().all(|r| number(r, 4) > 0.0 && number(r, 4) < 90.0 && number(r, 5) > 0.0));
    let error = |signal: &str, noise: &str, estimator: &str| {
        let is = |r: &&Vec<String>| r[0] == signal && r[1] == "cubic voxels" && r[2] == noise && r[3] == estimator;
        number(rows.iter().find(is).unwrap(), 4)
    };
    for signal in ["tube", "sphere", "phantom"] {
        assert!(error(signal, "22", "4D regression 1/d²") < error(signal, "22", "central differences"), "{signal}");
        assert!(error(signal, "100", "4D regression 1/d²") > error(signal, "0", "4D regression 1/d²"), "{signal}");
        let (fine, coarse) = (error(signal, "22", "stored, 16 bits"), error(signal, "22", "stored, 8 bits"));
        assert!((fine - error(signal, "22", "4D regression 1/d²")).abs() < 2.5e-5 && coarse > fine, "{signal}");
    }
    assert!(error("Marschner–Lobb", "0", "central differences") < error("Marschner–Lobb", "0", "4D regression 1/d²"));
    for plot in ["walls-cubic", "walls-1-1-3", "marschner-lobb-cubic", "marschner-lobb-1-1-3"] {
        assert_eq!(csv(&out.join(plot).with_extension("csv")).1.len(), 6 * 4);
    }
    let findings: Vec<&str> = said.lines().filter(|l| !l.starts_with("see ")).collect();
    assert_eq!(findings.len(), 2);
    assert!(findings.iter().all(|f| html.contains(*f)), "what is printed is what stands in the report");
}

#[test]
#[ignore = "slow: a quick report"]
fn scenes_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    run(&["report", "scenes", "--quick", "--out", dir.path().to_str().unwrap()], 0);
    page(dir.path(), 1);
    let (_, scenes) = csv(&dir.path().join("scenes.csv"));
    let of = |name: &str| scenes.iter().find(|r| r[0] == name).unwrap();
    let bytes = |name: &str| of(name)[2].parse::<f64>().unwrap();
    assert!(bytes("everything") > bytes("default") && bytes("default") > bytes("manual"));
    assert!(of("default")[4].is_empty() && of("render")[4].parse::<f64>().unwrap() > 0.0, "no picture, no frame time");
    assert!(scenes.iter().all(|r| r[3].parse::<f64>().unwrap() >= 0.0 && r[5].parse::<f64>().unwrap() > 0.0));
    let (_, parts) = csv(&dir.path().join("parts.csv"));
    let step = |name: &str| parts.iter().find(|r| r[0].starts_with(name)).unwrap()[3].parse::<f64>().unwrap();
    assert!(step("tentacles") > 0.0, "128 rays a step are not for nothing");
    assert!(parts.iter().all(|r| r[2].parse::<f64>().unwrap() >= 0.0), "leaving out never takes memory");
    assert_eq!(csv(&dir.path().join("built.csv")).1.len(), 2);
    let (_, threads) = csv(&dir.path().join("threads.csv"));
    assert_eq!(threads[0][0], "1");
    assert!(threads.iter().all(|r| r[1..].iter().all(|v| v.parse::<f64>().unwrap() >= 0.0)), "{threads:?}");
    let (_, jobs) = csv(&dir.path().join("jobs.csv"));
    assert_eq!(jobs.len(), 5 * threads.len());
}

#[test]
#[ignore = "slow: a report on two subjects"]
fn renderers_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let volume =
        || PreparedVolume::new(Phantom::embedded(&Progress::new()).unwrap().into(), TransferFunction::default());
    let subjects = [("a", volume()), ("b", volume())].map(|(name, volume)| Subject {
        name: name.to_owned(),
        title: format!("Subject {name}"),
        volume,
    });
    let extent = Extent {
        pixels: 48,
        fov_degrees: 90.0,
        along: 2,
        jumps: 1,
        lead: 2,
        sides: &[32, 64],
        moving: 8,
        stops: 1,
        effort: colvis::report::Effort::Quick,
    };
    let findings = report(&subjects, &extent, dir.path(), &Progress::new()).unwrap();
    assert_eq!(findings.len(), 7, "{findings:?}");
    let refined = findings.iter().filter_map(|f| f.split_once("with a PSNR of ")?.1.split_once(" dB")?.0.parse().ok());
    let refined: Vec<f64> = refined.collect();
    assert!(refined.len() == 2 && refined.iter().all(|db| (45.0..99.0).contains(db)), "{findings:?}");
    let html = page(dir.path(), 10);
    let (columns, methods) = csv(&dir.path().join("a-methods.csv"));
    for c in ["method", "PSNR worst / dB", "SSIM worst", "frame median / ms", "frame p99 / ms", "samples a ray"] {
        assert!(columns.iter().any(|k| k == c), "{c}");
    }
    assert_eq!(
        html.matches("data:image/png;base64,").count(),
        2 * (methods.len() - 1),
        "a worst frame for each method"
    );
    let column = |name: &str| columns.iter().position(|c| c == name).unwrap();
    for row in &methods {
        let is_reference = row[0].starts_with("reference");
        for (c, cell) in columns.iter().zip(row).skip(2) {
            let v = if cell.is_empty() { 0.0 } else { cell.parse::<f64>().unwrap() };
            assert!(v.is_finite() || (is_reference && c.starts_with("PSNR")), "{}: {c} is {cell}", row[0]);
        }
        assert_eq!(row[column("PSNR worst / dB")] == "inf", is_reference);
        assert_eq!(row[column("walls off by > h/4 / %")].is_empty(), row[0] != "marching cubes");
    }
    let (_, frames) = csv(&dir.path().join("a-frames.csv"));
    assert_eq!(frames.len(), 3 * methods.len());
    // Everything except the times is the same for the same scan.
    let (_, again) = csv(&dir.path().join("b-frames.csv"));
    for (a, b) in frames.iter().zip(&again) {
        assert_eq!((&a[..6], &a[7..]), (&b[..6], &b[7..]));
    }
    for plot in ["error", "worst", "ssim", "memory", "distance"] {
        let (columns, rows) = csv(&dir.path().join(format!("a-{plot}.csv")));
        assert_eq!((columns.len(), columns[4].as_str()), (5, "on_front"));
        assert!(
            rows.iter().any(|r| r[4] == "yes") && rows.iter().all(|r| r[2].parse::<f64>().unwrap() > 0.0),
            "{plot}"
        );
    }
    let (_, claims) = csv(&dir.path().join("a-claims.csv"));
    assert!(claims.iter().all(|c| !c[1].is_empty()));
    for claim in
        ["4 sampling steps", "double recalculation", "around 2 seconds", "two orders faster", "doubled", "five-folded"]
    {
        assert!(claims.iter().any(|c| c[0].contains(claim)), "{claim}");
    }
    // The value of each idea: the flag saves samples, the potential field takes memory, and so on, for both subjects.
    let (columns, worth) = csv(&dir.path().join("b-worth.csv"));
    let number = |idea: &str, column: &str| {
        let row = worth.iter().find(|r| r[0].contains(idea)).unwrap();
        row[columns.iter().position(|c| c == column).unwrap()].parse::<f64>().unwrap()
    };
    let pair = |idea: &str, what: &str| [" with it", " without it"].map(|w| number(idea, &what.replace('*', w)));
    let [with, without] = pair("homogeneous-region flag", "samples a ray*");
    assert!(with < without, "{with} {without}");
    let [with, without] = pair("potential field", "memory* / 16-bit volume");
    assert!(with > without + 0.45, "{with} {without}");
    let [with, without] = pair("all accelerations", "frame* / ms");
    assert!(3.0 * with < without && with > 0.0, "{with} {without}");
}

#[test]
#[ignore = "slow: a quick report"]
fn dynamics_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("d");
    let said = run(&["report", "dynamics", "--quick", "--out", out.to_str().unwrap()], 0);
    let html = page(&out, 13);
    let (_, orders) = csv(&out.join("orders.csv"));
    assert_eq!(orders.len(), 8);
    for row in &orders {
        let [theory, position, orientation] = [2, 3, 4].map(|c| row[c].parse::<f64>().unwrap());
        assert!((position - theory).abs() < 0.2, "{row:?}");
        assert!((orientation - theory).abs() < 0.2, "{row:?}");
    }
    let (columns, steps) = csv(&out.join("stable-step-by-wall-table.csv"));
    for (column, name) in columns.iter().enumerate().skip(1) {
        let largest = |row: &Vec<String>| row[column].parse::<f64>().unwrap();
        let implicit = ["backward Euler", "implicit midpoint", "Rosenbrock ROS34PW2"].contains(&name.as_str());
        assert_eq!(steps.iter().all(|r| largest(r) >= 10.0), implicit, "{name}");
    }
    let (_, free) = csv(&out.join("free-motion.csv"));
    assert!(free.iter().all(|r| r[2].parse::<f64>().unwrap() < 1e-12 && r[3].parse::<f64>().unwrap() < 1e-12));
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    assert!(said.lines().filter(|l| !l.starts_with("see ")).all(|f| html.contains(&f.replace('&', "&amp;"))));
}

#[test]
#[ignore = "slow: a quick report"]
fn perforations_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("p");
    run(&["report", "perforation", "--steps", "700", "--seed", "3", "--out", out.to_str().unwrap()], 0);
    page(&out, 0);
    for (file, rows) in [("places", 14), ("methods", 8)] {
        let (columns, all) = csv(&out.join(file).with_extension("csv"));
        assert_eq!((all.len(), columns[2].as_str()), (rows, "perforations"));
        assert_eq!(all.iter().map(|r| r[1].parse::<u64>().unwrap()).sum::<u64>(), 700);
        assert!(all.iter().all(|r| r[2] == "0" && r[3] == "0" && r[4] == "0"), "{file}");
    }
}

#[test]
#[ignore = "slow: a quick report"]
fn cleansing_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("c");
    let said = run(&["report", "cleansing", "--quick", "--out", out.to_str().unwrap()], 0);
    page(&out, 0);
    let (_, parts) = csv(&out.join("parts.csv"));
    // Position, normal and missing of a method on a part of the wall.
    let errors = |method: &str, part: &str| {
        let row = parts.iter().find(|r| r[1] == method && r[2] == part).unwrap_or_else(|| panic!("{method}, {part}"));
        [4, 6, 8].map(|n| row[n].parse::<f64>().unwrap_or(f64::NAN))
    };
    let [mm, degrees, missing] = errors("none", "dry");
    assert!(mm < 0.06 && degrees < 3.0 && missing == 0.0, "the measure itself: {mm} mm, {degrees}°, {missing} %");
    assert_eq!(errors("none", "under fluid")[2], 100.0, "without cleansing there is no wall under fluid");
    let [mm, degrees, missing] = errors("blanked", "under fluid");
    assert!(mm < 0.5 && degrees < 15.0 && missing < 1.0, "{mm} mm, {degrees}°, {missing} %");
    assert_eq!(errors("blanked", "dry"), errors("none", "dry"), "dry walls stay");
    for (method, most) in [("cleansed", [0.15, 5.0, 1.0]), ("as flown", [0.25, 6.0, 1.0])] {
        let found = errors(method, "under fluid");
        assert!(found.iter().zip(most).all(|(f, most)| *f < most), "{method}: {found:?}");
        let [mm, degrees, _] = errors(method, "rim of a level");
        assert!(mm < 0.25 && degrees < 10.0, "{method} at rims: {mm} mm, {degrees}°");
    }
    let (columns, methods) = csv(&out.join("methods.csv"));
    assert!(columns.len() == 7 && methods.len() == 5);
    assert!(String::from_utf8_lossy(&said.stdout).contains("blanked: under fluid"));
}

#[test]
#[ignore = "slow: a quick report"]
fn unfolding_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("u");
    let said = run(&["report", "unfold", "--quick", "--out", out.to_str().unwrap()], 0);
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    let html = page(&out, 0);
    let findings: Vec<&str> = said.lines().filter(|l| !l.starts_with("see ")).collect();
    assert!(findings.len() == 5 && findings.iter().all(|f| html.contains(*f)), "{said}");
    let (columns, rows) = csv(&out.join("unfold.csv"));
    assert_eq!(rows.len(), 3 * 2, "two tubes and a phantom, two methods");
    let number = |r: &[String], name: &str| {
        let column = columns.iter().position(|c| c == name).unwrap();
        r[column].parse::<f64>().unwrap()
    };
    for r in rows.iter().filter(|r| r[1] == "level sets") {
        assert!(number(r, "absent / %") <= 2.0 && number(r, "twice / %") <= 0.2, "{r:?}");
        assert!(number(r, "round trip, 99 % / mm") <= 0.5, "{r:?}");
        assert_eq!(number(r, "polyps"), number(r, "shown once"), "{r:?}");
    }
    // Plain rays do not see behind folds.
    let plain = rows.iter().find(|r| r[0].contains("phantom") && r[1] == "plain rays").unwrap();
    assert!(number(plain, "absent / %") > 2.0, "{plain:?}");
}

#[test]
#[ignore = "slow: a quick report"]
fn coverage_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("c");
    let said = run(&["report", "coverage", "--quick", "--out", out.to_str().unwrap()], 0);
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    let html = page(&out, 1);
    let findings: Vec<&str> = said.lines().filter(|l| !l.starts_with("see ")).collect();
    assert!(findings.len() == 4 && findings.iter().all(|f| html.contains(*f)), "{said}");
    let (columns, rows) = csv(&out.join("flights.csv"));
    assert_eq!(rows.len(), 3 * 3, "guides, cameras");
    let number = |r: &[String], name: &str| {
        let column = columns.iter().position(|c| c == name).unwrap();
        r[column].parse::<f64>().unwrap()
    };
    for r in &rows {
        assert_eq!((columns[4].as_str(), r[4].as_str()), ("arrives", "yes"), "{r:?}");
        let [one, both, back] =
            ["one way / %", "same places, both ways / %", "flown there and back / %"].map(|c| number(r, c));
        let [ahead, reviewed] = ["one way, reviewed / %", "there and back, reviewed / %"].map(|c| number(r, c));
        assert!(50.0 < one && one <= both && one <= back && both <= 100.0, "{r:?}");
        assert!(one <= ahead && back <= reviewed && ahead <= reviewed + 5.0, "{r:?}");
        if r[1] == "path" {
            let all = number(r, "visible maximum / %");
            assert!(all <= 100.0 + 1e-9 && [both, back, ahead, reviewed].iter().all(|s| *s <= all + 0.2), "{r:?}");
        }
    }
    for of_guide in rows.chunks(3) {
        assert_eq!([0, 1, 2].map(|n| of_guide[n][2].as_str()), ["perspective", "perspective", "fisheye"]);
        let [narrow, wide, fisheye] = [0, 1, 2].map(|n| number(&of_guide[n], "one way / %"));
        assert!(narrow < wide, "120° sees more than 90°");
        let both = number(&of_guide[0], "same places, both ways / %");
        assert!(wide < fisheye && fisheye >= both, "one pass with a fisheye sees what two with 90° do: {of_guide:?}");
    }
    // The reasons are the whole rest, and each criterion is the whole wall.
    let (_, reasons) = csv(&out.join("reasons.csv"));
    let rest: f64 = reasons.iter().map(|r| r[2].parse::<f64>().unwrap()).sum();
    let path = rows.iter().find(|r| r[1] == "path").unwrap();
    assert!((rest + number(path, "one way / %") - 100.0).abs() < 1e-6, "{rest}");
    let (_, parts) = csv(&out.join("parts.csv"));
    let faces = parts.iter().filter(|p| p[1] == "faces").map(|p| p[3].parse::<f64>().unwrap());
    assert!((faces.sum::<f64>() - 100.0).abs() < 0.1);
    let (_, visible) = csv(&out.join("visible.csv"));
    let [coarse, fine] = [3, 6].map(|n| visible[0][n].parse::<f64>().unwrap());
    assert!(90.0 < coarse && coarse <= fine, "{coarse} {fine}");
    let (_, tours) = csv(&out.join("tours.csv"));
    let tour: Vec<f64> = tours[0][1..].iter().map(|n| n.parse().unwrap()).collect();
    assert!((tour[0] - number(path, "one way / %")).abs() < 1e-6 && tour[1] > 97.0, "seen before and after: {tour:?}");
    assert!(tour[4] == tour[3] && tour[7] <= tour[8] + 1e-6, "places reached, and the orders' lengths: {tour:?}");
    let (_, cost) = csv(&out.join("cost.csv"));
    let [live, after] = [2, 3].map(|n| cost[0][n].parse::<f64>().unwrap());
    assert!((live - after).abs() < 2.0, "{live} {after}");
}

#[test]
fn what_no_report_can_do() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("r");
    let out = out.to_str().unwrap();
    run(&["report", "render"], 2);
    run(&["report", "render", "--quick", "--scan", "missing.nii.gz", "--out", out], 3);
    run(&["report", "gradients", "--quick", "--out", "/dev/null/r"], 5);
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "what is refused leaves nothing");
}

#[test]
#[ignore = "slow: a quick report"]
fn fields_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("f");
    let said = run(&["report", "fields", "--quick", "--out", out.to_str().unwrap()], 0);
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    let html = page(&out, 3);
    assert!(
        said.lines().count() == 5 && said.lines().take(4).all(|l| html.contains(&l.replace('&', "&amp;"))),
        "{said}"
    );
    let number = |r: &[String], c: usize| r[c].parse::<f64>().unwrap();
    let (columns, rows) = csv(&out.join("centerline-methods.csv"));
    assert_eq!(columns[4..7], ["mean error / mm", "95 % / mm", "largest / mm"]);
    assert_eq!(rows.len(), 4, "methods");
    assert!(rows.iter().all(|r| number(r, 4) <= number(r, 5) && number(r, 5) <= number(r, 6) && number(r, 2) > 0.0));
    assert!(number(&rows[0], 4) < 0.35 && (1..4).all(|n| number(&rows[n], 4) > number(&rows[0], 4)), "{rows:?}");
    let (_, rows) = csv(&out.join("distance-methods.csv"));
    assert_eq!(rows.len(), 3);
    assert!(number(&rows[0], 4) == 0.0 && number(&rows[1], 4) > 0.12 && number(&rows[2], 4) > number(&rows[1], 4));
    assert!(
        number(&rows[0], 6) < 0.1 && number(&rows[0], 6) < number(&rows[1], 6),
        "the exact one is nearer to the wall"
    );
    let (columns, rows) = csv(&out.join("slices.csv"));
    let column = |name: &str| columns.iter().position(|c| c == name).unwrap();
    assert_eq!(rows.len(), 2 * (7 + 3), "seeds; settings with limbs that touch and without");
    let [share, skips, skip, status] = ["share / %", "skips", "largest skip / mm", "exit status"].map(column);
    for r in rows.iter().filter(|r| r[status] == "0") {
        assert!((1.0..110.0).contains(&number(r, share)), "{r:?}");
        assert_eq!(r[skips] == "0", r[skip].is_empty(), "{r:?}");
        assert!(r[skip].is_empty() || number(r, skip) > 40.0, "{r:?}");
    }
    assert!(rows.iter().all(|r| r[status] == "0" || r[share].is_empty()));
}
