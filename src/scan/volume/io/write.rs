//! Writing scans and masks.

use std::ffi::OsString;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use super::voxels::Voxels;
use super::{deflate, metaimage, nifti, nrrd};
use crate::error::{Error, Kind, Result};
use crate::output::{AtomicFile, cannot};
use crate::progress::Progress;
use crate::volume::Grid;

pub(super) enum Format {
    Nifti { gzip: bool },
    Mha,
    Mhd,
    Nrrd,
    Nhdr,
}

pub(super) fn format(path: &Path) -> Result<Format> {
    let name = path.file_name().map(|n| n.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let known = [
        (".nii.gz", Format::Nifti { gzip: true }),
        (".nii", Format::Nifti { gzip: false }),
        (".mha", Format::Mha),
        (".mhd", Format::Mhd),
        (".nrrd", Format::Nrrd),
        (".nhdr", Format::Nhdr),
    ];
    known
        .into_iter()
        .find(|(ending, _)| name.ends_with(ending) && name.len() > ending.len())
        .map(|(_, f)| f)
        .ok_or_else(|| {
            Error::usage(
                path.display().to_string(),
                "its extension does not name a format that can be written",
                "end it in .nii, .nii.gz, .mha, .mhd, .nrrd or .nhdr",
            )
        })
}

/// Writes voxels on a grid, each file atomically. The path's extension selects the format. Fails with status 2 for an unknown
/// extension, status 4 if cancelled, status 5 if the file cannot be written.
pub(crate) fn write(path: &Path, grid: &Grid, voxels: Voxels, progress: &Progress) -> Result<()> {
    let format = format(path)?;
    let kind = voxels.kind();
    progress.stage("writing", voxels.bytes() as u64);
    let nifti = || {
        nifti::header(grid, kind)
            .map_err(|why| Error::new(Kind::Output, path.display().to_string(), why, "write .nrrd or .mha instead"))
    };
    match format {
        Format::Nifti { gzip: true } => one(path, |w| packed(w, &nifti()?, voxels, progress)),
        Format::Nifti { gzip: false } => one(path, |w| plain(w, &nifti()?, voxels, progress)),
        Format::Mha => one(path, |w| plain(w, metaimage::header(grid, kind, "LOCAL").as_bytes(), voxels, progress)),
        Format::Nrrd => one(path, |w| {
            w.write_all(nrrd::header(grid, kind, None).as_bytes())?;
            packed(w, &[], voxels, progress)
        }),
        Format::Mhd => {
            let (data, name) = beside(path, "raw")?;
            let header = metaimage::header(grid, kind, &name);
            two(path, header.as_bytes(), &data, |w| plain(w, &[], voxels, progress))
        }
        Format::Nhdr => {
            let (data, name) = beside(path, "raw.gz")?;
            let header = nrrd::header(grid, kind, Some(&name));
            two(path, header.as_bytes(), &data, |w| packed(w, &[], voxels, progress))
        }
    }
}

/// The data file that [`write`](fn@write) writes beside a header; `None` for a format of one file.
pub(super) fn data_file(path: &Path) -> Option<PathBuf> {
    let ending = match format(path).ok()? {
        Format::Mhd => "raw",
        Format::Nhdr => "raw.gz",
        Format::Nifti { .. } | Format::Mha | Format::Nrrd => return None,
    };
    beside(path, ending).ok().map(|(file, _)| file)
}

/// Returns the path of the data file beside a header, and its name as written in the header.
fn beside(path: &Path, ending: &str) -> Result<(PathBuf, String)> {
    let mut name: OsString = path.file_stem().unwrap_or_default().to_owned();
    name.push(".");
    name.push(ending);
    let text = name.to_str().filter(|n| !n.contains(['\n', '\r', '%']) && n.trim() == *n).map(str::to_owned);
    let text =
        text.ok_or_else(|| Error::output(path, "its name cannot be stored in a header", "choose a plain name"))?;
    Ok((path.with_file_name(name), text))
}

/// An error of either kind; both are reported as an [`Error`].
enum Fail {
    Own(Error),
    Io(io::Error),
}

impl From<Error> for Fail {
    fn from(e: Error) -> Self {
        Self::Own(e)
    }
}

impl From<io::Error> for Fail {
    fn from(e: io::Error) -> Self {
        Self::Io(e)
    }
}

impl Fail {
    fn about(self, path: &Path) -> Error {
        match self {
            Self::Own(e) => e,
            Self::Io(e) => cannot(path, e),
        }
    }
}

fn one(path: &Path, fill: impl FnOnce(&mut AtomicFile) -> std::result::Result<(), Fail>) -> Result<()> {
    let mut file = AtomicFile::create(path)?;
    fill(&mut file).map_err(|e| e.about(path))?;
    file.finish()
}

/// Writes a header and its data. Both are complete before either appears; the data appears first.
fn two(
    path: &Path,
    header: &[u8],
    data: &Path,
    fill: impl FnOnce(&mut AtomicFile) -> std::result::Result<(), Fail>,
) -> Result<()> {
    let mut first = AtomicFile::create(data)?;
    let mut second = AtomicFile::create(path)?;
    fill(&mut first).map_err(|e| e.about(data))?;
    second.write_all(header).map_err(|e| cannot(path, e))?;
    first.finish()?;
    second.finish()
}

fn plain(sink: &mut dyn Write, header: &[u8], voxels: Voxels, progress: &Progress) -> std::result::Result<(), Fail> {
    sink.write_all(header)?;
    for k in 0..voxels.blocks() {
        let block = voxels.block(k);
        sink.write_all(&block)?;
        progress.advance(block.len() as u64)?;
    }
    Ok(())
}

fn packed(sink: &mut dyn Write, header: &[u8], voxels: Voxels, progress: &Progress) -> std::result::Result<(), Fail> {
    let make = |k: usize| voxels.block(k);
    Ok(deflate::gzip(sink, header, voxels.blocks(), &make, progress)?)
}
