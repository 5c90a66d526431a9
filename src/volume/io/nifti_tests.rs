use super::*;

/// Returns the header of 4 × 3 × 2 voxels, in the given unit.
fn head(spacing: DVec3, origin: DVec3, unit: u8) -> Vec<u8> {
    let grid = Grid::new([4, 3, 2], spacing, origin, DMat3::IDENTITY).unwrap();
    let mut head = header(&grid, VoxelKind::Scan).unwrap();
    head[123] = unit;
    head
}

#[test]
fn metres_and_micrometres_become_millimetres_in_either_form() {
    let (spacing, origin) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(10.0, -20.0, 30.0));
    for (unit, mm) in [(0, 1.0), (1, 1000.0), (2, 1.0), (3, 0.001)] {
        // The codes of the qform and of the sform: without one the other counts.
        for without in [252, 254] {
            let mut head = head(spacing / mm, origin / mm, unit);
            head[without..without + 2].fill(0);
            let grid = parse(Path::new("x"), &head).unwrap().grid;
            assert!((grid.spacing() - spacing).length() < 1e-5, "{unit}, {without}: {}", grid.spacing());
            assert!((grid.origin() - origin).length() < 1e-5, "{unit}, {without}: {}", grid.origin());
        }
    }
}

#[test]
fn a_pixdim_that_differs_from_the_sform_by_a_hundredth_is_noted() {
    // The share counts, whatever the spacing.
    for spacing in [0.4, 1.0, 5.0] {
        for (share, notes) in [(1.0, 0), (1.006, 0), (0.994, 0), (1.015, 1), (0.985, 1)] {
            let mut head = head(DVec3::splat(spacing), DVec3::ZERO, 2);
            head[80..84].copy_from_slice(&((spacing * share) as f32).to_le_bytes());
            let read = parse(Path::new("x"), &head).unwrap();
            assert_eq!(read.notes.len(), notes, "{spacing} mm times {share}: {:?}", read.notes);
            assert!((read.grid.spacing() - DVec3::splat(spacing)).length() < 1e-6, "the sform counts");
        }
    }
}
