//! All checks are green; each is red under its mutation.

use super::*;
use boresight_common::parallel::{in_parallel, threads};
use std::collections::BTreeSet;
use std::path::Path;

fn line(finding: &Finding) -> String {
    format!(
        "{}: {}: {:?} against {} within {} ({:.2} s){}",
        finding.model,
        finding.name,
        finding.ours,
        finding.value,
        finding.tolerance,
        finding.took.as_secs_f64(),
        finding.refused.as_deref().unwrap_or_default(),
    )
}

fn listed(findings: &[Finding], wanted: impl Fn(&Finding) -> bool) -> Vec<String> {
    findings.iter().filter(|f| wanted(f)).map(line).collect()
}

#[test]
fn every_check_is_green() {
    let findings = run(&all(), threads(None));
    findings
        .iter()
        .for_each(|finding| println!("{}", line(finding)));
    let red = listed(&findings, |finding| finding.verdict == Verdict::Red);
    assert!(red.is_empty(), "red:\n{}", red.join("\n"));
}

#[test]
fn every_check_is_red_under_its_mutation() {
    let checks = all();
    let mutated = |check: &Check| Ok::<_, ()>(check.find_mutated());
    let findings = in_parallel(&checks, threads(None), mutated).unwrap();
    findings
        .iter()
        .for_each(|finding| println!("{}", line(finding)));
    // Red by its number: a model that refuses its input shows nothing of the tolerance.
    let green = listed(&findings, |f| {
        f.verdict == Verdict::Green || f.ours.is_none()
    });
    assert!(
        green.is_empty(),
        "not red by their number:\n{}",
        green.join("\n")
    );
}

#[test]
fn every_model_is_a_page_and_every_name_is_its_own() {
    let pages = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/validation");
    let mut names = BTreeSet::new();
    for check in all() {
        let page = pages.join(check.model).with_extension("md");
        assert!(page.exists(), "no page {}", check.model);
        assert!(
            names.insert((check.model, check.name)),
            "{} twice",
            check.name
        );
        assert!(check.mutation.factor != 1.0 && check.value.is_finite());
        assert!(
            check.tolerance.absolute(check.value) > 0.0,
            "{}",
            check.name
        );
    }
    assert!(names.len() >= 40, "{}", names.len());
}

#[test]
fn checks_are_chosen_by_model() {
    let chosen = of_models(&["sun".into()]).unwrap();
    assert!(chosen.len() == 2 && chosen.iter().all(|check| check.model == "sun"));
    let refused = of_models(&["moon".into()]).unwrap_err().to_string();
    assert!(
        refused.contains("'moon'") && refused.contains("geodesy"),
        "{refused}"
    );
}

#[test]
fn a_value_may_be_off_to_either_side() {
    let check = |run| Check {
        model: "sun",
        name: "a number",
        reference: "itself",
        value: -2.0,
        unit: "",
        tolerance: Tolerance::Relative(0.1),
        mutation: Mutation {
            constant: "the number",
            factor: 2.0,
        },
        run,
    };
    assert_eq!(check(|_| Ok(-2.19)).find().verdict, Verdict::Green);
    assert_eq!(check(|_| Ok(-1.81)).find().verdict, Verdict::Green);
    assert_eq!(check(|_| Ok(-2.21)).find().verdict, Verdict::Red);
    assert_eq!(check(|_| Ok(-1.79)).find().verdict, Verdict::Red);
    assert_eq!(check(|_| Ok(f64::NAN)).find().verdict, Verdict::Red);
    let refused = check(|_| Err(Fault::Nothing("it"))).find();
    assert!(refused.verdict == Verdict::Red && refused.refused.is_some());
    assert_eq!(
        check(|scale| Ok(scale.of(-2.0))).find_mutated().ours,
        Some(-4.0)
    );
}
