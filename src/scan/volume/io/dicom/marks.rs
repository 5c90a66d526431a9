//! Attributes that can distinguish two passes under one series UID: acquisition, kernel, energy, phase, ….

use super::dataset::{Item, Tag};
use super::origin;

const INSTANCE_NUMBER: Tag = (0x0020, 0x0013);
const ACQUISITION_TIME: Tag = (0x0008, 0x0032);
const ACQUISITION_DATE_TIME: Tag = (0x0008, 0x002A);
const FRAME_DATE_TIME: Tag = (0x0018, 0x9074);
const CONTENT_TIME: Tag = (0x0008, 0x0033);
/// Functional groups of an enhanced multi-frame image (PS3.3, C.7.6.16).
const SHARED: Tag = (0x5200, 0x9229);
const PER_FRAME: Tag = (0x5200, 0x9230);
/// Maximum depth at which a functional group is searched.
const DEEPEST: usize = 3;

/// Encoding of an attribute's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// Text.
    Text,
    /// A decimal or integer string.
    Number,
    /// An unsigned short.
    Short,
    /// An unsigned long.
    Long,
    /// A floating point number.
    Float,
    /// A unique identifier, which is numbered where it is listed.
    Uid,
}

/// An attribute that can distinguish passes.
struct Attribute {
    /// Where it stands: in the data set itself, and in the functional groups of an enhanced image.
    places: &'static [(Tag, Form)],
    /// Words around its value in a list.
    words: [&'static str; 2],
}

/// The attributes, strongest first: where two of them separate passes equally well, the first is used.
const ATTRIBUTES: [Attribute; 20] = [
    Attribute {
        places: &[((0x0020, 0x0012), Form::Number), ((0x0020, 0x9156), Form::Short)],
        words: ["acquisition ", ""],
    },
    Attribute { places: &[((0x0020, 0x9056), Form::Text)], words: ["stack ", ""] },
    Attribute {
        places: &[((0x0020, 0x0100), Form::Number), ((0x0020, 0x9128), Form::Long)],
        words: ["temporal position ", ""],
    },
    Attribute { places: &[((0x0018, 0x1210), Form::Text)], words: ["kernel ", ""] },
    Attribute { places: &[((0x0018, 0x0060), Form::Number)], words: ["", " kV"] },
    Attribute { places: &[((0x0018, 0x937C), Form::Float)], words: ["", " keV"] },
    Attribute { places: &[((0x0020, 0x9241), Form::Float)], words: ["cardiac phase ", " %"] },
    Attribute { places: &[((0x0020, 0x9245), Form::Float)], words: ["respiratory phase ", " %"] },
    Attribute {
        places: &[((0x0018, 0x1060), Form::Number), ((0x0020, 0x9153), Form::Float)],
        words: ["trigger delay ", " ms"],
    },
    Attribute { places: &[((0x0018, 0x0050), Form::Number)], words: ["", " mm thick"] },
    Attribute {
        places: &[((0x0018, 0x1100), Form::Number), ((0x0018, 0x9317), Form::Float)],
        words: ["field of view ", " mm"],
    },
    Attribute { places: &[((0x0018, 0x9315), Form::Text)], words: ["reconstruction ", ""] },
    Attribute { places: &[((0x0018, 0x0010), Form::Text)], words: ["contrast ", ""] },
    Attribute { places: &[((0x0018, 0x1160), Form::Text)], words: ["filter ", ""] },
    Attribute { places: &[((0x0008, 0x103E), Form::Text)], words: ["", ""] },
    Attribute { places: &[((0x0008, 0x0008), Form::Text), ((0x0008, 0x9007), Form::Text)], words: ["type ", ""] },
    Attribute { places: &[((0x0020, 0x4000), Form::Text)], words: ["", ""] },
    Attribute { places: &[((0x0008, 0x0017), Form::Uid)], words: ["acquisition ", ""] },
    Attribute { places: &[((0x0008, 0x3010), Form::Uid)], words: ["irradiation event ", ""] },
    Attribute { places: &[((0x0020, 0x000D), Form::Uid)], words: ["study ", ""] },
];
/// Number of attributes.
pub(crate) const COUNT: usize = ATTRIBUTES.len();

/// The value of an attribute.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Mark {
    /// Hash of the whole value.
    hash: u64,
    /// Text without the patient's name; empty for a UID.
    text: Box<str>,
}

/// The values of one slice.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Marks {
    values: [Option<Mark>; COUNT],
    /// Its number in the series.
    pub instance: Option<f64>,
    /// When it was acquired, and when its image was made: seconds of a clock of their own.
    pub times: [Option<f64>; 2],
}

impl Marks {
    /// Reads the values of a data set, and of its first functional groups.
    pub(crate) fn of(root: &Item) -> Self {
        let mut marks = Self { instance: root.decimal(INSTANCE_NUMBER), ..Self::default() };
        marks.take(root, root, 0);
        if let Some(shared) = root.items(SHARED).first() {
            marks.take(shared, root, DEEPEST);
        }
        marks
    }

    /// Returns the values of a frame, which may have its own.
    pub(crate) fn of_frame(&self, root: &Item, frame: u32) -> Option<Self> {
        let own = root.items(PER_FRAME).get(frame as usize)?;
        let mut marks = self.clone();
        marks.take(own, root, DEEPEST);
        (marks != *self).then_some(marks)
    }

    /// Takes the values of an item, and of the items nested in it down to `depth`.
    fn take(&mut self, item: &Item, root: &Item, depth: usize) {
        for (value, attribute) in self.values.iter_mut().zip(&ATTRIBUTES) {
            if let Some(mark) = attribute.places.iter().find_map(|(tag, form)| mark(item, root, *tag, *form)) {
                *value = Some(mark);
            }
        }
        let acquired = [ACQUISITION_TIME, ACQUISITION_DATE_TIME, FRAME_DATE_TIME].iter().find_map(|t| clock(item, *t));
        self.times = [acquired.or(self.times[0]), clock(item, CONTENT_TIME).or(self.times[1])];
        if depth > 0 {
            item.nested().for_each(|inner| self.take(inner, root, depth - 1));
        }
    }

    /// Returns a number that stands for the value of attribute `k`: the same for the same value.
    pub(crate) fn key(&self, k: usize) -> u64 {
        self.values[k].as_ref().map_or(0, |m| m.hash)
    }

    /// Returns all of them in one.
    pub(crate) fn all(&self) -> u64 {
        let keys: Vec<String> = (0..COUNT).map(|k| self.key(k).to_string()).collect();
        origin::hash(&keys.iter().map(String::as_str).collect::<Vec<_>>())
    }

    /// Returns the value of attribute `k` as it is ordered in a list.
    pub(crate) fn rank(&self, k: usize) -> (f64, &str) {
        let text = self.values[k].as_ref().map_or("", |m| &m.text);
        (text.parse().unwrap_or(f64::MAX), text)
    }
}

fn mark(item: &Item, root: &Item, tag: Tag, form: Form) -> Option<Mark> {
    let value = match form {
        Form::Text | Form::Uid => item.text(tag)?,
        // 120 and 120.0 are the same.
        Form::Number => rounded(item.decimal(tag).filter(|v| v.is_finite())?),
        Form::Short => item.short(tag)?.to_string(),
        Form::Long => item.long(tag)?.to_string(),
        Form::Float => item.float(tag).filter(|v| v.is_finite()).map(rounded)?,
    };
    let text = match form {
        Form::Uid => String::new(),
        Form::Text => origin::cleaned(root, &value),
        _ => value.clone(),
    };
    Some(Mark { hash: origin::hash(&["value", &value]), text: text.into() })
}

fn rounded(v: f64) -> String {
    ((1e4 * v).round() / 1e4).to_string()
}

/// Returns a time (HHMMSS.FFFFFF) or a date with a time (YYYYMMDDHHMMSS.FFFFFF), as it is written: it is only compared.
fn clock(item: &Item, tag: Tag) -> Option<f64> {
    item.text(tag)?
        .get(..)
        .and_then(|t| t.split(['+', '-', '&']).next())?
        .trim()
        .parse()
        .ok()
        .filter(|t: &f64| t.is_finite())
}

/// Describes in words how attribute `k` distinguishes passes, for each of `passes`.
pub(crate) fn words(k: usize, passes: &[&Marks]) -> Vec<String> {
    let [before, after] = ATTRIBUTES[k].words;
    let is_uid = ATTRIBUTES[k].places.iter().any(|p| p.1 == Form::Uid);
    let parts = |m: &&Marks| -> Vec<String> {
        m.values[k].as_ref().map(|v| v.text.split('\\').map(|t| t.trim().to_owned()).collect()).unwrap_or_default()
    };
    let all: Vec<Vec<String>> = passes.iter().map(parts).collect();
    // Of an image type, only the differing values are shown.
    let shared = |part: &String| passes.len() > 1 && all.iter().all(|p| p.contains(part));
    passes
        .iter()
        .zip(&all)
        .enumerate()
        .map(|(n, (marks, parts))| {
            let own: Vec<&str> = parts.iter().filter(|p| !shared(p)).map(String::as_str).collect();
            let own = if own.is_empty() { parts.iter().map(String::as_str).collect() } else { own };
            match own.join(" ") {
                _ if is_uid => format!("{before}{}", n + 1),
                _ if marks.values[k].is_none() && before.is_empty() => String::new(),
                _ if marks.values[k].is_none() => format!("no {}", before.trim_end()),
                value => format!("{before}{}{after}", origin::shortened(&value)),
            }
        })
        .collect()
}
