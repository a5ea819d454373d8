//! What a validation found, as text and numbers.

use crate::output::columns;
use boresight_validate::{Compared, Finding, Plot, Verdict};
use serde::Serialize;

/// What was found.
#[derive(Clone, Debug, Serialize)]
pub struct Validation {
    /// The program's version.
    pub version: &'static str,
    /// Each check.
    pub checks: Vec<Finding>,
    /// `scaling` against `wave`; empty where it was not asked for.
    pub scaling_against_wave: Vec<Compared>,
    /// What the plots draw.
    pub plots: Vec<Plot>,
}

impl Validation {
    /// How many checks are red.
    pub fn red(&self) -> usize {
        let red = |finding: &&Finding| finding.verdict == Verdict::Red;
        self.checks.iter().filter(red).count()
    }

    /// How many comparisons are not as wanted.
    pub fn missed(&self) -> usize {
        let all = self.scaling_against_wave.iter();
        all.filter(|compared| !compared.met()).count()
    }

    /// 0 where every check is green, else 1.
    pub fn exit_code(&self) -> u8 {
        u8::from(self.red() > 0)
    }

    /// As JSON.
    ///
    /// # Errors
    /// None in practice: it is numbers and words alone.
    pub fn json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self)
    }

    /// As a table, with a line that sums it up.
    pub fn text(&self) -> String {
        const HEAD: [&str; 7] = ["model", "check", "unit", "verdict", "value", "ours", "±"];
        let row = |finding: &Finding| {
            let name = match &finding.refused {
                Some(why) => format!("{}: {why}", finding.name),
                None => finding.name.to_owned(),
            };
            vec![
                finding.model.to_owned(),
                name,
                finding.unit.to_owned(),
                verdict(finding.verdict).to_owned(),
                number(finding.value),
                finding.ours.map_or("–".to_owned(), number),
                number(finding.tolerance),
            ]
        };
        let rows: Vec<Vec<String>> = self.checks.iter().map(row).collect();
        let mut text = columns(&HEAD, &rows, 4);
        if !self.scaling_against_wave.is_empty() {
            text += &format!("\n{}", self.comparison());
        }
        text + &format!("\n{}\n", self.summary())
    }

    /// How many checks are green, and how many comparisons are as wanted.
    pub(super) fn summary(&self) -> String {
        let green = self.checks.len() - self.red();
        let mut text = format!("{green} of {} checks green", self.checks.len());
        let compared = self.scaling_against_wave.len();
        if compared > 0 {
            let met = compared - self.missed();
            text += &format!("; scaling is as near to wave as wanted in {met} of {compared} cases");
        }
        text
    }

    fn comparison(&self) -> String {
        let rows: Vec<Vec<String>> = self.scaling_against_wave.iter().map(cells).collect();
        columns(&COMPARED, &rows, 0)
    }
}

/// Heads of the comparison's table.
pub(super) const COMPARED: [&str; 9] = [
    "range m", "Cn²", "W0 m", "wind m/s", "D/r0", "N", "peak", "power", "wanted",
];

/// A row of it.
pub(super) fn cells(compared: &Compared) -> Vec<String> {
    let case = &compared.case;
    let percent = |share: f64| format!("{:+.1} %", 100.0 * share);
    vec![
        format!("{:.0}", case.range_m),
        format!("{:.0e}", case.cn2),
        format!("{:.2}", case.w0_m),
        format!("{:.0}", case.wind_mps),
        format!("{:.2}", compared.d_over_r0),
        format!("{:.2}", compared.distortion),
        percent(compared.peak),
        percent(compared.power),
        format!(
            "±{:.0} %{}",
            100.0 * compared.wanted,
            if compared.met() { "" } else { ", missed" }
        ),
    ]
}

/// A verdict as it is shown.
pub(super) fn verdict(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Green => "green",
        Verdict::Red => "RED",
    }
}

/// A number with six digits, or with an exponent where it is very large or small.
pub(super) fn number(x: f64) -> String {
    const DIGITS: i32 = 6;
    if x == 0.0 {
        return "0".to_owned();
    }
    let decade = x.abs().log10().floor() as i32;
    if !(-4..=7).contains(&decade) {
        let text = format!("{x:.3e}");
        let (digits, exponent) = text.split_once('e').unwrap_or((&text, "0"));
        let digits = digits.trim_end_matches('0').trim_end_matches('.');
        return format!("{digits}e{exponent}");
    }
    let decimals = usize::try_from(DIGITS - 1 - decade).unwrap_or(0);
    let text = format!("{x:.decimals$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_six_digits() {
        let all = [
            0.0,
            -189_013.869,
            12.065,
            0.0496,
            2.2354e-12,
            3_771_793.968,
            1.1e-8,
            600.0,
        ];
        let wanted = [
            "0",
            "-189014",
            "12.065",
            "0.0496",
            "2.235e-12",
            "3771794",
            "1.1e-8",
            "600",
        ];
        assert_eq!(all.map(number), wanted);
    }
}
