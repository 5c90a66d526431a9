//! Flights, in two dimensions and in three: their paths, their steering, and what stops them.

mod determinism;
mod digests;
mod dynamics;
mod flight;
mod guides;
mod hostile;
mod operator;
mod overlays;
mod own_guide;
mod perforation;
mod plane;
mod plane_drawings;
mod plugins;
mod scan;
mod scenes;
mod traps;

#[path = "../support"]
mod support {
    pub mod failed;
    pub mod flights;
    pub mod logs;
    pub mod phantom;
    pub mod program;
    pub mod run;
    pub mod scans;
    pub mod skips;
}
