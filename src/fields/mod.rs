//! What is derived from a scan: where the lumen is, and what can be said about every place in it.

pub mod lumen;
