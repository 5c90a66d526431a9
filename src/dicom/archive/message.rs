//! Messages on an association: commands, their answers, and the data sets that follow them (PS3.7).

use std::collections::VecDeque;
use std::io::Read;

use colvis_scan::error::{Error, Result};
use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_ul::Pdu;
use dicom_ul::pdu::{PDataValue, PDataValueType};

use super::connection::{Association, Context};
use super::elements::{Elements, put_implicit, text};

/// Largest command, bytes.
const MOST_COMMAND: usize = 64 << 10;
/// Largest data set that is kept in memory, bytes: an answer to a question.
const MOST_DATA: usize = 1 << 20;
/// Most pieces one after the other that are empty.
const MOST_EMPTY: usize = 1000;
/// The value of CommandDataSetType without a data set.
const NO_DATA: u16 = 0x0101;

/// The kinds of commands that colvis sends and answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub(super) enum Kind {
    Store = 0x0001,
    Get = 0x0010,
    Find = 0x0020,
    Echo = 0x0030,
}

impl Kind {
    /// The command's number in its answer.
    pub(super) fn answer(self) -> u16 {
        self as u16 | 0x8000
    }
}

/// A command or an answer: its elements.
#[derive(Clone, Debug, Default)]
pub(super) struct Command {
    /// The presentation context that it belongs to.
    pub context: u8,
    elements: Vec<(Tag, Vec<u8>)>,
}

impl Command {
    /// A command to the archive about objects of a class.
    pub(super) fn new(kind: Kind, context: &Context, id: u16, data: bool) -> Self {
        let command = Self { context: context.id, elements: Vec::new() }
            .text(tags::AFFECTED_SOP_CLASS_UID, &context.class)
            .number(tags::COMMAND_FIELD, kind as u16)
            .number(tags::MESSAGE_ID, id);
        let command = if kind == Kind::Echo { command } else { command.number(tags::PRIORITY, 0) };
        command.number(tags::COMMAND_DATA_SET_TYPE, if data { 1 } else { NO_DATA })
    }

    /// The answer to a command of the archive.
    pub(super) fn answer_to(command: &Self, kind: Kind, status: u16) -> Self {
        Self { context: command.context, elements: Vec::new() }
            .text(tags::AFFECTED_SOP_CLASS_UID, &command.get_text(tags::AFFECTED_SOP_CLASS_UID))
            .number(tags::COMMAND_FIELD, kind.answer())
            .number(tags::MESSAGE_ID_BEING_RESPONDED_TO, command.get(tags::MESSAGE_ID).unwrap_or(0))
            .number(tags::COMMAND_DATA_SET_TYPE, NO_DATA)
            .number(tags::STATUS, status)
            .text(tags::AFFECTED_SOP_INSTANCE_UID, &command.get_text(tags::AFFECTED_SOP_INSTANCE_UID))
    }

    /// Adds an identifier.
    pub(super) fn text(mut self, tag: Tag, value: &str) -> Self {
        self.elements.push((tag, value.as_bytes().to_vec()));
        self
    }

    /// Adds a number.
    pub(super) fn number(mut self, tag: Tag, value: u16) -> Self {
        self.elements.push((tag, value.to_le_bytes().to_vec()));
        self
    }

    /// Returns a number.
    pub(super) fn get(&self, tag: Tag) -> Option<u16> {
        let value = self.value(tag)?.get(..2)?;
        Some(u16::from_le_bytes(value.try_into().ok()?))
    }

    /// Returns a text without its padding; empty if it is missing.
    pub(super) fn get_text(&self, tag: Tag) -> String {
        self.value(tag).map(text).unwrap_or_default()
    }

    fn value(&self, tag: Tag) -> Option<&[u8]> {
        self.elements.iter().find(|e| e.0 == tag).map(|e| e.1.as_slice())
    }

    /// The command's number.
    pub(super) fn field(&self) -> u16 {
        self.get(tags::COMMAND_FIELD).unwrap_or(0)
    }

    /// The status of an answer.
    pub(super) fn status(&self) -> Status {
        Status(self.get(tags::STATUS).unwrap_or(0xFFFF))
    }

    /// True if a data set follows.
    pub(super) fn has_data(&self) -> bool {
        self.get(tags::COMMAND_DATA_SET_TYPE) != Some(NO_DATA)
    }

    /// Describes the status of an answer, with the archive's comment.
    pub(super) fn told(&self) -> String {
        let comment = self.get_text(tags::ERROR_COMMENT);
        let Status(code) = self.status();
        if comment.is_empty() {
            format!("status {code:04X}, {}", self.status().meaning())
        } else {
            format!("status {code:04X}, {comment}")
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let mut sorted: Vec<&(Tag, Vec<u8>)> = self.elements.iter().collect();
        sorted.sort_by_key(|e| e.0);
        let mut body = Vec::new();
        sorted.iter().for_each(|(tag, value)| put_implicit(&mut body, *tag, value, 0));
        let mut all = Vec::new();
        put_implicit(&mut all, tags::COMMAND_GROUP_LENGTH, &(body.len() as u32).to_le_bytes(), 0);
        all.extend(body);
        all
    }
}

/// The status of an answer (PS3.7, annex C).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Status(pub u16);

impl Status {
    /// True if more answers follow.
    pub(super) fn is_pending(self) -> bool {
        matches!(self.0, 0xFF00 | 0xFF01)
    }

    /// True if what was asked is done.
    pub(super) fn is_success(self) -> bool {
        self.0 == 0
    }

    /// True if it is done, with a remark.
    pub(super) fn is_warning(self) -> bool {
        matches!(self.0, 0x0001 | 0x0107 | 0x0116 | 0xB000..=0xBFFF)
    }

    fn meaning(self) -> &'static str {
        match self.0 {
            0x0111 => "it has the object already",
            0x0112 => "no such object",
            0x0122 => "this kind of object or question is not supported",
            0x0124 => "not authorized",
            0xA700..=0xA7FF => "out of resources",
            0xA801 => "unknown destination",
            0xA900..=0xA9FF => "the object does not match its class",
            0xC000..=0xCFFF => "it cannot be processed",
            0xFE00 => "cancelled",
            0xFFFF => "no status",
            _ => "failed",
        }
    }
}

/// The exchange of messages on an association.
pub(super) struct Exchange<'a> {
    pub association: Association<'a>,
    /// Values that have been received and not yet been used.
    waiting: VecDeque<PDataValue>,
    /// Pieces that were empty, since one that was not.
    empty: usize,
    last_id: u16,
}

impl<'a> Exchange<'a> {
    pub(super) fn new(association: Association<'a>) -> Self {
        Self { association, waiting: VecDeque::new(), empty: 0, last_id: 0 }
    }

    /// Returns the number of a new message.
    pub(super) fn next_id(&mut self) -> u16 {
        self.last_id = self.last_id.wrapping_add(1).max(1);
        self.last_id
    }

    /// Returns the context of a service, or the error that the archive does not have it.
    pub(super) fn service(&self, class: &str, name: &str) -> Result<Context> {
        self.association.context(class).cloned().ok_or_else(|| {
            let hint = "ask who runs it whether it has this service, or name another archive";
            Error::input(self.association.archive().what(), format!("does not support {name}"), hint)
        })
    }

    /// Sends a command.
    pub(super) fn send(&mut self, command: &Command) -> Result<()> {
        self.send_values(command.context, true, &mut command.bytes().as_slice())
    }

    /// Sends the data set that belongs to a command.
    pub(super) fn send_data(&mut self, context: u8, data: &mut dyn Read) -> Result<()> {
        self.send_values(context, false, data)
    }

    fn send_values(&mut self, context: u8, is_command: bool, bytes: &mut dyn Read) -> Result<()> {
        let most = self.association.most_value() as u64;
        let what = self.association.archive().what();
        let mut read = || {
            let mut chunk = Vec::new();
            let read = (&mut *bytes).take(most).read_to_end(&mut chunk);
            read.map(|_| chunk)
                .map_err(|e| Error::input(what.clone(), format!("what is sent cannot be read ({e})"), "try again"))
        };
        let mut chunk = read()?;
        loop {
            let next = if chunk.len() as u64 == most { read()? } else { Vec::new() };
            let is_last = next.is_empty();
            let value = PDataValue {
                presentation_context_id: context,
                value_type: if is_command { PDataValueType::Command } else { PDataValueType::Data },
                is_last,
                data: std::mem::replace(&mut chunk, next),
            };
            self.association.send(&Pdu::PData { data: vec![value] })?;
            if is_last {
                return Ok(());
            }
        }
    }

    fn next_value(&mut self) -> Result<PDataValue> {
        loop {
            if let Some(value) = self.waiting.pop_front() {
                self.empty = if value.data.is_empty() { self.empty + 1 } else { 0 };
                return Ok(value);
            }
            self.waiting.extend(self.association.receive()?);
            self.empty += usize::from(self.waiting.is_empty());
            if self.empty > MOST_EMPTY {
                return Err(self.association.garbled("nothing but empty pieces"));
            }
        }
    }

    /// Receives a command or an answer. Its data set, if it has one, must be received next.
    pub(super) fn receive(&mut self) -> Result<Command> {
        let mut bytes = Vec::new();
        loop {
            let value = self.next_value()?;
            if value.value_type != PDataValueType::Command || bytes.len() + value.data.len() > MOST_COMMAND {
                return Err(self.association.garbled("data where a command is due"));
            }
            bytes.extend(value.data);
            if value.is_last {
                let elements = Elements::implicit(&bytes);
                if !elements.clone().are_whole() {
                    return Err(self.association.garbled("a damaged command"));
                }
                let elements = elements.map(|(tag, value)| (tag, value.to_vec())).collect();
                return Ok(Command { context: value.presentation_context_id, elements });
            }
        }
    }

    /// Receives the answer to the command with this number.
    pub(super) fn answer(&mut self, kind: Kind, id: u16) -> Result<Command> {
        let answer = self.receive()?;
        if answer.field() == kind.answer() && answer.get(tags::MESSAGE_ID_BEING_RESPONDED_TO) == Some(id) {
            Ok(answer)
        } else {
            Err(self.association.garbled("an answer to another question"))
        }
    }

    /// Receives a data set piece by piece.
    pub(super) fn receive_data(&mut self, mut take: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        loop {
            let value = self.next_value()?;
            if value.value_type != PDataValueType::Data {
                return Err(self.association.garbled("a command where data is due"));
            }
            take(&value.data)?;
            if value.is_last {
                return Ok(());
            }
        }
    }

    /// Receives a small data set whole.
    pub(super) fn receive_small(&mut self) -> Result<Vec<u8>> {
        let mut all = Vec::new();
        let too_large = self.association.garbled("an endless data set");
        self.receive_data(|piece| {
            all.extend(piece);
            if all.len() > MOST_DATA { Err(too_large.clone()) } else { Ok(()) }
        })?;
        Ok(all)
    }
}
