//! NIfTI files built byte by byte, so that every field can be wrong.

/// A NIfTI-1 file whose fields can all be changed.
#[derive(Clone)]
pub(crate) struct Nifti {
    pub big: bool,
    pub version: u8,
    pub dim: [i64; 8],
    pub datatype: i16,
    pub bitpix: i16,
    pub pixdim: [f64; 8],
    pub vox_offset: f64,
    pub slope: f64,
    pub inter: f64,
    pub units: u8,
    pub qform_code: i16,
    pub sform_code: i16,
    pub quatern: [f64; 3],
    pub qoffset: [f64; 3],
    pub srow: [[f64; 4]; 3],
    pub magic: &'static [u8],
    /// Voxels as stored in the file.
    pub data: Vec<u8>,
}

impl Nifti {
    /// Creates 4×3×2 `i16` voxels 0, 1, 2, …, with an sform only.
    pub(crate) fn small() -> Self {
        Self {
            big: false,
            version: 1,
            dim: [3, 4, 3, 2, 1, 1, 1, 1],
            datatype: 4,
            bitpix: 16,
            pixdim: [1.0, 0.5, 0.75, 2.0, 0.0, 0.0, 0.0, 0.0],
            vox_offset: 352.0,
            slope: 0.0,
            inter: 0.0,
            units: 2,
            qform_code: 0,
            sform_code: 1,
            quatern: [0.0; 3],
            qoffset: [0.0; 3],
            srow: [[-0.5, 0.0, 0.0, 10.0], [0.0, -0.75, 0.0, 20.0], [0.0, 0.0, 2.0, 30.0]],
            magic: b"n+1\0",
            data: (0..24i16).flat_map(i16::to_le_bytes).collect(),
        }
    }

    /// Returns the bytes of the file.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut out = self.header();
        out.extend(&self.data);
        out
    }

    /// Returns the header, up to `vox_offset` if that is plausible.
    pub(crate) fn header(&self) -> Vec<u8> {
        let one = self.version == 1;
        let mut h = vec![0u8; if one { 352 } else { 544 }];
        let big = self.big;
        let mut put = |o: usize, b: &[u8]| {
            let mut b = b.to_vec();
            if big {
                b.reverse();
            }
            h[o..o + b.len()].copy_from_slice(&b);
        };
        if one {
            put(0, &348i32.to_le_bytes());
            self.dim.iter().enumerate().for_each(|(k, d)| put(40 + 2 * k, &(*d as i16).to_le_bytes()));
            put(70, &self.datatype.to_le_bytes());
            put(72, &self.bitpix.to_le_bytes());
            self.pixdim.iter().enumerate().for_each(|(k, d)| put(76 + 4 * k, &(*d as f32).to_le_bytes()));
            put(108, &(self.vox_offset as f32).to_le_bytes());
            put(112, &(self.slope as f32).to_le_bytes());
            put(116, &(self.inter as f32).to_le_bytes());
            put(123, &[self.units]);
            put(252, &self.qform_code.to_le_bytes());
            put(254, &self.sform_code.to_le_bytes());
            let rest = self.quatern.iter().chain(&self.qoffset).chain(self.srow.iter().flatten());
            rest.enumerate().for_each(|(k, d)| put(256 + 4 * k, &(*d as f32).to_le_bytes()));
            h[344..344 + self.magic.len()].copy_from_slice(self.magic);
        } else {
            put(0, &540i32.to_le_bytes());
            put(12, &self.datatype.to_le_bytes());
            put(14, &self.bitpix.to_le_bytes());
            self.dim.iter().enumerate().for_each(|(k, d)| put(16 + 8 * k, &d.to_le_bytes()));
            self.pixdim.iter().enumerate().for_each(|(k, d)| put(104 + 8 * k, &d.to_le_bytes()));
            put(168, &(self.vox_offset as i64).to_le_bytes());
            put(176, &self.slope.to_le_bytes());
            put(184, &self.inter.to_le_bytes());
            put(344, &i32::from(self.qform_code).to_le_bytes());
            put(348, &i32::from(self.sform_code).to_le_bytes());
            let rest = self.quatern.iter().chain(&self.qoffset).chain(self.srow.iter().flatten());
            rest.enumerate().for_each(|(k, d)| put(352 + 8 * k, &d.to_le_bytes()));
            put(500, &i32::from(self.units).to_le_bytes());
            h[4..4 + self.magic.len()].copy_from_slice(self.magic);
        }
        h
    }
}
