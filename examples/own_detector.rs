//! Adds a detector of polyps to colvis: places where the wall is curved alike in every direction, more than a colon is.
//!
//! `cargo run --release --example own_detector -- candidates SCAN --detector round --out C.json`
//! `cargo run --release --example own_detector -- report candidates --quick --out R/` measures it beside the others.

use colvis::error::Result;
use colvis::polyps::{Candidate, Colon, Detector};
use colvis::progress::Progress;

const ROUND: Detector = Detector::new("round", "where the wall is as round as a ball of 3 to 12 mm", find);

/// Returns the roundest places. The engine keeps the best one within 5 mm and measures nothing that it is not asked for.
fn find(colon: &Colon<'_>, progress: &Progress) -> Result<Vec<Candidate>> {
    let wall = colon.wall;
    let mut found = Vec::new();
    for v in 0..wall.len() as u32 {
        let [k1, k2] = wall.curvatures(v);
        let is_peak = wall.beside(v).iter().all(|&n| wall.curvatures(n)[1] <= k2);
        if is_peak && k2 > 0.16 && k1 < 0.8 {
            found.push(Candidate::new(wall.world(v), f64::from(k2 / k1)));
        }
    }
    progress.check()?;
    Ok(found)
}

fn main() -> std::process::ExitCode {
    colvis::cli::Program::default().detector(ROUND).run()
}

#[test]
fn it_finds_the_polyps_of_a_phantom() -> Result<()> {
    use colvis::phantom::{Phantom, PhantomSettings};
    use colvis::polyps::{Wall, find};
    let (phantom, progress) = (Phantom::new(&PhantomSettings::embedded(1)), Progress::new());
    let volume = phantom.voxelise(&phantom.grid(), &progress)?;
    let lumen = colvis::fields::lumen::find(&volume, &progress)?;
    let wall = Wall::new(&volume, &lumen, -650.0, &progress)?;
    let found = find(&ROUND, &Colon { volume: &volume, lumen: &lumen, wall: &wall }, &progress)?;
    let polyps = phantom.polyps();
    let near = |p: &colvis::phantom::TruePolyp| found.iter().any(|c| c.position.distance(p.position) < p.diameter_mm);
    assert!(polyps.iter().filter(|p| near(p)).count() >= 5, "most of the {}", polyps.len());
    Ok(())
}
