//! The documents as a book. What the pages link to outside `docs` is laid beside them, so that every link of the
//! sources is one of the book.

use crate::{Fault, root};
use mdbook_driver::MDBook;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path, PathBuf};

/// The chapters in order, in mdBook's own format; links are from docs.
const CHAPTERS: &str = "docs/SUMMARY.md";

fn fault(path: &Path, error: impl std::fmt::Display) -> Fault {
    format!("{}: {error}", path.display())
}

/// A path without `.` and `..`.
fn plain(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => drop(out.pop()),
            Component::CurDir => {}
            other => out.push(other),
        }
    }
    out
}

/// Targets of a page's links, and of its pictures, that are files here.
fn links(text: &str) -> Vec<String> {
    let mut code = false;
    let mut found = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            code = !code;
        }
        if code {
            continue;
        }
        let outside: String = line.split('`').step_by(2).collect::<Vec<_>>().join("`");
        for after in outside.split("](").skip(1) {
            let target = after.split(')').next().unwrap_or_default();
            let file = target.split('#').next().unwrap_or_default();
            if !file.is_empty() && !file.contains("://") && !file.starts_with("mailto:") {
                found.push(file.to_owned());
            }
        }
    }
    found
}

/// Lays the pages and all that they link to, by the paths of the repository, below `to`.
fn stage(to: &Path, first: &[PathBuf]) -> Result<BTreeSet<PathBuf>, Fault> {
    let (mut known, mut waiting) = (BTreeSet::new(), first.to_vec());
    while let Some(path) = waiting.pop() {
        if !known.insert(path.clone()) {
            continue;
        }
        let (from, there) = (root().join(&path), to.join(&path));
        if from.is_dir() {
            let names = fs::read_dir(&from).map_err(|error| fault(&from, error))?;
            let mut names: Vec<String> = (names.flatten())
                .map(|entry| entry.file_name().to_string_lossy().into_owned())
                .collect();
            names.sort();
            let list: String = names.iter().map(|name| format!("- `{name}`\n")).collect();
            if !names.contains(&"README.md".to_owned()) {
                fs::create_dir_all(&there).map_err(|error| fault(&there, error))?;
                let page = there.join("README.md");
                let text = format!("# {}\n\n{list}", path.display());
                fs::write(&page, text).map_err(|error| fault(&page, error))?;
                known.insert(path.join("README.md"));
            } else {
                waiting.push(path.join("README.md"));
            }
            continue;
        }
        let folder = there.parent().unwrap_or(to);
        fs::create_dir_all(folder).map_err(|error| fault(folder, error))?;
        if path.extension().is_none_or(|end| end != "md") {
            fs::copy(&from, &there).map_err(|error| fault(&from, error))?;
            continue;
        }
        let mut text = fs::read_to_string(&from).map_err(|error| fault(&from, error))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        for link in links(&text) {
            let target = plain(&folder.join(&link));
            if root().join(&target).is_dir() {
                // A book has pages, no folders.
                let page = format!("]({}/README.md)", link.trim_end_matches('/'));
                text = text.replace(&format!("]({link})"), &page);
            }
            waiting.push(target);
        }
        fs::write(&there, text).map_err(|error| fault(&there, error))?;
    }
    Ok(known)
}

/// The chapters with their links from the root, and behind them the pages that none of them is.
fn summary(staged: &BTreeSet<PathBuf>) -> Result<String, Fault> {
    let path = root().join(CHAPTERS);
    let text = fs::read_to_string(&path).map_err(|error| fault(&path, error))?;
    let own: Vec<PathBuf> = links(&text)
        .iter()
        .map(|link| plain(&Path::new("docs").join(link)))
        .collect();
    let mut out = String::new();
    for line in text.lines() {
        match line.split_once("](") {
            Some((title, link)) => {
                let link = plain(&Path::new("docs").join(link.trim_end_matches(')')));
                out += &format!("{title}]({})\n", link.display());
            }
            None => out += &format!("{line}\n"),
        }
    }
    let others: Vec<&PathBuf> = (staged.iter())
        .filter(|path| path.extension().is_some_and(|end| end == "md") && !own.contains(path))
        .filter(|path| !path.ends_with("SUMMARY.md"))
        .collect();
    if let Some(forgotten) = others.iter().find(|path| path.starts_with("docs")) {
        return Err(format!(
            "{CHAPTERS}: {} is no chapter; give it a line",
            forgotten.display()
        ));
    }
    if !others.is_empty() {
        out += "\n# Beside the documents\n\n";
    }
    for path in others {
        let folder = path.parent().unwrap_or(Path::new("")).display().to_string();
        let title = match path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .as_ref()
        {
            "README" if !folder.is_empty() => folder,
            stem => stem.to_owned(),
        };
        out += &format!("- [{title}]({})\n", path.display());
    }
    Ok(out)
}

/// Links of the built pages that lead nowhere.
fn dead(built: &Path) -> Result<Vec<String>, Fault> {
    let (mut found, mut waiting) = (Vec::new(), vec![built.to_owned()]);
    while let Some(folder) = waiting.pop() {
        let entries = fs::read_dir(&folder).map_err(|error| fault(&folder, error))?;
        for path in entries.flatten().map(|entry| entry.path()) {
            if path.is_dir() {
                waiting.push(path);
                continue;
            }
            if path.extension().is_none_or(|end| end != "html") || path.ends_with("404.html") {
                continue;
            }
            let text = fs::read_to_string(&path).map_err(|error| fault(&path, error))?;
            for attribute in ["href=\"", "src=\""] {
                for after in text.split(attribute).skip(1) {
                    let target = after.split('"').next().unwrap_or_default();
                    let file = target.split(['#', '?']).next().unwrap_or_default();
                    let outside = ["://", "mailto:", "data:", "javascript:"];
                    if file.is_empty() || outside.iter().any(|mark| target.contains(mark)) {
                        continue;
                    }
                    let to = plain(&folder.join(file));
                    if !to.exists() {
                        let page = path.strip_prefix(built).unwrap_or(&path).display();
                        found.push(format!("{page}: {target}"));
                    }
                }
            }
        }
    }
    found.sort();
    found.dedup();
    Ok(found)
}

/// Builds the book and checks its links.
pub fn build() -> Result<(), Fault> {
    let (source, out) = (root().join("out/book-source"), root().join("out/book"));
    for folder in [&source, &out] {
        if folder.exists() {
            fs::remove_dir_all(folder).map_err(|error| fault(folder, error))?;
        }
    }
    let text = root().join(CHAPTERS);
    let text = fs::read_to_string(&text).map_err(|error| fault(&text, error))?;
    let mut first: Vec<PathBuf> = links(&text)
        .iter()
        .map(|link| plain(&Path::new("docs").join(link)))
        .collect();
    // A page that no chapter leads to is to be told, too.
    let pages = fs::read_dir(root().join("docs")).map_err(|error| fault(&root(), error))?;
    let pages = pages
        .flatten()
        .map(|entry| Path::new("docs").join(entry.file_name()));
    first.extend(pages.filter(|path| path.extension().is_some_and(|end| end == "md")));
    let inner = source.join("src");
    let staged = stage(&inner, &first)?;
    let chapters = inner.join("SUMMARY.md");
    fs::write(&chapters, summary(&staged)?).map_err(|error| fault(&chapters, error))?;
    let settings = source.join("book.toml");
    let book = format!(
        "[book]\ntitle = \"Boresight\"\nsrc = \"src\"\n\
         [build]\nbuild-dir = \"{}\"\nuse-default-preprocessors = false\n\
         [output.html]\nno-section-label = true\n[output.html.print]\nenable = false\n",
        out.display()
    );
    fs::write(&settings, book).map_err(|error| fault(&settings, error))?;
    let built = MDBook::load(&source).and_then(|book| book.build());
    built.map_err(|error| format!("the book: {error:#}"))?;
    let dead = dead(&out)?;
    if !dead.is_empty() {
        return Err(format!(
            "links of the book that lead nowhere:\n{}",
            dead.join("\n")
        ));
    }
    println!("{}", out.join("index.html").display());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_stand_outside_of_code() {
        let text =
            "[a](b.md#c) `[d](e.md)` ![f](g.jpg)\n```\n[h](i.md)\n```\n[j](https://k) [l](#m)";
        assert_eq!(links(text), ["b.md", "g.jpg"]);
        assert_eq!(plain(Path::new("docs/../a/./b")), Path::new("a/b"));
    }
}
