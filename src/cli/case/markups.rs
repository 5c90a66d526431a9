//! Findings and lines in the format of 3D Slicer's markups.

use glam::DVec3;
use serde_json::{Value, json};

use crate::app::findings::{Finding, Findings};
use crate::fields::centerline::Centerline;

/// The colour of findings.
const COLOUR: [f64; 3] = [1.0, 0.47, 0.78];

/// Returns a file of these markups.
fn file(markups: &[Value]) -> Value {
    json!({
        "@schema": "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/\
                    markups-schema-v1.0.3.json#",
        "markups": markups,
    })
}

/// Returns a control point, world mm LPS.
fn point(id: usize, label: &str, description: &str, at: DVec3, is_visible: bool) -> Value {
    json!({
        "id": id.to_string(), "label": label, "description": description, "associatedNodeID": "",
        "position": at, "orientation": [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0],
        "selected": true, "locked": true, "visibility": is_visible, "positionStatus": "defined",
    })
}

/// Returns a curve.
pub(crate) fn curve(line: &Centerline) -> Value {
    let points: Vec<Value> = line.points.iter().enumerate().map(|(n, p)| point(n + 1, "", "", *p, false)).collect();
    file(&[json!({
        "type": "Curve", "coordinateSystem": "LPS", "coordinateUnits": "mm", "locked": true,
        "labelFormat": "%N-%d", "lastUsedControlPointNumber": points.len(),
        "controlPoints": points, "measurements": [],
    })])
}

/// Returns the findings: one list of points with their names, those outside the colon in another, and a line for each diameter.
pub(super) fn findings(all: &Findings) -> Value {
    let display =
        json!({ "visibility": true, "color": COLOUR, "selectedColor": COLOUR, "textScale": 3.0, "glyphScale": 2.0 });
    let list = |name: &str, points: Vec<Value>| {
        json!({
            "type": "Fiducial", "name": name, "coordinateSystem": "LPS", "coordinateUnits": "mm", "locked": true,
            "labelFormat": "%N-%d", "lastUsedControlPointNumber": points.len(),
            "controlPoints": points, "measurements": [], "display": display,
        })
    };
    let own = all.findings.iter().enumerate();
    let own = own.map(|(n, f)| point(n + 1, &name(f), &f.note, f.place, true)).collect();
    let outside = all.outside.iter().enumerate();
    let outside: Vec<Value> = outside.map(|(n, o)| point(n + 1, &o.category, &o.text, o.place, true)).collect();
    let mut markups = vec![list("findings", own)];
    if !outside.is_empty() {
        markups.push(list("outside the colon", outside));
    }
    for (f, [a, b]) in all.findings.iter().filter_map(|f| Some((f, f.ends?))) {
        let points =
            [a, b].into_iter().enumerate().map(|(n, at)| point(n + 1, &format!("{}-{}", f.id, n + 1), "", at, true));
        markups.push(json!({
            "type": "Line", "name": format!("finding {} diameter", f.id), "coordinateSystem": "LPS",
            "coordinateUnits": "mm", "locked": true, "labelFormat": "%N-%d", "lastUsedControlPointNumber": 2,
            "controlPoints": points.collect::<Vec<_>>(),
            "measurements": [{ "name": "length", "enabled": true, "value": a.distance(b), "units": "mm", "printFormat": "%-#4.4g%s" }],
            "display": display,
        }));
    }
    file(&markups)
}

/// Returns a finding's name: "2, sigmoid, 8.8 mm".
fn name(finding: &Finding) -> String {
    let size = finding.diameter_mm.map(|mm| format!("{mm:.1} mm"));
    let parts = [Some(finding.id.clone()), finding.segment.clone(), size];
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::findings::Outside;

    #[test]
    fn points_and_diameters_have_their_places_and_names() {
        let place = DVec3::new(1.5, -2.0, 100.25);
        let ends = [place - DVec3::X * 3.0, place + DVec3::X * 4.0];
        let finding = Finding {
            id: "2".to_owned(),
            place,
            segment: Some("sigmoid".to_owned()),
            diameter_mm: Some(7.0),
            ends: Some(ends),
            note: "on a fold".to_owned(),
            ..Finding::default()
        };
        let bare = Finding { id: "3".to_owned(), place, ..Finding::default() };
        let outside = vec![Outside { place: DVec3::ZERO, category: "E3".to_owned(), text: "a cyst".to_owned() }];
        let file = findings(&Findings { findings: vec![finding, bare], outside, ..Findings::default() });
        let of = |n: usize| &file["markups"][n];
        assert_eq!(file["markups"].as_array().unwrap().len(), 3);
        assert_eq!(of(0)["controlPoints"][0]["label"], "2, sigmoid, 7.0 mm");
        assert_eq!(of(0)["controlPoints"][0]["position"], json!(place));
        assert_eq!(
            (&of(0)["controlPoints"][1]["label"], &of(1)["controlPoints"][0]["description"]),
            (&json!("3"), &json!("a cyst"))
        );
        assert_eq!((&of(2)["type"], &of(2)["measurements"][0]["value"]), (&json!("Line"), &json!(7.0)));
        assert_eq!(of(2)["controlPoints"][1]["position"], json!(ends[1]));
        let none = findings(&Findings::default());
        assert_eq!(none["markups"][0]["controlPoints"], json!([]));
    }
}
