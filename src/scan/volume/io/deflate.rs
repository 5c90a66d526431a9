//! Multithreaded gzip that writes one ordinary member.
//!
//! The data is cut into blocks of fixed size. Each block is deflated separately and ends on a byte boundary (a sync
//! flush), so the blocks can be concatenated. Neither the cuts nor the bytes depend on the number of threads.

use std::io::{self, Write};

use flate2::{Compress, Compression, Crc, FlushCompress};
use rayon::prelude::*;

use crate::progress::Progress;

/// Uncompressed bytes of one block, large enough that restarting costs almost no compression.
pub(crate) const BLOCK: usize = 1 << 20;

/// Gzips `prefix` followed by `blocks` blocks made by `make`. `progress` advances by uncompressed bytes. Returns the sink's error,
/// or the cancellation (wrapped).
pub(crate) fn gzip(
    sink: &mut dyn Write,
    prefix: &[u8],
    blocks: usize,
    make: &(dyn Fn(usize) -> Vec<u8> + Sync),
    progress: &Progress,
) -> io::Result<()> {
    // No name, no time (the same input gives the same bytes), fastest compression, unknown system.
    sink.write_all(&[0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 4, 255])?;
    let mut sum = Crc::new();
    let mut put = |unpacked: &Crc, packed: &[u8]| {
        sum.combine(unpacked);
        sink.write_all(packed)
    };
    let (first, packed) = block(prefix)?;
    put(&first, &packed)?;
    let wave = 2 * rayon::current_num_threads();
    for start in (0..blocks).step_by(wave) {
        let done: Vec<io::Result<(Crc, Vec<u8>)>> =
            (start..blocks.min(start + wave)).into_par_iter().map(|k| block(&make(k))).collect();
        for result in done {
            let (crc, packed) = result?;
            put(&crc, &packed)?;
            progress.advance(u64::from(crc.amount())).map_err(io::Error::other)?;
        }
    }
    // An empty final block of stored type ends the stream.
    sink.write_all(&[1, 0, 0, 0xff, 0xff])?;
    sink.write_all(&sum.sum().to_le_bytes())?;
    sink.write_all(&sum.amount().to_le_bytes())
}

fn block(bytes: &[u8]) -> io::Result<(Crc, Vec<u8>)> {
    let mut crc = Crc::new();
    crc.update(bytes);
    let mut deflate = Compress::new(Compression::fast(), false);
    let mut packed = Vec::with_capacity(bytes.len() / 2 + 1024);
    loop {
        let from = deflate.total_in() as usize;
        deflate.compress_vec(&bytes[from..], &mut packed, FlushCompress::Sync).map_err(io::Error::other)?;
        // If there is room left, the flush is complete.
        if deflate.total_in() as usize == bytes.len() && packed.len() < packed.capacity() {
            return Ok((crc, packed));
        }
        packed.reserve(bytes.len() / 4 + 1024);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    #[test]
    fn any_reader_gets_the_same_bytes_back() {
        for (seed, len) in [(1u64, 0usize), (2, 5), (3, BLOCK), (4, 3 * BLOCK + 17)] {
            // Half noise (which deflate cannot shrink), half constant.
            let data: Vec<u8> =
                (0..len).map(|i| if i < len / 2 { crate::math::hash::bits(seed, i as u64) as u8 } else { 7 }).collect();
            let make = |k: usize| data[k * BLOCK..len.min((k + 1) * BLOCK)].to_vec();
            let mut out = Vec::new();
            gzip(&mut out, b"head", len.div_ceil(BLOCK), &make, &Progress::new()).unwrap();
            let mut back = Vec::new();
            // This decoder reads a single member, so there must be only one.
            flate2::read::GzDecoder::new(&out[..]).read_to_end(&mut back).unwrap();
            assert_eq!(&back[..4], b"head");
            assert!(back[4..] == data[..]);
        }
    }
}
