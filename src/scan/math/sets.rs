//! Disjoint sets.

/// Union-find whose roots are the smallest members, so that the result does not depend on the order of operations.
///
/// ```
/// # use colvis_scan as colvis;
/// let mut sets = colvis::math::sets::Sets::new(5);
/// sets.join(3, 1);
/// sets.join(4, 3);
/// assert_eq!(sets.find(4), 1);
/// assert_eq!(sets.numbered(), (vec![0, 1, 2, 1, 1], 3));
/// ```
#[derive(Debug, Default)]
pub struct Sets {
    parent: Vec<u32>,
}

impl Sets {
    /// Creates sets of one member each, 0 to `n` − 1.
    pub fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect() }
    }

    /// Puts sets one after the other: the members of each are numbered on from those of the one before.
    pub fn concat(parts: Vec<Self>) -> Self {
        let mut parent: Vec<u32> = Vec::with_capacity(parts.iter().map(|p| p.parent.len()).sum());
        for part in parts {
            let base = parent.len() as u32;
            parent.extend(part.parent.into_iter().map(|p| base + p));
        }
        Self { parent }
    }

    /// Adds a set of one member, the next number, and returns it.
    #[inline]
    pub fn add(&mut self) -> u32 {
        let next = self.parent.len() as u32;
        self.parent.push(next);
        next
    }

    /// Returns the root of the set of `a`, and shortens the path to it.
    #[inline]
    pub fn find(&mut self, mut a: u32) -> u32 {
        while self.parent[a as usize] != a {
            let up = self.parent[self.parent[a as usize] as usize];
            self.parent[a as usize] = up;
            a = up;
        }
        a
    }

    /// Joins the sets of `a` and `b`.
    #[inline]
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        if a != b {
            self.parent[a.max(b) as usize] = a.min(b);
        }
    }

    /// Returns the set of every member, numbered from 0 in the order of first members, and the number of sets.
    #[must_use]
    pub fn numbered(mut self) -> (Vec<u32>, usize) {
        let mut count = 0;
        for a in 0..self.parent.len() {
            // A root is smaller than its members, so it was numbered before them; until then it is its own parent.
            let p = self.parent[a] as usize;
            self.parent[a] = if p == a {
                count += 1;
                count - 1
            } else {
                self.parent[p]
            };
        }
        (self.parent, count as usize)
    }
}
