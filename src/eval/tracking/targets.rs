//! The targets of the evaluation, and its figures as text.

use super::results::{Budget, Cause, Evaluation, LosRow, Target};
use crate::models::maths::statistics::Rate;

/// Targets that the project set itself.
const PRECISE_MEAN_PX: f64 = 0.59; // [px], the paper's field figure
const LOS_RMS_URAD: f64 = 2.0; // [µrad]
const LOS_PEAK_URAD: f64 = 30.0; // [µrad]
const SATURATED_SHARE: f64 = 0.01;
const FAILED_RATIO: f64 = 0.1;
const OPEN_SHARE: f64 = 0.1;

impl Target {
    fn at_most(
        name: impl Into<String>,
        limit: f64,
        unit: &'static str,
        value: Option<f64>,
    ) -> Self {
        Self {
            name: name.into(),
            limit,
            unit,
            value,
            met: value.map(|value| value <= limit),
            dominated_by: None,
            budget: None,
        }
    }

    /// With the budget that tells the largest cause.
    fn explained_by(mut self, detector: &'static str, controller: &'static str) -> Self {
        self.budget = Some((detector, controller));
        self
    }
}

impl Evaluation {
    /// The targets that the figures speak of, and whether they are met.
    pub(super) fn targets(&self) -> Vec<Target> {
        let mut targets = self.miss_targets();
        targets.extend(self.los_targets());
        targets.extend(self.budget_targets());
        targets.extend(self.lock_target());
        for target in &mut targets {
            if let (Some(false), Some((detector, controller))) = (target.met, target.budget) {
                target.dominated_by = self.dominant(detector, controller);
            }
        }
        targets
    }

    fn miss_targets(&self) -> Vec<Target> {
        self.table2
            .iter()
            .filter(|row| {
                (row.cameras, row.controller, row.detector) == ("urban_1km", "tuned", "onnx")
            })
            .map(|row| {
                Target::at_most(
                    format!("urban_1km, tuned, onnx, {}: mean precise miss", row.uav),
                    PRECISE_MEAN_PX,
                    "px",
                    row.precise_px.map(|stats| stats.mean),
                )
            })
            .collect()
    }

    fn los_targets(&self) -> Vec<Target> {
        let ours = |row: &&LosRow| row.controller != "paper";
        (self.precision.iter().filter(ours))
            .flat_map(|row| {
                let pointing = &row.pointing;
                let what = format!("0.1 px, {}: line-of-sight", row.controller);
                let measured = pointing.rms_urad.map(|_| pointing.saturated_share);
                [
                    Target::at_most(
                        format!("{what} error rms"),
                        LOS_RMS_URAD,
                        "µrad",
                        pointing.rms_urad,
                    )
                    .explained_by("fine", row.controller),
                    Target::at_most(
                        format!("{what} error peak"),
                        LOS_PEAK_URAD,
                        "µrad",
                        pointing.peak_urad,
                    )
                    .explained_by("fine", row.controller),
                    Target::at_most(
                        format!("{what} time with the mirror at its stop"),
                        SATURATED_SHARE,
                        "of the time",
                        measured,
                    ),
                ]
            })
            .collect()
    }

    fn budget_targets(&self) -> Vec<Target> {
        let open = |budget: &Budget| {
            let share = budget.sum_urad? / budget.all.rms_urad?;
            Some((share - 1.0).abs())
        };
        let budgets = self.budget.iter().map(|budget| {
            let (controller, detector) = (budget.controller, budget.detector);
            Target::at_most(
                format!("budget, {controller}, {detector}: sum of the sources off the whole"),
                OPEN_SHARE,
                "of the whole",
                open(budget),
            )
        });
        budgets.collect()
    }

    fn lock_target(&self) -> Option<Target> {
        if self.suite.is_empty() {
            return None;
        }
        // Of all runs, not of the locks: a rule that locks less has less to lose.
        let failed = |rule: &str| {
            let rows = self.suite.iter().filter(|row| row.rule == rule);
            let (failed, runs) = rows.fold((0, 0), |(failed, runs), row| {
                (failed + row.failed.successes, runs + row.failed.trials)
            });
            Rate::of(failed, runs)
        };
        let (paper, ours) = (failed("paper"), failed("global"));
        let ratio = ours
            .rate
            .zip(paper.rate.filter(|rate| *rate > 0.0))
            .map(|(ours, paper)| ours / paper);
        Some(Target::at_most(
            format!(
                "suite: rate of runs without a lock that lasts, ours ({}) over the paper's rule ({})",
                ours.text(),
                paper.text()
            ),
            FAILED_RATIO,
            "of the paper's rate",
            ratio,
        ))
    }

    /// The largest cause in the budget of a detector and controller, if one was made.
    fn dominant(&self, detector: &str, controller: &str) -> Option<String> {
        let budget = self
            .budget
            .iter()
            .find(|row| (row.detector, row.controller) == (detector, controller))?;
        let cause = budget.causes.iter().max_by(|a, b| {
            let urad = |cause: &Cause| cause.removed_urad.unwrap_or(f64::NEG_INFINITY);
            urad(a).total_cmp(&urad(b))
        })?;
        Some(format!("{} ({:.2} µrad)", cause.name, cause.removed_urad?))
    }

    /// Targets and main figures for a terminal.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for target in &self.targets {
            let value = target
                .value
                .map_or("not measured".into(), |v| format!("{v:.3}"));
            let met = match target.met {
                Some(true) => "met",
                Some(false) => "MISSED",
                None => "open",
            };
            text += &format!(
                "{met:<7} {}: {value}, at most {} {}",
                target.name, target.limit, target.unit
            );
            if let Some(cause) = &target.dominated_by {
                text += &format!("; largest cause: {cause}");
            }
            text.push('\n');
        }
        for why in &self.not_run {
            text += &format!("not run: {why}\n");
        }
        if !self.suite.is_empty() {
            text += "score the MOTChallenge files: python tests/score_mot.py DIR\n";
        }
        text
    }
}
