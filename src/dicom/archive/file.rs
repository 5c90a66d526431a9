//! DICOM files: what their head says, and whether they are whole (PS3.10).

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

use dicom_core::Tag;
use dicom_dictionary_std::{tags, uids};
use dicom_ul::IMPLEMENTATION_CLASS_UID;

use super::elements::{Elements, text};
use crate::text::is_uid;

/// Bytes before the first element: 128 of any content, and `DICM`.
const PREAMBLE: usize = 132;
/// Largest head that is looked at, bytes.
const MOST_HEAD: u64 = 64 << 10;

/// What a file says of the object in it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Head {
    pub class: String,
    pub instance: String,
    pub syntax: String,
    /// Place of the data set, bytes.
    pub data_at: u64,
}

impl Head {
    /// Reads the head of a file; `None` if it is no DICOM file.
    pub(super) fn read(file: &mut File) -> io::Result<Option<Self>> {
        let mut bytes = Vec::new();
        file.seek(SeekFrom::Start(0))?;
        file.take(MOST_HEAD).read_to_end(&mut bytes)?;
        Ok(Self::of(&bytes))
    }

    fn of(bytes: &[u8]) -> Option<Self> {
        let rest = bytes.get(PREAMBLE..).filter(|_| bytes[PREAMBLE - 4..PREAMBLE] == *b"DICM")?;
        let mut head = Self { data_at: PREAMBLE as u64, ..Self::default() };
        let mut elements = Elements::explicit(rest);
        while let Some((tag, value)) = elements.next().filter(|e| e.0.group() == 2) {
            match tag {
                tags::MEDIA_STORAGE_SOP_CLASS_UID => head.class = text(value),
                tags::MEDIA_STORAGE_SOP_INSTANCE_UID => head.instance = text(value),
                tags::TRANSFER_SYNTAX_UID => head.syntax = text(value),
                _ => {}
            }
            head.data_at = (PREAMBLE + elements.at()) as u64;
        }
        let are_uids = is_uid(&head.class) && is_uid(&head.instance) && is_uid(&head.syntax);
        are_uids.then_some(head)
    }

    /// Writes the head of a file that comes from an archive with this title.
    pub(super) fn write(&self, from: &str, out: &mut dyn Write) -> io::Result<()> {
        let mut rest = Vec::new();
        put(&mut rest, tags::FILE_META_INFORMATION_VERSION, *b"OB", &[0, 1]);
        put(&mut rest, tags::MEDIA_STORAGE_SOP_CLASS_UID, *b"UI", self.class.as_bytes());
        put(&mut rest, tags::MEDIA_STORAGE_SOP_INSTANCE_UID, *b"UI", self.instance.as_bytes());
        put(&mut rest, tags::TRANSFER_SYNTAX_UID, *b"UI", self.syntax.as_bytes());
        put(&mut rest, tags::IMPLEMENTATION_CLASS_UID, *b"UI", IMPLEMENTATION_CLASS_UID.as_bytes());
        put(&mut rest, tags::SOURCE_APPLICATION_ENTITY_TITLE, *b"AE", from.as_bytes());
        let mut all = vec![0; PREAMBLE - 4];
        all.extend(b"DICM");
        put(&mut all, tags::FILE_META_INFORMATION_GROUP_LENGTH, *b"UL", &(rest.len() as u32).to_le_bytes());
        all.extend(rest);
        out.write_all(&all)
    }
}

fn put(out: &mut Vec<u8>, tag: Tag, vr: [u8; 2], value: &[u8]) {
    let length = value.len().next_multiple_of(2);
    out.extend(tag.0.to_le_bytes());
    out.extend(tag.1.to_le_bytes());
    out.extend(vr);
    if vr == *b"OB" {
        out.extend([0, 0]);
        out.extend((length as u32).to_le_bytes());
    } else {
        out.extend((length as u16).to_le_bytes());
    }
    out.extend(value);
    if value.len() < length {
        out.push(if vr == *b"AE" { b' ' } else { 0 });
    }
}

/// True if a file has this instance, whole: its elements end where it ends.
pub(super) fn has_whole(path: &Path, instance: &str) -> bool {
    let Ok(bytes) = std::fs::read(path) else { return false };
    let Some(head) = Head::of(&bytes).filter(|h| h.instance == instance) else { return false };
    let data = &bytes[head.data_at as usize..];
    let is_whole = match head.syntax.as_str() {
        uids::IMPLICIT_VR_LITTLE_ENDIAN => Elements::implicit(data).are_whole(),
        // Its elements cannot be followed here. Only a whole file has this name.
        uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN | "1.2.840.10008.1.2.2" => true,
        _ => Elements::explicit(data).are_whole(),
    };
    is_whole && !data.is_empty()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_whole_or_not_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.dcm");
        let head = Head {
            class: uids::CT_IMAGE_STORAGE.to_owned(),
            instance: "1.2.3".to_owned(),
            syntax: uids::EXPLICIT_VR_LITTLE_ENDIAN.to_owned(),
            data_at: 0,
        };
        let mut bytes = Vec::new();
        head.write("ARCHIVE", &mut bytes).unwrap();
        let data_at = bytes.len() as u64;
        bytes.extend(b"\x08\0\x60\0CS\x02\0CT");
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(Head::read(&mut File::open(&path).unwrap()).unwrap(), Some(Head { data_at, ..head }));
        assert!(has_whole(&path, "1.2.3") && !has_whole(&path, "1.2.4"));
        for end in 0..bytes.len() {
            std::fs::write(&path, &bytes[..end]).unwrap();
            assert!(!has_whole(&path, "1.2.3"), "{end}");
        }
        assert!(!has_whole(folder.path(), "1.2.3"));
    }
}
