//! How the reading of a file goes on after an error: what is wrong is taken out of the tree, or something usable stands in
//! for it, so that the errors behind it show too.

use std::collections::BTreeMap;

use toml::Spanned;
use toml::de::DeValue;

/// What stands in, one after the other, for a value that cannot be left out.
const STAND_INS: [&str; 10] = [
    "1.0",
    "1",
    "\"x\"",
    "true",
    "1970-01-01T00:00:00Z",
    "[1.0, 2.0]",
    "[1.0, 2.0, 3.0]",
    "[]",
    "{}",
    "{ kind = \"hover\", position_enu_m = [0.0, 500.0, 100.0] }",
];

/// What serde says about a node of a numbered tree.
pub(super) enum Wrong {
    /// A table has a key too many.
    Unknown(String),
    /// A table lacks a key.
    Missing(String),
    /// A value is none of these names.
    NoneOf(Vec<String>),
    /// A value cannot be used.
    Value,
}

/// What was tried at each path.
#[derive(Default)]
pub(super) struct Tried(BTreeMap<String, usize>);

/// A numbered tree's value, with the number of its node.
type Node<'i> = Spanned<DeValue<'i>>;

impl Tried {
    /// Changes the tree so that it may be read further; false where nothing is left to try. `id` is the number of the node that
    /// is wrong, `path` its path, or that of the key that it lacks; `paths` gives the path of a number, and `new` is the number
    /// that a stand-in gets.
    pub(super) fn mend(
        &mut self,
        tree: &mut Node<'_>,
        (id, path): (usize, &str),
        wrong: &Wrong,
        paths: &dyn Fn(usize) -> String,
        new: usize,
    ) -> bool {
        match wrong {
            Wrong::Unknown(key) => {
                // The node is the table, or the key itself.
                let inside = match find(tree, id).map(Node::get_mut) {
                    Some(DeValue::Table(table)) => table.remove(key.as_str()).is_some(),
                    _ => false,
                };
                inside || remove_entry(tree, id)
            }
            Wrong::Missing(key) => {
                let next = self.next(path, STAND_INS.len());
                let stand_in = next.and_then(|index| stand_in(STAND_INS[index], new));
                match (stand_in, find(tree, id).map(Node::get_mut)) {
                    (Some(value), Some(DeValue::Table(table))) => {
                        table.insert(Spanned::new(new..new + 1, key.clone().into()), value);
                        true
                    }
                    // The table itself has to go.
                    _ => self.drop_value(tree, id, paths),
                }
            }
            Wrong::NoneOf(names) => {
                let place = format!("{path} = ");
                let name = (self.next(&place, 1)).and_then(|_| names.first());
                match (name, find(tree, id)) {
                    (Some(name), Some(node)) if matches!(node.get_ref(), DeValue::String(_)) => {
                        *node.get_mut() = DeValue::String(name.clone().into());
                        true
                    }
                    _ => self.drop_value(tree, id, paths),
                }
            }
            Wrong::Value => self.drop_value(tree, id, paths),
        }
    }

    /// The number of the next trial at a place, of so many.
    fn next(&mut self, place: &str, most: usize) -> Option<usize> {
        let tried = self.0.entry(place.to_owned()).or_default();
        *tried += 1;
        (*tried <= most).then(|| *tried - 1)
    }

    /// Leaves a value out, so that its default counts; in a list something stands in for it.
    fn drop_value(
        &mut self,
        tree: &mut Node<'_>,
        id: usize,
        paths: &dyn Fn(usize) -> String,
    ) -> bool {
        // Nothing stands in for the whole file.
        if tree.span().start == id {
            return false;
        }
        if remove_entry(tree, id) {
            return true;
        }
        let place = format!("{} in its list", paths(id));
        let next = self.next(&place, STAND_INS.len());
        let value = next.and_then(|index| stand_in(STAND_INS[index], id));
        match (value, find(tree, id)) {
            (Some(value), Some(node)) => {
                *node = value;
                true
            }
            _ => match list_around(tree, id) {
                Some(list) => self.drop_value(tree, list, paths),
                None => false,
            },
        }
    }
}

/// A value of a text of ours, every node of it with the number `id`.
fn stand_in(text: &'static str, id: usize) -> Option<Node<'static>> {
    Some(numbered(DeValue::parse(text).ok()?, id))
}

fn numbered<'i>(value: Node<'i>, id: usize) -> Node<'i> {
    let value = match value.into_inner() {
        DeValue::Table(table) => {
            let entries = table.into_iter().map(|(key, value)| {
                let key = Spanned::new(id..id + 1, key.into_inner());
                (key, numbered(value, id))
            });
            DeValue::Table(entries.collect())
        }
        DeValue::Array(list) => {
            DeValue::Array(list.into_iter().map(|item| numbered(item, id)).collect())
        }
        other => other,
    };
    Spanned::new(id..id + 1, value)
}

/// The outermost value of a number.
fn find<'t, 'i>(node: &'t mut Node<'i>, id: usize) -> Option<&'t mut Node<'i>> {
    if node.span().start == id {
        return Some(node);
    }
    match node.get_mut() {
        DeValue::Table(table) => table.iter_mut().find_map(|(_, value)| find(value, id)),
        DeValue::Array(list) => list.iter_mut().find_map(|item| find(item, id)),
        _ => None,
    }
}

/// Removes the entry whose key or value has the number; false where no table has one.
fn remove_entry(node: &mut Node<'_>, id: usize) -> bool {
    match node.get_mut() {
        DeValue::Table(table) => {
            let is_it = |key: usize, value: usize| key == id || value == id;
            let key = (table.iter())
                .find(|(key, value)| is_it(key.span().start, value.span().start))
                .map(|(key, _)| key.clone());
            match key {
                Some(key) => table.remove(&key).is_some(),
                None => (table.iter_mut()).any(|(_, value)| remove_entry(value, id)),
            }
        }
        DeValue::Array(list) => list.iter_mut().any(|item| remove_entry(item, id)),
        _ => false,
    }
}

/// The number of the list that has an item of this number.
fn list_around(node: &Node<'_>, id: usize) -> Option<usize> {
    match node.get_ref() {
        DeValue::Table(table) => (table.iter()).find_map(|(_, value)| list_around(value, id)),
        DeValue::Array(list) => match list.iter().any(|item| item.span().start == id) {
            true => Some(node.span().start),
            false => list.iter().find_map(|item| list_around(item, id)),
        },
        _ => None,
    }
}
