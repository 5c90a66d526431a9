//! The pelvic bones: iliac wings, sacrum, hip sockets and femoral heads.

use glam::DVec3;

use super::organ::{Organ, organ};

/// Nothing of the bones is above this, an adult's mm.
pub(crate) const TOP: f64 = -24.0;

/// The bowl that the iliac wings are part of: middle and half axes, an adult's mm.
const BOWL: ([f64; 3], [f64; 3]) = ([0.0, 2.0, -44.0], [143.0, 104.0, 118.0]);
/// Sacrum, and the sit bones and pubic bones of one side.
const SACRUM: Organ = organ([0.0, 117.0, -104.0], [46.0, 13.0, 56.0], 0.0);
const SIT: Organ = organ([62.0, 62.0, -196.0], [17.0, 20.0, 36.0], 0.0);
const PUBIS: Organ = organ([38.0, -38.0, -196.0], [42.0, 12.0, 13.0], 0.0);
/// Middle of the femoral head, its radius, the outer radius of its socket and the width of the joint.
const HEAD: ([f64; 3], f64, f64, f64) = ([93.0, 32.0, -178.0], 23.0, 33.0, 3.0);

/// Returns the depth inside bone at `o` (an adult's mm), in an adult's mm; a lower bound of the distance outside.
pub(crate) fn depth(o: DVec3) -> f64 {
    // Both sides are alike.
    let q = DVec3::new(o.x.abs(), o.y, o.z);
    let (centre, half) = (DVec3::from_array(BOWL.0), DVec3::from_array(BOWL.1));
    let bowl = (1.0 - ((q - centre) / half).length()) * half.min_element();
    // The crest is highest at the side, and the wing ends in front and above the socket.
    let crest = TOP - 4.0 - 0.004 * (q.y - 48.0).powi(2) - q.z;
    let thick = 5.5 + 1.5 * (crest / 14.0).clamp(0.0, 1.0);
    let wing = (thick - bowl.abs()).min(q.x - 30.0).min(crest / 1.3).min(q.y - 14.0).min(q.z + 158.0);
    let (head, radius, socket, joint) = (DVec3::from_array(HEAD.0), HEAD.1, HEAD.2, HEAD.3);
    let off = q - head;
    let out = off.length();
    let ball = radius - out;
    // The socket is open to the side and below.
    let cup = (socket - out).min(out - radius - joint).min(off.dot(DVec3::new(-0.6, 0.1, 0.79)) + 8.0);
    let neck = DVec3::new(0.79, 0.1, -0.6);
    let t = off.dot(neck).clamp(0.0, 60.0);
    let neck = 13.0 - (off - neck * t).length();
    wing.max(ball).max(cup).max(neck).max(SACRUM.depth(q)).max(SIT.depth(q)).max(PUBIS.depth(q))
}
