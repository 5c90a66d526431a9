//! Adds a shader to colvis: light that falls off with distance, and a gloss.
//!
//! `cargo run --release --example own_shader -- fly --scene lamp.toml`. In `lamp.toml`: `plugins = ["tentacles", "mines",
//! "watch"]`, `[render]` `shade = "lamp"`, and optionally `[lamp]` `reach_mm = 60.0`.

use std::sync::Arc;

use colvis::error::{Error, Result};
use colvis::glam::Vec3;
use colvis::render::shaders::headlight::tissue;
use colvis::render::{Options, Shader, ShaderModel, SurfacePoint};

const LAMP: ShaderModel =
    ShaderModel { name: "lamp", summary: "a lamp at the camera, and wet mucosa", make: lamp, ..ShaderModel::BASE };

/// The shader's settings. At `reach_mm` half of the light is left.
#[derive(Debug, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Lamp {
    reach_mm: f32,
    gloss: f32,
}

impl Default for Lamp {
    fn default() -> Self {
        Self { reach_mm: 40.0, gloss: 0.4 }
    }
}

fn lamp(options: Options) -> Result<Arc<dyn Shader>> {
    let lamp: Lamp = options.read("lamp")?;
    if lamp.reach_mm > 0.0 && lamp.reach_mm.is_finite() {
        return Ok(Arc::new(lamp));
    }
    Err(Error::usage("lamp.reach_mm", format!("{} is not above 0", lamp.reach_mm), "give millimetres"))
}

impl Shader for Lamp {
    fn colour(&self, point: &SurfacePoint) -> Vec3 {
        let light = 1.0 / (1.0 + (point.distance_mm / self.reach_mm).powi(2));
        (tissue(point.hu) * point.facing + self.gloss * point.facing.powi(40)) * light
    }

    /// It has no texture and no lines, so pixels between rays may be interpolated.
    fn is_smooth(&self) -> bool {
        true
    }
}

fn main() -> std::process::ExitCode {
    colvis::cli::Program::default().shader(LAMP).run()
}

#[test]
fn what_is_far_is_dark() -> Result<()> {
    use colvis::app::{Catalog, FlightRequest, Scan, Scene};
    let lit = |mm: u32| -> Result<u64> {
        let text = format!("plugins = [\"path\"]\n[render]\nshade = \"lamp\"\n[lamp]\nreach_mm = {mm}.0");
        let scene = Scene::parse(&text, &Catalog::default().shader(LAMP))?;
        let frame = Scan::phantom(1)?.flight(scene, &FlightRequest::default())?.look(64, 64)?;
        Ok(frame.pixels().iter().map(|p| u64::from(p[0])).sum())
    };
    Ok(assert!(lit(10)? < lit(40)? && lit(40)? < lit(1000)? && lit(0).is_err()))
}
