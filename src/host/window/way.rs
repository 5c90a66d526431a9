//! How far along the way a flight is: coarse, from the length flown.

/// Place along a segment, counted from its start to its goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    length_mm: f64,
    along_mm: f64,
    flown_mm: f64,
}

impl Way {
    /// At the start of a way of `length_mm`, after `flown_mm` of flight.
    pub fn new(length_mm: f64, flown_mm: f64) -> Self {
        Self { length_mm: length_mm.max(0.0), along_mm: 0.0, flown_mm }
    }

    /// Taken up at `along_mm`.
    pub fn at(mut self, along_mm: f64) -> Self {
        self.along_mm = if along_mm.is_finite() { along_mm.clamp(0.0, self.length_mm) } else { 0.0 };
        self
    }

    /// Goes on to `flown_mm` of flight in all.
    pub fn go(&mut self, flown_mm: f64) {
        self.along_mm = (self.along_mm + (flown_mm - self.flown_mm).max(0.0)).min(self.length_mm);
        self.flown_mm = flown_mm;
    }

    /// Start and goal are swapped.
    pub fn turn_round(&mut self) {
        self.along_mm = self.length_mm - self.along_mm;
    }

    /// The goal is reached, whatever was counted.
    pub fn arrive(&mut self) {
        self.along_mm = self.length_mm;
    }

    /// mm from the start.
    pub fn along_mm(&self) -> f64 {
        self.along_mm
    }

    /// mm in all.
    pub fn length_mm(&self) -> f64 {
        self.length_mm
    }

    /// 0 at the start, 1 at the goal.
    pub fn share(&self) -> f64 {
        if self.length_mm > 0.0 { self.along_mm / self.length_mm } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_and_back() {
        let mut w = Way::new(800.0, 0.0);
        w.go(200.0);
        assert_eq!(w.share(), 0.25);
        w.turn_round();
        w.go(300.0);
        assert_eq!(w.along_mm(), 700.0);
        w.go(1000.0);
        assert_eq!(w.share(), 1.0, "more was flown than the coarse length says");
        w.turn_round();
        assert_eq!(w.share(), 0.0);
        assert_eq!(Way::new(0.0, 0.0).share(), 0.0);
        assert_eq!(Way::new(10.0, 0.0).at(f64::NAN).along_mm(), 0.0);
    }
}
