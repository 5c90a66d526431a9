//! What the text headers of MetaImage and NRRD share.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use crate::error::{Error, Result};

/// The longest text header that is read, bytes: some writers keep whole protocols in it.
pub const MAX_HEADER: u64 = 1 << 20;

/// Exactly `N` numbers (or anything else that parses) separated by white space.
pub fn exactly<T: FromStr + Copy, const N: usize>(value: &str) -> Option<[T; N]> {
    some(value)?.try_into().ok()
}

/// All the numbers of a line.
pub fn some<T: FromStr>(value: &str) -> Option<Vec<T>> {
    value.split_whitespace().map(|t| t.parse().ok()).collect()
}

/// The failure of a header's field.
pub fn bad(path: &Path, key: &str, value: &str, wanted: &str) -> Error {
    // A damaged header can hold kilobytes in one line.
    let value: String = value.chars().take(60).collect();
    Error::file(path, format!("{key} is {value:?}, not {wanted}"), "correct the header")
}

/// The data file that a header names, which must lie in or below the header's folder.
///
/// # Errors
/// Status 3 when it is missing or lies elsewhere, be it by an absolute path, by `..` or behind a link.
pub fn data_file(header: &Path, name: &str) -> Result<PathBuf> {
    let outside = || {
        Error::file(
            header,
            format!("its data file {name:?} lies outside the header's folder"),
            "move the data beside the header and name it there",
        )
    };
    let missing =
        || Error::file(header, format!("its data file {name:?} does not exist"), "put the data beside the header");
    if name.is_empty() {
        return Err(Error::file(header, "names no data file", "name the data file in the header"));
    }
    let real = header.canonicalize().map_err(|e| super::source::unreadable(header, &e))?;
    let folder = real.parent().ok_or_else(outside)?;
    let named = Path::new(name);
    let leaves = named.is_absolute() || named.components().any(|c| c == std::path::Component::ParentDir);
    match folder.join(named).canonicalize() {
        Ok(data) if data.starts_with(folder) && data != folder => Ok(data),
        Ok(_) => Err(outside()),
        // Whether something exists elsewhere is not told.
        Err(_) if leaves => Err(outside()),
        Err(_) => Err(missing()),
    }
}

/// `count` voxels from dims.
///
/// # Errors
/// Status 3 when one is zero or the product is beyond what can be addressed.
pub fn voxel_count(path: &Path, dims: [usize; 3]) -> Result<usize> {
    if dims.contains(&0) {
        return Err(Error::file(path, format!("has no voxels (dims {dims:?})"), "correct the header"));
    }
    dims.iter()
        .try_fold(1usize, |n, &d| n.checked_mul(d))
        .filter(|&n| n <= isize::MAX as usize / 8)
        .ok_or_else(|| Error::file(path, format!("dims {dims:?} overflow"), "correct the header"))
}
