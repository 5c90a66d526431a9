//! What a window tells of a scan that cannot be flown, in words of the window: an error's hint is about the command line.

use crate::error::Error;

/// What the reader can do in a window.
const START: &str = "Double-click into gas in a slice to start there.";
/// What fails where nothing is a colon.
const NO_COLON: &str = "no colon found to fly through";

/// Returns why a scan cannot be flown, and how a flight starts in it all the same.
pub(crate) fn in_words(e: &Error) -> String {
    let what = if e.what == NO_COLON { "No colon was found".to_owned() } else { format!("No flight: {}", e.what) };
    format!("{what}: {}. {START}", e.why)
}

/// Returns why a scan could not be opened. Where there are series to choose from, they are listed below it.
pub(crate) fn failed_in_words(e: &Error) -> String {
    if e.choices.is_empty() { e.to_string() } else { format!("{}: {}", e.what, e.why) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::plan::no_colon;
    use crate::fields::Lumen;
    use crate::testing::Room;

    #[test]
    fn a_window_speaks_of_clicks_not_of_options() {
        let room = Room::new([12, 12, 12]).scan();
        let e = no_colon(room.voxels(), &Lumen::none(room.voxels().grid()));
        let told = in_words(&e);
        assert!(told.starts_with("No colon was found: ") && told.ends_with(START) && !told.contains("--"), "{told}");
        let narrow = Error::incomplete("start 1,2,3", "the lumen there is narrower than the camera", "use --from");
        let told = in_words(&narrow);
        assert_eq!(told, format!("No flight: start 1,2,3: the lumen there is narrower than the camera. {START}"));
        let mut several = Error::input("study", "holds 2 series", "choose one with --series N");
        assert_eq!(failed_in_words(&several), several.to_string());
        several.choices = vec!["1: prone".to_owned(), "2: supine".to_owned()];
        assert_eq!(failed_in_words(&several), "study: holds 2 series");
    }
}
