//! Reviews: after the flight, a tour past what it has missed.

use std::path::Path;

use colvis::components::output::LogLine;
use glam::DVec3;

use crate::support::logs::read_log;
use crate::support::program::colvis;
use crate::support::run::run;

/// Radius of the camera, mm.
const RADIUS_MM: f64 = 1.5;

#[test]
#[ignore = "slow: two flights with a review"]
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

#[test]
#[ignore = "slow: two flights with a review"]
fn a_review_looks_at_the_candidates_that_a_reader_is_unsure_of() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let mut place = DVec3::ZERO;
    let mut all = [0.0; 2];
    for (n, told) in all.iter_mut().enumerate() {
        let answer = |at: DVec3, answer: &str, rank: u32| serde_json::json!({"rank": rank, "position": at.to_array(), "answer": answer, "note": ""});
        let answers = [answer(place, "unsure", 1), answer(DVec3::splat(900.0), "unsure", 2), answer(place, "no", 3)];
        let file = serde_json::json!({"colvis": "answers", "scan": "", "answers": answers});
        std::fs::write(at("a.json"), file.to_string()).unwrap();
        let out = colvis()
            .args(["fly", "--headless", "--guide", "path", "--review", "--answers", &at("a.json")])
            .args(["--log", &at("f.jsonl"), "--stats", &at("s.json")])
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(out.status.success(), "{text}");
        let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(at("s.json")).unwrap()).unwrap();
        assert_eq!(stats["review"]["unsure"], 2);
        *told = stats["review"]["stops"].as_f64().unwrap();
        if n == 0 {
            // Neither is on the wall, but what was missed is.
            assert!(text.contains("2 of 2 unsure candidates"), "{text}");
            place = serde_json::from_value(stats["missed"][0]["position"].clone()).unwrap();
        } else {
            assert!(text.contains("1 of 2 unsure candidates"), "{text}");
            let log = read_log(Path::new(&at("f.jsonl")));
            let looks = |l: &&LogLine| {
                let to = place - DVec3::from_array(l.position);
                to.length() < 40.0 && to.normalize().dot(DVec3::from_array(l.forward)) > 0.99
            };
            assert!(log.iter().any(|l| looks(&l)), "the camera looks at it");
        }
    }
    assert!(all[1] > all[0], "{all:?}");
    run(&["fly", "--headless", "--answers", "a.json"], 2);
    run(&["fly", "--headless", "--review", "--answers", &at("none.json")], 3);
}
