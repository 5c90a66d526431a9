//! Archives of others on this machine, started and stopped by a test: Orthanc, and those of DCMTK.

use std::fs::File;
use std::io::{Read, Seek};
use std::net::TcpListener;
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
    /// What it says, for a test that fails.
    log: File,
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
        let mut said = Vec::new();
        if std::thread::panicking() && self.log.rewind().and_then(|()| self.log.read_to_end(&mut said)).is_ok() {
            eprintln!("the archive at port {} said:\n{}", self.port, String::from_utf8_lossy(&said));
        }
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

/// Returns if a process listens at a port of this machine.
fn listens(process: u32, port: u16) -> bool {
    let local = format!(":{port:04X}");
    let tables = ["/proc/net/tcp", "/proc/net/tcp6"].map(|table| std::fs::read_to_string(table).unwrap_or_default());
    // The local address of a socket, its state (0A listens), its inode.
    let sockets = tables.iter().flat_map(|table| table.lines()).filter_map(|line| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let is_there = fields.get(1)?.ends_with(&local) && *fields.get(3)? == "0A";
        is_there.then_some(fields.get(9).map(|inode| format!("socket:[{inode}]"))).flatten()
    });
    let sockets: Vec<String> = sockets.collect();
    let files = std::fs::read_dir(format!("/proc/{process}/fd")).into_iter().flatten();
    let mut files = files.filter_map(|file| std::fs::read_link(file.ok()?.path()).ok());
    files.any(|file| sockets.iter().any(|socket| file.as_os_str() == socket.as_str()))
}

/// Starts a program on a free port, and waits until it listens there. Nothing connects to it before the test does.
fn started(mut command: impl FnMut(u16) -> Command) -> Running {
    // Another program may take the port in between.
    for _ in 0..5 {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        // DCMTK, also within Orthanc, otherwise waits 40 ms before it sends the rest of a message.
        let mut command = command(port);
        command.env("TCP_NODELAY", "1");
        let log = tempfile::tempfile().unwrap();
        let [out, err] = [(); 2].map(|()| log.try_clone().unwrap());
        let child = command.stdin(Stdio::null()).stdout(out).stderr(err).spawn().unwrap();
        let mut running = Running { port, child, log };
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(20) && running.child.try_wait().unwrap().is_none() {
            if listens(running.child.id(), port) {
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
