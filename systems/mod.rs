//! One file (or folder) for each scheduled system.
