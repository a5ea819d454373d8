//! JSON as some programs write it.

use std::borrow::Cow;

/// What Python's writer puts for numbers that are none.
const WORDS: [&str; 3] = ["-Infinity", "Infinity", "NaN"];

/// The text of a JSON file with null for numbers that are none (`NaN`, `Infinity`), which JSON does not have.
pub fn without_nan(text: &str) -> Cow<'_, str> {
    if !WORDS.iter().any(|word| text.contains(word)) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len());
    let (mut quoted, mut rest) = (false, text);
    while let Some(c) = rest.chars().next() {
        let found = |word: &&&str| !quoted && rest.starts_with(**word);
        if let Some(word) = WORDS.iter().find(found) {
            out.push_str("null");
            rest = &rest[word.len()..];
            continue;
        }
        quoted ^= c == '"';
        let mut length = c.len_utf8();
        if c == '\\' {
            // What is escaped ends no text.
            length += rest[1..].chars().next().map_or(0, char::len_utf8);
        }
        out.push_str(&rest[..length]);
        rest = &rest[length..];
    }
    Cow::Owned(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_are_none_are_null_but_texts_stay() {
        let text = r#"{"a": NaN, "b": [-Infinity, Infinity, 1], "NaN": "a \"NaN\" Größe \\"}"#;
        let want = r#"{"a": null, "b": [null, null, 1], "NaN": "a \"NaN\" Größe \\"}"#;
        assert_eq!(without_nan(text), want);
        assert!(matches!(without_nan("{}"), Cow::Borrowed(_)));
    }
}
