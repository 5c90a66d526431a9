//! What is measured of a case: the columns of the table, and where its record has them.

use serde_json::Value;

/// Where a number stands in a record.
#[derive(Clone, Copy)]
enum At {
    /// A statistic of a step.
    Number(&'static str, &'static str),
    /// The number of entries of a list in the statistics of a step.
    Count(&'static str, &'static str),
    /// The length of all stretches (from, to) of a list.
    Length(&'static str, &'static str),
    /// The seconds of all steps.
    Seconds,
    /// The peak memory of the step that took most.
    Peak,
}

/// A number that every case may have.
pub(super) struct Measure {
    /// Its column in the table.
    pub(super) name: &'static str,
    /// Its name on the page.
    pub(super) title: &'static str,
    /// Its unit on the page, and what a number of the table is multiplied with.
    pub(super) unit: &'static str,
    pub(super) scale: f64,
    /// True if the page shows its distribution and looks for outliers in it.
    pub(super) is_shown: bool,
    at: At,
}

const fn shown(name: &'static str, title: &'static str, (unit, scale): (&'static str, f64), at: At) -> Measure {
    Measure { name, title, unit, scale, is_shown: true, at }
}

const fn listed(name: &'static str, at: At) -> Measure {
    Measure { name, title: "", unit: "", scale: 1.0, is_shown: false, at }
}

const ML: (&str, f64) = ("ml", 1.0);
const MM: (&str, f64) = ("mm", 1.0);
const SHARE: (&str, f64) = ("%", 100.0);
const COUNT: (&str, f64) = ("", 1.0);
const MIB: (&str, f64) = ("MiB", 1.0 / 1_048_576.0);

/// All of them, in the order of the table and of the page.
pub(super) const MEASURES: [Measure; 19] = [
    shown("length_mm", "Length of the centerline", MM, At::Number("centerline", "length_mm")),
    shown("guessed_mm", "Collapsed length", MM, At::Length("centerline", "guessed_mm")),
    shown("lumen_ml", "Volume of the lumen", ML, At::Number("segment", "lumen_ml")),
    shown("fluid_ml", "Tagged fluid", ML, At::Number("segment", "fluid_ml")),
    shown("segments", "Segments", COUNT, At::Count("segment", "segments")),
    shown("caliber_mm", "Mean caliber", MM, At::Number("centerline", "caliber_mm")),
    shown("least_caliber_mm", "Least caliber", MM, At::Number("centerline", "least_caliber_mm")),
    shown("distended", "Length that is distended", SHARE, At::Number("centerline", "distended")),
    shown("coverage", "Coverage", SHARE, At::Number("coverage", "coverage")),
    listed("coverage_both_ways", At::Number("coverage", "coverage_both_ways")),
    listed("missed", At::Count("coverage", "missed")),
    shown("candidates", "Candidates", COUNT, At::Number("candidates", "candidates")),
    listed("replaced_ml", At::Number("cleanse", "replaced_ml")),
    listed("residue_ml", At::Number("cleanse", "residue_ml")),
    listed("flown_mm", At::Number("fly", "length_mm")),
    listed("surface_mm2", At::Number("surface", "area_mm2")),
    listed("surface_ml", At::Number("surface", "volume_ml")),
    shown("seconds", "Time", ("s", 1.0), At::Seconds),
    shown("peak_bytes", "Peak memory", MIB, At::Peak),
];

/// The numbers of a case, in the order of [`MEASURES`].
pub(super) type Values = [Option<f64>; MEASURES.len()];

/// Returns the numbers of a case from the steps of its record.
pub(super) fn values(steps: &Value) -> Values {
    let costs = |name: &str| {
        let all = steps.as_object().into_iter().flatten();
        all.filter_map(|(_, made)| made["times"][name].as_f64()).collect::<Vec<_>>()
    };
    let list = |step: &str, name: &str| steps[step]["results"][name].as_array();
    let number = |at: At| match at {
        At::Number(step, name) => steps[step]["results"][name].as_f64(),
        At::Count(step, name) => list(step, name).map(|l| l.len() as f64),
        At::Length(step, name) => {
            let length = |span: &Value| Some(span[1].as_f64()? - span[0].as_f64()?);
            list(step, name).map(|l| l.iter().filter_map(length).fold(0.0, |a, b| a + b))
        }
        At::Seconds => costs("seconds").into_iter().reduce(|a, b| a + b),
        At::Peak => costs("peak_rss_bytes").into_iter().reduce(f64::max),
    };
    std::array::from_fn(|n| number(MEASURES[n].at).filter(|x| x.is_finite()))
}

/// Returns a number for the page: with as many digits as tell something.
pub(super) fn short(x: f64) -> String {
    let size = x.abs();
    let digits = match size {
        _ if size >= 1e9 => return format!("{x:.2e}"),
        _ if size.fract() == 0.0 || size >= 100.0 => 0,
        _ if size >= 10.0 => 1,
        _ => 2,
    };
    let text = format!("{x:.digits$}");
    let text = if digits > 0 { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// Returns a number with its unit, on one line.
pub(super) fn with_unit(x: f64, unit: &str) -> String {
    if unit.is_empty() { short(x) } else { format!("{}\u{a0}{unit}", short(x)) }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn numbers_are_found_where_the_commands_write_them() {
        let steps = json!({
            "centerline": {
                "results": {"length_mm": 900.5, "guessed_mm": [[10.0, 15.5], [20.0, 22.0], "x"], "caliber_mm": "wide"},
                "times": {"seconds": 1.5, "peak_rss_bytes": 300},
            },
            "segment": {"results": {"segments": [1, 2, 3], "lumen_ml": null}, "times": {"seconds": 2, "peak_rss_bytes": 200}},
            "fly": 3,
        });
        let of = |steps: &Value, name: &str| values(steps)[MEASURES.iter().position(|m| m.name == name).unwrap()];
        for (name, expected) in [
            ("length_mm", Some(900.5)),
            ("guessed_mm", Some(7.5)),
            ("segments", Some(3.0)),
            ("lumen_ml", None),
            ("caliber_mm", None),
            ("coverage", None),
            ("seconds", Some(3.5)),
            ("peak_bytes", Some(300.0)),
        ] {
            assert_eq!(of(&steps, name), expected, "{name}");
        }
        for steps in [json!(null), json!([1]), json!({}), json!({"segment": []})] {
            assert!(values(&steps).iter().all(Option::is_none), "{steps}");
        }
    }

    #[test]
    fn numbers_are_short() {
        for (x, text) in [
            (0.0, "0"),
            (-0.001, "0"),
            (18.0, "18"),
            (1234.56, "1235"),
            (99.5, "99.5"),
            (7.126, "7.13"),
            (-7.1, "-7.1"),
            (120.0, "120"),
            (2e12, "2.00e12"),
        ] {
            assert_eq!(short(x), text);
        }
        assert_eq!([with_unit(1.0, "mm"), with_unit(1.0, "")], ["1\u{a0}mm", "1"]);
    }
}
