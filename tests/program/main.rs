//! The whole program: its command line, its reports, and its module dependencies.

#[cfg(all(unix, feature = "dicom"))]
mod archive;
mod batch;
mod cameras;
mod candidates;
mod case;
#[cfg(feature = "dicom")]
mod case_dicom;
mod case_second;
mod centerline;
mod circles;
mod cleanse;
mod command_line;
mod commands;
mod dataset;
mod dataset_layouts;
mod doors;
mod examples;
mod extremes;
mod glossary;
mod group;
mod into;
mod layers;
mod leftovers;
mod matching;
mod outside;
mod paper_table;
mod planners;
mod plugging;
mod report;
mod rust_source;
mod second;
mod slice;
mod unfold;

#[path = "../support"]
mod support {
    #[cfg(all(unix, feature = "dicom"))]
    pub(crate) mod archives;
    pub(crate) mod checks;
    #[cfg(feature = "dicom")]
    pub(crate) mod dicom;
    pub(crate) mod embedded;
    pub(crate) mod phantom;
    pub(crate) mod program;
    pub(crate) mod run;
    #[cfg(feature = "dicom")]
    pub(crate) mod scan_study;
    pub(crate) mod scans;
    pub(crate) mod skips;
}
