//! Recordings: numbered PNGs, a GIF, or an MP4 through an `ffmpeg` on the `PATH`.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use crate::app::overlay::Mark;
use crate::components::output::Picture;
use crate::error::{Error, Result};
use crate::host::frames::FrameStats;
use crate::output::{self, AtomicFile, png};
use crate::render::{Frame, ImageSize};
use crate::systems::present::Presenter;

/// Writes one image as PNG, completely or not at all.
///
/// # Errors
/// Returns status 5 if it cannot be written.
pub(crate) fn write_png(path: &Path, frame: &Frame) -> Result<()> {
    frame.write_png(path)
}

/// Writes an 8-bit grey image as PNG, completely or not at all. Width and height are in pixels, row 0 is on top.
///
/// # Errors
/// Returns status 5 if it cannot be written.
#[doc(hidden)]
pub fn write_grey_png(path: &Path, pixels: &[u8], [width, height]: [usize; 2]) -> Result<()> {
    output::write_whole(path, |w| {
        png::encode(w, pixels, [width, height], png::ColorType::Grayscale, png::Compression::Fast)
    })
}

/// Writes an 8-bit colour image as PNG, red, green and blue of each pixel, completely or not at all. Width and height are in pixels, row 0
/// is on top.
///
/// # Errors
/// Returns status 5 if it cannot be written.
#[doc(hidden)]
pub fn write_rgb_png(path: &Path, pixels: &[[u8; 3]], [width, height]: [usize; 2]) -> Result<()> {
    output::write_whole(path, |w| {
        png::encode(w, pixels.as_flattened(), [width, height], png::ColorType::Rgb, png::Compression::Fast)
    })
}

/// Speed at which the palette of a GIF image is chosen, 1 (best) to 30: the colours are learnt from every tenth pixel.
const PALETTE_SPEED: i32 = 10;

/// The presenter that receives the pictures of a flight to record.
pub(crate) struct Recording {
    recorder: Recorder,
    begun: Instant,
    frames: Vec<FrameStats>,
    outcome: Result<()>,
    /// Marks that overlays have drawn over the next picture.
    marks: Vec<Mark>,
    /// The painter of marks, and the picture with marks.
    #[cfg(feature = "window")]
    marked: Option<(crate::host::window::Marker, Frame)>,
}

impl Recording {
    /// Creates a recording without pictures.
    pub(crate) fn new(recorder: Recorder) -> Self {
        Self {
            recorder,
            begun: Instant::now(),
            frames: Vec::new(),
            outcome: Ok(()),
            marks: Vec::new(),
            #[cfg(feature = "window")]
            marked: None,
        }
    }

    /// Starts the clock of the next picture and takes its marks. Call it when the pose is known. Returns the number of pictures so
    /// far.
    pub(crate) fn begin(&mut self, marks: Vec<Mark>) -> usize {
        self.marks = marks;
        self.begun = Instant::now();
        self.images()
    }

    /// Returns the number of pictures that were recorded.
    pub(crate) fn images(&self) -> usize {
        self.frames.len()
    }

    /// Records a picture with the marks over it.
    fn add(&mut self, picture: &Frame) -> Result<()> {
        #[cfg(feature = "window")]
        if !self.marks.is_empty() {
            let (marker, marked) = self.marked.get_or_insert_default();
            marked.show(picture);
            marker.paint(&std::mem::take(&mut self.marks), marked);
            return self.recorder.add(marked);
        }
        self.recorder.add(picture)
    }

    /// Returns the outcome of writing the pictures since the last call.
    ///
    /// # Errors
    /// Returns status 5 if one could not be written.
    pub(crate) fn take_outcome(&mut self) -> Result<()> {
        std::mem::replace(&mut self.outcome, Ok(()))
    }

    /// Ends the recording. Returns the statistics of the pictures and the outcome.
    pub(crate) fn finish(self) -> (Vec<FrameStats>, Result<()>) {
        let finished = self.outcome.and(self.recorder.finish());
        (self.frames, finished)
    }
}

impl Presenter for Recording {
    fn name(&self) -> &'static str {
        "recording"
    }

    fn present(&mut self, picture: &Picture) {
        // File output does not count as the picture's time.
        let ms = self.begun.elapsed().as_secs_f64() * 1e3;
        if !picture.traced || self.outcome.is_err() {
            return;
        }
        self.outcome = self.add(&picture.frame);
        if self.outcome.is_ok() {
            self.frames.push(FrameStats::new(ms, &picture.work));
        }
    }
}

/// A recording that is being written.
pub(crate) enum Recorder {
    /// `0000.png`, … in a folder.
    Folder {
        /// The folder.
        folder: PathBuf,
        /// Number of images written.
        count: usize,
    },
    /// An animated GIF.
    Gif {
        /// The encoder, which writes to `file`. `None` before the first image, which sets its size.
        encoder: Option<gif::Encoder<Shared>>,
        /// The same file, to be finished after the encoder has written its trailer.
        file: Shared,
        /// The final name of the file.
        path: PathBuf,
        /// Images per second.
        fps: f64,
        /// Number of images written.
        count: u64,
    },
    /// A video encoded by another program.
    Video {
        /// The encoder.
        child: Child,
        /// The file it writes.
        file: AtomicFile,
        /// The final name of the file.
        path: PathBuf,
    },
}

impl Recorder {
    /// Starts a recording to `out` (which ends in `/`, `.gif` or `.mp4`), with images of the given size, shown at `fps`.
    ///
    /// # Errors
    /// Returns status 2 for another extension, and status 5 if it cannot be written or there is no `ffmpeg`.
    pub(crate) fn create(out: &str, ImageSize { width, height }: ImageSize, fps: f64) -> Result<Self> {
        let path = PathBuf::from(out);
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        if out.ends_with('/') {
            output::make_folder(&path)?;
            return Ok(Self::Folder { folder: path, count: 0 });
        }
        match ending.as_deref() {
            Some("gif") => {
                let file = Shared(Arc::new(Mutex::new(Some(AtomicFile::create(&path)?))));
                Ok(Self::Gif { encoder: None, file, path, fps, count: 0 })
            }
            Some("mp4") => Self::video(path, ImageSize { width, height }, fps),
            _ => Err(Error::usage(
                format!("--record {out}"),
                "does not end in /, .gif or .mp4",
                "give a folder that ends in /, a .gif or an .mp4",
            )),
        }
    }

    fn video(path: PathBuf, ImageSize { width, height }: ImageSize, fps: f64) -> Result<Self> {
        let file = AtomicFile::create(&path)?;
        let mut ffmpeg = std::process::Command::new("ffmpeg");
        #[cfg(unix)]
        {
            use std::os::unix::process::CommandExt;
            // Ctrl-C goes to the terminal's whole process group, but the film must not end before its images do.
            ffmpeg.process_group(0);
        }
        let child = ffmpeg
            .args(["-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-s", &format!("{width}x{height}"), "-r", &fps.to_string(), "-i", "-"])
            // Chroma is halved in each direction, so the sides must be even.
            .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", "-f", "mp4"])
            .arg(file.place())
            .stdin(Stdio::piped())
            .spawn()
            .map_err(|e| {
                Error::output(
                    &path,
                    format!("ffmpeg cannot be run ({e})"),
                    "install ffmpeg, or record a .gif or a folder/",
                )
            })?;
        Ok(Self::Video { child, file, path })
    }

    /// Adds an image.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be written.
    pub(crate) fn add(&mut self, frame: &Frame) -> Result<()> {
        match self {
            Self::Folder { folder, count } => {
                write_png(&folder.join(format!("{count:04}.png")), frame)?;
                *count += 1;
                Ok(())
            }
            Self::Gif { encoder, file, path, fps, count } => {
                // A GIF counts hundredths of a second. The rounding error of one image is carried over to the next.
                let until = |n: u64| (n as f64 * 100.0 / *fps).round() as u32;
                let delay = u16::try_from(until(*count + 1) - until(*count)).unwrap_or(u16::MAX);
                *count += 1;
                let side = |n: usize| {
                    u16::try_from(n).map_err(|_| {
                        Error::output(
                            path,
                            format!("a GIF has at most {} pixels a side", u16::MAX),
                            "record smaller images",
                        )
                    })
                };
                let (width, height) = (side(frame.width())?, side(frame.height())?);
                let encoder = match encoder {
                    Some(encoder) => encoder,
                    none => {
                        let mut new =
                            gif::Encoder::new(file.clone(), width, height, &[]).map_err(|e| failed(path, e))?;
                        new.set_repeat(gif::Repeat::Infinite).map_err(|e| failed(path, e))?;
                        none.insert(new)
                    }
                };
                let mut image = gif::Frame::from_rgb_speed(width, height, frame.pixels().as_flattened(), PALETTE_SPEED);
                image.delay = delay;
                image.dispose = gif::DisposalMethod::Background;
                encoder.write_frame(&image).map_err(|e| failed(path, e))
            }
            Self::Video { child, path, .. } => child
                .stdin
                .as_mut()
                .map_or(Ok(()), |pipe| pipe.write_all(frame.pixels().as_flattened()))
                .map_err(|e| output::cannot(path, e)),
        }
    }

    /// Finishes the recording. Only then does a GIF or a video get its final name.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be written.
    pub(crate) fn finish(self) -> Result<()> {
        match self {
            Self::Folder { .. } => Ok(()),
            // Without images there is no film, and an existing file of that name is kept.
            Self::Gif { count: 0, .. } => Ok(()),
            Self::Gif { encoder, file, path, .. } => {
                // The encoder writes the file's trailer when it is dropped.
                drop(encoder);
                let whole = file.0.lock().map(|mut f| f.take()).unwrap_or_default();
                whole.map_or_else(
                    || Err(Error::output(&path, "could not be written", "choose another place")),
                    AtomicFile::finish,
                )
            }
            Self::Video { mut child, file, path } => {
                drop(child.stdin.take());
                let done = child.wait().map_err(|e| output::cannot(&path, e))?;
                if !done.success() {
                    return Err(Error::output(&path, format!("ffmpeg failed ({done})"), "record a .gif or a folder/"));
                }
                file.finish()
            }
        }
    }
}

/// A file that an encoder writes to and another owner finishes. It is removed for good if a write fails.
#[derive(Clone)]
pub(crate) struct Shared(Arc<Mutex<Option<AtomicFile>>>);

impl Shared {
    fn with<T>(&self, f: impl FnOnce(&mut AtomicFile) -> std::io::Result<T>) -> std::io::Result<T> {
        let gone = || std::io::Error::other("an earlier write to the file failed");
        let mut file = self.0.lock().map_err(|_| gone())?;
        let result = f(file.as_mut().ok_or_else(gone)?);
        if result.is_err() {
            *file = None;
        }
        result
    }
}

impl Write for Shared {
    fn write(&mut self, buf: &[u8]) -> std::io::Result<usize> {
        self.with(|f| f.write(buf))
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.with(Write::flush)
    }
}

fn failed(path: &Path, e: gif::EncodingError) -> Error {
    match e {
        gif::EncodingError::Io(e) => output::cannot(path, e),
        e => Error::output(path, e.to_string(), "choose another place").caused_by(e),
    }
}

#[cfg(test)]
mod tests {
    use image::AnimationDecoder;
    use image::codecs::gif::GifDecoder;

    use super::*;

    fn plain(colour: [u8; 3]) -> Frame {
        let mut frame = Frame::new(12, 8);
        frame.buffers().0.fill(colour);
        frame
    }

    const COLOURS: [[u8; 3]; 3] = [[250, 0, 0], [0, 250, 0], [0, 0, 250]];

    #[test]
    fn every_image_of_a_folder_has_a_file_of_its_own() {
        let dir = tempfile::tempdir().unwrap();
        let film = dir.path().join("film");
        let mut recorder = Recorder::create(&format!("{}/", film.display()), ImageSize::new(12, 8), 30.0).unwrap();
        COLOURS.iter().for_each(|c| recorder.add(&plain(*c)).unwrap());
        recorder.finish().unwrap();
        for (name, colour) in ["0000.png", "0001.png", "0002.png"].into_iter().zip(COLOURS) {
            assert_eq!(image::open(film.join(name)).unwrap().into_rgb8().get_pixel(5, 5).0, colour, "{name}");
        }
        assert_eq!(std::fs::read_dir(&film).unwrap().count(), 3);
    }

    #[test]
    fn a_gif_keeps_the_time_although_it_counts_hundredths() {
        let dir = tempfile::tempdir().unwrap();
        let film = dir.path().join("film.gif");
        let mut recorder = Recorder::create(&film.to_string_lossy(), ImageSize::new(12, 8), 30.0).unwrap();
        COLOURS.iter().for_each(|c| recorder.add(&plain(*c)).unwrap());
        assert!(!film.exists(), "not before it is whole");
        recorder.finish().unwrap();
        let file = std::io::BufReader::new(std::fs::File::open(&film).unwrap());
        let frames = GifDecoder::new(file).unwrap().into_frames().collect_frames().unwrap();
        // The images begin after 3.3, 6.7 and 10 hundredths of a second.
        let delays: Vec<_> = frames.iter().map(|f| f.delay().numer_denom_ms()).collect();
        assert_eq!(delays, [(30, 1), (40, 1), (30, 1)]);
        for (frame, colour) in frames.iter().zip(COLOURS) {
            assert!(frame.buffer().get_pixel(5, 5).0.iter().zip(colour).all(|(a, b)| a.abs_diff(b) < 8), "{colour:?}");
        }
    }

    #[test]
    fn without_an_image_there_is_no_film() {
        let dir = tempfile::tempdir().unwrap();
        let film = dir.path().join("film.gif");
        Recorder::create(&film.to_string_lossy(), ImageSize::new(12, 8), 30.0).unwrap().finish().unwrap();
        assert!(!film.exists());
    }

    #[cfg(feature = "window")]
    #[test]
    fn marks_are_recorded_over_their_picture_only() {
        let dir = tempfile::tempdir().unwrap();
        let size = ImageSize::new(60, 40);
        let film = dir.path().join("film");
        let mut recording = Recording::new(Recorder::create(&format!("{}/", film.display()), size, 30.0).unwrap());
        let mut picture = Picture::new(size.width, size.height);
        picture.frame.buffers().0.fill([0, 0, 90]);
        picture.traced = true;
        let disc = Mark::Disc { centre: [20.0, 15.0], radius: 8.0, colour: [240, 20, 10] };
        recording.begin(vec![disc]);
        recording.present(&picture);
        recording.begin(Vec::new());
        recording.present(&picture);
        let (frames, outcome) = recording.finish();
        outcome.unwrap();
        assert_eq!(frames.len(), 2);
        let is = |name: &str, x: u32, y: u32, colour: [u8; 3]| {
            let seen = image::open(film.join(name)).unwrap().into_rgb8().get_pixel(x, y).0;
            assert!(seen.iter().zip(colour).all(|(a, b)| a.abs_diff(b) < 4), "{name} {x} {y}: {seen:?}");
        };
        is("0000.png", 20, 15, [240, 20, 10]);
        is("0000.png", 50, 30, [0, 0, 90]);
        is("0001.png", 20, 15, [0, 0, 90]);
    }
}
