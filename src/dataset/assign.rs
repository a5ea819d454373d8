//! Which background and split every scene of a set has.

use super::recipe::Recipe;
use super::shares::{Background, Split, quota};
use crate::models::maths::rng::Stream;

/// Background and split of every scene of a recipe, those with sequences last.
pub fn assign_scenes(recipe: &Recipe) -> Vec<(Background, Split)> {
    let mut scenes = assign(recipe, recipe.scenes, "dataset backgrounds");
    let sequences = recipe.sequences.count;
    scenes.extend(assign(recipe, sequences, "dataset clips' backgrounds"));
    scenes
}

fn assign(recipe: &Recipe, scenes: u32, purpose: &str) -> Vec<(Background, Split)> {
    let shares = &recipe.backgrounds;
    let mut rng = Stream::new(recipe.seed, 0, purpose);
    let kinds = [Background::Sky, Background::Forest, Background::Urban];
    let shares = [shares.sky, shares.forest, shares.urban];
    let backgrounds = quota(scenes, &shares, &mut rng);
    let mut splits = vec![Split::Train; backgrounds.len()];
    // Every background gets its share of validation scenes; the scenes are shuffled already.
    let mut owed = 0.0;
    for kind in 0..kinds.len() {
        for (scene, _) in (backgrounds.iter().enumerate()).filter(|(_, found)| **found == kind) {
            owed += recipe.val_share;
            if owed >= 0.5 {
                splits[scene] = Split::Val;
                owed -= 1.0;
            }
        }
    }
    let named = backgrounds.into_iter().map(|kind| kinds[kind]);
    named.zip(splits).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_background_has_its_share_to_validate_with() {
        let recipe = Recipe {
            scenes: 200,
            val_share: 0.25,
            ..Recipe::default()
        };
        let scenes = assign_scenes(&recipe);
        assert_eq!(scenes.len(), 200);
        for (kind, all) in [
            (Background::Sky, 90.0),
            (Background::Forest, 55.0),
            (Background::Urban, 55.0),
        ] {
            let val = scenes.iter().filter(|s| **s == (kind, Split::Val)).count() as f64;
            assert!((val - 0.25 * all).abs() <= 1.0, "{kind:?}: {val}");
        }
        let none = Recipe {
            val_share: 0.0,
            ..recipe
        };
        assert!(
            assign_scenes(&none)
                .iter()
                .all(|(_, split)| *split == Split::Train)
        );
    }
}
