//! `report dynamics`: what the parts of the motion cost for what they bring.

pub mod mines;
pub mod tentacles;
