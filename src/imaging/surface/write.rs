//! Writing of a closed surface to a file: STL (binary), PLY (binary, little endian) or OBJ, in millimetres, LPS.

use std::io::{self, Write};
use std::path::Path;

use glam::{DVec3, Vec3};

use super::lumen::LumenMesh;
use crate::error::{Error, Result};
use crate::output;
use crate::progress::Progress;

/// Triangles and vertices between two checks for interruption.
const BATCH: usize = 1 << 15;
/// Largest distance from the world's origin at which single precision is accurate to 2 µm, mm. Beyond it PLY uses
/// double precision, and STL, which cannot, is refused.
const NEAR_MM: f64 = 32_768.0;

/// The file format of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MeshFormat {
    /// Binary STL: triangles with their normals; vertices are not shared.
    Stl,
    /// Binary little-endian PLY.
    Ply,
    /// Wavefront OBJ.
    Obj,
}

impl MeshFormat {
    /// Returns the format for a file's extension.
    ///
    /// # Errors
    /// Returns status 2 if the extension is not one of them.
    pub fn of(path: &Path) -> Result<Self> {
        let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        match ending.as_str() {
            "stl" => Ok(Self::Stl),
            "ply" => Ok(Self::Ply),
            "obj" => Ok(Self::Obj),
            _ => {
                let why = "its extension is not that of a mesh format";
                Err(Error::usage(path.display().to_string(), why, "end it in .stl, .ply or .obj"))
            }
        }
    }
}

impl LumenMesh {
    /// Writes the complete surface, or nothing, in the format of the file's extension.
    ///
    /// # Errors
    /// Returns status 2 for an unknown extension, or for an STL so far from the world's origin that single precision
    /// cannot distinguish its vertices; 4 if interrupted; 5 if the file cannot be written.
    pub fn save(&self, path: &Path, progress: &Progress) -> Result<()> {
        let format = MeshFormat::of(path)?;
        progress.stage("writing the surface", (self.triangles.len()) as u64);
        let far = is_far(self.origin, &self.places);
        if far && format == MeshFormat::Stl {
            let why =
                format!("the scan lies more than {NEAR_MM} mm from the world's origin, too far for single precision");
            return Err(Error::usage(path.display().to_string(), why, "write a .ply or an .obj"));
        }
        output::write_whole(path, |w| match format {
            MeshFormat::Stl => self.stl(w, progress),
            MeshFormat::Ply => self.ply(w, far, progress),
            MeshFormat::Obj => self.obj(w, progress),
        })
    }

    fn stl(&self, w: &mut dyn Write, progress: &Progress) -> io::Result<()> {
        let mut head = [b' '; 80];
        let text = b"colvis: surface of the colon's lumen, mm LPS, normals out of the lumen";
        head[..text.len()].copy_from_slice(text);
        w.write_all(&head)?;
        w.write_all(&(self.triangles.len() as u32).to_le_bytes())?;
        for batch in self.triangles.chunks(BATCH) {
            for &t in batch {
                let [a, b, c] = t.map(|v| self.world(v).as_vec3().as_dvec3());
                let normal = (b - a).cross(c - a).normalize_or_zero();
                for p in [normal, a, b, c] {
                    write_single(w, p)?;
                }
                w.write_all(&[0; 2])?;
            }
            progress.advance(batch.len() as u64).map_err(io::Error::other)?;
        }
        Ok(())
    }

    fn ply(&self, w: &mut dyn Write, double: bool, progress: &Progress) -> io::Result<()> {
        let about = "surface of the colon's lumen, mm LPS, normals out of the lumen";
        write_ply(w, (self.origin, &self.places, &self.triangles), about, double, None, progress)
    }

    fn obj(&self, w: &mut dyn Write, progress: &Progress) -> io::Result<()> {
        writeln!(w, "# colvis: surface of the colon's lumen, mm LPS, normals out of the lumen")?;
        for first in (0..self.places.len()).step_by(BATCH) {
            for v in first..(first + BATCH).min(self.places.len()) {
                let p = self.world(v as u32);
                writeln!(w, "v {:.5} {:.5} {:.5}", p.x, p.y, p.z)?;
            }
            progress.check().map_err(io::Error::other)?;
        }
        for batch in self.triangles.chunks(BATCH) {
            for [a, b, c] in batch.iter().map(|t| t.map(|v| v + 1)) {
                writeln!(w, "f {a} {b} {c}")?;
            }
            progress.advance(batch.len() as u64).map_err(io::Error::other)?;
        }
        Ok(())
    }
}

/// Writes vertices, as offsets from an origin, and triangles as binary PLY, with a named number for each triangle if there are any.
#[doc(hidden)]
pub fn write_ply(
    w: &mut dyn Write,
    (origin, places, triangles): (DVec3, &[Vec3], &[[u32; 3]]),
    about: &str,
    double: bool,
    numbers: Option<(&str, &dyn Fn(usize) -> u16)>,
    progress: &Progress,
) -> io::Result<()> {
    let kind = if double { "double" } else { "float" };
    let number = numbers.map_or_else(String::new, |(name, _)| format!("property ushort {name}\n"));
    write!(
        w,
        "ply\nformat binary_little_endian 1.0\ncomment colvis: {about}\nelement vertex {}\nproperty {kind} x\n\
         property {kind} y\nproperty {kind} z\nelement face {}\nproperty list uchar int vertex_indices\n{number}end_header\n",
        places.len(),
        triangles.len()
    )?;
    for batch in places.chunks(BATCH) {
        for place in batch {
            let p = origin + place.as_dvec3();
            if double {
                p.to_array().into_iter().try_for_each(|x| w.write_all(&x.to_le_bytes()))?;
            } else {
                write_single(w, p)?;
            }
        }
        progress.check().map_err(io::Error::other)?;
    }
    for (first, batch) in (0..).step_by(BATCH).zip(triangles.chunks(BATCH)) {
        for (n, t) in batch.iter().enumerate() {
            w.write_all(&[3])?;
            t.iter().try_for_each(|v| w.write_all(&v.to_le_bytes()))?;
            if let Some((_, of)) = numbers {
                w.write_all(&of(first + n).to_le_bytes())?;
            }
        }
        progress.advance(batch.len() as u64).map_err(io::Error::other)?;
    }
    Ok(())
}

/// True if single precision cannot hold the places, which are offsets from an origin.
#[doc(hidden)]
pub fn is_far(origin: DVec3, places: &[Vec3]) -> bool {
    places.iter().any(|p| (origin + p.as_dvec3()).abs().max_element() > NEAR_MM)
}

fn write_single(w: &mut dyn Write, p: DVec3) -> io::Result<()> {
    p.as_vec3().to_array().into_iter().try_for_each(|x| w.write_all(&x.to_le_bytes()))
}
