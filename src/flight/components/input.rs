//! Operator input.

use std::collections::VecDeque;
use std::fmt;

use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::de::value::{EnumAccessDeserializer, StrDeserializer};
use serde::de::{self, DeserializeSeed, EnumAccess, IntoDeserializer, VariantAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::review::ReviewStop;
use crate::dynamics::hand;

/// A direct control command of the operator. The operator system applies it in the step for which it is due.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum HandCommand {
    /// Pushes along the view's right, up and forward axes, each −1 to 1, until the next `Push`.
    Push([f64; 3]),
    /// Turns about up (to the right), right (upwards) and forward (clockwise), each −1 to 1, until the next `Turn`.
    Turn([f64; 3]),
    /// Turns the view once, degrees to the right and upwards (a mouse move).
    Look([f64; 2]),
    /// Rolls the view once, degrees clockwise (a mouse move).
    Roll(f64),
    /// Pauses to look around, or continues.
    Pause(bool),
    /// Sets the cruise speed, as a multiple of the scene's.
    Speed(f64),
    /// Resumes the flight after the guide called for help. Of programs that drive a flight, and of recordings: in a window the
    /// operator steers, turns round or chooses another segment instead.
    Resume,
}

/// A command that changes the flight: its guide, its end, its direction, or the camera's position or picture.
///
/// The flight executes it immediately or refuses it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
#[non_exhaustive]
pub enum FlightCommand {
    /// Switches to another guide.
    Guide(String),
    /// Swaps start and goal and turns round.
    Reverse,
    /// Flies another segment of the lumen, counted from 0, from the end nearer to the rectum.
    Segment(usize),
    /// Restarts in the same segment, from the end that the flight was heading for.
    OtherEnd,
    /// Goes to a share of the path, 0 to 1: of the plan, or of the path flown if there is no plan.
    Seek(f64),
    /// Moves the camera to a position in the lumen, world mm, with the given view.
    Go {
        /// Position, world mm.
        to: [f64; 3],
        /// View direction.
        forward: [f64; 3],
        /// Up direction.
        up: [f64; 3],
    },
    /// Flies the shortest tour past these places from here, and looks at each. At its end the flight is as before. Replaces the
    /// current review; it is paused like any flight.
    Review(Vec<ReviewStop>),
    /// Cuts a review short. The flight continues as before it, from where the camera is.
    EndReview,
    /// Sets the view angle over the shorter side of the picture, degrees, clamped to what the camera can show.
    ///
    /// It affects only the picture: a flight without one ignores it.
    ViewAngle(f64),
    /// Looks through another camera model, with a view angle over the shorter side of the picture, degrees, clamped to what the
    /// camera can show.
    ///
    /// It affects only the picture: a flight without one ignores it.
    Camera {
        /// The model's name.
        model: String,
        /// View angle, degrees.
        fov_degrees: f64,
    },
}

impl Command {
    /// Returns the command with finite numbers that does the same, so that a recording can hold it; `None` if it does nothing, as a
    /// turn of the view that is not finite.
    #[doc(hidden)]
    pub fn finite(self) -> Option<Self> {
        let held = |all: [f64; 3]| all.map(|x| if x.is_finite() { x } else { 0.0 });
        Some(match self {
            Self::Hand(HandCommand::Push(all)) => HandCommand::Push(held(all)).into(),
            Self::Hand(HandCommand::Turn(all)) => HandCommand::Turn(held(all)).into(),
            Self::Hand(HandCommand::Look(all)) if !all.iter().all(|x| x.is_finite()) => return None,
            Self::Hand(HandCommand::Roll(x) | HandCommand::Speed(x)) if !x.is_finite() => return None,
            Self::Flight(FlightCommand::Seek(share)) if !share.is_finite() => FlightCommand::Seek(0.0).into(),
            Self::Flight(FlightCommand::ViewAngle(degrees) | FlightCommand::Camera { fov_degrees: degrees, .. })
                if degrees.is_nan() =>
            {
                return None;
            }
            Self::Flight(FlightCommand::Camera { model, fov_degrees }) => {
                FlightCommand::Camera { model, fov_degrees: fov_degrees.clamp(-f64::MAX, f64::MAX) }.into()
            }
            Self::Flight(FlightCommand::ViewAngle(degrees)) => {
                FlightCommand::ViewAngle(degrees.clamp(-f64::MAX, f64::MAX)).into()
            }
            other => other,
        })
    }

    /// Calls `each` with every number of the command.
    #[doc(hidden)]
    pub fn each_number(&mut self, mut each: impl FnMut(&mut f64)) {
        match self {
            Self::Hand(HandCommand::Push(v) | HandCommand::Turn(v)) => v.iter_mut().for_each(&mut each),
            Self::Hand(HandCommand::Look(v)) => v.iter_mut().for_each(&mut each),
            Self::Hand(HandCommand::Roll(x) | HandCommand::Speed(x)) => each(x),
            Self::Flight(
                FlightCommand::Seek(x) | FlightCommand::ViewAngle(x) | FlightCommand::Camera { fov_degrees: x, .. },
            ) => each(x),
            Self::Flight(FlightCommand::Go { to, forward, up }) => {
                [to, forward, up].into_iter().flatten().for_each(&mut each);
            }
            Self::Flight(FlightCommand::Review(stops)) => {
                stops
                    .iter_mut()
                    .flat_map(|s| [Some(&mut s.at), s.look_at.as_mut()])
                    .flatten()
                    .flatten()
                    .for_each(&mut each);
            }
            Self::Hand(HandCommand::Pause(_) | HandCommand::Resume)
            | Self::Flight(
                FlightCommand::Guide(_)
                | FlightCommand::Reverse
                | FlightCommand::Segment(_)
                | FlightCommand::OtherEnd
                | FlightCommand::EndReview,
            ) => {}
        }
    }
}

/// A command of the operator, as recorded and replayed. In a file, only the name distinguishes the two kinds.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Command {
    /// Direct control.
    Hand(HandCommand),
    /// A change of the flight.
    Flight(FlightCommand),
}

impl From<HandCommand> for Command {
    fn from(command: HandCommand) -> Self {
        Self::Hand(command)
    }
}

impl From<FlightCommand> for Command {
    fn from(command: FlightCommand) -> Self {
        Self::Flight(command)
    }
}

/// The name of every command in a file. The first [`HAND_NAMES`] are those of [`HandCommand`].
const NAMES: [&str; 17] = [
    "push",
    "turn",
    "look",
    "roll",
    "pause",
    "speed",
    "resume",
    "guide",
    "reverse",
    "segment",
    "other_end",
    "seek",
    "go",
    "review",
    "end_review",
    "view_angle",
    "camera",
];
const HAND_NAMES: usize = 7;

/// Written by hand, because serde's untagged enums do not report which command is unknown, or which number is wrong and where.
impl<'de> Deserialize<'de> for Command {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_enum("Command", &NAMES, CommandVisitor)
    }
}

struct CommandVisitor;

impl<'de> Visitor<'de> for CommandVisitor {
    type Value = Command;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a command")
    }

    fn visit_enum<A: EnumAccess<'de>>(self, data: A) -> Result<Command, A::Error> {
        let (Name(place), content) = data.variant()?;
        let named = EnumAccessDeserializer::new(Named { name: NAMES[place], content });
        if place < HAND_NAMES {
            HandCommand::deserialize(named).map(Command::Hand)
        } else {
            FlightCommand::deserialize(named).map(Command::Flight)
        }
    }
}

/// The index of a command in [`NAMES`].
struct Name(usize);

impl<'de> Deserialize<'de> for Name {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_identifier(NameVisitor)
    }
}

struct NameVisitor;

impl Visitor<'_> for NameVisitor {
    type Value = Name;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("the name of a command")
    }

    fn visit_str<E: de::Error>(self, name: &str) -> Result<Name, E> {
        let place = NAMES.iter().position(|n| *n == name);
        place.map(Name).ok_or_else(|| E::unknown_variant(name, &NAMES))
    }
}

/// A command whose name has been read but not its content.
struct Named<A> {
    name: &'static str,
    content: A,
}

impl<'de, A: VariantAccess<'de>> EnumAccess<'de> for Named<A> {
    type Error = A::Error;
    type Variant = A;

    fn variant_seed<S: DeserializeSeed<'de>>(self, seed: S) -> Result<(S::Value, A), A::Error> {
        let name: StrDeserializer<A::Error> = self.name.into_deserializer();
        Ok((seed.deserialize(name)?, self.content))
    }
}

/// A command and the step before which it acts.
///
/// ```
/// # use colvis_flight as colvis;
/// use colvis::components::input::{TimedCommand, HandCommand};
///
/// // A line of `--record-input`: from step 240 on the operator pushes to the right.
/// let act: TimedCommand = serde_json::from_str(r#"{"tick": 240, "command": {"push": [1.0, 0.0, 0.0]}}"#)?;
/// assert_eq!(act, TimedCommand { tick: 240, command: HandCommand::Push([1.0, 0.0, 0.0]).into() });
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimedCommand {
    /// Step before which the command acts.
    pub tick: u64,
    /// The operator's command.
    pub command: Command,
}

/// Control commands for the coming step, in order.
#[derive(Resource, Default, Debug)]
pub struct Inbox(pub VecDeque<HandCommand>);

/// The current operator input.
#[derive(Component, Clone, Copy, Debug)]
pub struct Hand {
    /// Push to the right, up and forward, each −1 to 1.
    pub push: DVec3,
    /// Yaw, pitch, roll, each −1 to 1.
    pub turn: DVec3,
    /// True if the flight is paused.
    pub paused: bool,
    /// Multiple of the scene's cruise speed.
    pub speed: f64,
    /// Tick until which the operator has control and the guide does not thrust.
    pub on_until: u64,
    /// Tick until which the view stays turned aside by the operator and does not turn back to the path.
    pub looking_until: u64,
    /// Tick until which the operator has turned the view in any way. A roll alone does not keep the view from following
    /// the path, and it stays when the view does so.
    pub turned_until: u64,
    /// Acceleration from the push, world mm/s².
    pub acceleration: DVec3,
    /// Angular velocity requested by the turn, world rad/s.
    pub turning: DVec3,
    /// The guide's part of the control, 0 to 1. It fades out and in gradually.
    pub guided: f64,
}

impl Default for Hand {
    fn default() -> Self {
        Self {
            push: DVec3::ZERO,
            turn: DVec3::ZERO,
            paused: false,
            speed: 1.0,
            on_until: 0,
            looking_until: 0,
            turned_until: 0,
            acceleration: DVec3::ZERO,
            turning: DVec3::ZERO,
            guided: 1.0,
        }
    }
}

impl Hand {
    /// Returns true while the operator has control or has paused the flight.
    pub fn is_in_control(&self, tick: u64) -> bool {
        self.paused || tick < self.on_until
    }

    /// Returns true if the flight is paused and not pushed: drag alone brings the body to rest.
    pub fn is_stopped(&self) -> bool {
        self.paused && self.push == DVec3::ZERO
    }

    /// Returns the factor on the guide's thrust: the operator's speed, eased in and out when control changes.
    pub fn pace(&self) -> f64 {
        self.speed * self.share()
    }

    /// Returns the share of its thrust that the guide may use, 0 to 1.
    pub fn share(&self) -> f64 {
        hand::share(self.guided)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recordings_old_and_new_are_read_and_written_alike() {
        let old = include_str!("../../../tests/inputs/hand.jsonl");
        let new = [
            r#"{"tick":1,"command":{"roll":-35.0}}"#,
            r#"{"tick":2,"command":{"view_angle":40.0}}"#,
            r#"{"tick":3,"command":{"turn":[0.0,0.0,-1.0]}}"#,
        ];
        for line in old.lines().chain(new) {
            let act: TimedCommand = serde_json::from_str(line).unwrap();
            assert_eq!(serde_json::to_string(&act).unwrap(), line);
        }
    }

    #[test]
    fn every_command_has_its_form_in_a_file() {
        let forms: [(Command, &str); 17] = [
            (HandCommand::Push([1.0, 0.0, -0.5]).into(), r#"{"push":[1.0,0.0,-0.5]}"#),
            (HandCommand::Turn([0.6, 0.3, 0.0]).into(), r#"{"turn":[0.6,0.3,0.0]}"#),
            (HandCommand::Look([60.0, -20.0]).into(), r#"{"look":[60.0,-20.0]}"#),
            (HandCommand::Roll(-35.0).into(), r#"{"roll":-35.0}"#),
            (HandCommand::Pause(true).into(), r#"{"pause":true}"#),
            (HandCommand::Speed(0.1 + 0.2).into(), r#"{"speed":0.30000000000000004}"#),
            (HandCommand::Resume.into(), r#""resume""#),
            (FlightCommand::Guide("path".to_owned()).into(), r#"{"guide":"path"}"#),
            (FlightCommand::Reverse.into(), r#""reverse""#),
            (FlightCommand::Segment(2).into(), r#"{"segment":2}"#),
            (FlightCommand::OtherEnd.into(), r#""other_end""#),
            (FlightCommand::Seek(0.5).into(), r#"{"seek":0.5}"#),
            (
                FlightCommand::Go { to: [1.0, 2.0, 3.0], forward: [0.0, 1.0, 0.0], up: [0.0, 0.0, 1.0] }.into(),
                r#"{"go":{"to":[1.0,2.0,3.0],"forward":[0.0,1.0,0.0],"up":[0.0,0.0,1.0]}}"#,
            ),
            (
                FlightCommand::Review(vec![
                    ReviewStop { at: [1.0, 2.0, 3.5], look_at: Some([0.0, -1.25, 0.0]) },
                    ReviewStop { at: [4.0, 5.0, 6.0], look_at: None },
                ])
                .into(),
                r#"{"review":[{"at":[1.0,2.0,3.5],"look_at":[0.0,-1.25,0.0]},{"at":[4.0,5.0,6.0],"look_at":null}]}"#,
            ),
            (FlightCommand::EndReview.into(), r#""end_review""#),
            (FlightCommand::ViewAngle(40.0).into(), r#"{"view_angle":40.0}"#),
            (
                FlightCommand::Camera { model: "fisheye".into(), fov_degrees: 180.0 }.into(),
                r#"{"camera":{"model":"fisheye","fov_degrees":180.0}}"#,
            ),
        ];
        for ((command, form), name) in forms.into_iter().zip(NAMES) {
            assert!(form.contains(&format!("\"{name}\"")), "{form}: {name}");
            let line = format!(r#"{{"tick":240,"command":{form}}}"#);
            let act = TimedCommand { tick: 240, command };
            assert_eq!(serde_json::to_string(&act).unwrap(), line);
            assert_eq!(serde_json::from_str::<TimedCommand>(&line).unwrap(), act);
        }
        // The derived serde code knows the same names in the same order. A new command needs an entry in `NAMES`.
        let known =
            |e: serde_json::Error| e.to_string().split('`').skip(3).step_by(2).map(str::to_owned).collect::<Vec<_>>();
        let hand = known(serde_json::from_str::<HandCommand>(r#""dance""#).unwrap_err());
        let flight = known(serde_json::from_str::<FlightCommand>(r#""dance""#).unwrap_err());
        assert_eq!((hand.len(), [hand, flight].concat()), (HAND_NAMES, NAMES.map(str::to_owned).to_vec()));
    }

    #[test]
    fn a_damaged_command_is_told_with_its_name_and_place() {
        let names = NAMES.map(|n| format!("`{n}`")).join(", ");
        for (command, reported) in [
            (r#""dance""#, format!("unknown variant `dance`, expected one of {names} at line 1 column 29")),
            (r#"{"dance":1}"#, format!("unknown variant `dance`, expected one of {names} at line 1 column 30")),
            (r#"{"push":[1.0,"up"]}"#, "invalid type: string \"up\", expected f64 at line 1 column 39".to_owned()),
            (r#""push""#, "invalid type: unit variant, expected newtype variant at line 1 column 29".to_owned()),
            (r#"{"reverse":1}"#, "invalid type: integer `1`, expected unit at line 1 column 34".to_owned()),
            (
                r#"{"go":{"at":[0.0,0.0,0.0]}}"#,
                "unknown field `at`, expected one of `to`, `forward`, `up` at line 1 column 33".to_owned(),
            ),
            (r#"{"segment":-1}"#, "invalid value: integer `-1`, expected usize at line 1 column 35".to_owned()),
            (r#"{"pause":true,"speed":1.0}"#, "expected value at line 1 column 35".to_owned()),
        ] {
            let line = format!(r#"{{"tick":240,"command":{command}}}"#);
            assert_eq!(serde_json::from_str::<TimedCommand>(&line).unwrap_err().to_string(), reported);
        }
    }
}
