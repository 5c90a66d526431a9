//! Measured distances: pairs of points.

use glam::DVec3;

use crate::app::findings::MOST_DISTANCES;

/// A distance between two points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Measure {
    /// World, mm.
    pub from: DVec3,
    /// World, mm.
    pub to: DVec3,
}

impl From<[DVec3; 2]> for Measure {
    fn from([from, to]: [DVec3; 2]) -> Self {
        Self { from, to }
    }
}

impl From<Measure> for [DVec3; 2] {
    fn from(m: Measure) -> Self {
        [m.from, m.to]
    }
}

impl Measure {
    /// Returns its length, mm.
    pub(crate) fn mm(self) -> f64 {
        self.from.distance(self.to)
    }

    /// Returns its length as displayed.
    pub(crate) fn text(self) -> String {
        format!("{:.1} mm", self.mm())
    }
}

/// The measures of a scan.
#[derive(Debug, Default)]
pub(crate) struct Measures {
    list: Vec<Measure>,
    /// True if clicks measure.
    on: bool,
    /// The first clicked end, until the second one is clicked.
    begun: Option<DVec3>,
}

impl Measures {
    /// Restores measures that were made before.
    pub(crate) fn restore(&mut self, list: &[[DVec3; 2]]) {
        self.list = list.iter().map(|ends| Measure::from(*ends)).collect();
    }

    /// Returns all measures, in the order in which they were made.
    pub(crate) fn list(&self) -> &[Measure] {
        &self.list
    }

    /// Returns the first clicked end, until the second one is clicked.
    pub(crate) fn begun(&self) -> Option<DVec3> {
        self.begun
    }

    /// True if clicks measure.
    pub(crate) fn is_on(&self) -> bool {
        self.on
    }

    /// Switches measuring by clicks on or off. An incomplete measure is discarded.
    pub(crate) fn switch(&mut self) {
        (self.on, self.begun) = (!self.on, None);
    }

    /// Handles a click while measuring: the first one sets an end, the second one completes and returns the measure.
    pub(crate) fn click(&mut self, at: DVec3) -> Option<Measure> {
        let Some(from) = self.begun.take().filter(|_| at.is_finite()) else {
            self.begun = Some(at).filter(|a| a.is_finite());
            return None;
        };
        let made = Measure { from, to: at };
        self.list.push(made);
        let more = self.list.len().saturating_sub(MOST_DISTANCES);
        self.list.drain(..more);
        Some(made)
    }

    /// Deletes a measure by its number.
    pub(crate) fn delete(&mut self, number: usize) {
        if number < self.list.len() {
            self.list.remove(number);
        }
    }

    /// Deletes the last measure.
    pub(crate) fn delete_last(&mut self) {
        self.list.pop();
    }

    /// Discards an incomplete measure. Returns true if there was one.
    pub(crate) fn discard_begun(&mut self) -> bool {
        self.begun.take().is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_clicks_are_a_distance() {
        let mut m = Measures::default();
        m.switch();
        assert_eq!(m.click(DVec3::NAN), None);
        assert_eq!(m.click(DVec3::ZERO), None);
        assert_eq!(m.click(DVec3::new(3.0, 4.0, 0.0)).unwrap().text(), "5.0 mm");
        m.click(DVec3::X);
        assert!(m.discard_begun() && !m.discard_begun());
        assert!(m.begun().is_none() && m.list().len() == 1, "an end without another is no change");
        for x in [1.0, 2.0] {
            m.click(DVec3::X * x);
            m.click(DVec3::Y * x);
        }
        m.delete(0);
        m.delete_last();
        m.delete(77);
        assert_eq!(m.list(), [Measure { from: DVec3::X, to: DVec3::Y }]);
    }
}
