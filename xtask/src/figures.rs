//! Published figures: each stands once, in docs/figures.toml, and the pages quote it by name, between
//! `<!--figure NAME-->` and `<!--/-->`.

use crate::{Fault, root};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// docs/figures.toml.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Data {
    /// What a series of figures was measured by.
    #[serde(default)]
    series: BTreeMap<String, Series>,
    /// The pictures, by their files below docs.
    #[serde(default)]
    pictures: BTreeMap<String, Series>,
}

/// Figures of one command.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Series {
    /// The command that makes them.
    command: String,
    /// The commit that it was run at.
    commit: String,
    /// What they depend on, from the root.
    paths: Vec<String>,
    /// The values as the pages have them, intervals included, by their names.
    #[serde(default)]
    values: BTreeMap<String, String>,
}

fn data() -> Result<Data, Fault> {
    let path = root().join("docs/figures.toml");
    let text = fs::read_to_string(&path).map_err(|error| format!("docs/figures.toml: {error}"))?;
    toml::from_str(&text).map_err(|error| format!("docs/figures.toml: {error}"))
}

/// Every Markdown file outside what is built.
pub fn pages() -> Result<Vec<PathBuf>, Fault> {
    const LEFT_OUT: [&str; 4] = ["out", "target", ".git", "runs"];
    let (mut found, mut waiting) = (Vec::new(), vec![root()]);
    while let Some(folder) = waiting.pop() {
        let entries = fs::read_dir(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        for path in entries.flatten().map(|entry| entry.path()) {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if path.is_dir() && !LEFT_OUT.contains(&&*name) {
                waiting.push(path);
            } else if path.extension().is_some_and(|end| end == "md") {
                found.push(path);
            }
        }
    }
    found.sort();
    Ok(found)
}

/// A page with today's values.
fn renewed(text: &str, values: &BTreeMap<&str, &str>) -> Result<String, Fault> {
    const BEGIN: &str = "<!--figure ";
    let (mut out, mut rest) = (String::new(), text);
    while let Some((before, after)) = rest.split_once(BEGIN) {
        let cut = after.split_once("-->").and_then(|(name, after)| {
            let (_, after) = after.split_once("<!--/-->")?;
            Some((name, after))
        });
        let Some((name, after)) = cut else {
            return Err(format!("'{BEGIN}{:.20}' has no end '<!--/-->'", after));
        };
        let value = values
            .get(name)
            .ok_or_else(|| format!("no figure '{name}' in docs/figures.toml"))?;
        out += &format!("{before}{BEGIN}{name}-->{value}<!--/-->");
        rest = after;
    }
    Ok(out + rest)
}

/// Writes the values into the pages that quote them.
pub fn write() -> Result<(), Fault> {
    let data = data()?;
    let values: BTreeMap<&str, &str> = (data.series.values())
        .flat_map(|series| &series.values)
        .map(|(name, value)| (name.as_str(), value.as_str()))
        .collect();
    let mut changed = 0;
    for page in pages()? {
        let said = |error: &dyn std::fmt::Display| format!("{}: {error}", page.display());
        let text = fs::read_to_string(&page).map_err(|error| said(&error))?;
        let new = renewed(&text, &values).map_err(|error| said(&error))?;
        if new != text {
            fs::write(&page, new).map_err(|error| said(&error))?;
            println!("{}", page.display());
            changed += 1;
        }
    }
    println!("{changed} pages changed");
    Ok(())
}

/// Commits after `since` that changed one of these paths, the newest first.
fn changes(since: &str, paths: &[String]) -> Result<Vec<String>, Fault> {
    let mut git = Command::new("git");
    git.current_dir(root())
        .args(["log", "--format=%h %cs %s", &format!("{since}..HEAD"), "--"])
        .args(paths);
    let output = git.output().map_err(|error| format!("git: {error}"))?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).trim().to_owned());
    }
    let text = String::from_utf8_lossy(&output.stdout);
    Ok(text.lines().map(str::to_owned).collect())
}

/// Lists what is older than its paths' last change.
pub fn stale() -> Result<(), Fault> {
    let data = data()?;
    let mut fresh = 0;
    for (name, series) in data.series.iter().chain(&data.pictures) {
        for path in &series.paths {
            if !root().join(path).exists() {
                return Err(format!("docs/figures.toml: {name}: no path '{path}'"));
            }
        }
        let changes = changes(&series.commit, &series.paths)?;
        let Some(newest) = changes.first() else {
            fresh += 1;
            continue;
        };
        println!(
            "{name}: of {}, {} changes since",
            series.commit,
            changes.len()
        );
        println!("    newest: {newest}");
        println!("    renew:  {}", series.command);
    }
    println!("{fresh} series and pictures are of today's sources");
    Ok(())
}

/// Lists the pictures and how they are made.
pub fn pictures() -> Result<(), Fault> {
    let data = data()?;
    let there = |path: &str| Path::new(&root().join("docs").join(path)).exists();
    for (file, picture) in &data.pictures {
        let lost = if there(file) { "" } else { " (is not there)" };
        println!(
            "docs/{file}{lost}, of {}\n    {}",
            picture.commit, picture.command
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_take_over_the_values_and_nothing_else() {
        let values = BTreeMap::from([("a", "2.5"), ("b", "–")]);
        let page = "of <!--figure a-->1.0<!--/--> px, | <!--figure b--><!--/--> |\n";
        let new = "of <!--figure a-->2.5<!--/--> px, | <!--figure b-->–<!--/--> |\n";
        assert_eq!(renewed(page, &values).unwrap(), new);
        assert_eq!(renewed(new, &values).unwrap(), new);
        assert!(
            renewed("<!--figure c-->1<!--/-->", &values)
                .unwrap_err()
                .contains("'c'")
        );
        assert!(
            renewed("<!--figure a-->1", &values)
                .unwrap_err()
                .contains("no end")
        );
    }
}
