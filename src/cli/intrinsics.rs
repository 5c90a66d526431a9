//! The camera of a poses file: the intrinsics of a calibration.

use std::path::Path;
use std::sync::Arc;

use serde_json::{Map, Value};

use crate::cli::args::ImageSize;
use crate::error::{Error, Kind, Result};
use crate::render::camera::{Camera, Pixels, fisheye, pinhole, scaramuzza};

/// How such a camera is written.
const HINT: &str = r#"give {"model": "perspective", "fx", "fy", "cx", "cy"}, {"model": "fisheye", …, "k": [k1,k2,k3,k4]} or {"model": "scaramuzza", "a": [a0,a2,a3,a4], "cx", "cy", "stretch": [c,d,e]}"#;

/// Returns the camera that `value` describes, for images of a `size`: its numbers are pixels of these images.
///
/// Fails with status 2 for an unknown model, and for numbers that are missing or describe no camera.
pub(crate) fn camera(path: &Path, value: &Value, size: ImageSize) -> Result<Arc<dyn Camera>> {
    let refuse = |why: String, hint: String| Error::usage(format!("camera in {}", path.display()), why, hint);
    let fields = Fields { map: value.as_object().ok_or_else(|| refuse("is not an object".into(), HINT.into()))? };
    let named = fields.map.get("model").and_then(Value::as_str);
    let made = || -> std::result::Result<Result<Arc<dyn Camera>>, String> {
        let pixels = || {
            Ok::<_, String>(Pixels {
                size: [size.width, size.height],
                centre: [fields.number("cx")?, fields.number("cy")?],
            })
        };
        let focal = || Ok::<_, String>([fields.number("fx")?, fields.number("fy")?]);
        Ok(match named {
            Some("perspective") => pinhole::pinhole(pixels()?, focal()?),
            Some("fisheye") => {
                fisheye::kannala_brandt(pixels()?, focal()?, fields.numbers("k")?).map(|c| Arc::new(c) as _)
            }
            Some("scaramuzza") => {
                let (a, stretch) = (fields.numbers("a")?, fields.numbers("stretch")?);
                scaramuzza::scaramuzza(pixels()?, a, stretch).map(|c| Arc::new(c) as _)
            }
            Some(other) => return Err(format!("{other:?} is no model that it may have")),
            None => return Err("has no \"model\"".into()),
        })
    };
    made().map_err(|why| refuse(why, HINT.into()))?.map_err(|e| match e.kind {
        Kind::Usage => refuse(e.why, e.hint),
        _ => e,
    })
}

struct Fields<'a> {
    map: &'a Map<String, Value>,
}

impl Fields<'_> {
    fn number(&self, name: &str) -> std::result::Result<f64, String> {
        self.map.get(name).and_then(Value::as_f64).ok_or_else(|| format!("has no number {name:?}"))
    }

    fn numbers<const N: usize>(&self, name: &str) -> std::result::Result<[f64; N], String> {
        let all: Option<Vec<f64>> =
            self.map.get(name).and_then(Value::as_array).and_then(|all| all.iter().map(Value::as_f64).collect());
        all.and_then(|all| all.try_into().ok()).ok_or_else(|| format!("has no {N} numbers {name:?}"))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    const SIZE: ImageSize = ImageSize { width: 640, height: 480 };

    fn made(value: &Value) -> Result<Arc<dyn Camera>> {
        camera(Path::new("poses.json"), value, SIZE)
    }

    #[test]
    fn each_model_is_read() {
        let flat = json!({"model": "perspective", "fx": 240, "fy": 240, "cx": 319.5, "cy": 239.5});
        assert!(made(&flat).unwrap().tangent().is_some_and(|t| (t - 1.0).abs() < 1e-12));
        let round = json!({"model": "fisheye", "fx": 300.5, "fy": 300, "cx": 310, "cy": 250, "k": [0.1, 0, 0, 0]});
        assert!(made(&round).unwrap().form().is_some());
        let taylor =
            json!({"model": "scaramuzza", "a": [300, -0.001, 0, 0], "cx": 310, "cy": 250, "stretch": [1, 0, 0]});
        assert!(made(&taylor).unwrap().form().is_some());
    }

    #[test]
    fn what_is_wrong_is_named_with_status_2() {
        for (value, why) in [
            (json!(7), "is not an object"),
            (json!({"fx": 3}), "has no \"model\""),
            (json!({"model": "keyhole"}), "\"keyhole\""),
            (json!({"model": "perspective", "fx": 3, "fy": 3, "cx": 1}), "\"cy\""),
            (json!({"model": "perspective", "fx": "3", "fy": 3, "cx": 1, "cy": 1}), "\"fx\""),
            (json!({"model": "perspective", "fx": null, "fy": 3, "cx": 1, "cy": 1}), "\"fx\""),
            (json!({"model": "perspective", "fx": 0, "fy": 3, "cx": 1, "cy": 1}), "fx is 0"),
            (json!({"model": "fisheye", "fx": 3, "fy": 3, "cx": 1, "cy": 1, "k": [1, 2, 3]}), "4 numbers \"k\""),
            (json!({"model": "fisheye", "fx": 3, "fy": 3, "cx": 1, "cy": 1, "k": [1e300, 2, 3, 4]}), "k1"),
            (json!({"model": "scaramuzza", "a": [-3, 0, 0, 0], "cx": 1, "cy": 1, "stretch": [1, 0, 0]}), "never grow"),
            (json!({"model": "scaramuzza", "a": [3, 0, 0, 0], "cx": 1, "cy": 1, "stretch": [0, 0, 0]}), "no inverse"),
        ] {
            let e = made(&value).unwrap_err();
            assert_eq!((e.kind, e.what.as_str()), (Kind::Usage, "camera in poses.json"), "{value}");
            assert!(e.why.contains(why), "{value}: {e}");
        }
    }
}
