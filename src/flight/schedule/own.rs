//! Whether a path belongs to this crate.

/// True for a path of this crate or of another member of its workspace, which a crate that merely begins with its name is not.
pub(super) fn is_own(path: &str) -> bool {
    let krate = path.split("::").next().unwrap_or(path);
    krate.strip_prefix("colvis").is_some_and(|member| {
        ["", "_app", "_flight", "_host", "_imaging", "_kernels", "_phantom", "_plane", "_report", "_scan"]
            .contains(&member)
    })
}
