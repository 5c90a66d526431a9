//! Archives (PACS): asked, read from and sent to over the network.
//!
//! | call | service | model |
//! |---|---|---|
//! | [`Archive::echo`] | C-ECHO | |
//! | [`Archive::find`] | C-FIND | study root |
//! | [`Archive::get`] | C-GET | study root; no recoding |
//! | [`Archive::send`] | C-STORE | |
//!
//! All calls block, report to a [`Progress`], and end within a second once that is cancelled: run them on a thread of their own
//! where a window must not wait. Limits hold whatever the network sends: for the time until a connection stands, for the time until
//! each answer, for the length of PDUs, commands and answers, and for their number.
//!
//! ```no_run
//! # use colvis_dicom as dicom;
//! use colvis_scan::progress::Progress;
//! use dicom::archive::{Archive, Query};
//!
//! let archive = Archive::new("hospital", "127.0.0.1", 4242, "ORTHANC");
//! let found = archive.find(&Query { patient: Some("doe".to_owned()), ..Query::default() }, 500, &Progress::new())?;
//! for study in &found.studies {
//!     println!("{} {} {}", study.date, study.patient_name, study.description);
//! }
//! # Ok::<(), colvis_scan::error::Error>(())
//! ```

mod connection;
mod elements;
mod file;
mod find;
mod get;
mod message;
mod send;
#[cfg(test)]
mod tests;
mod text;
mod tls;

use std::path::PathBuf;
use std::time::Duration;

use colvis_scan::error::{Error, Result};
use colvis_scan::progress::Progress;
use dicom_dictionary_std::uids;

use connection::{Association, Proposal};
use message::{Command, Exchange, Kind};

pub use find::{DateRange, Found, Query, Series, Study};
pub use get::Got;
pub use send::Sent;

/// An archive and how it is reached.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Archive {
    /// Its name in messages.
    pub name: String,
    /// Its host, by name or address.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// Its application entity title.
    pub title: String,
    /// Our application entity title.
    pub own_title: String,
    /// Limit for a connection.
    pub connect_timeout: Duration,
    /// Limit for each answer.
    pub answer_timeout: Duration,
    /// Encryption, if the archive wants it.
    pub tls: Option<Tls>,
}

/// Encryption of the connection to an archive. All files are PEM.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tls {
    /// The certificates that the archive's is checked against.
    pub ca: PathBuf,
    /// Our certificate, if the archive asks for one.
    pub own: Option<OwnCertificate>,
    /// The name in the archive's certificate, if it is not the host.
    pub name: Option<String>,
}

/// A certificate of ours.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OwnCertificate {
    /// The certificate, and those that lead to its authority.
    pub certificate: PathBuf,
    /// Its key.
    pub key: PathBuf,
}

impl Archive {
    /// Creates an archive without encryption, with the usual title of ours (`COLVIS`) and the usual limits: 10 s for a connection,
    /// 30 s for each answer.
    #[must_use]
    pub fn new(name: impl Into<String>, host: impl Into<String>, port: u16, title: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            host: host.into(),
            port,
            title: title.into(),
            own_title: "COLVIS".to_owned(),
            connect_timeout: Duration::from_secs(10),
            answer_timeout: Duration::from_secs(30),
            tls: None,
        }
    }

    /// Asks the archive whether it is there.
    ///
    /// # Errors
    /// Returns status 2 if its settings cannot be used, 3 if it cannot be reached or refuses, 4 if interrupted.
    pub fn echo(&self, progress: &Progress) -> Result<()> {
        progress.stage("asking the archive", 0);
        let proposals = [proposal(uids::VERIFICATION)];
        let mut exchange = Exchange::new(Association::open(self, &proposals, progress)?);
        let context = exchange.service(uids::VERIFICATION, "C-ECHO")?;
        let id = exchange.next_id();
        exchange.send(&Command::new(Kind::Echo, &context, id, false))?;
        let answer = exchange.answer(Kind::Echo, id)?;
        if !answer.status().is_success() {
            return Err(Error::input(self.what(), format!("answers with {}", answer.told()), "ask who runs it"));
        }
        exchange.association.release();
        Ok(())
    }

    /// The archive, for messages.
    fn what(&self) -> String {
        format!("archive {} ({}:{})", self.name, self.host, self.port)
    }
}

/// A proposal of a service, whose data sets are small.
fn proposal(class: &str) -> Proposal {
    Proposal { class: class.to_owned(), syntaxes: vec![uids::IMPLICIT_VR_LITTLE_ENDIAN.to_owned()], receives: false }
}
