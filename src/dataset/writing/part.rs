//! A dataset's folder while it is not whole.

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::shots::{EXPOSURES, exposure};
use super::{Source, path, readme};
use crate::dataset::layout::{Index, Layout};
use crate::error::{Error, Result};
use crate::output;
use crate::progress::Progress;

/// What the dataset is, in the folder.
const IDENTITY: &str = "dataset.json";
/// The checksums of all other files.
const SUMS: &str = "SHA256SUMS";

/// The folder of a dataset that is not whole, beside the one that it will be.
#[derive(Debug)]
pub struct Part {
    folder: PathBuf,
    path: PathBuf,
}

impl Part {
    /// Begins a dataset, or goes on with one that was cut short; `None` if it is whole already.
    ///
    /// # Errors
    /// Returns status 2 if there is something else in either folder, 5 if one cannot be created.
    pub fn begin(folder: &Path, identity: &serde_json::Value) -> Result<Option<Self>> {
        let folder: PathBuf = folder.components().collect();
        let mut name = folder.file_name().unwrap_or_default().to_owned();
        name.push(".part");
        let path = folder.with_file_name(name);
        let same = |at: &Path| {
            let known = fs::read(at.join(IDENTITY)).ok()?;
            Some(serde_json::from_slice::<serde_json::Value>(&known).is_ok_and(|known| known == *identity))
        };
        let is_empty = |at: &Path| fs::read_dir(at).map_or(!at.exists(), |mut all| all.next().is_none());
        let refuse = |at: &Path, what: &str| {
            Error::usage(at.display().to_string(), what.to_owned(), "name another folder, or move this one away")
        };
        if !is_empty(&folder) {
            return match same(&folder) {
                Some(true) => Ok(None),
                Some(false) => Err(refuse(&folder, "holds another dataset")),
                None => Err(refuse(&folder, "is there, and no dataset")),
            };
        }
        match same(&path) {
            Some(true) => {}
            Some(false) => return Err(refuse(&path, "holds the beginning of another dataset")),
            None if !is_empty(&path) => return Err(refuse(&path, "is there, and not the beginning of this dataset")),
            None => {
                output::make_folder(&path)?;
                output::write_json(&path.join(IDENTITY), identity)?;
            }
        }
        Ok(Some(Self { folder, path }))
    }

    /// Returns the folder that files are written to.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Adds the lists, the README and the checksums, and gives the folder its name.
    pub(super) fn finish(
        self,
        source: &Source<'_>,
        layout: &dyn Layout,
        index: &Index<'_>,
        progress: &Progress,
    ) -> Result<()> {
        let write = |name: &str, text: &str| {
            let file = path(&self.path, name);
            file.parent().map_or(Ok(()), output::make_folder)?;
            output::write_whole(&file, |w| w.write_all(text.as_bytes()))
        };
        for (name, text) in layout.lists(index) {
            write(&name, &text)?;
        }
        write("README.md", &readme::text(source, layout, index))?;
        if let Some(rings) = &source.rings {
            let line = rings.points().map(|(mm, f)| format!("{mm},{},{},{}\n", f.at.x, f.at.y, f.at.z));
            write("centerline.csv", &line.fold("along_mm,x_mm,y_mm,z_mm\n".to_owned(), |all, l| all + &l))?;
        }
        let mut exposures = "frame,exposure\n".to_owned();
        for frame in index.frames {
            let file = path(&self.path, &exposure(frame.n));
            let factor = fs::read_to_string(&file).map_err(|e| output::cannot(&file, e))?;
            exposures += &format!("{},{factor}\n", frame.n);
        }
        write("exposure.csv", &exposures)?;
        let folder = path(&self.path, EXPOSURES);
        fs::remove_dir_all(&folder).map_err(|e| output::cannot(&folder, e))?;
        let mut files = Vec::new();
        list(&self.path, &self.path, &mut files)?;
        files.retain(|name| name != SUMS);
        files.sort();
        progress.stage("checksums", files.len() as u64);
        let sum = |name: &String| {
            progress.advance(1)?;
            Ok(format!("{}  {name}\n", sha256(&path(&self.path, name))?))
        };
        let sums: Vec<String> = files.par_iter().map(sum).collect::<Result<_>>()?;
        write(SUMS, &sums.concat())?;
        // An empty folder of that name gives way.
        let _ = fs::remove_dir(&self.folder);
        fs::rename(&self.path, &self.folder).map_err(|e| output::cannot(&self.folder, e))
    }
}

/// Collects the names of files below a folder, with `/` between parts.
fn list(root: &Path, at: &Path, out: &mut Vec<String>) -> Result<()> {
    for entry in fs::read_dir(at).map_err(|e| output::cannot(at, e))? {
        let path = entry.map_err(|e| output::cannot(at, e))?.path();
        if path.is_dir() {
            list(root, &path, out)?;
        } else if let Ok(name) = path.strip_prefix(root) {
            let parts = name.components().map(|c| c.as_os_str().to_string_lossy().into_owned());
            out.push(parts.collect::<Vec<_>>().join("/"));
        }
    }
    Ok(())
}

fn sha256(path: &Path) -> Result<String> {
    let mut file = fs::File::open(path).map_err(|e| output::cannot(path, e))?;
    let (mut hash, mut buffer) = (Sha256::new(), vec![0; 1 << 18]);
    loop {
        match file.read(&mut buffer).map_err(|e| output::cannot(path, e))? {
            0 => break,
            n => hash.update(&buffer[..n]),
        }
    }
    Ok(hash.finalize().iter().map(|b| format!("{b:02x}")).collect())
}
