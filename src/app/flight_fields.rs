//! Fields over the lumen that guides need. They are built when a guide requests them and dropped when no guide does.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;

use crate::dynamics::Route;
use crate::error::{Error, Result};
use crate::fields::centerline::{self, CenterlineMethod, End};
use crate::fields::clearance::TOLERANCE_MM;
use crate::fields::{BodyClearance, Lumen, TargetDistance, Through, WallDistance};
use crate::plan::Plan;
use crate::progress::Progress;
use crate::schedule::Needs;
use crate::volume::Volume;

/// The fields of a flight that are built so far.
#[derive(Clone, Debug, Default)]
pub struct Fields {
    walls: Option<Arc<WallDistance>>,
    /// Gas outside the lumen, if `walls` refer to that gas.
    gas: Option<Arc<Lumen>>,
    /// Together with the requested goal: the field may have moved its goal into the lumen.
    target: Option<(DVec3, Arc<TargetDistance>)>,
    route: Option<PlannedRoute>,
    /// Build times in the order of building, s.
    took: Vec<(&'static str, f64)>,
    /// Notes to the user about what was built.
    notes: Vec<String>,
}

/// A route and the ends that it was planned for.
#[derive(Clone, Debug)]
struct PlannedRoute {
    ends: [DVec3; 2],
    planner: CenterlineMethod,
    route: Arc<Route>,
}

/// Formats the note that the path to the target is narrower than requested.
fn narrower(kept_mm: f64, asked_mm: f64) -> String {
    let kept = match kept_mm {
        0.0 => "it follows the open lumen".to_owned(),
        mm => format!("it keeps {mm:.1} mm"),
    };
    format!(
        "no path to the goal keeps the {asked_mm:.1} mm from the wall that the camera needs; {kept}, which may be too narrow"
    )
}

impl Fields {
    /// True if everything in `wanted` is built for this plan.
    #[doc(hidden)]
    pub fn has(&self, wanted: Needs, plan: &Plan) -> bool {
        let ends = [plan.begin, plan.goal().at];
        let planned = self
            .route
            .as_ref()
            .is_some_and(|r| r.planner == wanted.planner && (r.ends == ends || r.ends == [ends[1], ends[0]]));
        let aimed = self.target.as_ref().is_some_and(|t| t.0 == plan.goal().at);
        (planned || !wanted.centerline) && (aimed || !wanted.distances)
    }

    /// Returns the wall distance D_s, if it is built.
    pub fn walls(&self) -> Option<&Arc<WallDistance>> {
        self.walls.as_ref()
    }

    /// Returns the target distance D_t, if it is built.
    pub fn target(&self) -> Option<&Arc<TargetDistance>> {
        self.target.as_ref().map(|t| &t.1)
    }

    /// Returns the route planned from one end of the plan to its goal, if it is built.
    pub fn route(&self) -> Option<&Arc<Route>> {
        self.route.as_ref().map(|p| &p.route)
    }

    /// Returns the build times that have not been taken yet, s, in the order of building.
    pub fn times(&self) -> &[(&'static str, f64)] {
        &self.took
    }

    /// Takes the build times since the last call, s, in the order of building.
    pub(crate) fn take_times(&mut self) -> Vec<(&'static str, f64)> {
        std::mem::take(&mut self.took)
    }

    /// Takes the notes to the user since the last call.
    pub(crate) fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    /// Creates fields that hold a route planned elsewhere between the ends of `plan`, for a guide that follows it.
    pub(crate) fn along(route: Arc<Route>, plan: &Plan, planner: CenterlineMethod) -> Self {
        let ends = [plan.begin, plan.goal().at];
        Self { gas: plan.gas.clone(), route: Some(PlannedRoute { ends, planner, route }), ..Self::default() }
    }

    fn timed<T>(&mut self, name: &'static str, build: impl FnOnce() -> Result<T>) -> Result<T> {
        let begun = Instant::now();
        let built = build();
        colvis_scan::memory::release();
        self.took.push((name, begun.elapsed().as_secs_f64()));
        built
    }

    /// Builds what is wanted and missing, for the current plan and a body of `radius_mm`, and drops what is not wanted.
    ///
    /// # Errors
    /// Returns status 4 if there is no path between the plan's ends, or if interrupted.
    #[doc(hidden)]
    pub fn build(
        &mut self,
        wanted: Needs,
        volume: &Volume,
        lumen: &Lumen,
        plan: &Plan,
        radius_mm: f64,
        progress: &Progress,
    ) -> Result<()> {
        let same = match (&self.gas, &plan.gas) {
            (None, None) => true,
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            _ => false,
        };
        if !same {
            (self.walls, self.target, self.route) = (None, None, None);
            self.gas = plan.gas.clone();
        }
        if !wanted.distances {
            self.target = None;
        }
        let ends = [plan.begin, plan.goal().at];
        let planner = wanted.planner;
        let known = self.route.as_ref().filter(|r| wanted.centerline && r.planner == planner).map(|r| r.ends);
        let planned = match known {
            Some(known) if known == ends => self.route.clone(),
            Some(known) if known == [ends[1], ends[0]] => {
                self.route.as_ref().map(|r| PlannedRoute { ends, planner, route: Arc::new(r.route.reversed()) })
            }
            _ => None,
        };
        let aimed = self.target.as_ref().is_some_and(|t| t.0 == plan.goal().at);
        let missing = (wanted.centerline && planned.is_none()) || (wanted.distances && !aimed);
        self.route = planned;
        if missing && self.walls.is_none() {
            let gas = plan.gas.as_deref().unwrap_or(lumen);
            let walls = self.timed("distance_s", || WallDistance::of_lumen(volume, gas, Through::Gas, progress))?;
            self.walls = Some(Arc::new(walls));
        }
        if let Some(walls) = self.walls.clone() {
            if wanted.centerline && self.route.is_none() {
                let line = self.timed("centerline_s", || {
                    centerline::to_fly(planner, &walls, End::At(ends[0]), End::At(ends[1]), progress)
                })?;
                let route = Route::along(&line.points, &line.radius_mm, DVec3::NEG_Y).ok_or_else(|| {
                    Error::incomplete("path", "start and goal coincide", "give --from and --to farther apart")
                })?;
                self.route = Some(PlannedRoute { ends, planner, route: Arc::new(route) });
            }
            if wanted.distances && !aimed {
                // Between the centres of two neighbours, along any axis, the wall may be nearer than at either centre by half the
                // distance between them.
                let clearance_mm = radius_mm + TOLERANCE_MM + 0.5 * volume.grid().spacing().max_element();
                let body = BodyClearance { from: plan.begin, clearance_mm };
                let target =
                    self.timed("target_s", || TargetDistance::to(&walls, plan.goal().at, Some(body), &[], progress))?;
                if target.clearance_mm() < clearance_mm {
                    self.notes.push(narrower(target.clearance_mm(), clearance_mm));
                }
                self.target = Some((plan.goal().at, Arc::new(target)));
            }
        }
        if !wanted.distances {
            self.walls = None;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::fields::{Distance, lumen};
    use crate::volume::Grid;

    /// Two rooms of 18 × 32 × 16 mm, side by side along x, without a way from one to the other.
    fn two_rooms() -> Volume {
        let dims = [52, 40, 24];
        let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let gas = |n: usize| {
            let (i, j, k) = (n % 52, n / 52 % 40, n / (52 * 40));
            ((4..22).contains(&i) || (30..48).contains(&i)) && (4..36).contains(&j) && (4..20).contains(&k)
        };
        let data = (0..grid.len()).map(|n| if gas(n) { -1000 } else { 40 }).collect();
        Volume::new(grid, data)
    }

    #[test]
    fn the_fields_follow_the_plan_into_another_gas() {
        let (volume, progress) = (two_rooms(), Progress::new());
        let [first, second] = [13.0, 39.0].map(|x| [10.0, 30.0].map(|y| DVec3::new(x, y, 12.0)));
        let gas = |at: DVec3| lumen::gas_at(&volume, at, &progress).unwrap().unwrap();
        // From gas beside the colon to the colon, and back.
        let (beside, colon) = (Arc::new(gas(first[0])), gas(second[0]));
        let along = |[from, to]: [DVec3; 2]| Plan::between(from, to, 20.0);
        let outside = Plan { gas: Some(Arc::clone(&beside)), ..along(first) };
        let wanted = Needs { distances: true, centerline: true, ..Needs::NOTHING };
        let mut fields = Fields::default();
        for (plan, here, there) in
            [(&outside, first, second), (&along(second), second, first), (&outside, first, second)]
        {
            fields.build(wanted, &volume, &colon, plan, 1.5, &progress).unwrap();
            let walls = fields.walls().unwrap();
            let is_inside = |at: DVec3| walls.is_inside(walls.voxel(at));
            assert!(here.into_iter().all(is_inside) && !there.into_iter().any(is_inside));
            let target = fields.target().unwrap();
            assert!(target.sample(here[0]).is_some() && target.sample(there[0]).is_none());
        }
        fields.build(Needs::NOTHING, &volume, &colon, &outside, 1.5, &progress).unwrap();
        assert!(fields.walls().is_none() && fields.target().is_none());
    }
}
