//! The files of the shipped drawings.

/// Name and PNG of each drawing. The first is flown by default.
pub const DRAWINGS: [(&str, &[u8]); 10] = [
    ("bends", include_bytes!("../../assets/plane/bends.png")),
    ("straight", include_bytes!("../../assets/plane/straight.png")),
    ("fork", include_bytes!("../../assets/plane/fork.png")),
    ("pocket", include_bytes!("../../assets/plane/pocket.png")),
    ("ring", include_bytes!("../../assets/plane/ring.png")),
    ("touching", include_bytes!("../../assets/plane/touching.png")),
    ("bridge", include_bytes!("../../assets/plane/bridge.png")),
    ("polyp", include_bytes!("../../assets/plane/polyp.png")),
    ("neck", include_bytes!("../../assets/plane/neck.png")),
    ("spiral", include_bytes!("../../assets/plane/spiral.png")),
];

/// Returns all names, for messages.
pub fn names() -> String {
    DRAWINGS.map(|d| d.0).join(", ")
}
