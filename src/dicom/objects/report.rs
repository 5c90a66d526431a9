//! Structured reports: a tree of content items (PS3.3, C.17.3), in a Comprehensive 3D SR (PS3.3, A.35.13).

use std::collections::BTreeMap;
use std::io::{self, Write};

use dicom_core::PrimitiveValue;
use dicom_dictionary_std::{tags, uids};
use glam::DVec3;

use super::set::{Code, Set, decimal, long, short};
use super::study::{About, Study};

/// A reference to an image, or to frames or a segment of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageReference {
    /// UID of its series.
    pub series: String,
    /// UID of its SOP class.
    pub class: String,
    /// UID of the object.
    pub instance: String,
    /// Numbers of frames, from 1; all if empty.
    pub frames: Vec<u32>,
}

/// What a content item says.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// What its children say. A template (PS3.16) that they follow may be named by its number.
    Container(Option<&'static str>),
    /// A text.
    Text(String),
    /// A code.
    Code(Code),
    /// A number with its unit.
    Number(f64, Code),
    /// A UID.
    Uid(String),
    /// A point (one), or a line through points, world mm.
    Points(Vec<DVec3>),
    /// An image.
    Image(ImageReference),
}

/// A content item: a name, what it says, and what belongs to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// How it belongs to its parent, such as `CONTAINS` (PS3.3, table C.17.3-8). That of the root is left out.
    pub relation: &'static str,
    /// What it is.
    pub name: Code,
    /// What it says.
    pub content: Content,
    /// What belongs to it.
    pub children: Vec<Self>,
}

impl Node {
    /// Returns an item that its parent contains.
    pub fn new(name: Code, content: Content) -> Self {
        Self { relation: "CONTAINS", name, content, children: Vec::new() }
    }

    /// Returns it with this relation to its parent.
    #[must_use]
    pub fn as_(self, relation: &'static str) -> Self {
        Self { relation, ..self }
    }

    /// Returns it with these children after those that it has.
    #[must_use]
    pub fn with(mut self, children: impl IntoIterator<Item = Self>) -> Self {
        self.children.extend(children);
        self
    }

    /// Calls `see` with every image that is referred to.
    fn images(&self, see: &mut impl FnMut(&ImageReference)) {
        if let Content::Image(image) = &self.content {
            see(image);
        }
        self.children.iter().for_each(|child| child.images(see));
    }

    fn set(&self, study: &Study) -> Set {
        let kind = match &self.content {
            Content::Container(_) => "CONTAINER",
            Content::Text(_) => "TEXT",
            Content::Code(_) => "CODE",
            Content::Number(..) => "NUM",
            Content::Uid(_) => "UIDREF",
            Content::Points(_) => "SCOORD3D",
            Content::Image(_) => "IMAGE",
        };
        let set = Set::default().with(tags::VALUE_TYPE, kind).with_code(tags::CONCEPT_NAME_CODE_SEQUENCE, self.name);
        let set = match &self.content {
            Content::Container(template) => {
                let set = set.with(tags::CONTINUITY_OF_CONTENT, "SEPARATE");
                let template = template.map(|number| {
                    Set::default().with(tags::MAPPING_RESOURCE, "DCMR").with(tags::TEMPLATE_IDENTIFIER, number)
                });
                template.map_or(set.clone(), |t| set.with_items(tags::CONTENT_TEMPLATE_SEQUENCE, [t]))
            }
            // A text must say something.
            Content::Text(text) => {
                let text = long(text);
                set.with(tags::TEXT_VALUE, if text.trim().is_empty() { "-".to_owned() } else { text })
            }
            Content::Code(code) => set.with_code(tags::CONCEPT_CODE_SEQUENCE, *code),
            Content::Number(value, unit) => {
                let value = Set::default()
                    .with(tags::NUMERIC_VALUE, decimal(*value))
                    .with(tags::FLOATING_POINT_VALUE, *value)
                    .with_code(tags::MEASUREMENT_UNITS_CODE_SEQUENCE, *unit);
                set.with_items(tags::MEASURED_VALUE_SEQUENCE, [value])
            }
            Content::Uid(uid) => set.with(tags::UID, uid.as_str()),
            Content::Points(points) => {
                let data: Vec<f32> = points.iter().flat_map(|p| p.as_vec3().to_array()).collect();
                set.with(tags::GRAPHIC_DATA, PrimitiveValue::F32(data.into()))
                    .with(tags::GRAPHIC_TYPE, if points.len() == 1 { "POINT" } else { "POLYLINE" })
                    .with(tags::REFERENCED_FRAME_OF_REFERENCE_UID, study.frame_of_reference.as_str())
            }
            Content::Image(image) => {
                let reference = Set::default()
                    .with(tags::REFERENCED_SOP_CLASS_UID, image.class.as_str())
                    .with(tags::REFERENCED_SOP_INSTANCE_UID, image.instance.as_str());
                let reference = if image.frames.is_empty() {
                    reference
                } else {
                    let frames = image.frames.iter().map(u32::to_string).collect();
                    reference.with(tags::REFERENCED_FRAME_NUMBER, PrimitiveValue::Strs(frames))
                };
                set.with_items(tags::REFERENCED_SOP_SEQUENCE, [reference])
            }
        };
        if self.children.is_empty() {
            return set;
        }
        let children = self.children.iter().map(|c| c.set(study).with(tags::RELATIONSHIP_TYPE, c.relation));
        set.with_items(tags::CONTENT_SEQUENCE, children)
    }
}

/// A report: a Comprehensive 3D SR, complete, preliminary and not verified.
#[derive(Clone, Debug, PartialEq)]
pub struct Report<'a> {
    /// Whose it is.
    pub study: &'a Study,
    /// UID of the report.
    pub instance: String,
    /// UID of its series.
    pub series: String,
    /// Number of its series.
    pub series_number: u32,
    /// What it is, in words.
    pub description: &'a str,
    /// What it says.
    pub root: Node,
}

impl Report<'_> {
    /// Writes it.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let about = About {
            class: uids::COMPREHENSIVE3_DSR_STORAGE,
            instance: &self.instance,
            series: &self.series,
            series_number: self.series_number,
            number: 1,
            modality: "SR",
            description: &short(self.description, 64),
        };
        let set = self
            .study
            .head(&about)
            .with_items(tags::REFERENCED_PERFORMED_PROCEDURE_STEP_SEQUENCE, [])
            .with_items(tags::PERFORMED_PROCEDURE_CODE_SEQUENCE, [])
            .with(tags::COMPLETION_FLAG, "COMPLETE")
            .with(tags::PRELIMINARY_FLAG, "PRELIMINARY")
            .with(tags::VERIFICATION_FLAG, "UNVERIFIED");
        let evidence = self.evidence();
        let set = if evidence.is_empty() {
            set
        } else {
            let study = Set::default()
                .with(tags::STUDY_INSTANCE_UID, self.study.study.as_str())
                .with_items(tags::REFERENCED_SERIES_SEQUENCE, evidence);
            set.with_items(tags::CURRENT_REQUESTED_PROCEDURE_EVIDENCE_SEQUENCE, [study])
        };
        set.and(self.root.set(self.study)).write(out)
    }

    /// Returns the images that it refers to, by series.
    fn evidence(&self) -> Vec<Set> {
        let mut series: BTreeMap<String, BTreeMap<String, String>> = BTreeMap::new();
        self.root.images(&mut |image| {
            series.entry(image.series.clone()).or_default().insert(image.instance.clone(), image.class.clone());
        });
        let one = |(uid, images): (String, BTreeMap<String, String>)| {
            let images = images.into_iter().map(|(instance, class)| {
                Set::default()
                    .with(tags::REFERENCED_SOP_CLASS_UID, class)
                    .with(tags::REFERENCED_SOP_INSTANCE_UID, instance)
            });
            Set::default().with(tags::SERIES_INSTANCE_UID, uid).with_items(tags::REFERENCED_SOP_SEQUENCE, images)
        };
        series.into_iter().map(one).collect()
    }
}
