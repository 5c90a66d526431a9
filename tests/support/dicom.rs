//! DICOM files built byte by byte, so that every attribute can be wrong.

pub(crate) const EXPLICIT: &str = "1.2.840.10008.1.2.1";
pub(crate) const IMPLICIT: &str = "1.2.840.10008.1.2";
pub(crate) const BIG: &str = "1.2.840.10008.1.2.2";
pub(crate) const DEFLATED: &str = "1.2.840.10008.1.2.1.99";
pub(crate) const RLE: &str = "1.2.840.10008.1.2.5";
pub(crate) const JPEG_LOSSLESS: &str = "1.2.840.10008.1.2.4.70";
pub(crate) const JPEG_LS: &str = "1.2.840.10008.1.2.4.80";
/// SOP class of a CT slice.
const CT_IMAGE: &str = "1.2.840.10008.5.1.4.1.1.2";

/// One CT slice.
#[derive(Clone)]
pub(crate) struct Slice {
    pub syntax: &'static str,
    pub series: String,
    pub series_number: i32,
    pub modality: &'static str,
    pub sop_class: &'static str,
    /// Name and identifier of the patient.
    pub patient: [&'static str; 2],
    pub study: &'static str,
    pub frame_of_reference: &'static str,
    pub description: &'static str,
    pub image_type: &'static str,
    pub patient_position: &'static str,
    pub rows: u16,
    pub cols: u16,
    pub position: Option<[f64; 3]>,
    pub orientation: [f64; 6],
    /// Spacing between rows, then between columns.
    pub spacing: String,
    pub slope: &'static str,
    pub intercept: &'static str,
    /// Rescale Type; none if empty.
    pub units: &'static str,
    pub photometric: &'static str,
    pub samples: u16,
    pub allocated: u16,
    pub stored: u16,
    pub high: u16,
    pub signed: bool,
    pub padding: Option<u16>,
    pub padding_limit: Option<u16>,
    pub frames: Option<&'static str>,
    /// Positions of the frames of an enhanced image, in functional groups (explicit, little-endian forms only).
    pub places: Vec<[f64; 3]>,
    /// Stored samples, in their low bits.
    pub pixels: Vec<u16>,
    /// Bytes that replace the packed pixels.
    pub packed: Option<Vec<u8>>,
    /// False for a report, which has no pixel data.
    pub image: bool,
}

impl Slice {
    /// Creates a 6×4 slice at `z` whose stored values are 1000 + 24 z + index. HU are 1024 less.
    pub(crate) fn at(z: f64) -> Self {
        Self {
            syntax: EXPLICIT,
            series: "1.2.3.4".to_owned(),
            series_number: 1,
            modality: "CT",
            sop_class: CT_IMAGE,
            patient: ["Doe^Jane", "SECRET7"],
            study: "",
            frame_of_reference: "",
            description: "",
            image_type: "ORIGINAL\\PRIMARY\\AXIAL",
            patient_position: "HFS",
            rows: 4,
            cols: 6,
            position: Some([-10.0, -20.0, z]),
            orientation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            spacing: "0.75\\0.5".to_owned(),
            slope: "1",
            intercept: "-1024",
            units: "",
            photometric: "MONOCHROME2",
            samples: 1,
            allocated: 16,
            stored: 16,
            high: 15,
            signed: true,
            padding: None,
            padding_limit: None,
            frames: None,
            places: Vec::new(),
            pixels: (0..24).map(|i| (1000 + 24 * z as i64 + i) as u16).collect(),
            packed: None,
            image: true,
        }
    }

    /// Returns the UID of the object: another one at each position.
    fn instance(&self) -> String {
        let parts = self.position.unwrap_or_default().map(|mm| format!(".{}", (1000.0 * (mm + 1e5)) as i64));
        format!("{}.5{}", self.series, parts.concat())
    }

    /// Returns the bytes of the file.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let big = self.syntax == BIG;
        let explicit = self.syntax != IMPLICIT;
        let mut body = Writer { out: Vec::new(), big, explicit };
        let floats = |v: &[f64]| v.iter().map(f64::to_string).collect::<Vec<_>>().join("\\");
        body.text(0x0008, 0x0008, b"CS", self.image_type);
        body.text(0x0008, 0x0016, b"UI", self.sop_class);
        body.text(0x0008, 0x0018, b"UI", &self.instance());
        body.text(0x0008, 0x0060, b"CS", self.modality);
        if !self.description.is_empty() {
            body.text(0x0008, 0x103E, b"LO", self.description);
        }
        let [name, id] = self.patient;
        body.text(0x0010, 0x0010, b"PN", name);
        body.text(0x0010, 0x0020, b"LO", id);
        body.text(0x0010, 0x0030, b"DA", "19500102");
        body.text(0x0018, 0x0050, b"DS", "2.5");
        body.text(0x0018, 0x5100, b"CS", self.patient_position);
        if !self.study.is_empty() {
            body.text(0x0020, 0x000D, b"UI", self.study);
        }
        body.text(0x0020, 0x000E, b"UI", &self.series);
        body.text(0x0020, 0x0011, b"IS", &self.series_number.to_string());
        if let Some(p) = self.position {
            body.text(0x0020, 0x0032, b"DS", &floats(&p));
        }
        body.text(0x0020, 0x0037, b"DS", &floats(&self.orientation));
        if !self.frame_of_reference.is_empty() {
            body.text(0x0020, 0x0052, b"UI", self.frame_of_reference);
        }
        body.short(0x0028, 0x0002, self.samples);
        body.text(0x0028, 0x0004, b"CS", self.photometric);
        if let Some(f) = self.frames {
            body.text(0x0028, 0x0008, b"IS", f);
        }
        body.short(0x0028, 0x0010, self.rows);
        body.short(0x0028, 0x0011, self.cols);
        if !self.spacing.is_empty() {
            body.text(0x0028, 0x0030, b"DS", &self.spacing);
        }
        body.short(0x0028, 0x0100, self.allocated);
        body.short(0x0028, 0x0101, self.stored);
        body.short(0x0028, 0x0102, self.high);
        body.short(0x0028, 0x0103, u16::from(self.signed));
        if let Some(p) = self.padding {
            body.short(0x0028, 0x0120, p);
        }
        if let Some(p) = self.padding_limit {
            body.short(0x0028, 0x0121, p);
        }
        for (element, vr, value) in
            [(0x1052, b"DS", self.intercept), (0x1053, b"DS", self.slope), (0x1054, b"LO", self.units)]
        {
            if !value.is_empty() {
                body.text(0x0028, element, vr, value);
            }
        }
        if !self.places.is_empty() {
            self.functional_groups(&mut body);
        }
        if self.image {
            self.pixel_data(&mut body);
        }
        let mut out = vec![0; 128];
        out.extend(b"DICM");
        let mut meta = Writer { out: Vec::new(), big: false, explicit: true };
        meta.text(0x0002, 0x0002, b"UI", self.sop_class);
        meta.text(0x0002, 0x0003, b"UI", &self.instance());
        meta.text(0x0002, 0x0010, b"UI", self.syntax);
        out.extend(b"\x02\0\0\0UL\x04\0");
        out.extend((meta.out.len() as u32).to_le_bytes());
        out.extend(meta.out);
        if self.syntax == DEFLATED {
            use std::io::Write;
            let mut e = flate2::write::DeflateEncoder::new(out, flate2::Compression::fast());
            e.write_all(&body.out).unwrap();
            return e.finish().unwrap();
        }
        out.extend(body.out);
        out
    }

    /// Writes one item for each frame, with sequences and items of undefined length, each with a PlanePositionSequence
    /// of known length.
    fn functional_groups(&self, body: &mut Writer) {
        body.out.extend(b"\x00\x52\x30\x92SQ\0\0\xff\xff\xff\xff");
        for place in &self.places {
            let mut inner = Writer { out: Vec::new(), big: false, explicit: true };
            let text = place.iter().map(f64::to_string).collect::<Vec<_>>().join("\\");
            inner.text(0x0020, 0x0032, b"DS", &text);
            body.out.extend(b"\xfe\xff\x00\xe0\xff\xff\xff\xff\x20\0\x13\x91SQ\0\0");
            body.out.extend((inner.out.len() as u32 + 8).to_le_bytes());
            body.out.extend(b"\xfe\xff\x00\xe0");
            body.out.extend((inner.out.len() as u32).to_le_bytes());
            body.out.extend(inner.out);
            body.out.extend(b"\xfe\xff\x0d\xe0\0\0\0\0");
        }
        body.out.extend(b"\xfe\xff\xdd\xe0\0\0\0\0");
    }

    fn pixel_data(&self, body: &mut Writer) {
        let packed = match (&self.packed, self.syntax) {
            (Some(p), _) => Some(p.clone()),
            (None, RLE) => Some(rle(&self.pixels)),
            (None, JPEG_LOSSLESS) => Some(jpeg_lossless(&self.pixels, self.cols, self.rows)),
            (None, JPEG_LS) => {
                let (w, h) = (u32::from(self.cols), u32::from(self.rows));
                let mut p = Vec::new();
                // As writers do, and not the fewest bits that hold the values: the highest is the sign.
                let mut options = jpegls::EncodeOptions::default();
                options.precision = Some(self.stored as u8);
                jpegls::encode_with_options(&self.pixels, w, h, &options, &mut p).unwrap();
                Some(p)
            }
            _ => None,
        };
        match packed {
            Some(p) if [EXPLICIT, IMPLICIT, BIG, DEFLATED].contains(&self.syntax) => {
                body.bytes(0x7FE0, 0x0010, b"OW", &p);
            }
            Some(mut p) => {
                p.resize(p.len().next_multiple_of(2), 0);
                body.out.extend(b"\xe0\x7f\x10\0OB\0\0\xff\xff\xff\xff\xfe\xff\x00\xe0\0\0\0\0\xfe\xff\x00\xe0");
                body.out.extend((p.len() as u32).to_le_bytes());
                body.out.extend(p);
                body.out.extend(b"\xfe\xff\xdd\xe0\0\0\0\0");
            }
            None => {
                let bytes: Vec<u8> = if self.allocated == 8 {
                    self.pixels.iter().map(|p| *p as u8).collect()
                } else {
                    self.pixels.iter().flat_map(|p| if body.big { p.to_be_bytes() } else { p.to_le_bytes() }).collect()
                };
                body.bytes(0x7FE0, 0x0010, b"OW", &bytes);
            }
        }
    }
}

struct Writer {
    out: Vec<u8>,
    big: bool,
    explicit: bool,
}

impl Writer {
    fn u16(&mut self, v: u16) {
        self.out.extend(if self.big { v.to_be_bytes() } else { v.to_le_bytes() });
    }

    fn u32(&mut self, v: u32) {
        self.out.extend(if self.big { v.to_be_bytes() } else { v.to_le_bytes() });
    }

    fn bytes(&mut self, group: u16, element: u16, vr: &[u8; 2], value: &[u8]) {
        self.u16(group);
        self.u16(element);
        if !self.explicit {
            self.u32(value.len() as u32);
        } else if vr == b"OW" {
            self.out.extend(vr);
            self.u16(0);
            self.u32(value.len() as u32);
        } else {
            self.out.extend(vr);
            self.u16(value.len() as u16);
        }
        self.out.extend(value);
    }

    fn text(&mut self, group: u16, element: u16, vr: &[u8; 2], value: &str) {
        let mut v = value.as_bytes().to_vec();
        v.resize(v.len().next_multiple_of(2), if vr == b"UI" { 0 } else { b' ' });
        self.bytes(group, element, vr, &v);
    }

    fn short(&mut self, group: u16, element: u16, value: u16) {
        let v = if self.big { value.to_be_bytes() } else { value.to_le_bytes() };
        self.bytes(group, element, b"US", &v);
    }
}

/// Encodes RLE of PS3.5, annex G: two segments (high bytes, low bytes) of literal runs.
fn rle(pixels: &[u16]) -> Vec<u8> {
    let segment = |shift: u32| {
        let plane: Vec<u8> = pixels.iter().map(|p| (p >> shift) as u8).collect();
        let mut s: Vec<u8> =
            plane.chunks(128).flat_map(|c| std::iter::once(c.len() as u8 - 1).chain(c.iter().copied())).collect();
        s.resize(s.len().next_multiple_of(2), 0x80);
        s
    };
    let (high, low) = (segment(8), segment(0));
    let mut out: Vec<u8> = [2, 64, 64 + high.len() as u32].iter().flat_map(|v| v.to_le_bytes()).collect();
    out.resize(64, 0);
    out.extend(high);
    out.extend(low);
    out
}

/// Encodes lossless JPEG of T.81, annex H: predictor 1, one Huffman table of 17 codes of five bits each.
fn jpeg_lossless(pixels: &[u16], cols: u16, rows: u16) -> Vec<u8> {
    let mut out = b"\xff\xd8\xff\xc3\0\x0b\x10".to_vec();
    out.extend(rows.to_be_bytes());
    out.extend(cols.to_be_bytes());
    out.extend(b"\x01\x01\x11\0\xff\xc4\0\x24\0\0\0\0\0\x11\0\0\0\0\0\0\0\0\0\0\0");
    out.extend(0..17u8);
    out.extend(b"\xff\xda\0\x08\x01\x01\0\x01\0\0");
    let (mut bits, mut count) = (0u64, 0u32);
    let mut put = |value: u32, n: u32, out: &mut Vec<u8>| {
        bits = (bits << n) | u64::from(value);
        count += n;
        while count >= 8 {
            count -= 8;
            let b = (bits >> count) as u8;
            out.push(b);
            if b == 0xFF {
                out.push(0);
            }
        }
    };
    let width = usize::from(cols);
    for (i, p) in pixels.iter().enumerate() {
        let predicted = match (i % width, i / width) {
            (0, 0) => 0x8000,
            (0, _) => pixels[i - width],
            _ => pixels[i - 1],
        };
        let difference = i32::from(p.wrapping_sub(predicted) as i16);
        let category = 32 - difference.unsigned_abs().leading_zeros();
        put(category, 5, &mut out);
        if category > 0 && category < 16 {
            let low = if difference < 0 { difference - 1 } else { difference };
            put(low as u32 & ((1 << category) - 1), category, &mut out);
        }
    }
    // Pad the last byte with ones.
    put(0x7F, 7, &mut out);
    out.extend(b"\xff\xd9");
    out
}
