//! What a reader finds in a scan: lesions of the colon, findings outside it, distances, answers to candidates, and kinds of gas.
//!
//! All of it is one file ([`Findings::read`], [`Findings::write`]), which names its scan by
//! [`content_hash`](crate::volume::content_hash). `colvis case` makes a report of it.

mod file;
mod lesion;
mod pictures;
mod place;
mod quality;
mod scheme;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::components::camera::Pose;
use crate::dynamics::Attitude;
use crate::fields::lumen::Told;
use crate::polyps::answers::Answered;
use crate::polyps::{Form, Measurement};

pub use file::NoScan;
#[doc(hidden)]
pub use file::{MOST_DISTANCES, MOST_KINDS, kinds};
pub use lesion::lesion_at;
pub use pictures::{FindingPicture, LEVEL_HU, WIDTH_HU};
pub use place::{normal_at, wall_near};
pub use quality::{DISTENDED_MM, QualityRule, SegmentFacts, add_seconds, judge, quality, quality_rules};
pub use scheme::{Draft, OutsideCategory, Scheme, SchemeRule};

/// What a reader finds in a scan. Places are world, mm LPS.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Findings {
    /// The hash of the scan, as [`content_hash`](crate::volume::content_hash) returns it; empty if it is not known.
    pub scan: String,
    /// Where the scan lies, as [`content_origin`](crate::volume::content_origin) returns it; `None` if it is not known.
    pub origin: Option<DVec3>,
    /// The hash of the scan in the patient's other position.
    pub second: Option<String>,
    /// Lesions of the colon, in the order in which they were made.
    pub findings: Vec<Finding>,
    /// Findings outside the colon.
    pub outside: Vec<Outside>,
    /// How well each segment of the colon could be read.
    pub quality: Vec<Quality>,
    /// Answers to candidates.
    pub answers: Vec<Answered>,
    /// The ends of each measured distance.
    pub distances: Vec<[DVec3; 2]>,
    /// Kinds that the reader gave to gas; `None` if the file does not tell.
    pub kinds: Option<Vec<Told>>,
}

impl Findings {
    /// Moves all places from where the scan lay when the findings were made to where it lies in a file with this origin, world mm.
    #[must_use]
    pub fn moved_to(mut self, origin: DVec3) -> Self {
        let by = self.origin.map_or(DVec3::ZERO, |before| origin - before);
        self.origin = Some(origin);
        // The precision of headers.
        if by.length() < 1e-3 {
            return self;
        }
        for f in &mut self.findings {
            let ends = f.ends.iter_mut().flatten();
            ends.chain(f.view.iter_mut().map(|v| &mut v.position)).chain([&mut f.place]).for_each(|place| *place += by);
        }
        self.outside.iter_mut().for_each(|o| o.place += by);
        self.answers.iter_mut().for_each(|a| a.position += by);
        self.distances.iter_mut().flatten().for_each(|end| *end += by);
        self.kinds.iter_mut().flatten().for_each(|(at, _)| *at += by);
        self
    }

    /// True if something was read: there is a finding, or a coverage or a time of a segment is noted.
    pub fn tells_a_reading(&self) -> bool {
        let is_read = |q: &Quality| q.coverage.is_some() || q.seconds > 0.0;
        !self.findings.is_empty() || !self.outside.is_empty() || self.quality.iter().any(is_read)
    }

    /// Returns an id that no finding has.
    pub fn new_id(&self) -> String {
        let numbers = self.findings.iter().filter_map(|f| f.id.parse::<u64>().ok());
        (numbers.max().unwrap_or(0) + 1).to_string()
    }
}

/// A lesion of the colon. What is not known is `None`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Finding {
    /// Its name, which no other finding in the file has.
    #[serde(deserialize_with = "file::text_or_number")]
    pub id: String,
    /// Where it is on the wall.
    pub place: DVec3,
    /// The direction from the wall into the lumen there, of unit length.
    pub normal: Option<DVec3>,
    /// The part of the colon, one of [`NAMES`](crate::fields::lumen::NAMES).
    pub segment: Option<String>,
    /// Distance along the colon from the rectum, mm.
    pub along_mm: Option<f64>,
    /// Largest diameter without a stalk, mm.
    pub diameter_mm: Option<f64>,
    /// The ends of that diameter.
    pub ends: Option<[DVec3; 2]>,
    /// Height above the wall, mm.
    pub height_mm: Option<f64>,
    /// Volume, mm³.
    pub volume_mm3: Option<f64>,
    /// Its form.
    pub morphology: Option<Morphology>,
    /// What it consists of.
    pub tissue: Option<Tissue>,
    /// How far it can be trusted, 0 to 1: that of its measures, until the reader says otherwise.
    pub confidence: Option<f64>,
    /// Free text.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// The pose that shows it.
    pub view: Option<View>,
    /// Its place in the second scan.
    pub other: Option<DVec3>,
}

impl Finding {
    /// True if it has this id and place (world, mm). An id alone may have been that of a finding that is deleted.
    #[doc(hidden)]
    pub fn is_at(&self, id: &str, place: DVec3) -> bool {
        self.id == id && self.place == place
    }

    /// Takes the measures of a lesion.
    pub fn measure(&mut self, measured: &Measurement) {
        let l = &measured.lesion;
        (self.diameter_mm, self.ends) = (Some(l.diameter_mm), Some(l.ends));
        // Heights above the base are summed with their signs: a low lesion on a bent wall may have none left.
        let volume_mm3 = Some(l.volume_mm3).filter(|mm3| *mm3 > 0.0);
        (self.height_mm, self.volume_mm3) = (Some(l.height_mm), volume_mm3);
        self.normal = l.axis.try_normalize();
        self.morphology = Some(Morphology::of(measured.form, l.diameter_mm));
        self.tissue = Tissue::of(l.feature("share_fat"), l.feature("hu_max"), l.diameter_mm);
        self.confidence = Some(measured.confidence);
    }

    /// Moves the ends of its diameter, which has their distance then. The volume that belonged to the former ends is not known any more.
    /// The height stays: the ends of the same lesion are often a little off. It is not known any more once the diameter changes by more
    /// than a third of what it was: then another base was measured.
    pub fn correct(&mut self, ends: [DVec3; 2]) {
        let mm = ends[0].distance(ends[1]);
        self.volume_mm3 = None;
        if self.diameter_mm.is_some_and(|before| (mm - before).abs() > before / 3.0) {
            self.height_mm = None;
        }
        (self.diameter_mm, self.ends) = (Some(mm), Some(ends));
        // What was a mass by its size alone, or is one now.
        match self.morphology {
            Some(Morphology::Mass) if mm < MASS_MM => self.morphology = Some(Morphology::Sessile),
            Some(_) if mm >= MASS_MM => self.morphology = Some(Morphology::Mass),
            _ => {}
        }
    }
}

/// The form of a lesion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Morphology {
    /// It stands on the wall with a broad base.
    Sessile,
    /// It hangs on a stalk.
    Pedunculated,
    /// It is low for its width.
    Flat,
    /// It is 30 mm wide or more.
    Mass,
}

/// Diameter from which a lesion is a mass, mm (C-RADS 2023).
pub const MASS_MM: f64 = 30.0;

impl Morphology {
    /// All forms, in the order in which readers list them.
    pub const ALL: [Self; 4] = [Self::Sessile, Self::Pedunculated, Self::Flat, Self::Mass];

    /// Returns its name, as in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sessile => "sessile",
            Self::Pedunculated => "pedunculated",
            Self::Flat => "flat",
            Self::Mass => "mass",
        }
    }

    /// Returns the form of a lesion with this measured form and largest diameter, mm.
    pub fn of(form: Form, diameter_mm: f64) -> Self {
        match form {
            _ if diameter_mm >= MASS_MM => Self::Mass,
            Form::Stalked => Self::Pedunculated,
            Form::Flat => Self::Flat,
            _ => Self::Sessile,
        }
    }
}

/// A lesion of a smaller diameter than this is blurred throughout, mm.
const BLURRED_MM: f64 = 6.0;

/// Fat is nowhere brighter than this, HU: it is at about -100 HU, and this leaves room for noise.
const FAT_MOST_HU: f64 = -20.0;

/// What a lesion consists of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Tissue {
    /// Soft tissue.
    Soft,
    /// Fat: a lipoma.
    Fat,
}

impl Tissue {
    /// Both kinds.
    pub const ALL: [Self; 2] = [Self::Soft, Self::Fat];

    /// Returns its name, as in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Soft => "soft",
            Self::Fat => "fat",
        }
    }

    /// Returns the tissue of a lesion of this largest diameter, mm, of which this share has the values of fat, 0 to 1, and whose brightest
    /// place has this value, HU. `None` if it cannot be told: a small or thin lesion is blurred with the gas around it, and has values of
    /// fat whatever it consists of. Only what is soft nowhere is called fat, because fat does not count as a polyp.
    pub fn of(share_fat: f64, hu_max: f64, diameter_mm: f64) -> Option<Self> {
        match share_fat > 0.5 {
            true if diameter_mm < BLURRED_MM || hu_max > FAT_MOST_HU => None,
            true => Some(Self::Fat),
            false => Some(Self::Soft),
        }
    }
}

/// A pose that shows a finding, as in lists of poses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// Where the camera is.
    pub position: DVec3,
    /// Where it looks, of unit length.
    pub forward: DVec3,
    /// Upwards in the picture, of unit length, at a right angle to `forward`.
    pub up: DVec3,
    /// The vertical angle of view, degrees.
    pub fov_degrees: f64,
}

impl View {
    /// Returns the view of a camera.
    pub fn new(pose: Pose, fov_degrees: f64) -> Self {
        Self { position: pose.position, forward: pose.attitude.forward, up: pose.attitude.up, fov_degrees }
    }

    /// Returns the pose of the camera.
    pub fn pose(&self) -> Pose {
        Pose { position: self.position, attitude: Attitude::new(self.forward, self.up) }
    }
}

/// A finding outside the colon.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outside {
    /// Where it is.
    pub place: DVec3,
    /// Its category in the scheme of the report, such as `E3`; may be empty.
    #[serde(default)]
    pub category: String,
    /// What it is.
    #[serde(default)]
    pub text: String,
}

/// How well a segment of the colon could be read.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Quality {
    /// The part of the colon, one of [`NAMES`](crate::fields::lumen::NAMES).
    pub segment: String,
    /// Its length, mm.
    pub length_mm: f64,
    /// The share of its length that is distended, 0 to 1.
    pub distended: f64,
    /// Its least caliber, mm.
    pub least_caliber_mm: f64,
    /// The share of its wall under tagged fluid, 0 to 1.
    pub fluid: f64,
    /// The share of its wall that was seen, 0 to 1; `None` if that was not watched.
    pub coverage: Option<f64>,
    /// How long it was looked at, seconds.
    pub seconds: f64,
    /// True if it can be read.
    pub adequate: bool,
}
