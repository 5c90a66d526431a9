//! A dataset's folder while it is not whole.

use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::shots::{EXPOSURES, exposure};
use super::{Source, path, readme};
use crate::dataset::layout::{Index, Layout};
use crate::error::{Error, Result};
use crate::output::{self, AtomicFile};
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
        progress.stage("checksums", 0);
        // Before the file of the sums is there.
        let names = names(&self.path)?;
        let mut file = AtomicFile::create(&path(&self.path, SUMS))?;
        sums(&self.path, "", &names, &mut file, progress)?;
        file.finish()?;
        // An empty folder of that name gives way.
        let _ = fs::remove_dir(&self.folder);
        fs::rename(&self.path, &self.folder).map_err(|e| output::cannot(&self.folder, e))
    }
}

/// Files whose sums are found at a time.
const CHUNK: usize = 1 << 12;

/// Returns the names in a folder in order, those of folders with `/` behind them: the order in which paths with `/` between parts are.
fn names(folder: &Path) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(|e| output::cannot(folder, e))? {
        let entry = entry.map_err(|e| output::cannot(folder, e))?;
        let end = if entry.path().is_dir() { "/" } else { "" };
        names.push(format!("{}{end}", entry.file_name().to_string_lossy()));
    }
    names.sort_unstable();
    Ok(names)
}

/// Writes the sums of the files with these `names` below `root`, whose paths begin with `before`, and of those in the folders among them. A
/// million files of a folder take no more memory than their names.
fn sums(root: &Path, before: &str, names: &[String], out: &mut dyn Write, progress: &Progress) -> Result<()> {
    let is_file = |name: &String| !name.ends_with('/');
    for some in names.chunk_by(|a, b| is_file(a) && is_file(b)).flat_map(|some| some.chunks(CHUNK)) {
        if let [folder] = some
            && !is_file(folder)
        {
            let whole = format!("{before}{folder}");
            let inside = self::names(&path(root, whole.trim_end_matches('/')))?;
            sums(root, &whole, &inside, out, progress)?;
            continue;
        }
        let sum = |name: &String| {
            progress.advance(1)?;
            Ok(format!("{}  {before}{name}\n", sha256(&path(root, &format!("{before}{name}")))?))
        };
        let wanted: Vec<&String> = some.iter().filter(|name| *name != SUMS || !before.is_empty()).collect();
        let lines: Vec<String> = wanted.into_par_iter().map(sum).collect::<Result<_>>()?;
        out.write_all(lines.concat().as_bytes()).map_err(|e| output::cannot(&path(root, SUMS), e))?;
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
