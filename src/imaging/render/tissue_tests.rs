//! A camera within tissue: a homogeneous region that is not empty, whose gradient points at the camera.
//!
//! The expected picture is computed here, voxel by voxel. The first sample of each ray is opaque, so the picture is the
//! colour of its value or filtered density in full light, as on a wall seen head on.

use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};

use super::transfer::Palette;
use super::*;
use crate::math::hash;
use crate::volume::{Grid, Volume};

const SIZE: usize = 24;

/// Tissue everywhere, with uneven density as from noise: a regression finds gradients of any direction in it. The
/// values are within what seven bits can distinguish.
fn tissue(spacing: DVec3) -> PreparedVolume {
    let grid = Grid::new([SIZE; 3], spacing, DVec3::new(5.0, -7.0, 11.0), DMat3::from_rotation_y(0.3)).unwrap();
    let data = (0..grid.len() as u64).map(|n| (-450.0 + 300.0 * hash::uniform(3, n)) as i16).collect();
    PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default())
}

/// Returns D of the 4D regression at a voxel: the mean of its 26 neighbours, weighted by 1/d².
fn density(volume: &Volume, v: [i64; 3]) -> f64 {
    let spacing = volume.grid().spacing();
    let (mut sum, mut weights) = (0.0, 0.0);
    for n in (0..27i64).filter(|&n| n != 13) {
        let by = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
        let d = DVec3::from_array(by.map(|b| b as f64)) * spacing;
        let w = 1.0 / d.length_squared();
        sum += w * f64::from(volume.get(v[0] + by[0], v[1] + by[1], v[2] + by[2]));
        weights += w;
    }
    sum / weights
}

/// Evaluates `of_voxel` at a place (voxel coordinates): interpolated between eight voxels, or at the nearest one.
fn at(place: DVec3, detail: Quality, of_voxel: impl Fn([i64; 3]) -> f64) -> f64 {
    if detail == Quality::Low {
        return of_voxel(place.round().to_array().map(|c| c as i64));
    }
    let (cell, t) = (place.floor(), place - place.floor());
    (0..8)
        .map(|n| {
            let corner = DVec3::new(f64::from(n & 1), f64::from(n >> 1 & 1), f64::from(n >> 2));
            let near = DVec3::ONE - (t - corner).abs();
            near.x * near.y * near.z * of_voxel((cell + corner).to_array().map(|c| c as i64))
        })
        .sum()
}

/// Computes the expected picture.
fn truth(volume: &PreparedVolume, view: &View, settings: &Settings, by_density: bool) -> Vec<Vec3> {
    let (volume, grid) = (volume.voxels(), volume.voxels().grid());
    let first = 0.5 * grid.min_spacing() * 2f64.powi(settings.step_power);
    let pixel = |n: usize| {
        let ray = view.ray(n % view.width(), n / view.width()).unwrap();
        let place = grid.voxel(ray.origin + ray.direction * first);
        let value = if by_density {
            at(place, settings.quality, |v| density(volume, v))
        } else {
            at(place, settings.quality, |[i, j, k]| f64::from(volume.get(i, j, k)))
        };
        Palette::default().colour(value as f32) * 255.0
    };
    (0..view.width() * view.height()).map(pixel).collect()
}

#[test]
fn tissue_all_round_is_as_bright_as_a_wall_seen_head_on() {
    let (filtered, bytes) = (Classification::Filtered, presets::colvis::PRESET);
    for spacing in [DVec3::ONE, DVec3::new(0.6, 0.7, 2.0)] {
        let volume = tissue(spacing);
        let from = volume.voxels().grid().world(DVec3::new(11.3, 12.1, 12.4));
        let view = View::new(from, DVec3::new(0.3, -0.5, 0.8), DVec3::Z, 90.0, 21, 15).unwrap();
        for quality in [Quality::High, Quality::Low] {
            let low = Some(LowDetail::Nearest);
            let sources =
                [None, Some(GradientSource::Eight), Some(GradientSource::Cached), Some(GradientSource::Stored)];
            let mut all = Vec::new();
            for gradients in sources {
                let choices = Choices { gradients, low, ..Choices::default() };
                let settings = Settings { choices, ..Settings::new(quality) };
                all.push((presets::standard::PRESET, settings, false));
                all.push((presets::standard::PRESET, Settings { classification: filtered, ..settings }, true));
                all.push((bytes, settings, true));
            }
            for (preset, settings, by_density) in all {
                let mut frame = Frame::default();
                renderer(&volume, settings, preset, Reuse::Allowed).render(&view, &mut frame);
                let want = truth(&volume, &view, &settings, by_density);
                for (got, want) in frame.pixels().iter().zip(want) {
                    let got = Vec3::from_array(got.map(f32::from));
                    let off = (got - want).abs().max_element();
                    assert!(off <= 1.0, "{} {settings:?} {spacing}: {got} for {want}", preset.name);
                }
            }
        }
    }
}

/// A filtered density reaches beyond the flag's neighbourhood. Next to the wall it is visible where the nearest voxel
/// is flagged as empty, and its gradient shades it all the same.
#[test]
fn gas_beside_a_slanted_wall_has_its_gradient() {
    let grid = Grid::new([SIZE; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let wall = |n: usize| if (n % SIZE) as f64 - 0.5 * (n / SIZE % SIZE) as f64 > 6.0 { 3000 } else { -1000 };
    let volume = Volume::new(grid.clone(), (0..grid.len()).map(wall).collect());
    let volume = PreparedVolume::new(Arc::new(volume), TransferFunction::default());
    let view = View::new(DVec3::new(4.0, 12.0, 12.0), DVec3::X, DVec3::Z, 10.0, 15, 15).unwrap();
    let settings = Settings { classification: Classification::Filtered, ..Settings::default() };
    let mut frame = Frame::default();
    renderer(&volume, settings, presets::standard::PRESET, Reuse::Allowed).render(&view, &mut frame);
    // The wall is seen 27° from head on, and 20° to 34° over the picture and the steps of its voxels: 0.1 + 0.9 cos of
    // full light, which is 230 to 242 in red.
    let brightest = frame.pixels().iter().map(|p| p[0]).max().unwrap();
    assert!((190..230).contains(&brightest), "{brightest}");
}
