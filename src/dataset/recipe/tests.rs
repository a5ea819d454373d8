use super::*;
use proptest::prelude::*;

const GOOD: &str = r#"seed = 3
scenes = 12
stills = 5
val_share = 0.2

[backgrounds]
sky = 1.0
forest = 0.5

[camera]
sizes_px = [[640, 480], [320, 240]]
hfov_deg = [1.0, 30.0]
"#;

fn error(text: &str) -> String {
    Recipe::parse(text, "r.toml").unwrap_err().to_string()
}

#[test]
fn what_is_absent_has_its_default() {
    let recipe = Recipe::parse(GOOD, "r.toml").unwrap();
    assert_eq!((recipe.scenes, recipe.backgrounds.forest), (12, 0.5));
    assert_eq!(recipe.targets, Targets::default());
    assert_eq!(Recipe::parse("", "r.toml").unwrap(), Recipe::default());
    for shipped in ["uav", "tiny", "hybrid"] {
        let path = format!("{}/recipes/{shipped}.toml", env!("CARGO_MANIFEST_DIR"));
        Recipe::load(Path::new(&path)).unwrap();
    }
}

#[test]
fn every_error_names_line_and_key() {
    for (text, wanted) in [
        (
            "scnes = 3",
            "r.toml:1: scnes: unknown key - did you mean 'scenes'? expected one of",
        ),
        (
            "\n[camera]\nhfov = 3",
            "r.toml:3: camera.hfov: unknown key - did you mean 'hfov_deg'?",
        ),
        (
            "[targets]\nsize_px = 12",
            "r.toml:2: targets.size_px: invalid type",
        ),
        ("seed = ", "r.toml:1: not TOML"),
        (
            "\nstills = 0",
            "r.toml:2: stills: found 0, must be from 1 to",
        ),
        ("val_share = nan", "r.toml:1: val_share: must be a finite"),
        (
            "[targets]\nsize_px = [40, 4]",
            "r.toml:2: targets.size_px: found [40, 4], the first must not be above",
        ),
        (
            "[targets]\nnone = 0.5\nseveral = 0.6",
            "r.toml:3: targets.several: found 0.6, must be from 0 to 0.5",
        ),
        (
            "[backgrounds]\nsky = 0\nforest = 0\nurban = 0",
            "r.toml:1: backgrounds: sky, forest, urban are all 0",
        ),
        (
            "[camera]\nsizes_px = []",
            "r.toml:2: camera.sizes_px: is empty",
        ),
        (
            "[camera]\nsizes_px = [\n[640, 480],\n[640, 0]]",
            "r.toml:4: camera.sizes_px[1][1]: found 0, must be from 64",
        ),
        (
            "[city]\nextent_m = [100, 900]",
            "r.toml:2: city.extent_m[0]: found 100, must be from 800",
        ),
    ] {
        let message = error(text);
        assert!(!message.contains('\n'), "{message}");
        assert!(message.starts_with(wanted), "{wanted:?}: {message}");
    }
    let message = Recipe::load(Path::new("nowhere.toml"))
        .unwrap_err()
        .to_string();
    assert!(
        message.starts_with("nowhere.toml: cannot be read: "),
        "{message}"
    );
}

proptest! {
    #[test]
    fn mutated_recipes_are_taken_or_refused_in_one_line(
        at in 0..GOOD.len(),
        cut in 0..20usize,
        insert in "([\\[\\]{}=.,'\"\n #-]|[a-z_]{1,9}|[0-9]{1,25}|nan|inf|\\PC){0,4}",
    ) {
        let end = (at + cut).min(GOOD.len());
        let text = format!("{}{insert}{}", &GOOD[..at], &GOOD[end..]);
        if let Err(error) = Recipe::parse(&text, "r.toml") {
            let message = error.to_string();
            prop_assert!(message.starts_with("r.toml") && !message.contains('\n'), "{message}");
        }
    }

    #[test]
    fn a_recipe_survives_being_written(
        seed in 0..u64::MAX / 2,
        scenes in 0..1000u32,
        stills in 1..100u32,
        share in 0.0..0.9f64,
        low in 0.5..5.0f64,
    ) {
        let mut recipe = Recipe { seed, scenes, stills, val_share: share, ..Recipe::default() };
        recipe.camera.hfov_deg[0] = low;
        recipe.motions.level = share;
        let text = toml::to_string(&recipe).map_err(|e| TestCaseError::fail(e.to_string()))?;
        prop_assert_eq!(Recipe::parse(&text, "r.toml").ok(), Some(recipe));
    }
}
