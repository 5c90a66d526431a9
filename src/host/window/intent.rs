//! What the operator can want, by whatever key, button, menu, panel or action of another crate.

use std::borrow::Cow;
use std::path::PathBuf;
use std::time::Instant;

use glam::DVec3;

use super::assistant::Showing;
use super::flat::FlatInput;
use super::keys::Hold;
use crate::app::findings::{Morphology, Tissue};
use crate::components::input::Command;
use crate::components::slices::Orientation;
use crate::fields::lumen::GasKind;
use crate::polyps::answers::Answer;
use crate::render::ImageSize;

/// Something that the operator wants. The window does it if it is possible, and says why not otherwise.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Intent {
    /// Nothing by a key: it is a mouse gesture only.
    Gesture,
    /// Steer while the key is held.
    Hold(Hold),
    /// Pause or resume the flight.
    Pause,
    /// Turn round and fly back.
    Reverse,
    /// Fly the next segment that is not yet flown.
    NextSegment,
    /// Start from the other end.
    OtherEnd,
    /// Switch to manual control, or back to the last guide.
    SwitchGuide,
    /// Switch to the guide with this name.
    Guide(&'static str),
    /// Look around by a drag to the right and downwards, pixels.
    Look([f64; 2]),
    /// Roll by a drag to the right, pixels.
    Roll(f64),
    /// Narrow the view angle by a number of wheel notches.
    Zoom(f64),
    /// Reset the view angle.
    UsualAngle,
    /// Look through a fisheye, or through the flight's usual camera again.
    WideView,
    /// Fly faster by a number of wheel notches.
    Speed(f64),
    /// Jump to a share of the path.
    Seek(f64),
    /// A click on a pixel of the flight's picture.
    Click([f64; 2]),
    /// Fly towards the point seen at a pixel of the picture, and look at it.
    LookAt([f64; 2]),
    /// Send a command to the flight.
    Command(Command),

    /// Show or hide the figures that only a developer needs.
    Figures,
    /// Switch between high and low detail.
    Detail,
    /// Switch between the endoscope's light and the headlight.
    Light,
    /// Switch between the scan without tag and the scan as it is.
    Tag,
    /// Show or hide the overlay with this number.
    Overlay(usize),
    /// Move the lens that shows what lies behind the wall to a pixel of the picture.
    MoveLens([f64; 2]),

    /// A pointer's input to a slice.
    Slice(SliceInput),
    /// Set the grey-level window of the slices: level and width, HU.
    Greys(f64, f64),
    /// Switch to the next slab thickness.
    Slab,
    /// Switch to the next projection of a slab.
    SlabKind,
    /// Reset the slices.
    ResetSlices,

    /// Measure distances by clicks, or stop that.
    Measure,
    /// Delete a distance, by its number.
    DeleteMeasure(usize),
    /// Delete the last distance.
    DeleteLast,
    /// Undo the last change of distances, answers or kinds.
    Undo,

    /// Look for polyps, unless that is done or under way.
    Search,
    /// Stop looking for polyps.
    CancelSearch,
    /// Show a candidate, by its number from 0.
    Select(usize),
    /// Show the next candidate, or with `false` the previous one.
    Step(bool),
    /// Set which candidates the list shows, and in which order.
    Show(Showing),
    /// Answer whether the candidate that is shown is a polyp, and go on to the next without an answer.
    Answer(Answer),
    /// Write the note of a candidate, by its number from 0.
    Note(usize, String),
    /// Undo the last change of answers and notes.
    UndoAnswer,
    /// Mark candidates in all views, or stop that.
    Mark,
    /// Measure lesions by clicks, or stop that.
    MeasureLesion,
    /// Forget the measured lesion.
    ForgetLesion,
    /// Add the answers of a file.
    LoadAnswers(PathBuf),

    /// Mark a finding.
    Finding(FindingOf),
    /// Show a finding, by its number from 0.
    VisitFinding(usize),
    /// Change a finding, by its number.
    EditFinding(usize, FindingEdit),
    /// Move an end, 0 or 1, of a finding's diameter.
    MoveEnd(usize, usize, EndAt),
    /// Let the next distance be the diameter of a finding, by its number or the chosen one, or stop that.
    MeasureFinding(Option<usize>),
    /// Delete a finding, by its number or the chosen one.
    DeleteFinding(Option<usize>),
    /// Make the pictures of the findings that have none.
    DrawFindings,
    /// Mark a finding outside the colon, at the place that all views show.
    Outside,
    /// Write the category and text of a finding outside the colon, by its number.
    EditOutside(usize, String, String),
    /// Delete a finding outside the colon, by its number.
    DeleteOutside(usize),

    /// Compute the quality of the segments.
    Quality,
    /// Write the report of this reading.
    Report,
    /// Send the report of this reading to the archive with this number.
    SendReport(usize),
    /// Stop making a report.
    CancelReport,

    /// Show or hide the kinds of gas in the slices, and their panel.
    Kinds,
    /// Look at the colon laid flat.
    Flat(FlatInput),
    /// Give a kind to the chosen body of gas, or with `None` take back what was given.
    Kind(Option<GasKind>),

    /// Paint or stop painting what of the wall was not seen, and show or hide its panel.
    Coverage,
    /// List the missed patches anew.
    ListMissed,
    /// Go to the missed patch with this number and look at it.
    VisitMissed(usize),
    /// Fly to the next missed patch.
    NextMissed,
    /// Fly past all missed patches, or end that.
    Review,

    /// Save a screenshot of all views.
    Screenshot,
    /// Save the flight's picture alone, and print its pose.
    Picture,
    /// Show a message for a moment.
    Say(String),
    /// Perform an action of the window, by its id.
    Action(String),
    /// Perform the action of another crate with this number.
    Own(usize),

    /// Open another scan. The number selects a series in a folder that holds several.
    Open(PathBuf, Option<usize>),
    /// Open another scan as the patient's second position. The number selects a series in a folder that holds several.
    OpenSecond(PathBuf, Option<usize>),
    /// Work in the patient's other position.
    OtherPosition,
    /// Do something in the other position without working there.
    OfOther(Box<Intent>),
    /// Go to the same place in the other position, and work there.
    SamePlace,
    /// Fly both positions together, or stop that.
    Link,
    /// Part a finding from that of the other position, by its number or the chosen one.
    PartFinding(Option<usize>),
    /// Take a finding, by its number or the chosen one, and the chosen one of the other position for one.
    JoinFindings(Option<usize>),
    /// Start a flight in the gas at a place, world mm, of a scan that is shown without one.
    StartAt(DVec3),
    /// Open the scan anew, for one flight through the whole colon.
    Whole,
    /// Show or hide the list of scans to open.
    Files,
    /// Toggle full screen.
    Fullscreen,
    /// Show or hide the list of keys.
    Help,
    /// Show the layout with this number.
    Layout(usize),
    /// Show or hide the panel with this number.
    Panel(usize),
    /// Cancel what is under way, or close what covers the window: the innermost of these. Never quits.
    Cancel,
    /// Quit the program; asks first if something is unfinished.
    Quit,
}

/// What a finding is marked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FindingOf {
    /// The place that all views show, or the wall in the middle of the picture.
    Here,
    /// A candidate, by its number from 0.
    Candidate(usize),
    /// The measured lesion.
    Lesion,
    /// What was measured: the lesion where lesions are measured by clicks, the last distance otherwise.
    Measured,
    /// A distance, by its number.
    Distance(usize),
    /// A missed patch, by its number.
    Missed(usize),
}

/// A change to a finding.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum FindingEdit {
    Morphology(Option<Morphology>),
    Tissue(Option<Tissue>),
    Confidence(f64),
    Note(String),
}

/// Where an end of a diameter is dragged to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum EndAt {
    /// A place, world mm.
    World(DVec3),
    /// The wall at a pixel of the flight's picture.
    Pixel([f64; 2]),
}

/// A pointer's input to a slice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum SliceInput {
    /// A click at a place, world mm.
    Click(DVec3),
    /// Point at a place, world mm.
    Point(DVec3),
    /// Go to a place, world mm, or tell why the camera cannot; without a flight, start one there.
    SetOut(DVec3),
    /// Scroll by a number of layers, towards the viewer.
    Scroll(Orientation, f64),
    /// Move the image to the right and downwards, mm.
    Pan(Orientation, [f64; 2]),
    /// Magnify by a number of wheel notches about a place, world mm, which stays where it is in the image.
    Zoom(Orientation, f64, DVec3),
    /// Go to a place, world mm: point at it, in the middle of every slice, with at least so many mm across it.
    GoTo(DVec3, f64),
    /// Adjust the grey-level window by a drag in pixels: to the right widens it, upwards raises it.
    Window([f64; 2]),
}

/// When and where something is wanted: the size of the picture and the time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ActionContext {
    /// Size of the flight's picture, pixels.
    pub window: ImageSize,
    /// Current time.
    pub now: Instant,
}

/// The reason why something is not possible now.
pub(crate) type WhyNot = Cow<'static, str>;
