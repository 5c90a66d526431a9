//! Archives of others on this machine, started and stopped by a test: Orthanc, and those of DCMTK.

use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::skips::skip;

/// Where the programs of archives are, beside those of the path.
const FOLDERS: [&str; 1] = ["/usr/sbin"];

/// A running archive. It is stopped when it is dropped.
pub(crate) struct Running {
    pub(crate) port: u16,
    child: Child,
}

impl Running {
    /// Ends the archive at once, as a power cut does.
    pub(crate) fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Returns the place of a program. If it is not there, the test is skipped.
#[track_caller]
pub(crate) fn program(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let found =
        std::env::split_paths(&path).chain(FOLDERS.map(PathBuf::from)).map(|f| f.join(name)).find(|p| p.is_file());
    if found.is_none() {
        skip("archive", &format!("there is no program {name}"));
    }
    found
}

/// Starts a program on a free port, and waits until it listens.
fn started(mut command: impl FnMut(u16) -> Command) -> Running {
    // Another program may take the port in between.
    for _ in 0..5 {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        // DCMTK, also within Orthanc, otherwise waits 40 ms before it sends the rest of a message.
        let mut command = command(port);
        command.env("TCP_NODELAY", "1");
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let mut running = Running { port, child };
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(20) && running.child.try_wait().unwrap().is_none() {
            // A connection to a port that nobody listens at may be one with itself: its own port is drawn from the same range.
            let is_other = |s: &TcpStream| s.local_addr().ok() != s.peer_addr().ok();
            if TcpStream::connect(("127.0.0.1", port)).is_ok_and(|s| is_other(&s)) {
                return running;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }
    panic!("the archive does not start");
}

/// Starts Orthanc with its files in `folder`, and further settings.
pub(crate) fn orthanc(program: &Path, folder: &Path, more: &Value) -> Running {
    started(|port| {
        let mut settings = json!({
            "Name": "test", "StorageDirectory": folder, "IndexDirectory": folder, "Plugins": [], "DicomPort": port,
            "DicomAet": "ORTHANC", "DicomCheckCalledAet": true, "DicomAlwaysAllowEcho": true, "DicomAlwaysAllowStore": true,
            "DicomAlwaysAllowFind": true, "DicomAlwaysAllowGet": true, "HttpServerEnabled": false, "RemoteAccessAllowed": false,
            "SyncStorageArea": false,
        });
        let more = more.as_object().into_iter().flatten().map(|(key, value)| (key.clone(), value.clone()));
        settings.as_object_mut().unwrap().extend(more);
        let file = folder.join("orthanc.json");
        std::fs::write(&file, settings.to_string()).unwrap();
        let mut command = Command::new(program);
        command.arg(file);
        command
    })
}

/// Starts storescp, which writes what it is sent into `folder`.
pub(crate) fn storescp(program: &Path, folder: &Path, more: &[&str]) -> Running {
    started(|port| {
        let mut command = Command::new(program);
        command.arg("-od").arg(folder).args(more).arg(port.to_string());
        command
    })
}

/// Starts dcmqrscp with the title `QRSCP` and its files in `folder`.
pub(crate) fn dcmqrscp(program: &Path, folder: &Path) -> Running {
    started(|port| {
        let database = folder.join("database");
        std::fs::create_dir_all(&database).unwrap();
        let file = folder.join("dcmqrscp.cfg");
        let text = format!(
            "NetworkTCPPort = {port}\nMaxPDUSize = 16384\nMaxAssociations = 16\nHostTable BEGIN\nHostTable END\n\
             VendorTable BEGIN\nVendorTable END\nAETable BEGIN\nQRSCP {} RW (200, 1024mb) ANY\nAETable END\n",
            database.display()
        );
        std::fs::write(&file, text).unwrap();
        let mut command = Command::new(program);
        command.arg("-c").arg(file);
        command
    })
}
