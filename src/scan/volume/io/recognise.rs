//! The format of a slice, recognised by the first bytes of its file.

/// Number of bytes at the start of a file by which its format is recognised.
pub(crate) const HEAD: u64 = 512;

/// True if the bytes are the start of a PNG file.
pub(crate) fn is_png(head: &[u8]) -> bool {
    head.starts_with(b"\x89PNG\r\n\x1a\n")
}

/// True if the bytes are the start of a DICOM file (with the 128-byte preamble, or directly with its meta group).
pub(crate) fn is_dicom(head: &[u8]) -> bool {
    head.get(128..132) == Some(b"DICM") || head.starts_with(b"\x02\0\0\0UL")
}

/// True if the bytes are the start of a DICOM data set without preamble. Ask this last: its signs are weaker than those of others.
#[cfg(feature = "dicom")]
pub(crate) fn is_bare_dicom(head: &[u8]) -> bool {
    super::dicom::begins_bare(head)
}

/// Without DICOM, no file is.
#[cfg(not(feature = "dicom"))]
pub(crate) fn is_bare_dicom(_: &[u8]) -> bool {
    false
}
