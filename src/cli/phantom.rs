//! `colvis phantom`.

use std::path::{Path, PathBuf};

use crate::app::{Timings, graft};
use crate::cli::args::{Global, PhantomArgs, PhantomFeature, PhantomPosition, PhantomSize};
use crate::cli::messages::say;
use crate::cli::prepare;
use crate::cli::shared::Use;
use crate::error::{Error, Result};
use crate::output;
use crate::phantom::{NOISE_HU, Phantom, PhantomSettings, Position, Scanner, Size};
use crate::progress::Progress;
use crate::volume::io;

/// Runs the command. Fails with status 2 for an unknown extension, invalid slices or noise, or a second position of limbs that touch, 4 if cancelled, 5 if an output cannot
/// be written.
pub(crate) fn run(args: &PhantomArgs, global: &Global, progress: &Progress) -> Result<()> {
    let volumes = || std::iter::once(&args.out).chain(&args.twin).chain(&args.second).map(PathBuf::as_path);
    let all: Vec<_> = volumes().chain(args.truth.as_deref()).chain(args.labels.as_deref()).collect();
    output::check_folders(&all)?;
    volumes().chain(args.labels.as_deref()).try_for_each(io::check_ending)?;
    if let Some(scan) = &args.into {
        return put_into(scan, args, global, progress);
    }
    let has = |feature| args.with.contains(&feature);
    let scanner = Scanner { noise_hu: noise_hu(args)?, slice_mm: args.slice, ..Scanner::default() };
    let settings = PhantomSettings {
        size: match args.size {
            PhantomSize::Small => Size::Small,
            PhantomSize::Standard => Size::Standard,
            PhantomSize::Large => Size::Large,
        },
        folds: has(PhantomFeature::Folds),
        polyps: has(PhantomFeature::Polyps),
        fluid: has(PhantomFeature::Fluid),
        pools: has(PhantomFeature::Pools),
        films: has(PhantomFeature::Films),
        stool: has(PhantomFeature::Stool),
        inhomogeneous: has(PhantomFeature::Inhomogeneous),
        pseudo: has(PhantomFeature::Pseudo),
        position: match args.position {
            PhantomPosition::Supine => Position::Supine,
            PhantomPosition::Prone => Position::Prone,
            PhantomPosition::Left => Position::Left,
            PhantomPosition::Right => Position::Right,
        },
        bridges: has(PhantomFeature::Bridges),
        lesions: has(PhantomFeature::Lesions),
        decoys: has(PhantomFeature::Decoys),
        ileum: has(PhantomFeature::Ileum),
        stomach: has(PhantomFeature::Stomach),
        lungs: has(PhantomFeature::Lungs),
        collapsed: has(PhantomFeature::Collapsed),
        pelvis: has(PhantomFeature::Pelvis),
        touching: has(PhantomFeature::Touching),
        touching_mm: None,
        noise: has(PhantomFeature::Noise),
        seed: global.seed.unwrap_or(1),
    };
    let phantom = Phantom::scanned(&settings, scanner);
    let second = args.second.as_ref().map(|path| Ok((path, phantom.second()?))).transpose()?;
    let grid = phantom.scan_grid()?;
    let volume = phantom.scan(progress)?;
    let own = || second.as_ref().map_or_else(|| phantom.truth(), |(_, second)| second.truth());
    let truth = args.truth.as_ref().map(|path| (path, own()));
    progress.check()?;
    io::save(&args.out, &volume, progress)?;
    drop(volume);
    if let Some(path) = &args.twin {
        io::save(path, &phantom.twin().scan(progress)?, progress)?;
    }
    if let Some((path, second)) = &second {
        io::save(path, &second.phantom().scan(progress)?, progress)?;
    }
    if let Some(path) = &args.labels {
        io::save_mask(path, &grid, &phantom.labels(&grid, progress)?, progress)?;
    }
    match truth {
        Some((path, truth)) => output::write_json(path, &truth),
        None => Ok(()),
    }
}

/// Number of lesions that are put into a scan if none is given.
const LESIONS: u16 = 20;

/// Puts lesions into a scan. Fails with status 2 for outputs that only a phantom has, 3 if it cannot be read, 4 if it has no colon to put them into or if cancelled, 5 if an
/// output cannot be written.
fn put_into(scan: &Path, args: &PhantomArgs, global: &Global, progress: &Progress) -> Result<()> {
    for (option, path) in [("--labels", &args.labels), ("--twin", &args.twin), ("--second", &args.second)] {
        if path.is_some() {
            return Err(Error::usage(option, "is not known of a scan that lesions are put into", "leave it out"));
        }
    }
    // Cleansing is the reader's: the scan keeps its tag.
    let global = Global { cleanse: false, ..global.clone() };
    let volume = prepare::load(scan, &global, Use::Change, &mut Timings::default(), progress)?.into_volume();
    let count = usize::from(args.lesions.unwrap_or(LESIONS));
    let made = graft::graft(volume, global.seed.unwrap_or(1), count, progress)?;
    let found_room = made.truth.polyps.len();
    if found_room < count {
        say(&format!("{found_room} of {count} lesions found room in this colon"));
    }
    io::save(&args.out, &made.volume, progress)?;
    args.truth.as_ref().map_or(Ok(()), |path| output::write_json(path, &made.truth))
}

/// Returns the level of the noise, HU.
fn noise_hu(args: &PhantomArgs) -> Result<f64> {
    let Some(hu) = args.noise else { return Ok(NOISE_HU) };
    if !args.with.contains(&PhantomFeature::Noise) {
        return Err(Error::usage("--noise", "the phantom has no noise", "add noise to --with"));
    }
    if !(0.0..=MOST_NOISE_HU).contains(&hu) {
        let why = format!("{hu} HU is not a valid noise level");
        return Err(Error::usage("--noise", why, format!("give a number from 0 to {MOST_NOISE_HU}")));
    }
    Ok(hu)
}

/// Largest level of the noise, HU.
const MOST_NOISE_HU: f64 = 500.0;
