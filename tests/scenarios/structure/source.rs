//! As much of Rust's grammar as it takes to see which file names which: words and signs without
//! comments, strings and tests, and the paths among them.

use std::collections::{BTreeMap, BTreeSet};

/// A word, a number, `::`, or a single sign, and its line.
#[derive(Clone, Debug, PartialEq)]
pub struct Token {
    pub text: String,
    pub line: usize,
}

/// The tokens of a source text. Comments are left out; of strings and characters only the opening
/// quote remains.
pub fn tokens(source: &str) -> Vec<Token> {
    let chars: Vec<char> = source.chars().collect();
    let at = |i: usize| chars.get(i).copied().unwrap_or('\0');
    let word = |c: char| c.is_alphanumeric() || c == '_';
    let mut found = Vec::new();
    let (mut i, mut line) = (0, 1);
    while i < chars.len() {
        let from = i;
        let mut text = String::new();
        if at(i) == '/' && at(i + 1) == '/' {
            while i < chars.len() && at(i) != '\n' {
                i += 1;
            }
        } else if at(i) == '/' && at(i + 1) == '*' {
            let mut depth = 0;
            loop {
                match (at(i), at(i + 1)) {
                    ('/', '*') => (depth, i) = (depth + 1, i + 2),
                    ('*', '/') => (depth, i) = (depth - 1, i + 2),
                    _ => i += 1,
                }
                if depth == 0 || i >= chars.len() {
                    break;
                }
            }
        } else if let Some(end) = raw_string(&chars, i) {
            (text, i) = ("\"".into(), end);
        } else if at(i) == '"' || ("bc".contains(at(i)) && at(i + 1) == '"') {
            i += if at(i) == '"' { 1 } else { 2 };
            while i < chars.len() && at(i) != '"' {
                i += if at(i) == '\\' { 2 } else { 1 };
            }
            (text, i) = ("\"".into(), i + 1);
        } else if at(i) == '\'' && at(i + 1) == '\\' {
            i += 3;
            while i < chars.len() && at(i) != '\'' {
                i += 1;
            }
            (text, i) = ("'".into(), i + 1);
        } else if at(i) == '\'' && at(i + 2) == '\'' {
            (text, i) = ("'".into(), i + 3);
        } else if at(i) == '\'' {
            // A lifetime: its name is no word of the code.
            i += 1;
            while word(at(i)) {
                i += 1;
            }
        } else if word(at(i)) {
            while word(at(i)) {
                text.push(at(i));
                i += 1;
            }
        } else if at(i) == ':' && at(i + 1) == ':' {
            (text, i) = ("::".into(), i + 2);
        } else {
            if !at(i).is_whitespace() {
                text.push(at(i));
            }
            i += 1;
        }
        if !text.is_empty() {
            found.push(Token { text, line });
        }
        let end = i.min(chars.len());
        line += chars[from..end].iter().filter(|c| **c == '\n').count();
    }
    found
}

/// The end of a raw string that begins at `i`: `r"…"`, `r#"…"#`, with `b` or `c` before.
fn raw_string(chars: &[char], i: usize) -> Option<usize> {
    let at = |i: usize| chars.get(i).copied().unwrap_or('\0');
    let r = if "bc".contains(at(i)) { i + 1 } else { i };
    if at(r) != 'r' {
        return None;
    }
    let hashes = (r + 1..).take_while(|i| at(*i) == '#').count();
    if at(r + 1 + hashes) != '"' {
        return None;
    }
    let closes = |end: &usize| at(*end) == '"' && (1..=hashes).all(|k| at(end + k) == '#');
    let end = (r + 2 + hashes..chars.len()).find(closes);
    Some(end.map_or(chars.len(), |end| end + 1 + hashes))
}

/// The tokens without what is compiled for tests only.
pub fn without_tests(tokens: &[Token]) -> Vec<Token> {
    let says = |i: usize, words: &[&str]| {
        let texts = tokens[i.min(tokens.len())..]
            .iter()
            .map(|t| t.text.as_str());
        texts.take(words.len()).eq(words.iter().copied())
    };
    let mut kept = Vec::new();
    let mut i = 0;
    while i < tokens.len() {
        if says(i, &["#", "!", "[", "cfg", "(", "test", ")", "]"]) {
            return Vec::new();
        }
        if says(i, &["#", "[", "cfg", "(", "test", ")", "]"]) || says(i, &["#", "[", "test", "]"]) {
            while says(i, &["#", "["]) {
                i = past_group(tokens, i + 1);
            }
            i = past_item(tokens, i);
        } else {
            kept.push(tokens[i].clone());
            i += 1;
        }
    }
    kept
}

/// The index past the group of brackets that opens at `i`.
fn past_group(tokens: &[Token], mut i: usize) -> usize {
    let mut depth = 0;
    while i < tokens.len() {
        match tokens[i].text.as_str() {
            "(" | "[" | "{" => depth += 1,
            ")" | "]" | "}" => depth -= 1,
            _ => {}
        }
        i += 1;
        if depth <= 0 {
            break;
        }
    }
    i
}

/// The index past an item, a statement or a field that begins at `i`.
fn past_item(tokens: &[Token], mut i: usize) -> usize {
    const ITEMS: [&str; 14] = [
        "pub", "fn", "mod", "use", "impl", "struct", "enum", "const", "static", "type", "trait",
        "unsafe", "async", "extern",
    ];
    let item = tokens
        .get(i)
        .is_some_and(|t| ITEMS.contains(&t.text.as_str()));
    while i < tokens.len() {
        match tokens[i].text.as_str() {
            "(" | "[" => i = past_group(tokens, i),
            "{" => return past_group(tokens, i),
            ";" => return i + 1,
            "," if !item => return i + 1,
            // The end of what the field stands in.
            ")" | "]" | "}" => return i,
            _ => i += 1,
        }
    }
    i
}

/// A path that a file names, from the crate's root (`["crate", …]`) or from another crate's name.
#[derive(Clone, Debug, PartialEq)]
pub struct Named {
    pub path: Vec<String>,
    pub line: usize,
    /// Whether it is handed on by `pub use`.
    pub handed_on: bool,
}

/// What one file says.
#[derive(Clone, Debug, Default)]
pub struct Source {
    /// The module that the file is, below the crate's root.
    pub module: Vec<String>,
    /// Its code without tests.
    pub tokens: Vec<Token>,
    /// What it names.
    pub named: Vec<Named>,
    /// What it hands on, by the name it gives it.
    pub handed_on: BTreeMap<String, Vec<String>>,
    /// Modules of which it hands on everything.
    pub all_of: Vec<Vec<String>>,
    /// Names of the items in it.
    pub items: BTreeSet<String>,
}

/// One name that a `use` brings in; `*` stands for all.
struct Import {
    path: Vec<String>,
    name: String,
}

impl Source {
    /// Reads the text of the file that is `module`; `root` is the name by which its code calls this
    /// crate besides `crate`.
    pub fn read(module: Vec<String>, text: &str, root: Option<&str>) -> Self {
        let tokens = without_tests(&tokens(text));
        let mut source = Self {
            module,
            ..Self::default()
        };
        let text = |i: usize| tokens.get(i).map_or("", |t| t.text.as_str());
        // Modules that stand in the file itself, with the depth of their braces.
        let mut inside: Vec<(String, usize)> = Vec::new();
        let mut depth = 0;
        let mut children = BTreeSet::new();
        let mut local: BTreeMap<String, Vec<String>> = BTreeMap::new();
        let mut bare = Vec::new();
        let mut i = 0;
        while i < tokens.len() {
            let here = || {
                let inner = inside.iter().map(|(name, _)| name.clone());
                source
                    .module
                    .iter()
                    .cloned()
                    .chain(inner)
                    .collect::<Vec<_>>()
            };
            let line = tokens[i].line;
            match text(i) {
                "{" => depth += 1,
                "}" => {
                    depth -= 1;
                    inside.retain(|(_, outer)| *outer < depth + 1);
                }
                "mod" if text(i + 2) == ";" => {
                    children.insert(text(i + 1).to_string());
                }
                "mod" if text(i + 2) == "{" => {
                    inside.push((text(i + 1).to_string(), depth + 1));
                    i += 1;
                }
                "struct" | "enum" | "union" | "trait" | "type" | "fn" | "const" | "static"
                | "macro_rules" => {
                    let name = if text(i + 1) == "!" { i + 2 } else { i + 1 };
                    source.items.insert(text(name).to_string());
                }
                // `use<…>` lists what a type captures.
                "use" if text(i + 1) != "<" => {
                    let mut imports = Vec::new();
                    let handed_on = text(i.wrapping_sub(1)) == "pub"
                        || (text(i.wrapping_sub(1)) == ")" && opened_by_pub(&tokens, i - 1));
                    i = use_tree(&tokens, i + 1, &[], &mut imports);
                    for import in imports {
                        let path = absolute(&here(), &import.path, root);
                        local.insert(import.name.clone(), path.clone());
                        bare.push((path, line, handed_on, import.name));
                    }
                    continue;
                }
                first if is_name(first) && !["::", "."].contains(&text(i.wrapping_sub(1))) => {
                    let mut path = vec![first.to_string()];
                    while text(i + 1) == "::" && is_name(text(i + 2)) {
                        path.push(text(i + 2).to_string());
                        i += 2;
                    }
                    let rooted = ["crate", "self", "super"].contains(&first) || root == Some(first);
                    if path.len() > 1 {
                        let path = if rooted {
                            absolute(&here(), &path, root)
                        } else {
                            path
                        };
                        bare.push((path, line, false, String::new()));
                    }
                }
                _ => {}
            }
            i += 1;
        }
        for (path, line, handed_on, name) in bare {
            let path = source.rooted(path, &children, &local);
            if handed_on && name == "*" {
                source.all_of.push(path.clone());
            } else if handed_on {
                source.handed_on.insert(name, path.clone());
            }
            source.named.push(Named {
                path,
                line,
                handed_on,
            });
        }
        source.tokens = tokens;
        source
    }

    /// A path whose first name is a child of this file, or was brought in by a `use`, from the
    /// crate's root.
    fn rooted(
        &self,
        path: Vec<String>,
        children: &BTreeSet<String>,
        local: &BTreeMap<String, Vec<String>>,
    ) -> Vec<String> {
        let mut path = path;
        // A name may be brought in by way of another; no chain is longer than the list.
        for _ in 0..=local.len() {
            if path[0] == "crate" {
                break;
            }
            let before = if children.contains(&path[0]) {
                let mut module = vec!["crate".to_string()];
                module.extend(self.module.iter().cloned());
                module.push(path[0].clone());
                module
            } else if let Some(there) = local.get(&path[0]).filter(|there| there[0] != path[0]) {
                there.clone()
            } else {
                break;
            };
            path = before.into_iter().chain(path.into_iter().skip(1)).collect();
        }
        path
    }
}

fn is_name(text: &str) -> bool {
    text.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// Whether the bracket that closes at `i` belongs to `pub(…)`.
fn opened_by_pub(tokens: &[Token], i: usize) -> bool {
    let open = tokens[..i].iter().rposition(|t| t.text == "(");
    open.is_some_and(|open| open > 0 && tokens[open - 1].text == "pub")
}

/// Reads the tree of a `use` from `i` on and returns the index past it.
fn use_tree(tokens: &[Token], mut i: usize, before: &[String], found: &mut Vec<Import>) -> usize {
    let text = |i: usize| tokens.get(i).map_or("", |t| t.text.as_str());
    let mut path = before.to_vec();
    loop {
        match text(i) {
            "{" => {
                i += 1;
                while !["}", ""].contains(&text(i)) {
                    i = use_tree(tokens, i, &path, found);
                    if text(i) == "," {
                        i += 1;
                    }
                }
                i += 1;
                break;
            }
            "*" => {
                found.push(Import {
                    path: path.clone(),
                    name: "*".into(),
                });
                i += 1;
                break;
            }
            "::" => i += 1,
            name if is_name(name) && name != "as" => {
                if name != "self" || path.is_empty() {
                    path.push(name.to_string());
                }
                i += 1;
                if text(i) == "::" {
                    continue;
                }
                let alias = if text(i) == "as" {
                    i += 2;
                    text(i - 1).to_string()
                } else {
                    path[path.len() - 1].clone()
                };
                found.push(Import { path, name: alias });
                break;
            }
            _ => break,
        }
    }
    if before.is_empty() && text(i) == ";" {
        i += 1;
    }
    i
}

/// A path that begins with `crate`, `self` or `super`, or with the crate's own name, from the root.
fn absolute(here: &[String], path: &[String], root: Option<&str>) -> Vec<String> {
    let below = |module: &[String], rest: &[String]| {
        let whole = std::iter::once("crate").map(String::from);
        whole
            .chain(module.iter().cloned())
            .chain(rest.iter().cloned())
            .collect()
    };
    let ups = path.iter().take_while(|name| *name == "super").count();
    match path[0].as_str() {
        "crate" => path.to_vec(),
        first if root == Some(first) => below(&[], &path[1..]),
        "self" if path.get(1).is_some_and(|next| next == "super") => {
            absolute(here, &path[1..], root)
        }
        "self" => below(here, &path[1..]),
        "super" => below(&here[..here.len().saturating_sub(ups)], &path[ups..]),
        _ => path.to_vec(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(source: &str) -> Vec<String> {
        tokens(source).into_iter().map(|token| token.text).collect()
    }

    fn paths(module: &[&str], text: &str) -> Vec<String> {
        let module = module.iter().map(ToString::to_string).collect();
        let source = Source::read(module, text, None);
        source
            .named
            .iter()
            .map(|named| named.path.join("::"))
            .collect()
    }

    #[test]
    fn comments_and_strings_are_no_code() {
        assert_eq!(
            words("a // crate::b\n/* c /* d */ e */ f"),
            ["a", "f"],
            "comments"
        );
        assert_eq!(
            words(r####"x("crate::b \" y", r#"z " w"#, b"v", br"u\", c"t")"####),
            [
                "x", "(", "\"", ",", "\"", ",", "\"", ",", "\"", ",", "\"", ")"
            ]
        );
        assert_eq!(
            words("'{' '\\'' '\\u{7d}' &'a b"),
            ["'", "'", "'", "&", "b"]
        );
        assert_eq!(
            words("a::b.c 1.0..2"),
            ["a", "::", "b", ".", "c", "1", ".", "0", ".", ".", "2"]
        );
        let lines: Vec<_> = tokens("a\n\"b\nc\"\nd").iter().map(|t| t.line).collect();
        assert_eq!(lines, [1, 2, 4]);
    }

    #[test]
    fn what_is_for_tests_only_is_left_out() {
        let kept = |source: &str| {
            let kept = without_tests(&tokens(source)).into_iter();
            kept.map(|token| token.text).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(kept("a; #[cfg(test)] mod tests { b { c } } d"), "a ; d");
        assert_eq!(kept("#[cfg(test)] mod tests; a"), "a");
        assert_eq!(
            kept("#[cfg(test)] #[allow(x)] fn f(a: [u8; 2]) -> X { b } c"),
            "c"
        );
        assert_eq!(kept("#[test] fn f() { b } c"), "c");
        assert_eq!(
            kept("struct S { #[cfg(test)] a: X<Y>, b: Z }"),
            "struct S { b : Z }"
        );
        assert_eq!(kept("struct S { #[cfg(test)] a: X }"), "struct S { }");
        assert_eq!(kept("#![cfg(test)] a"), "");
        assert_eq!(
            kept("#[cfg(unix)] mod a { b }"),
            "# [ cfg ( unix ) ] mod a { b }"
        );
    }

    #[test]
    fn every_way_to_name_a_path_is_read() {
        assert_eq!(
            paths(
                &["a", "b"],
                "use crate::c::{self, d::E as F, g::*}; pub(crate) use super::h;"
            ),
            ["crate::c", "crate::c::d::E", "crate::c::g", "crate::a::h"]
        );
        assert_eq!(
            paths(
                &["a"],
                "fn f(x: crate::b::C<self::d::E>) -> <X as super::g::H>::I { x }"
            ),
            ["crate::b::C", "crate::a::d::E", "crate::g::H"]
        );
        // Through a module that was brought in, under another name, and through a child.
        assert_eq!(
            paths(
                &["a"],
                "mod kid; use crate::b::c as z; fn f() { z::g(); kid::h(); x.z::<T>() }"
            ),
            ["crate::b::c", "crate::b::c::g", "crate::a::kid::h"]
        );
        // A path by way of a child of the crate's root, and what is in the file itself.
        assert_eq!(
            paths(
                &["a"],
                "mod m { use super::x; mod n { use super::super::y; } } use super::z;"
            ),
            ["crate::a::x", "crate::a::y", "crate::z"]
        );
        assert_eq!(
            paths(&[], "fn f<'a>() -> impl Fn() + use<'a> { bevy::app::App }"),
            ["bevy::app::App"]
        );
        let main = Source::read(
            vec![],
            "use boresight::cli; boresight::app::f();",
            Some("boresight"),
        );
        let named: Vec<_> = main
            .named
            .iter()
            .map(|named| named.path.join("::"))
            .collect();
        assert_eq!(named, ["crate::cli", "crate::app::f"]);
    }
}
