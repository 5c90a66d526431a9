//! The display of this session.

use winit::event_loop::EventLoop;

use super::shell::Wake;
use crate::panics::catch_panic;

/// A display on which a window can be opened.
#[doc(hidden)]
pub struct Display(pub(super) EventLoop<Wake>);

impl Display {
    /// Opens the display of this session; `None` if there is none or it cannot be used. Call it once, on the program's first
    /// thread.
    ///
    /// A Wayland display is preferred. If its compositor does not answer, and there is an X display, that is used, with a note.
    #[doc(hidden)]
    pub fn open() -> Option<Self> {
        let set = |name: &str| std::env::var_os(name).is_some_and(|v| !v.is_empty());
        if cfg!(all(unix, not(target_os = "macos")))
            && !["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"].map(set).contains(&true)
        {
            return None;
        }
        // If a system library or an extension of the X server is missing, winit panics instead of returning an error. No display
        // is available then, and the flight continues without one.
        catch_panic(open).ok().flatten().map(Self)
    }
}

#[cfg(not(all(unix, not(target_os = "macos"))))]
fn open() -> Option<EventLoop<Wake>> {
    EventLoop::with_user_event().build().ok()
}

#[cfg(all(unix, not(target_os = "macos")))]
fn open() -> Option<EventLoop<Wake>> {
    use winit::platform::x11::EventLoopBuilderExtX11;

    // winit builds an event loop only once, so it cannot be asked for one display after the other.
    let is_there = cfg!(feature = "wayland");
    let instead = wayland::why_not().filter(|_| is_there && std::env::var_os("DISPLAY").is_some_and(|v| !v.is_empty()));
    let mut builder = EventLoop::with_user_event();
    if instead.is_some() {
        builder.with_x11();
    }
    let built = builder.build().ok()?;
    if let Some(why) = instead {
        crate::output::to_stderr(format_args!("note: {why}; the window opens on the X11 display"));
    }
    Some(built)
}

#[cfg(all(unix, not(target_os = "macos")))]
mod wayland {
    use std::ffi::OsStr;
    use std::os::unix::net::UnixStream;
    use std::path::{Path, PathBuf};

    /// Returns why the Wayland display that the environment names cannot be used; `None` if it can, or none is named.
    pub(super) fn why_not() -> Option<String> {
        let set = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty());
        // A connection that another program opened can be used only once.
        if set("WAYLAND_SOCKET").is_some() {
            return None;
        }
        let display = set("WAYLAND_DISPLAY")?;
        let why = match socket(&display, set("XDG_RUNTIME_DIR").as_deref()) {
            // Any of this: it is stale, of another user, or not visible in a container.
            Some(socket) => format!("{}: {}", socket.display(), UnixStream::connect(&socket).err()?),
            None => "XDG_RUNTIME_DIR is not set".to_owned(),
        };
        Some(format!("the Wayland display {} cannot be used ({why})", display.display()))
    }

    /// Returns the socket of a Wayland display; `None` if its name is relative, and there is no folder for it.
    fn socket(display: &OsStr, runtime: Option<&OsStr>) -> Option<PathBuf> {
        if Path::new(display).is_absolute() {
            return Some(display.into());
        }
        runtime.map(Path::new).filter(|r| r.is_absolute()).map(|r| r.join(display))
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn sockets_are_in_the_runtime_folder_unless_their_path_is_absolute() {
            let of = |display: &str, runtime: Option<&str>| socket(display.as_ref(), runtime.map(OsStr::new));
            assert_eq!(of("wayland-1", Some("/run/user/7")), Some("/run/user/7/wayland-1".into()));
            assert_eq!(of("/tmp/w", Some("/run/user/7")), Some("/tmp/w".into()));
            assert_eq!(of("/tmp/w", None), Some("/tmp/w".into()));
            assert_eq!((of("wayland-1", None), of("wayland-1", Some("run"))), (None, None));
        }
    }
}
