use super::*;
use crate::dataset::Recipe as SetRecipe;
use crate::eval::engagement::recipe::{Purpose, Recipe};
use crate::models::flight::distractor::DistractorKind;
use crate::models::ground::city::learned_seed;
use crate::scenario::Scenario;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The files of a folder that end in `.toml`.
fn files(folder: &str) -> Vec<PathBuf> {
    let all = std::fs::read_dir(root().join(folder)).unwrap();
    let all = all.map(|entry| entry.unwrap().path());
    let mut files: Vec<PathBuf> = all
        .filter(|f| f.extension().is_some_and(|e| e == "toml"))
        .collect();
    files.sort_unstable();
    files
}

fn held_out(model: &str) -> bool {
    catalogue::load(model).unwrap().held_out
}

/// Of all recipes that the program comes with.
#[test]
fn networks_learn_from_other_cities_and_airframes_than_they_are_judged_by() {
    let (mut judging, mut learning, mut sets) = (0, 0, 0);
    for file in files("recipes") {
        if let Ok(recipe) = Recipe::load(&file) {
            let first = recipe.purpose.first_seed();
            // Of the first and the last city.
            let judged = [first, first + u64::from(recipe.places) - 1]
                .map(|seed| JUDGED_SEEDS.contains(&seed));
            let kept = recipe.uav.models.iter().filter(|model| held_out(model));
            match recipe.purpose {
                Purpose::Judging => {
                    judging += 1;
                    assert_eq!(judged, [true; 2], "{file:?}");
                    assert_eq!(kept.count(), 2, "{file:?}");
                    assert!(recipe.uav.held_out.unwrap() >= 0.5);
                    // Nearly every draw of a hundred has a city of its own.
                    assert!(recipe.places >= 10_000);
                    for kind in DistractorKind::ALL {
                        let drawn = |k: &&crate::eval::engagement::recipe::KindDraw| {
                            k.kind == kind && k.share > 0.0
                        };
                        assert!(
                            recipe.distractors.kinds.iter().any(|k| drawn(&k)),
                            "{kind:?}"
                        );
                    }
                }
                Purpose::Learning => {
                    learning += 1;
                    assert_eq!(judged, [false; 2], "{file:?}");
                    assert_eq!(kept.count(), 0, "{file:?}");
                    assert_eq!(recipe.real.share, 0.0);
                }
            }
        } else if let Ok((recipe, _)) = SetRecipe::load(&file) {
            sets += 1;
            assert!(!recipe.targets.models.iter().any(|model| held_out(model)));
        }
    }
    // `engagement`, of which `ablation` takes the draws; `tracks`; `hybrid`, `tiny` and `uav`.
    assert_eq!((judging, learning, sets), (1, 1, 3));
    // A data set draws its cities from all other seeds.
    for seed in [JUDGED_SEEDS.start, JUDGED_SEEDS.end - 1] {
        assert!(!JUDGED_SEEDS.contains(&learned_seed(seed)));
    }
    // What the program comes with for people to look at, tune and train policies on.
    for file in ["scenarios", "python/boresight/gym/scenarios"]
        .map(files)
        .concat()
    {
        let loaded = Scenario::load(&file, &[]).unwrap();
        refuse_kept(&loaded).unwrap();
    }
}

#[test]
fn a_scenario_to_learn_from_shows_nothing_that_is_kept() {
    let path = root().join("scenarios/urban_intercept.toml");
    let refused = |set: &str| {
        let loaded = Scenario::load(&path, &[set.to_owned()]).unwrap();
        refuse_kept(&loaded).map_err(|error| error.to_string())
    };
    assert_eq!(refused("city.seed=999999"), Ok(()));
    for (set, key) in [
        ("city.seed=1000000", "city.seed: city 1000000 is kept"),
        ("uavs.0.model=hframe", "uavs[0].model: 'hframe' is held out"),
    ] {
        let error = refused(set).unwrap_err();
        assert!(error.contains(key) && !error.contains('\n'), "{error}");
    }
}

#[test]
fn recipes_to_learn_from_refuse_a_held_out_uav_with_its_line() {
    let text = "\n[targets]\nmodels = [\"phantom4\", \"quadplane\"]";
    let error = SetRecipe::parse(text, "r.toml").unwrap_err().to_string();
    let wanted = "r.toml:3: targets.models[1]: 'quadplane' is held out";
    assert!(error.starts_with(wanted), "{error}");
    let tracks = std::fs::read_to_string(root().join("recipes/tracks.toml")).unwrap();
    let text = tracks.replace("\"fpv5\"", "\"hframe\"");
    let error = Recipe::parse(&text, "r.toml").unwrap_err().to_string();
    assert!(
        error.contains(": uav.models[5]: 'hframe' is held out"),
        "{error}"
    );
    let real = "[real]\nshare = 0.5\nscenarios = [\"a.toml\"]\n\n[weather]";
    let error = Recipe::parse(&tracks.replace("[weather]", real), "r.toml");
    let error = error.unwrap_err().to_string();
    assert!(
        error.contains("real.share: real cities are kept"),
        "{error}"
    );
}
