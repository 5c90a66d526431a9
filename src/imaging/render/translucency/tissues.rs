//! The table of ranges of HU: what each looks like, and how much of the light it stops.

use serde::Deserialize;

use crate::error::{Error, Result};
use crate::render::Options;

/// The most ranges of a table.
pub(super) const MOST_RANGES: usize = 8;
/// The largest depth, mm.
const DEEPEST_MM: f64 = 30.0;
/// Two ranges that touch blend over this width, HU.
const NARROWEST_HU: f64 = 1.0;
/// The longest name of a range, characters: it stands in a legend.
const LONGEST_NAME: usize = 24;

/// A range of HU in the table of [`TranslucencySettings`].
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TissueRange {
    /// What it is, for the legend.
    pub name: String,
    /// The first and the last value, HU. Between two ranges the colour changes evenly.
    pub hu: [f64; 2],
    /// Its colour on a bright wall: red, green, blue.
    pub colour: [u8; 3],
    /// The share of the light that one mm of it stops, above 0 and up to 1. A range with more of it shows through less of another.
    pub opacity: f64,
}

/// What the colour of the wall says about what lies behind it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TranslucencySettings {
    /// How far behind the wall is looked, along its normal, mm.
    pub depth_mm: f64,
    /// The radius of the lens at the pointer, as a share of the picture's shorter side.
    pub lens: f64,
    /// From the least values to the largest.
    pub ranges: Vec<TissueRange>,
}

impl Default for TranslucencySettings {
    /// Gas behind a thin wall is blue, fat yellow, soft tissue red and tag white. Readers who do not tell red from green see white,
    /// blue, and two yellows of which fat's is twice as strong.
    fn default() -> Self {
        let range = |name: &str, hu, colour, opacity| TissueRange { name: name.to_owned(), hu, colour, opacity };
        Self {
            depth_mm: 5.0,
            lens: 0.2,
            ranges: vec![
                range("gas", [-1024.0, -350.0], [70, 140, 255], 0.2),
                range("fat", [-140.0, -40.0], [255, 205, 0], 0.3),
                range("soft tissue", [-5.0, 110.0], [222, 92, 90], 0.25),
                range("tag", [160.0, 3071.0], [255, 255, 255], 0.7),
            ],
        }
    }
}

impl TranslucencySettings {
    /// Reads and checks the settings in a table.
    ///
    /// # Errors
    /// Returns status 2 if a setting is unknown or out of range, or if ranges overlap or are not in order.
    pub fn read(options: Options) -> Result<Self> {
        let settings: Self = options.read("translucency")?;
        settings.in_range()?;
        Ok(settings)
    }

    /// Checks that all numbers are in range, and that the ranges are in order and do not overlap.
    ///
    /// # Errors
    /// Returns status 2 for the first that is not.
    pub fn in_range(&self) -> Result<()> {
        let within = |what: &str, value: f64, above: f64, most: f64, unit: &str| {
            if value > above && value <= most {
                return Ok(());
            }
            let hint = format!("give a number above {above} and up to {most}{unit}");
            Err(Error::usage(format!("translucency.{what}"), format!("is {value}"), hint))
        };
        within("depth_mm", self.depth_mm, 0.0, DEEPEST_MM, "")?;
        within("lens", self.lens, 0.0, 1.0, ", a share of the picture's shorter side")?;
        if !(1..=MOST_RANGES).contains(&self.ranges.len()) {
            let why = format!("has {} ranges", self.ranges.len());
            return Err(Error::usage("translucency.ranges", why, format!("give 1 to {MOST_RANGES}")));
        }
        for (n, range) in self.ranges.iter().enumerate() {
            let what = |part: &str| format!("ranges[{n}].{part}");
            if range.name.is_empty() || range.name.chars().count() > LONGEST_NAME {
                let hint = format!("give 1 to {LONGEST_NAME} characters");
                return Err(Error::usage(
                    format!("translucency.{}", what("name")),
                    format!("is {:?}", range.name),
                    hint,
                ));
            }
            within(&what("opacity"), range.opacity, 0.0, 1.0, ", a share for each mm")?;
            let [low, high] = range.hu;
            if !(low.is_finite() && high.is_finite() && low < high) {
                let why = format!("is [{low}, {high}]");
                let hint = "give the lower value first, both finite";
                return Err(Error::usage(format!("translucency.{}", what("hu")), why, hint));
            }
            if let Some(before) = n.checked_sub(1).map(|n| &self.ranges[n]).filter(|before| before.hu[1] > low) {
                let why = format!("{} begins at {low}, before {} ends at {}", range.name, before.name, before.hu[1]);
                let hint = "order the ranges by their values, without overlap";
                return Err(Error::usage(format!("translucency.{}", what("hu")), why, hint));
            }
        }
        Ok(())
    }
}

/// Between two ranges of the table, how colour and opacity change.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Ramp {
    /// Where it begins, HU.
    pub from: f32,
    /// One over its width, 1/HU.
    pub scale: f32,
    /// The change of the opacity of a step over it.
    pub stops: f32,
    /// The change of the opacity times the colour over it.
    pub light: [f32; 3],
}

/// The table as a sum of ramps: what a step through a value stops, and the colour that it gives for that.
///
/// A step through values between two ranges is that share of a step through each.
#[derive(Clone, Debug)]
pub(super) struct Ramps {
    /// The opacity of a step through the first range.
    pub stops: f32,
    /// That times its colour, 0 to 255.
    pub light: [f32; 3],
    all: [Ramp; MOST_RANGES - 1],
    count: usize,
}

impl Ramps {
    /// Prepares the table for steps of `step_mm`.
    pub(super) fn new(settings: &TranslucencySettings, step_mm: f64) -> Self {
        let stops = |range: &TissueRange| 1.0 - (1.0 - range.opacity.min(1.0)).powf(step_mm);
        let light = |range: &TissueRange| range.colour.map(|c| f64::from(c) * stops(range));
        let mut all = [Ramp::default(); MOST_RANGES - 1];
        for (ramp, pair) in all.iter_mut().zip(settings.ranges.windows(2)) {
            let [a, b] = [&pair[0], &pair[1]];
            let (from, width) = (a.hu[1], (b.hu[0] - a.hu[1]).max(NARROWEST_HU));
            let (old, new) = (light(a), light(b));
            *ramp = Ramp {
                from: from as f32,
                scale: (1.0 / width) as f32,
                stops: (stops(b) - stops(a)) as f32,
                light: [0, 1, 2].map(|c| (new[c] - old[c]) as f32),
            };
        }
        let first = settings.ranges.first();
        Self {
            stops: first.map_or(0.0, |r| stops(r) as f32),
            light: first.map_or([0.0; 3], |r| light(r).map(|c| c as f32)),
            all,
            count: settings.ranges.len().clamp(1, MOST_RANGES) - 1,
        }
    }

    /// Returns the ramps in order.
    #[inline(always)]
    pub(super) fn all(&self) -> &[Ramp] {
        &self.all[..self.count]
    }
}
