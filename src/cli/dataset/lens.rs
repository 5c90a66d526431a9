//! The camera of a dataset, before there are poses.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use crate::cli::args::{DatasetArgs, Global, ImageSize};
use crate::cli::render::{Poses, camera, read};
use crate::cli::{Program, prepare};
use crate::dataset::camera::Intrinsics;
use crate::error::Result;
use crate::render::{Camera, CameraModel, View};

/// Returns the intrinsics of the arguments' camera. Fails with status 2 for invalid options, 3 for an unusable file of poses.
pub(super) fn intrinsics(program: &Program, args: &DatasetArgs, global: &Global) -> Result<Intrinsics> {
    let (poses, model) = match &args.poses {
        Some(path) => read(program, global, path)?,
        None => (Poses::default(), prepare::camera(program, global, CameraModel::default())?),
    };
    let size = args.size.map_or_else(|| prepare::usual_size(model), Ok)?;
    let place = args.poses.as_deref().unwrap_or(Path::new(""));
    let (lens, _) = camera(global, &poses, model, (place, size))?;
    of(&poses, model, global, (&lens, size))
}

/// Returns the intrinsics of a camera: those in the file of poses, or those of the model that was named.
pub(super) fn of(
    poses: &Poses,
    model: CameraModel,
    global: &Global,
    (lens, size): (&Arc<dyn Camera>, ImageSize),
) -> Result<Intrinsics> {
    let other = |name: &str| Intrinsics::Other { name: name.into() };
    if let Some(value) = poses.camera.as_ref().filter(|c| c.is_object()) {
        return Ok(serde_json::from_value(value.clone()).unwrap_or_else(|_| other("poses")));
    }
    Ok(match model.name {
        "fisheye" => {
            let fov = global.fov.or(poses.fov_degrees).unwrap_or(90.0);
            Intrinsics::of_equidistant(fov, [size.width, size.height])
        }
        "panorama" => Intrinsics::Panorama,
        name => {
            // Wherever it is, it has the same.
            let view = View::with_camera(DVec3::ZERO, DVec3::Y, DVec3::Z, Arc::clone(lens), size.width, size.height)?;
            Intrinsics::of_perspective(&view).unwrap_or_else(|| other(name))
        }
    })
}
