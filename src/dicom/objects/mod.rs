//! Objects that are written: reports, segmentations and captures.
