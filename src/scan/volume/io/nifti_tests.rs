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

/// Without an sform the spacing is that of the header's pixdim, in the second version too, and the sign of the first
/// one turns the third axis round.
#[test]
fn a_header_of_the_second_version_has_the_spacing_of_its_pixdim() {
    for qfac in [1.0, -1.0] {
        let mut head = vec![0u8; 540];
        let mut put = |offset: usize, bytes: &[u8]| head[offset..offset + bytes.len()].copy_from_slice(bytes);
        put(0, &540i32.to_le_bytes());
        put(4, b"n+2\0\r\n\x1a\n");
        // 16-bit numbers.
        put(12, &4i16.to_le_bytes());
        put(14, &16i16.to_le_bytes());
        for (k, n) in [3i64, 4, 3, 2, 1, 1, 1, 1].into_iter().enumerate() {
            put(16 + 8 * k, &n.to_le_bytes());
        }
        for (k, mm) in [qfac, 0.7f64, 0.8, 2.5].into_iter().enumerate() {
            put(104 + 8 * k, &mm.to_le_bytes());
        }
        // A qform whose rotation is none, and millimetres.
        put(344, &1i32.to_le_bytes());
        put(500, &2i32.to_le_bytes());
        let grid = parse(Path::new("x"), &head).unwrap().grid;
        assert_eq!((grid.dims(), grid.spacing()), ([4, 3, 2], DVec3::new(0.7, 0.8, 2.5)));
        assert!((grid.direction().z_axis - DVec3::Z * qfac).length() < 1e-12, "{}", grid.direction());
    }
}
