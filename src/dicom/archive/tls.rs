//! Encrypted connections: the certificates that they are checked against, and ours.

use std::path::Path;
use std::sync::Arc;

use colvis_scan::error::{Error, Result};
use colvis_scan::output::plain;
use rustls::crypto::ring;
use rustls::pki_types::pem::{self, PemObject};
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use rustls::{ClientConfig, ClientConnection, RootCertStore};

use super::{Archive, Tls};

/// Largest file of certificates or of a key, bytes.
const MOST_BYTES: u64 = 4 << 20;

/// Prepares an encrypted connection to an archive.
///
/// # Errors
/// Returns status 2 if a certificate or the key cannot be used, or the name is no host's.
pub(super) fn client(archive: &Archive, tls: &Tls) -> Result<ClientConnection> {
    let mut roots = RootCertStore::empty();
    for certificate in certificates(&tls.ca)? {
        roots.add(certificate).map_err(|e| bad(&tls.ca, format!("has a certificate that cannot be used ({e})")))?;
    }
    let fault = |e: rustls::Error| Error::fault(archive.what(), e.to_string(), "report it").caused_by(e);
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()
        .map_err(fault)?
        .with_root_certificates(roots);
    let config = match &tls.own {
        None => config.with_no_client_auth(),
        Some(own) => {
            let key = PrivateKeyDer::from_pem_slice(&read(&own.key)?).map_err(|e| no_pem(&own.key, "key", e))?;
            config
                .with_client_auth_cert(certificates(&own.certificate)?, key)
                .map_err(|e| bad(&own.key, format!("does not fit to {} ({e})", own.certificate.display())))?
        }
    };
    let name = tls.name.as_ref().unwrap_or(&archive.host);
    let server = ServerName::try_from(name.clone()).map_err(|_| {
        Error::usage(archive.what(), format!("{name:?} is no name of a host"), "correct it in the settings")
    })?;
    ClientConnection::new(Arc::new(config), server).map_err(fault)
}

fn certificates(file: &Path) -> Result<Vec<CertificateDer<'static>>> {
    let bytes = read(file)?;
    let all: std::result::Result<Vec<_>, _> = CertificateDer::pem_slice_iter(&bytes).collect();
    match all {
        Ok(all) if all.is_empty() => Err(no_pem(file, "certificate", pem::Error::NoItemsFound)),
        Ok(all) => Ok(all),
        Err(e) => Err(no_pem(file, "certificate", e)),
    }
}

fn read(file: &Path) -> Result<Vec<u8>> {
    let length = std::fs::metadata(file).map(|m| m.len());
    match length.and_then(|n| if n > MOST_BYTES { Ok(None) } else { std::fs::read(file).map(Some) }) {
        Ok(Some(bytes)) => Ok(bytes),
        Ok(None) => Err(bad(file, format!("is larger than {MOST_BYTES} bytes"))),
        Err(e) => Err(bad(file, format!("cannot be read ({})", plain(&e))).caused_by(e)),
    }
}

fn no_pem(file: &Path, what: &str, e: pem::Error) -> Error {
    let why = match e {
        pem::Error::NoItemsFound => format!("holds no {what} in the form PEM"),
        e => format!("holds a damaged {what} ({e:?})"),
    };
    bad(file, why)
}

fn bad(file: &Path, why: String) -> Error {
    Error::usage(file.display().to_string(), why, "give the right file in the archive's settings")
}
