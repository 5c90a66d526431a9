//! Shows slices where the layout has none.

use super::Workspace;
use crate::host::window::layouts::{FIRST, LAYOUTS};

/// Panels of slices.
const SLICES: [&str; 4] = ["axial", "coronal", "sagittal", "across"];

impl Workspace {
    /// Shows slices: in the first layout, if the present one shows none. Returns the number of the layout that was left.
    pub(crate) fn show_slices(&mut self) -> Option<usize> {
        if SLICES.iter().any(|name| self.layouts[self.layout].is_shown(name)) {
            return None;
        }
        let left = self.layout;
        self.choose(LAYOUTS.iter().position(|l| l.name == FIRST)?);
        Some(left)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::host::window::panels::BUILT_IN;

    #[test]
    fn a_layout_with_slices_stays() {
        for (name, stays) in [("flight", false), ("reading", true), ("slices", true), ("across", true)] {
            let (mut workspace, _) = Workspace::new(BUILT_IN, Some(name), None);
            let before = workspace.layout;
            assert_eq!(workspace.show_slices(), (!stays).then_some(before), "{name}");
            assert!(SLICES.iter().any(|s| workspace.layouts[workspace.layout].is_shown(s)), "{name}");
        }
    }
}
