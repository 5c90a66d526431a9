//! A scan with its tagged fluid replaced by gas, so that the segments joined by fluid are flown as one.

use super::Lumen;
use super::lumen::Segment;
use crate::volume::Volume;

/// Value that replaces the fluid, HU: gas.
const GAS: i16 = -1000;

/// Returns the volume with gas in place of the lumen's tagged fluid. The blurred layer between gas and fluid counts as
/// fluid, so no film remains between them. The wall under the fluid is unchanged.
pub(crate) fn drained(volume: &Volume, lumen: &Lumen) -> Volume {
    let grid = volume.grid();
    let mut data = volume.data().to_vec();
    for (j, k, r) in lumen.fluid().iter() {
        let row = grid.index(0, j, k);
        data[row + r.start as usize..row + r.end as usize].fill(GAS);
    }
    Volume::new(grid.clone(), data)
}

/// Keeps the ends of the original segments in a drained scan, if their order from rectum to cecum was known. The
/// drained fluid may lead on into bowel beyond them, which is not flown.
pub(crate) fn keep_ends(drained: &mut Lumen, before: &Lumen) {
    if !before.ordered {
        return;
    }
    for n in 0..drained.segments.len() {
        let holds = |s: &&Segment| s.ends.iter().all(|&e| drained.segment_at(e) == Some(n));
        let mut joined = before.segments.iter().filter(holds);
        if let Some(first) = joined.next() {
            let last = joined.next_back().unwrap_or(first);
            drained.segments[n].ends = [first.ends[0], last.ends[1]];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::lumen;
    use crate::phantom::{Phantom, PhantomSettings, Size};
    use crate::progress::Progress;

    #[test]
    fn fluid_becomes_gas_and_parts_nothing() {
        let phantom =
            Phantom::new(&PhantomSettings { size: Size::Small, fluid: true, seed: 3, ..PhantomSettings::default() });
        let progress = Progress::new();
        let volume = phantom.voxelise(&phantom.grid(), &progress).unwrap();
        let before = lumen::find(&volume, &progress).unwrap();
        assert!(before.fluid_ml() > 5.0, "{} ml", before.fluid_ml());
        let after = lumen::find(&drained(&volume, &before), &progress).unwrap();
        assert!(after.segments.len() <= before.segments.len());
        let [was, is] = [before.gas_ml() + before.fluid_ml(), after.gas_ml() + after.fluid_ml()];
        println!("{was:.1} ml of gas and fluid, {is:.1} ml when drained");
        assert!((is / was - 1.0).abs() < 0.05 && after.fluid_ml() < 0.1 * before.fluid_ml());
        assert_eq!(after.segments.len(), 1);
        let mut kept = after;
        keep_ends(&mut kept, &before);
        if before.ordered {
            let last = before.segments.len() - 1;
            assert_eq!(kept.segments[0].ends, [before.segments[0].ends[0], before.segments[last].ends[1]]);
        }
    }
}
