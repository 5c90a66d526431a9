//! Archives: asked, read from and sent to over the network.
