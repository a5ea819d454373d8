//! The files about a whole set: annotations, labels, statistics and counts.

use super::coco::{self, SceneRecord};
use super::error::DatasetError;
use super::page;
use super::recipe::Recipe;
use super::shares::Split;
use super::statistics::Statistics;
use super::store::{FORMAT, record_path, write};
use std::collections::BTreeMap;
use std::path::Path;

/// Gathers the scenes that are there into the files about the set; what to tell the user.
///
/// `digest` is that of the recipe, `scenes` the number of scenes of the whole set.
pub fn merge(
    recipe: &Recipe,
    digest: &str,
    scenes: usize,
    out: &Path,
) -> Result<String, DatasetError> {
    let records = records(scenes, out)?;
    let mut text = String::new();
    let mut counts = serde_json::Map::new();
    for split in [Split::Train, Split::Val] {
        let of_split: Vec<_> = records.values().filter(|r| r.split == split).collect();
        annotations(recipe, split, &of_split, out)?;
        let images: usize = of_split.iter().map(|r| r.images.len()).sum();
        let boxes: usize = (of_split.iter().flat_map(|r| &r.images))
            .map(|i| i.annotations.len())
            .sum();
        let uavs: usize = (of_split.iter().flat_map(|r| &r.images))
            .map(|i| i.uavs().count())
            .sum();
        let others = boxes - uavs;
        text += &format!(
            "{:<6} {} scenes, {images} pictures, {boxes} boxes, {others} of them of distractors\n",
            split.name(),
            of_split.len()
        );
        counts.insert(
            split.name().into(),
            serde_json::json!({ "scenes": of_split.len(), "images": images, "annotations": boxes }),
        );
    }
    statistics(recipe, &records.values().collect::<Vec<_>>(), out)?;
    let real = records.values().filter(|record| record.is_real()).count();
    let about = serde_json::json!({
        "format": FORMAT,
        "program": crate::VERSION,
        "recipe_digest": digest,
        "seed": recipe.seed,
        "scenes": recipe.scenes,
        "sequences": recipe.sequences.count,
        "real_clips": real,
        "real_crops": recipe.real.crops,
        "complete": records.len() == scenes,
        "counts": counts,
    });
    write(
        &out.join("dataset.json"),
        &serde_json::to_vec_pretty(&about)?,
    )?;
    if records.len() < scenes {
        text += &format!(
            "{} of {scenes} scenes are there; the same command, without --scenes, makes the rest\n",
            records.len()
        );
    }
    Ok(text)
}

/// The records that are there, by scene.
fn records(scenes: usize, out: &Path) -> Result<BTreeMap<u32, SceneRecord>, DatasetError> {
    let mut records = BTreeMap::new();
    for scene in 0..scenes as u32 {
        let path = record_path(out, scene);
        let Ok(text) = std::fs::read_to_string(&path) else {
            continue;
        };
        let record =
            serde_json::from_str(&text).map_err(|source| DatasetError::Record { path, source })?;
        records.insert(scene, record);
    }
    Ok(records)
}

/// Writes the COCO file of a part of the set, the YOLO files of its stills and the MOTChallenge
/// files of its sequences.
fn annotations(
    recipe: &Recipe,
    split: Split,
    records: &[&SceneRecord],
    out: &Path,
) -> Result<(), DatasetError> {
    let folder = out.join(split.name());
    let file = serde_json::to_vec(&coco::file(records))?;
    write(&folder.join("annotations.json"), &file)?;
    for record in records {
        if let Some(name) = &record.sequence {
            let folder = out.join("sequences").join(name);
            let (truth, about) = coco::mot(record, name, recipe.sequences.rate_hz);
            write(&folder.join("gt/gt.txt"), truth.as_bytes())?;
            write(&folder.join("seqinfo.ini"), about.as_bytes())?;
            continue;
        }
        for image in &record.images {
            let (name, lines) = coco::yolo(image);
            write(&folder.join("labels").join(name), lines.as_bytes())?;
        }
    }
    Ok(())
}

/// Writes what the set holds, as numbers and as a page; nothing for a set without scenes.
fn statistics(recipe: &Recipe, records: &[&SceneRecord], out: &Path) -> Result<(), DatasetError> {
    if records.is_empty() {
        return Ok(());
    }
    let part = |wanted: &dyn Fn(&SceneRecord) -> bool| {
        let of_part: Vec<_> = (records.iter().copied())
            .filter(|record| wanted(record))
            .collect();
        Statistics::of(&of_part)
    };
    let numbers = serde_json::json!({
        "all": Statistics::of(records),
        (Split::Train.name()): part(&|record| record.split == Split::Train),
        (Split::Val.name()): part(&|record| record.split == Split::Val),
        "rendered": part(&|record| !record.is_real()),
        "real": part(&SceneRecord::is_real),
    });
    let json = serde_json::to_vec_pretty(&numbers)?;
    write(&out.join("statistics.json"), &json)?;
    let page = page::page(records, out, &recipe.description)?;
    write(&out.join("statistics.html"), page.as_bytes())
}
