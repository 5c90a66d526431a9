//! How the pictures look: the options.

use crate::cli::args::DatasetArgs;
use crate::dataset::look::{Look, Mucosa, Sensor};
use crate::error::{Error, Result};

/// The most noise, as a multiple of the usual.
const MOST_NOISE: f64 = 100.0;

/// Returns the look of the arguments. Fails with status 2 for values that are none.
pub(super) fn of(args: &DatasetArgs) -> Result<Look> {
    let no = |name: &str, why: String, fix: &str| Err(Error::usage(name, why, fix));
    let exposure = match (args.exposure.as_str(), args.exposure.parse::<f64>()) {
        ("auto", _) => None,
        (_, Ok(x)) if (1e-6..=1e9).contains(&x) => Some(x),
        (text, _) => return no("--exposure", format!("{text:?} is no exposure"), "give auto, or a number above 0"),
    };
    if !(1.0..=3.0).contains(&args.gamma) {
        return no("--gamma", format!("{} is not from 1 to 3", args.gamma), "give 2.2 for most screens");
    }
    if !(0.0..=MOST_NOISE).contains(&args.noise) {
        return no("--noise", format!("{} is not from 0 to {MOST_NOISE}", args.noise), "give 1 for the usual noise");
    }
    if !(1..=2).contains(&args.lights) {
        return no("--lights", format!("there is no place for {}", args.lights), "give 1 or 2");
    }
    let (usual, sensor) = (Look::default(), Sensor::default());
    Ok(Look {
        lights_mm: Look::lights(args.lights),
        shadows: args.shadows,
        mucosa: Mucosa::named(&args.mucosa).unwrap_or(Mucosa::Mild),
        linear: args.linear,
        sensor: Sensor { exposure, gamma: args.gamma, shot: sensor.shot * args.noise, read: sensor.read * args.noise },
        ..usual
    })
}

/// Returns the options of the arguments that are not the usual ones, as they are written.
pub(super) fn options(args: &DatasetArgs) -> impl Iterator<Item = String> {
    [
        (args.mucosa != "mild").then(|| format!("--mucosa {}", args.mucosa)),
        (args.lights != 2).then(|| format!("--lights {}", args.lights)),
        args.shadows.then(|| "--shadows".to_owned()),
        (args.exposure != "auto").then(|| format!("--exposure {}", args.exposure)),
        (args.gamma != 2.2).then(|| format!("--gamma {}", args.gamma)),
        (args.noise != 1.0).then(|| format!("--noise {}", args.noise)),
        args.linear.then(|| "--linear".to_owned()),
        args.noise_seed.map(|seed| format!("--noise-seed {seed}")),
    ]
    .into_iter()
    .flatten()
}
