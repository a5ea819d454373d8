//! Small things with texts and paths.

/// Appends a key to a dotted path.
pub(super) fn join(path: &mut String, key: &str) {
    if !path.is_empty() {
        path.push('.');
    }
    path.push_str(&one_line(key));
}

/// The text with every run of white space as one blank.
pub(super) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Whether two dotted paths name one value, or one a value inside the other's.
pub(super) fn related(a: &str, b: &str) -> bool {
    lies_in(a, b) || lies_in(b, a)
}

/// Whether a dotted path names a value, or one inside it.
pub(super) fn lies_in(path: &str, value: &str) -> bool {
    let rest = path.strip_prefix(value);
    rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '[']))
}
