//! The documents as a reader meets them: links that lead somewhere, short sentences, small cells.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

/// Most words of a sentence.
const WORDS: usize = 40;
/// Most characters of a table's cell.
const CHARACTERS: usize = 300;
/// Documents that are not written this way yet: this one is made of the scenario's doc comments.
const LONG: [&str; 1] = ["docs/scenarios.md"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every document of the repository, by its path from the root.
fn documents() -> Vec<String> {
    const PLACES: [&str; 9] = [
        ".", "assets", "benches", "crates", "docs", "examples", "fuzz", "python", "training",
    ];
    let mut found = BTreeSet::new();
    let mut waiting: Vec<PathBuf> = PLACES.iter().map(|place| root().join(place)).collect();
    while let Some(folder) = waiting.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() && folder != root().join(".") {
                waiting.push(path);
            } else if path.extension().is_some_and(|extension| extension == "md") {
                let name = path.strip_prefix(root()).unwrap();
                let name: PathBuf = name
                    .components()
                    .filter(|c| *c != Component::CurDir)
                    .collect();
                found.insert(name.to_str().unwrap().to_owned());
            }
        }
    }
    found.into_iter().collect()
}

/// The lines of a document outside its blocks of code, numbered from 1.
fn prose(text: &str) -> Vec<(usize, &str)> {
    let mut code = false;
    let mut found = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        if line.trim_start().starts_with("```") {
            code = !code;
        } else if !code {
            found.push((number, line));
        }
    }
    found
}

/// A line without comments and without what stands in backticks, and its links' targets.
fn plain(line: &str) -> (String, Vec<String>) {
    let mut text = String::new();
    for (k, part) in without_comments(line).split('`').enumerate() {
        text.push_str(if k % 2 == 0 { part } else { "code" });
    }
    let (mut out, mut targets, mut rest) = (String::new(), Vec::new(), text.as_str());
    while let Some((before, after)) = rest.split_once("](") {
        out.push_str(before);
        let (target, after) = after.split_once(')').unwrap_or((after, ""));
        targets.push(target.to_owned());
        rest = after;
    }
    out.push_str(rest);
    (out, targets)
}

/// A line as it is shown.
fn without_comments(line: &str) -> String {
    let (mut out, mut rest) = (String::new(), line);
    while let Some((before, after)) = rest.split_once("<!--") {
        out.push_str(before);
        rest = after.split_once("-->").map_or("", |(_, after)| after);
    }
    out + rest
}

/// The figures that a document quotes: line, name, and what stands there.
fn quoted(text: &str) -> Vec<(usize, &str, &str)> {
    let mut found = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        for after in line.split("<!--figure ").skip(1) {
            let (name, after) = after.split_once("-->").unwrap_or((after, ""));
            let value = after.split_once("<!--/-->").map_or("", |(value, _)| value);
            found.push((number, name, value));
        }
    }
    found
}

/// The anchor that a heading has where the documents are shown.
fn anchor(heading: &str) -> String {
    let (text, _) = plain(&heading.replace('`', ""));
    let text = text.trim().to_lowercase();
    let kept = text.chars().filter_map(|c| match c {
        ' ' => Some('-'),
        '[' | ']' => None,
        c if c.is_alphanumeric() || c == '-' || c == '_' => Some(c),
        _ => None,
    });
    kept.collect()
}

/// The anchors of a document.
fn anchors(text: &str) -> BTreeSet<String> {
    let headings = prose(text).into_iter().filter_map(|(_, line)| {
        let heading = line.trim_start_matches('#');
        (heading.len() < line.len()).then(|| anchor(heading))
    });
    headings.collect()
}

/// Links of a document that lead nowhere.
fn dead_links(name: &str, text: &str) -> Vec<String> {
    let folder = root().join(name).parent().unwrap().to_owned();
    let mut found = Vec::new();
    for (number, line) in prose(text) {
        for target in plain(line).1 {
            if target.contains("://") || target.starts_with("mailto:") {
                continue;
            }
            let (file, at) = target.split_once('#').unwrap_or((&target, ""));
            let path = folder.join(file);
            let leads = match file {
                "" => anchors(text).contains(at),
                file if file.ends_with(".md") && !at.is_empty() => {
                    let text = std::fs::read_to_string(&path);
                    text.is_ok_and(|text| anchors(&text).contains(at))
                }
                _ => path.exists(),
            };
            if !leads {
                found.push(format!("{name}:{number}: {target}"));
            }
        }
    }
    found
}

/// Sentences and cells of a document that are too long.
fn too_long(name: &str, text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut sentences = |number: usize, text: &str| {
        let ends = |pair: &[char]| ".!?".contains(pair[0]) && pair[1].is_whitespace();
        let letters: Vec<char> = plain(text).0.chars().chain([' ']).collect();
        let mut from = 0;
        for end in 0..letters.len() - 1 {
            if ends(&letters[end..end + 2]) || end + 2 == letters.len() {
                let sentence: String = letters[from..=end].iter().collect();
                let words = sentence.split_whitespace().count();
                if words > WORDS {
                    found.push(format!("{name}:{number}: {words} words: {sentence:.60}"));
                }
                from = end + 1;
            }
        }
    };
    let mut cells = Vec::new();
    let (mut block, mut began) = (String::new(), 1);
    for (number, line) in prose(text) {
        if line.starts_with('|') {
            for cell in line.replace("\\|", "/").trim_matches('|').split('|') {
                sentences(number, cell.trim());
                let characters = plain(cell.trim()).0.chars().count();
                if characters > CHARACTERS {
                    cells.push(format!(
                        "{name}:{number}: {characters} characters: {cell:.60}"
                    ));
                }
            }
            continue;
        }
        let text = line.trim_start();
        let item = text.starts_with("- ")
            || text
                .split_once(". ")
                .is_some_and(|(n, _)| n.parse::<u32>().is_ok());
        if text.is_empty() || item || text.starts_with('#') {
            sentences(began, &std::mem::take(&mut block));
            began = number;
        }
        block.push_str(if block.is_empty() { "" } else { " " });
        block.push_str(text);
    }
    sentences(began, &block);
    found.extend(cells);
    found
}

#[test]
fn every_link_leads_somewhere() {
    let mut found = Vec::new();
    for name in documents() {
        let text = std::fs::read_to_string(root().join(&name)).unwrap();
        found.extend(dead_links(&name, &text));
    }
    assert!(
        found.is_empty(),
        "links that lead nowhere:\n{}",
        found.join("\n")
    );
}

#[test]
fn sentences_and_cells_are_short() {
    let mut found = Vec::new();
    for name in documents() {
        let text = std::fs::read_to_string(root().join(&name)).unwrap();
        let long = too_long(&name, &text);
        match LONG.contains(&name.as_str()) {
            true => assert!(!long.is_empty(), "{name} is short now; take it out of LONG"),
            false => found.extend(long),
        }
    }
    assert!(
        found.is_empty(),
        "a sentence has at most {WORDS} words, a cell {CHARACTERS} characters:\n{}",
        found.join("\n")
    );
}

/// Files of code by the ends of their paths, as documents name them: from the root, or from a crate's `src`.
fn sources_named(path: &str) -> Vec<PathBuf> {
    let crates = std::fs::read_dir(root().join("crates")).unwrap();
    let roots = crates.map(|entry| entry.unwrap().path().join("src"));
    let found = roots.chain([root().to_owned()]).map(|from| from.join(path));
    found.filter(|path| path.is_file()).collect()
}

/// A test is named by its file and its name, or by its name alone after another of the same file.
#[test]
fn the_tests_that_validation_names_are_there() {
    let (mut count, mut found) = (0, Vec::new());
    for page in documents()
        .iter()
        .filter(|page| page.starts_with("docs/validation"))
    {
        let text = std::fs::read_to_string(root().join(page)).unwrap();
        let mut file = String::new();
        for (number, line) in prose(&text) {
            for named in line.split('`').skip(1).step_by(2) {
                let Some((path, test)) = named.split_once("::") else {
                    if named.ends_with(".rs") {
                        file = named.to_owned();
                    }
                    continue;
                };
                if path.ends_with(".rs") {
                    file = path.to_owned();
                } else if !path.is_empty() || file.is_empty() {
                    continue;
                }
                count += 1;
                let has = |source: &PathBuf| {
                    let text = std::fs::read_to_string(source).unwrap();
                    text.contains(&format!("fn {test}("))
                };
                if !sources_named(&file).iter().any(has) {
                    found.push(format!("{page}:{number}: {file}::{test}"));
                }
            }
        }
    }
    assert!(count > 200, "only {count} tests are named");
    assert!(
        found.is_empty(),
        "tests that are not there:\n{}",
        found.join("\n")
    );
}

/// `cargo xtask figures` writes the values of docs/figures.toml into the pages.
#[test]
fn pages_quote_the_figures_as_they_stand_in_their_file() {
    let text = std::fs::read_to_string(root().join("docs/figures.toml")).unwrap();
    let data: toml::Table = text.parse().unwrap();
    let (mut values, mut found) = (BTreeMap::new(), Vec::new());
    let tables = ["series", "pictures"].map(|kind| data[kind].as_table().unwrap());
    for (name, series) in tables.into_iter().flatten() {
        for key in ["command", "commit"] {
            assert!(!series[key].as_str().unwrap().is_empty(), "{name}: {key}");
        }
        for path in series["paths"].as_array().unwrap() {
            let path = path.as_str().unwrap();
            if !root().join(path).exists() {
                found.push(format!("{name}: no path '{path}'"));
            }
        }
        let own = series.get("values").and_then(toml::Value::as_table);
        for (name, value) in own.into_iter().flatten() {
            let before = values.insert(name.as_str(), value.as_str().unwrap());
            assert_eq!(before, None, "{name} stands twice");
        }
    }
    for name in tables[1].keys() {
        if !root().join("docs").join(name).exists() {
            found.push(format!("no picture docs/{name}"));
        }
    }
    let mut unquoted: BTreeSet<&str> = values.keys().copied().collect();
    for page in documents() {
        let text = std::fs::read_to_string(root().join(&page)).unwrap();
        for (line, name, value) in quoted(&text) {
            unquoted.remove(name);
            if values.get(name) != Some(&value) {
                let wanted = values.get(name).unwrap_or(&"no such figure");
                found.push(format!(
                    "{page}:{line}: {name}: '{value}', the file: '{wanted}'"
                ));
            }
        }
    }
    assert!(values.len() > 50, "only {} figures", values.len());
    found.extend(unquoted.iter().map(|name| format!("no page quotes {name}")));
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn the_readme_is_one_screen() {
    let text = std::fs::read_to_string(root().join("README.md")).unwrap();
    assert!(text.lines().count() <= 100);
}

#[test]
fn dead_links_and_long_sentences_are_found() {
    let text = "# A `b` c\n[here](#a-b-c) [no](#nothing) [file](none.md)\n```\n[code](x.md)\n```\n";
    assert_eq!(
        dead_links("docs/made-up.md", text),
        ["docs/made-up.md:2: #nothing", "docs/made-up.md:2: none.md"]
    );
    let long = "word ".repeat(41);
    assert_eq!(too_long("a.md", &format!("- {long}\n- short.\n")).len(), 1);
    assert!(
        too_long(
            "a.md",
            &format!("{}. {}.", "w ".repeat(30), "w ".repeat(30))
        )
        .is_empty()
    );
    assert_eq!(
        too_long("a.md", &format!("| {} | b |", "x".repeat(301))).len(),
        1
    );
    let figures = "of <!--figure a-->2.5<!--/--> px and <!--figure b-->–<!--/-->";
    assert_eq!(quoted(figures), [(1, "a", "2.5"), (1, "b", "–")]);
    assert_eq!(without_comments(figures), "of 2.5 px and –");
}
