//! A connection to an archive, and the association on it: it is waited for with patience and with limits.

use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use colvis_scan::error::{Error, Result};
use colvis_scan::output::plain;
use colvis_scan::progress::Progress;
use dicom_ul::pdu::{
    AbortRQSource, AssociationRJServiceUserReason, AssociationRJSource, AssociationRQ, PDataValue,
    PresentationContextProposed, RequestorRoles, UserVariableItem, read_pdu, write_pdu,
};
use dicom_ul::{IMPLEMENTATION_CLASS_UID, Pdu};
use rustls::{ClientConnection, StreamOwned};

use super::elements::text;
use super::{Archive, tls};

/// Largest PDU that an archive may send, and that it is sent, bytes after the head.
pub(super) const MOST_PDU: u32 = 128 << 10;
/// Bytes of a data value's head within a PDU.
const VALUE_HEAD: u32 = 6;
/// Largest PDU that every archive must take, bytes.
const LEAST_PDU: u32 = 1 << 10;
/// Time until a cancellation is noticed.
const POLL: Duration = Duration::from_millis(50);
/// Time that a farewell may take.
const FAREWELL: Duration = Duration::from_secs(2);
/// Application context of DICOM (PS3.7, annex A).
const DICOM: &str = "1.2.840.10008.3.1.1.1";
/// Presentation contexts of one association: their numbers are odd and below 256.
pub(super) const MOST_CONTEXTS: usize = 128;

/// What an association may be used for: a class of objects or of services, and the forms in which they are sent.
#[derive(Clone, Debug)]
pub(super) struct Proposal {
    pub class: String,
    pub syntaxes: Vec<String>,
    /// True if the archive sends objects of this class.
    pub receives: bool,
}

/// A proposal that the archive has accepted.
#[derive(Clone, Debug)]
pub(super) struct Context {
    pub id: u8,
    pub class: String,
    pub syntax: String,
}

enum Stream {
    Plain(TcpStream),
    Encrypted(Box<StreamOwned<ClientConnection, TcpStream>>),
}

impl Stream {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        // Many archives send the rest of a message only once its beginning is acknowledged, which the system puts off for 40 ms.
        #[cfg(target_os = "linux")]
        {
            use std::os::linux::net::TcpStreamExt;
            let socket = match self {
                Self::Plain(s) => &*s,
                Self::Encrypted(s) => &s.sock,
            };
            // Without it, the work only takes longer.
            let _ = socket.set_quickack(true);
        }
        match self {
            Self::Plain(s) => s.read(into),
            Self::Encrypted(s) => s.read(into),
        }
    }

    /// Writes some bytes; none if everything before is still to be flushed.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Plain(s) if bytes.is_empty() => s.flush().map(|()| 0),
            Self::Plain(s) => s.write(bytes),
            Self::Encrypted(s) if bytes.is_empty() => s.flush().map(|()| 0),
            Self::Encrypted(s) => s.write(bytes),
        }
    }
}

/// An association with an archive. Dropping it without [`Association::release`] aborts it.
pub(super) struct Association<'a> {
    archive: &'a Archive,
    progress: &'a Progress,
    stream: Stream,
    contexts: Vec<Context>,
    /// Largest PDU that the archive takes.
    most_sent: u32,
    /// True between the archive's acceptance and the association's end.
    is_open: bool,
}

impl<'a> Association<'a> {
    /// Connects to an archive and proposes `proposals`.
    ///
    /// # Errors
    /// Returns status 3 if the archive cannot be reached or refuses, 2 if the certificates in the settings cannot be used, 4 if
    /// interrupted.
    pub(super) fn open(archive: &'a Archive, proposals: &[Proposal], progress: &'a Progress) -> Result<Self> {
        progress.check()?;
        let encryption = archive.tls.as_ref().map(|t| tls::client(archive, t)).transpose()?;
        let socket = connect(archive, progress)?;
        let set = socket
            .set_read_timeout(Some(POLL))
            .and_then(|()| socket.set_write_timeout(Some(POLL)))
            .and_then(|()| socket.set_nodelay(true));
        set.map_err(|e| unreachable(archive, &e))?;
        let stream = match encryption {
            None => Stream::Plain(socket),
            Some(client) => Stream::Encrypted(Box::new(StreamOwned::new(client, socket))),
        };
        let mut opened = Self { archive, progress, stream, contexts: Vec::new(), most_sent: LEAST_PDU, is_open: false };
        opened.propose(proposals)?;
        Ok(opened)
    }

    fn propose(&mut self, proposals: &[Proposal]) -> Result<()> {
        let number = |n: usize| (2 * n + 1) as u8;
        let proposed = proposals.iter().take(MOST_CONTEXTS).enumerate();
        let mut variables = vec![
            UserVariableItem::MaxLength(MOST_PDU),
            UserVariableItem::ImplementationClassUID(IMPLEMENTATION_CLASS_UID.to_owned()),
            UserVariableItem::ImplementationVersionName(format!("COLVIS_{}", env!("CARGO_PKG_VERSION"))),
        ];
        let mut classes: Vec<&str> = proposals.iter().filter(|p| p.receives).map(|p| p.class.as_str()).collect();
        classes.sort_unstable();
        classes.dedup();
        let roles = RequestorRoles { scu: false, scp: true };
        variables.extend(classes.iter().map(|c| UserVariableItem::ScuScpRoleSelectionSubItem((*c).to_owned(), roles)));
        let request = Pdu::AssociationRQ(AssociationRQ {
            protocol_version: 1,
            calling_ae_title: self.archive.own_title.clone(),
            called_ae_title: self.archive.title.clone(),
            application_context_name: DICOM.to_owned(),
            presentation_contexts: proposed
                .clone()
                .map(|(n, p)| PresentationContextProposed {
                    id: number(n),
                    abstract_syntax: p.class.clone(),
                    transfer_syntaxes: p.syntaxes.clone(),
                })
                .collect(),
            user_variables: variables,
        });
        self.send(&request)?;
        let (kind, body) = self.receive_pdu()?;
        match kind {
            0x02 => {
                let Some(answer) = Acceptance::read(&body) else { return Err(self.garbled("a damaged acceptance")) };
                self.is_open = true;
                self.most_sent = match answer.most_sent {
                    0 => MOST_PDU,
                    n => n.clamp(LEAST_PDU, MOST_PDU),
                };
                self.contexts = answer
                    .contexts
                    .into_iter()
                    .filter_map(|(id, syntax)| {
                        let (_, proposal) = proposed.clone().find(|(n, _)| number(*n) == id)?;
                        let known = proposal.syntaxes.contains(&syntax);
                        known.then(|| Context { id, class: proposal.class.clone(), syntax })
                    })
                    .collect();
                Ok(())
            }
            0x03 => Err(self.refused(&body)),
            _ => Err(self.unexpected(kind, &body)),
        }
    }

    /// What is asked, for messages.
    pub(super) fn archive(&self) -> &'a Archive {
        self.archive
    }

    /// The progress of the work.
    pub(super) fn progress(&self) -> &'a Progress {
        self.progress
    }

    /// What the archive has accepted.
    pub(super) fn contexts(&self) -> &[Context] {
        &self.contexts
    }

    /// Returns the accepted form of a class, if there is one.
    pub(super) fn context(&self, class: &str) -> Option<&Context> {
        self.contexts.iter().find(|c| c.class == class)
    }

    /// Largest value that fits into a PDU, bytes.
    pub(super) fn most_value(&self) -> usize {
        (self.most_sent - VALUE_HEAD) as usize
    }

    /// Sends a PDU.
    pub(super) fn send(&mut self, pdu: &Pdu) -> Result<()> {
        let mut bytes = Vec::new();
        write_pdu(&mut bytes, pdu).map_err(|e| {
            let hint = "correct its titles in the settings: up to 16 letters and digits";
            Error::usage(self.archive.what(), format!("cannot be asked ({e})"), hint)
        })?;
        self.write(&bytes, self.archive.answer_timeout)
    }

    fn write(&mut self, bytes: &[u8], time: Duration) -> Result<()> {
        let mut deadline = Instant::now() + time;
        let mut rest = bytes;
        loop {
            self.progress.check()?;
            match self.stream.write(rest) {
                Ok(0) if rest.is_empty() => return Ok(()),
                Ok(0) => return Err(self.closed()),
                Ok(n) => {
                    rest = &rest[n..];
                    deadline = Instant::now() + time;
                }
                Err(e) => self.wait(&e, deadline)?,
            }
        }
    }

    /// Receives the values of the next PDU of data.
    pub(super) fn receive(&mut self) -> Result<Vec<PDataValue>> {
        let (kind, body) = self.receive_pdu()?;
        if kind != 0x04 {
            return Err(self.unexpected(kind, &body));
        }
        match parsed(kind, &body) {
            Some(Pdu::PData { data }) => Ok(data),
            _ => Err(self.garbled("damaged data")),
        }
    }

    /// Receives a PDU: its kind, and what follows its head.
    fn receive_pdu(&mut self) -> Result<(u8, Vec<u8>)> {
        let deadline = Instant::now() + self.archive.answer_timeout;
        let mut head = [0; 6];
        self.fill(&mut head, deadline)?;
        let [kind, _, a, b, c, d] = head;
        let length = u32::from_be_bytes([a, b, c, d]);
        if !(0x01..=0x07).contains(&kind) {
            return Err(self.garbled("something else than DICOM"));
        }
        if length > MOST_PDU {
            return Err(self.garbled(&format!("a PDU of {length} bytes")));
        }
        let mut body = vec![0; length as usize];
        self.fill(&mut body, deadline)?;
        Ok((kind, body))
    }

    fn fill(&mut self, mut rest: &mut [u8], deadline: Instant) -> Result<()> {
        while !rest.is_empty() {
            self.progress.check()?;
            match self.stream.read(rest) {
                Ok(0) => return Err(self.closed()),
                Ok(n) => {
                    rest = &mut rest[n..];
                    if Instant::now() > deadline {
                        return Err(self.silent());
                    }
                }
                Err(e) => self.wait(&e, deadline)?,
            }
        }
        Ok(())
    }

    /// Returns if what was interrupted by `e` can go on.
    fn wait(&mut self, e: &io::Error, deadline: Instant) -> Result<()> {
        match e.kind() {
            io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted => {
                if Instant::now() > deadline { Err(self.silent()) } else { Ok(()) }
            }
            io::ErrorKind::UnexpectedEof
            | io::ErrorKind::ConnectionReset
            | io::ErrorKind::ConnectionAborted
            | io::ErrorKind::BrokenPipe => Err(self.closed()),
            _ => {
                let is_encryption = e.get_ref().is_some_and(|inner| inner.is::<rustls::Error>());
                self.is_open = false;
                Err(if is_encryption { self.not_encrypted(e) } else { unreachable(self.archive, e) })
            }
        }
    }

    fn not_encrypted(&self, e: &io::Error) -> Error {
        let hint = "correct ca, cert, key and name in its table tls in the settings";
        Error::input(self.archive.what(), format!("the connection cannot be encrypted ({e})"), hint)
    }

    fn closed(&mut self) -> Error {
        self.is_open = false;
        let hint = if self.archive.tls.is_some() {
            "check that it runs and wants TLS, then try again"
        } else {
            "check that it runs and wants no TLS, then try again"
        };
        Error::input(self.archive.what(), "closed the connection", hint)
    }

    fn silent(&self) -> Error {
        let why = format!("has not answered for {} s", self.archive.answer_timeout.as_secs_f64());
        Error::input(
            self.archive.what(),
            why,
            "check that it runs, then try again; `answer_s` in the settings waits longer",
        )
    }

    /// The error of an archive that sends what it should not.
    pub(super) fn garbled(&self, what: &str) -> Error {
        Error::input(
            self.archive.what(),
            format!("answers with {what}"),
            "check that host and port are those of a DICOM archive",
        )
    }

    fn refused(&self, body: &[u8]) -> Error {
        let what = self.archive.what();
        let Some(Pdu::AssociationRJ(refusal)) = parsed(0x03, body) else {
            return Error::input(what, "refuses the association", "ask who runs it");
        };
        let hint = match &refusal.source {
            AssociationRJSource::ServiceUser(AssociationRJServiceUserReason::CalledAETitleNotRecognized) => {
                format!("its title is not {}: correct `title` in the settings", self.archive.title)
            }
            AssociationRJSource::ServiceUser(AssociationRJServiceUserReason::CallingAETitleNotRecognized) => {
                format!(
                    "it does not know {}: correct `own_title` in the settings, or let it know",
                    self.archive.own_title
                )
            }
            AssociationRJSource::ServiceProviderPresentation(_) => "try again later".to_owned(),
            _ => "ask who runs it".to_owned(),
        };
        Error::input(what, format!("refuses the association ({})", refusal.source), hint)
    }

    fn unexpected(&mut self, kind: u8, body: &[u8]) -> Error {
        if kind != 0x07 {
            return self.garbled("what was not asked for");
        }
        self.is_open = false;
        let by = match parsed(kind, body) {
            Some(Pdu::AbortRQ { source: AbortRQSource::ServiceProvider(reason) }) => format!(" ({reason})"),
            _ => String::new(),
        };
        Error::input(self.archive.what(), format!("aborted the association{by}"), "try again; its log tells why")
    }

    /// Ends the association. What was asked is done, so an archive that answers no farewell is no failure.
    pub(super) fn release(mut self) {
        let mut bytes = Vec::new();
        if write_pdu(&mut bytes, &Pdu::ReleaseRQ).is_ok() && self.write(&bytes, FAREWELL).is_ok() {
            let mut head = [0; 10];
            self.is_open = self.fill(&mut head, Instant::now() + FAREWELL).is_err();
        }
    }
}

impl Drop for Association<'_> {
    fn drop(&mut self) {
        if !self.is_open {
            return;
        }
        let mut bytes = Vec::new();
        if write_pdu(&mut bytes, &Pdu::AbortRQ { source: AbortRQSource::ServiceUser }).is_ok() {
            // Only an attempt: what is under way has failed or was interrupted, and the connection ends in any case.
            let _ = self.stream.write(&bytes).and_then(|_| self.stream.write(&[]));
        }
    }
}

fn parsed(kind: u8, body: &[u8]) -> Option<Pdu> {
    let mut whole = vec![kind, 0];
    whole.extend((body.len() as u32).to_be_bytes());
    whole.extend(body);
    read_pdu(&whole[..], MOST_PDU, true).ok()?
}

fn unreachable(archive: &Archive, e: &io::Error) -> Error {
    let hint = "check host and port in the settings, and that it runs";
    Error::input(archive.what(), format!("cannot be reached ({})", plain(e)), hint)
}

/// Connects to the archive's host. Names are looked up on another thread, because nothing can interrupt that.
fn connect(archive: &Archive, progress: &Progress) -> Result<TcpStream> {
    let deadline = Instant::now() + archive.connect_timeout;
    let (host, port) = (archive.host.clone(), archive.port);
    let (send, receive) = channel();
    std::thread::spawn(move || {
        let connected = (host.as_str(), port).to_socket_addrs().and_then(|addresses| {
            let mut last = io::Error::from(io::ErrorKind::AddrNotAvailable);
            for address in addresses {
                let left = deadline.saturating_duration_since(Instant::now()).max(POLL);
                match TcpStream::connect_timeout(&address, left) {
                    Ok(socket) => return Ok(socket),
                    Err(e) => last = e,
                }
            }
            Err(last)
        });
        // Nobody may be waiting any more.
        let _ = send.send(connected);
    });
    loop {
        match receive.recv_timeout(POLL) {
            Ok(Err(e)) if e.kind() == io::ErrorKind::TimedOut => break,
            Ok(connected) => return connected.map_err(|e| unreachable(archive, &e)),
            Err(RecvTimeoutError::Disconnected) => break,
            Err(RecvTimeoutError::Timeout) => {
                progress.check()?;
                if Instant::now() > deadline + POLL {
                    break;
                }
            }
        }
    }
    let why = format!("cannot be reached (no answer for {} s)", archive.connect_timeout.as_secs_f64());
    Err(Error::input(archive.what(), why, "check host and port in the settings, and that it runs"))
}

/// An archive's acceptance of an association (PS3.8, table 9-17).
///
/// dicom-ul insists on a transfer syntax for contexts that are refused. The standard says that what stands there has no meaning, and some
/// archives leave it out.
#[derive(Debug, Default, PartialEq)]
struct Acceptance {
    /// The accepted contexts and their transfer syntax.
    contexts: Vec<(u8, String)>,
    /// Largest PDU that the archive takes; 0 if any.
    most_sent: u32,
}

impl Acceptance {
    fn read(body: &[u8]) -> Option<Self> {
        let mut read = Self { most_sent: LEAST_PDU, ..Self::default() };
        for (kind, item) in items(body.get(68..)?)? {
            match kind {
                0x21 => {
                    let [id, _, result, _, rest @ ..] = item else { return None };
                    if *result == 0 {
                        let syntax = items(rest)?.into_iter().find(|i| i.0 == 0x40)?.1;
                        read.contexts.push((*id, text(syntax)));
                    }
                }
                0x50 => {
                    let length = items(item)?.into_iter().find(|i| i.0 == 0x51).map(|i| i.1);
                    if let Some(length) = length {
                        read.most_sent = u32::from_be_bytes(length.try_into().ok()?);
                    }
                }
                _ => {}
            }
        }
        Some(read)
    }
}

/// Splits bytes into items: their kind and content.
fn items(mut bytes: &[u8]) -> Option<Vec<(u8, &[u8])>> {
    let mut all = Vec::new();
    while let [kind, _, high, low, rest @ ..] = bytes {
        let (item, after) = rest.split_at_checked(usize::from(u16::from_be_bytes([*high, *low])))?;
        all.push((*kind, item));
        bytes = after;
    }
    bytes.is_empty().then_some(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_acceptance_may_leave_out_what_has_no_meaning() {
        let mut body = vec![0; 68];
        body.extend(b"\x10\0\0\x03abc\x21\0\0\x0c\x01\0\0\0\x40\0\0\x041.2\0");
        body.extend(b"\x21\0\0\x04\x03\0\x03\0\x50\0\0\x08\x51\0\0\x04\0\x01\0\0");
        let read = Acceptance::read(&body).unwrap();
        assert_eq!(read, Acceptance { contexts: vec![(1, "1.2".to_owned())], most_sent: 65536 });
        for end in 0..body.len() {
            let _ = Acceptance::read(&body[..end]);
        }
        assert_eq!(Acceptance::read(&body[..body.len() - 1]), None);
    }
}
