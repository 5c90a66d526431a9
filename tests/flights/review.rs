//! Reviews: after the flight, a tour past what it has missed.

use std::path::Path;

use crate::support::logs::read_log;
use crate::support::program::colvis;
use crate::support::run::run;

/// Radius of the camera, mm.
const RADIUS_MM: f64 = 1.5;

#[test]
fn a_review_shows_what_was_missed_and_is_the_same_on_one_thread_and_two() {
    let reviews = ["1", "2"].map(|threads| {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
        let out = colvis()
            .args(["fly", "--headless", "--guide", "path", "--review", "--threads", threads])
            .args(["--log", &at("f.jsonl"), "--stats", &at("s.json")])
            .output()
            .unwrap();
        let told = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(out.status.success() && told.contains("review: ") && told.contains("flying back"), "{told}");
        let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(at("s.json")).unwrap()).unwrap();
        let log = read_log(Path::new(&at("f.jsonl")));
        assert!(log.iter().all(|l| l.clearance_mm >= RADIUS_MM), "no perforation");
        let share = |name: &str| stats[name].as_f64().unwrap();
        let [before, both, after] = ["coverage", "coverage_both_ways", "coverage_after_review"].map(share);
        println!("coverage {before:.3}, both ways {both:.3}, after the review {after:.3}; {}", stats["review"]);
        assert!(before < both && both < after && after >= 0.97, "{before} {both} {after}");
        // The flight's own figures are without the review.
        let review = &stats["review"];
        assert!(stats["state"] == "arrived" && review["seconds"].as_f64().unwrap() > 10.0);
        let all = stats["seconds"].as_f64().unwrap() + review["seconds"].as_f64().unwrap();
        assert!((all - log[log.len() - 1].t).abs() < 0.1, "{all} s of {}", log[log.len() - 1].t);
        assert!(review["reached"] == review["stops"] && review["left_out"] == 0);
        let order = |name: &str| review[name][0].as_f64().unwrap();
        assert!(order("order_mm") <= order("order_best_of_1000_mm"));
        assert!(stats["prepare"]["review_s"].as_f64().unwrap() > 0.0);
        let seen = [before, both, after].map(f64::to_bits);
        (std::fs::read(at("f.jsonl")).unwrap(), seen, review.clone(), stats["better_direction"].clone())
    });
    assert!(reviews[0] == reviews[1]);
    run(&["fly", "--headless", "--play", "x.jsonl", "--review"], 2);
}
