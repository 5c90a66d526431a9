//! How far along the way a flight is: from its plan, or coarsely from the length flown; and where it called for help.

/// Calls nearer to each other than this share of the way are one mark.
const ONE_MARK: f64 = 0.01;
/// No more marks than this are kept.
const MARKS: usize = 64;

/// Place along a segment, counted from its start to its goal.
#[derive(Clone, Debug, PartialEq)]
pub struct Way {
    length_mm: f64,
    along_mm: f64,
    flown_mm: f64,
    /// Where the guide called for the operator, as shares of the way.
    marks: Vec<f64>,
}

impl Way {
    /// At the start of a way of `length_mm`, after `flown_mm` of flight.
    pub fn new(length_mm: f64, flown_mm: f64) -> Self {
        Self { length_mm: length_mm.max(0.0), along_mm: 0.0, flown_mm, marks: Vec::new() }
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

    /// Takes the place from a plan: at `along_mm` of `length_mm`.
    pub fn set(&mut self, along_mm: f64, length_mm: f64, flown_mm: f64) {
        self.length_mm = length_mm.max(0.0);
        self.along_mm = along_mm.clamp(0.0, self.length_mm);
        self.flown_mm = flown_mm;
    }

    /// The camera was taken to a share of the way, 0 to 1.
    pub fn jump(&mut self, share: f64) {
        self.along_mm = self.length_mm * share.clamp(0.0, 1.0);
    }

    /// Start and goal are swapped.
    pub fn turn_round(&mut self) {
        self.along_mm = self.length_mm - self.along_mm;
        self.marks.iter_mut().for_each(|m| *m = 1.0 - *m);
    }

    /// The guide called for the operator here.
    pub fn mark(&mut self) {
        let here = self.share();
        if self.marks.len() < MARKS && self.marks.iter().all(|m| (m - here).abs() > ONE_MARK) {
            self.marks.push(here);
        }
    }

    /// Where the guide called for the operator, as shares of the way.
    pub fn marks(&self) -> &[f64] {
        &self.marks
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
        w.jump(0.3);
        w.mark();
        w.mark();
        w.turn_round();
        assert!((w.share() - 0.7).abs() < 1e-12 && w.marks().len() == 1 && (w.marks()[0] - 0.7).abs() < 1e-12);
        w.set(30.0, 60.0, 0.0);
        assert_eq!(w.share(), 0.5);
        assert_eq!(Way::new(0.0, 0.0).share(), 0.0);
        assert_eq!(Way::new(10.0, 0.0).at(f64::NAN).along_mm(), 0.0);
    }
}
