//! What a `tileset.json` must keep to beyond what reading it needs (OGC 22-025r4, sections 7.2 to 7.9).

use crate::tiles::error::TilesError;
use crate::tiles::json::At;
use crate::tiles::read::volume;
use boresight_models::tiles::volume::Bounds;
use glam::DAffine3;
use serde_json::Value;

/// What is wrong with a tileset's file, as the errors that a reader would give.
pub(super) fn faults(location: &str, value: &Value) -> Vec<TilesError> {
    let root = At::root(location, value);
    let mut rules = Rules {
        found: Vec::new(),
        version_1_0: value["asset"]["version"] == "1.0",
        gltf_declared: (value["extensionsUsed"].as_array())
            .is_some_and(|used| used.iter().any(|name| name == "3DTILES_content_gltf")),
        groups: value["groups"].as_array().map(Vec::len),
        schema: value.get("schema"),
        classes: value.get("schema").is_some() || value.get("schemaUri").is_some(),
    };
    rules.file(&root);
    if let Some(tile) = root.get("root") {
        if tile.get("refine").is_none() {
            rules.say(&tile, "has no 'refine'; add ADD or REPLACE");
        }
        rules.tiles(tile);
    }
    rules.extensions(&root);
    rules.found
}

struct Rules<'a> {
    found: Vec<TilesError>,
    version_1_0: bool,
    /// Whether glTF contents are declared, as 1.0 wants it.
    gltf_declared: bool,
    groups: Option<usize>,
    schema: Option<&'a Value>,
    /// Whether there is a schema, here or elsewhere.
    classes: bool,
}

impl Rules<'_> {
    fn say(&mut self, at: &At, fault: impl Into<String>) {
        self.found.push(at.fault(fault));
    }

    fn check<T>(&mut self, checked: Result<T, TilesError>) -> Option<T> {
        match checked {
            Ok(value) => Some(value),
            Err(error) => {
                self.found.push(error);
                None
            }
        }
    }

    fn file(&mut self, root: &At) {
        let error = root.need("geometricError").and_then(|error| {
            if error.number()? < 0.0 {
                return Err(error.fault("must not be negative"));
            }
            Ok(())
        });
        self.check(error);
        if let Some(version) = root
            .get("asset")
            .and_then(|asset| asset.get("tilesetVersion"))
        {
            self.check(version.text());
        }
        if root.get("schema").is_some() && root.get("schemaUri").is_some() {
            self.say(root, "has schema and schemaUri; leave one out");
        }
        if let Some(uri) = root.get("schemaUri") {
            self.check(uri.text());
        }
        if let Some(properties) = root.get("properties") {
            self.properties(&properties);
        }
        if let Some(extensions) = root.get("extensions") {
            self.check(extensions.object());
        }
        if let Some(metadata) = root.get("metadata") {
            self.entity(&metadata);
        }
        if let Some(groups) = root.get("groups")
            && let Some(groups) = self.check(groups.items())
        {
            groups.for_each(|group| self.entity(&group));
        }
        if let Some(statistics) = root.get("statistics").and_then(|s| s.get("classes")) {
            self.statistics(&statistics);
        }
    }

    /// `properties` of 1.0: the range of each.
    fn properties(&mut self, at: &At) {
        let Some(all) = self.check(at.object()) else {
            return;
        };
        for name in all.keys() {
            let Some(one) = at.get(name) else { continue };
            let bound = |key| one.need(key).and_then(|bound| bound.number());
            let bounds = bound("minimum").and_then(|low| Ok((low, bound("maximum")?)));
            if let Some((low, high)) = self.check(bounds)
                && low > high
            {
                self.say(&one, "has a minimum above its maximum; exchange them");
            }
        }
    }

    fn statistics(&mut self, at: &At) {
        let Some(all) = self.check(at.object()) else {
            return;
        };
        for name in all.keys() {
            let Some(one) = at.get(name) else { continue };
            let class = self.schema.map(|schema| &schema["classes"][&name[..]]);
            match class {
                None if !self.classes => {
                    self.say(&one, "is of a class, but there is no schema; add it")
                }
                Some(Value::Null) => self.say(&one, "is no class of the schema; add it there"),
                class => {
                    let Some(properties) = one.get("properties") else {
                        continue;
                    };
                    let Some(names) = self.check(properties.object()) else {
                        continue;
                    };
                    for name in names.keys() {
                        let known =
                            class.is_none_or(|class| class["properties"].get(name).is_some());
                        if !known {
                            self.say(
                                &properties,
                                format!("has '{name}', which the class has not; take it out"),
                            );
                        }
                    }
                }
            }
        }
    }

    /// A metadata entity: its class is in the schema, and its properties are in the class.
    fn entity(&mut self, at: &At) {
        let class = at
            .need("class")
            .and_then(|class| Ok((class.text()?, class)));
        let Some((name, class)) = self.check(class) else {
            return;
        };
        if !self.classes {
            self.say(&class, "is a class, but there is no schema; add it");
            return;
        }
        let Some(schema) = self.schema else { return };
        let known = &schema["classes"][name];
        if known.is_null() {
            self.say(
                &class,
                format!("'{name}' is no class of the schema; add it there"),
            );
            return;
        }
        let values = at.value["properties"].as_object();
        for name in values.into_iter().flat_map(|values| values.keys()) {
            if known["properties"].get(name).is_none() {
                self.say(
                    at,
                    format!("has '{name}', which the class has not; take it out"),
                );
            }
        }
        for (name, property) in known["properties"].as_object().into_iter().flatten() {
            let value = values.and_then(|values| values.get(name));
            let there = value.is_some_and(|value| !value.is_null());
            if property["required"] == true && !there && property.get("default").is_none() {
                self.say(
                    at,
                    format!("lacks '{name}', which the class requires; add it"),
                );
            }
            if let Some(value) = value {
                self.value(at, name, property, schema, value);
            }
        }
    }

    /// A property's value: within the range of its type and class, or one of its enum.
    fn value(&mut self, at: &At, name: &str, property: &Value, schema: &Value, value: &Value) {
        if property["type"] == "ENUM" {
            let kind = property["enumType"].as_str().unwrap_or("");
            let values = schema["enums"][kind]["values"].as_array();
            let has = |word: &Value| {
                values.is_none_or(|values| values.iter().any(|value| value["name"] == *word))
            };
            let words = value.as_array().cloned().unwrap_or(vec![value.clone()]);
            if let Some(word) = words.iter().find(|word| !word.is_null() && !has(word)) {
                self.say(at, format!("'{name}' is {word}, which is none of '{kind}'"));
            }
            return;
        }
        fn flat(value: &Value) -> Vec<f64> {
            match value {
                Value::Array(values) => values.iter().flat_map(flat).collect(),
                value => value.as_f64().into_iter().collect(),
            }
        }
        let numbers = flat(value);
        if property["array"] == true || numbers.is_empty() {
            return;
        }
        for (key, wrong) in [("min", f64::lt as fn(&f64, &f64) -> bool), ("max", f64::gt)] {
            let bounds = flat(&property[key]);
            let outside = numbers
                .iter()
                .zip(bounds.iter())
                .find(|(number, bound)| wrong(number, bound));
            if let Some((number, bound)) = outside {
                self.say(
                    at,
                    format!("'{name}' is {number}, beyond its {key} of {bound}"),
                );
            }
        }
        let whole = match property["componentType"].as_str() {
            Some("UINT8") => (0.0, 255.0),
            Some("INT8") => (-128.0, 127.0),
            Some("UINT16") => (0.0, 65_535.0),
            Some("INT16") => (-32_768.0, 32_767.0),
            Some("UINT32") => (0.0, f64::from(u32::MAX)),
            Some("INT32") => (f64::from(i32::MIN), f64::from(i32::MAX)),
            _ => return,
        };
        let normalized = property["normalized"] == true;
        if let Some(number) = numbers
            .iter()
            .find(|n| !normalized && (**n < whole.0 || **n > whole.1))
        {
            self.say(
                at,
                format!("'{name}' is {number}, beyond its component type"),
            );
        }
    }

    fn tiles(&mut self, root: At) {
        // A tile with its parent's error and bounds.
        let mut waiting = vec![(root, None::<f64>, None::<Bounds>)];
        while let Some((at, above_m, around)) = waiting.pop() {
            let error_m = at
                .get("geometricError")
                .and_then(|error| error.number().ok());
            if let (Some(above_m), Some(error_m)) = (above_m, error_m)
                && error_m > above_m
            {
                let fault = format!(
                    "is {error_m}, more than its parent's {above_m}; errors must not grow downwards"
                );
                self.say(&at.get("geometricError").unwrap_or(at.clone()), fault);
            }
            let bounds = at.get("boundingVolume").and_then(|v| volume(&v).ok());
            let region = at
                .get("boundingVolume")
                .is_some_and(|v| v.get("region").is_some());
            let own = transform(&at);
            let bounds = bounds.map(|v| Bounds::of(&v, &DAffine3::IDENTITY));
            if let (Some(around), Some(bounds)) = (&around, &bounds)
                && !region
                && own.is_some()
            {
                let moved = own.unwrap_or(DAffine3::IDENTITY);
                let center_m = moved.transform_point3(bounds.center_m);
                let over_m = around.distance_m(center_m);
                if over_m > 1e-3 * around.radius_m() {
                    let fault = format!(
                        "has its middle {over_m:.2} m outside its parent's; enlarge the parent's"
                    );
                    self.say(&at.get("boundingVolume").unwrap_or(at.clone()), fault);
                }
            }
            self.tile(&at, error_m);
            if let Some(children) = at.get("children")
                && let Ok(children) = children.items()
            {
                // A region stays where it is; a box or ball of it is not compared with it.
                let around = bounds.filter(|_| !region);
                waiting.extend(children.map(|child| (child, error_m.or(above_m), around)));
            }
        }
    }

    fn tile(&mut self, at: &At, error_m: Option<f64>) {
        if at.value["children"].as_array().is_some_and(Vec::is_empty) && !self.version_1_0 {
            self.say(at, "has an empty array of children; leave it out");
        }
        if at.get("content").is_some() && at.get("contents").is_some() {
            self.say(at, "has content and contents; leave one out");
        }
        if let Some(refine) = at.value["refine"].as_str()
            && !["ADD", "REPLACE"].contains(&refine)
        {
            self.say(at, "has a 'refine' that is not written ADD or REPLACE");
        }
        if transform(at).is_some_and(|m| m.matrix3.determinant() == 0.0) {
            self.say(at, "has a transform that flattens everything; check it");
        }
        for key in ["contents", "implicitTiling"] {
            if self.version_1_0 && at.get(key).is_some() {
                self.say(
                    at,
                    format!("has '{key}', which 3D Tiles 1.0 has not; write version 1.1"),
                );
            }
        }
        if let Some(metadata) = at.get("metadata") {
            self.entity(&metadata);
            let classes = self.schema.map(|schema| &schema["classes"]);
            let properties =
                classes.map(|c| &c[metadata.value["class"].as_str().unwrap_or("")]["properties"]);
            for (name, property) in properties.and_then(Value::as_object).into_iter().flatten() {
                let said = metadata.value["properties"][&name[..]].as_f64();
                if property["semantic"] == "TILE_GEOMETRIC_ERROR"
                    && said.is_some()
                    && said != error_m
                {
                    self.say(
                        &metadata,
                        format!("'{name}' differs from the tile's geometricError; make them one"),
                    );
                }
            }
        }
        if let Some(tiling) = at.get("implicitTiling") {
            self.tiling(at, &tiling);
        }
        let several = at
            .get("contents")
            .and_then(|contents| contents.items().ok());
        for content in at
            .get("content")
            .into_iter()
            .chain(several.into_iter().flatten())
        {
            self.content(at, &content);
        }
    }

    fn tiling(&mut self, at: &At, tiling: &At) {
        if at.get("metadata").is_some() {
            self.say(
                at,
                "has implicitTiling and metadata; put it into the subtrees",
            );
        }
        let octree = tiling.value["subdivisionScheme"] == "OCTREE";
        let keys: &[&str] = if octree {
            &["{level}", "{x}", "{y}", "{z}"]
        } else {
            &["{level}", "{x}", "{y}"]
        };
        let several = at
            .get("contents")
            .and_then(|contents| contents.items().ok());
        let contents = at
            .get("content")
            .into_iter()
            .chain(several.into_iter().flatten());
        let uris = contents.filter_map(|content| {
            if content.get("boundingVolume").is_some() {
                return Some((content, ""));
            }
            let uri = content.get("uri")?;
            Some((uri.clone(), uri.value.as_str()?))
        });
        let mut templates: Vec<(At, &str)> = uris.collect();
        let subtrees = tiling
            .get("subtrees")
            .and_then(|subtrees| subtrees.get("uri"));
        templates.extend(subtrees.and_then(|uri| Some((uri.clone(), uri.value.as_str()?))));
        for (place, template) in templates {
            if template.is_empty() {
                self.say(&place, "has a boundingVolume, which contents of implicit tiles must not have; take it out");
                continue;
            }
            if let Some(key) = keys.iter().find(|key| !template.contains(**key)) {
                self.say(
                    &place,
                    format!("lacks {key}; tiles could not be told apart"),
                );
            }
            let rest = keys
                .iter()
                .fold(template.to_string(), |rest, key| rest.replace(key, ""));
            if rest.contains(['{', '}']) {
                self.say(
                    &place,
                    format!("has a variable that is none of {}", keys.join(", ")),
                );
            }
        }
    }

    fn content(&mut self, tile: &At, content: &At) {
        if let Some(own) = content.get("boundingVolume")
            && let Some(own) = self.check(volume(&own))
            && let Some(Ok(around)) = tile.get("boundingVolume").map(|v| volume(&v))
        {
            let [own, around] = [own, around].map(|v| Bounds::of(&v, &DAffine3::IDENTITY));
            let over = corners(&own)
                .into_iter()
                .map(|corner| around.distance_m(corner));
            let over_m = over.fold(0.0, f64::max);
            if over_m > 1e-3 * around.radius_m() {
                self.say(content, format!("has a volume that stands {over_m:.2} m out of its tile's; enlarge the tile's"));
            }
        }
        if let Some(metadata) = content.get("metadata") {
            self.entity(&metadata);
        }
        if let Some(group) = content.get("group") {
            let groups = self.groups.unwrap_or(0) as u64;
            if group.value.as_u64().is_none_or(|number| number >= groups) {
                self.say(
                    &group,
                    format!("is no number of the {groups} groups; counting starts at 0"),
                );
            }
        }
        let uri = content.value["uri"]
            .as_str()
            .unwrap_or("")
            .split(['?', '#'])
            .next()
            .unwrap_or("");
        let gltf = [".gltf", ".glb"].iter().any(|end| uri.ends_with(end));
        if content.get("url").is_some() {
            self.say(content, "has a 'url'; since 1.0 it is called 'uri'");
        }
        if gltf && self.version_1_0 && !self.gltf_declared {
            self.say(
                content,
                "is glTF, which 3D Tiles 1.0 has not; write version 1.1",
            );
        }
    }

    fn extensions(&mut self, root: &At) {
        let mut lists = ["extensionsUsed", "extensionsRequired"].map(|key| {
            let list = root.get(key)?;
            let names = list.items().and_then(|items| {
                items
                    .map(|item| item.text())
                    .collect::<Result<Vec<&str>, TilesError>>()
            });
            Some((list, names))
        });
        let mut names: [Vec<&str>; 2] = Default::default();
        for (list, names) in lists.iter_mut().zip(&mut names) {
            let Some((at, list)) = list.take() else {
                continue;
            };
            let Some(list) = self.check(list) else {
                continue;
            };
            if list.is_empty() {
                self.say(&at, "is empty; leave it out");
            }
            let mut once = list.clone();
            once.sort_unstable();
            once.dedup();
            if once.len() < list.len() {
                self.say(&at, "names an extension twice");
            }
            *names = list;
        }
        let [used, required] = names;
        for name in required.iter().filter(|name| !used.contains(*name)) {
            self.say(
                root,
                format!("requires {name}, but extensionsUsed has it not; add it"),
            );
        }
        let mut found = Vec::new();
        collect_extensions(root.value, &mut found);
        for name in &found {
            if !used.contains(&&name[..]) {
                self.say(
                    root,
                    format!("has {name}, but extensionsUsed has it not; add it"),
                );
            }
        }
        for name in used.iter().filter(|name| {
            name.starts_with("3DTILES_")
                && !["3DTILES_content_gltf", "3DTILES_metadata"].contains(name)
        }) {
            if !found.iter().any(|found| found == name) {
                self.say(
                    root,
                    format!("says it uses {name}, but nothing does; take it out"),
                );
            }
        }
    }
}

/// A tile's transform, if it can be read.
fn transform(at: &At) -> Option<DAffine3> {
    let Some(transform) = at.get("transform") else {
        return Some(DAffine3::IDENTITY);
    };
    let m = transform.numbers::<16>().ok()?;
    Some(DAffine3::from_mat4(glam::DMat4::from_cols_array(&m)))
}

fn corners(bounds: &Bounds) -> Vec<glam::DVec3> {
    let side = |i: u8, bit: u8| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
    let corner = |i| {
        let at = glam::DVec3::new(side(i, 0), side(i, 1), side(i, 2));
        bounds.center_m + bounds.axes * (at * bounds.half_m)
    };
    if bounds.ball {
        return vec![bounds.center_m];
    }
    (0..8).map(corner).collect()
}

/// The names of all extensions in a JSON value; its depth is bounded where it is parsed.
fn collect_extensions(value: &Value, found: &mut Vec<String>) {
    match value {
        Value::Object(members) => {
            for (key, value) in members {
                if let (true, Some(extensions)) = (key == "extensions", value.as_object()) {
                    let new = extensions
                        .keys()
                        .filter(|name| !found.contains(name))
                        .cloned();
                    let new: Vec<String> = new.collect();
                    found.extend(new);
                }
                if key != "extras" {
                    collect_extensions(value, found);
                }
            }
        }
        Value::Array(values) => values
            .iter()
            .for_each(|value| collect_extensions(value, found)),
        _ => {}
    }
}
