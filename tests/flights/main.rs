//! Flights, in two dimensions and in three: their paths, their steering, and what stops them.

mod determinism;
mod digests;
mod dynamics;
mod flight;
mod guides;
mod hostile;
mod names;
mod operator;
mod overlays;
mod own_guide;
mod perforation;
mod plane;
mod plane_drawings;
mod plugins;
mod review;
mod scan;
mod scenes;
mod states;
mod taken;
mod traps;

#[path = "../support"]
mod support {
    pub(crate) mod checks;
    pub(crate) mod embedded;
    pub(crate) mod failed;
    pub(crate) mod flights;
    pub(crate) mod logs;
    pub(crate) mod phantom;
    pub(crate) mod program;
    pub(crate) mod run;
    pub(crate) mod scans;
    pub(crate) mod skips;
}
