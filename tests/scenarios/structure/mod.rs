//! The architecture (ARCHITECTURE.md) as the sources keep it: which room may know which, no circle
//! of files, data among the components, the same domains in each room, no hidden panic.

mod kept;
mod source;

use source::{Source, Token};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::Path;

/// Rooms that are commands: they use the app, and nothing below them knows them.
const COMMANDS: [&str; 9] = [
    "eval",
    "experiment",
    "dataset",
    "georef",
    "tune",
    "validate",
    "report",
    "serve",
    "fmu",
];
/// Crates of the engine: what stands under `crates/` does without, but for those in [`WITH_ENGINE`].
const ENGINE: [&str; 4] = ["bevy", "bevy_egui", "big_space", "wgpu"];
/// Crates that are part of an engine's app.
const WITH_ENGINE: [&str; 1] = ["tiles"];
/// Rooms of the models, each of which may know those before it.
const MODELS: &[&str] = &[
    "maths", "air", "mount", "shape", "laser", "optics", "ground", "tiles", "flight", "bodies",
    "tracking", "sensing", "control", "engage", "decision",
];
/// Rooms of the geodata, likewise.
const GEODATA: &[&str] = &["projection", "tiles", "sources", "build", "place"];
/// Domain names that one of the three rooms may have alone, and why.
const ONE_ROOM_ONLY: [(&str, &str); 0] = [];

/// The sources of one crate by their path from the repository's root.
struct Crate(BTreeMap<String, Source>);

impl Crate {
    /// Reads texts by their paths; files of tests are left out.
    fn new<'a>(texts: impl IntoIterator<Item = (&'a str, &'a str)>) -> Self {
        let code = texts.into_iter().filter(|(path, _)| {
            let mut parts = path.trim_end_matches(".rs").split('/');
            !parts.any(|part| part == "tests")
        });
        let read = |(path, text): (&str, &str)| {
            let root = (path == "src/main.rs").then_some("boresight");
            (path.to_string(), Source::read(module_of(path), text, root))
        };
        Self(code.map(read).collect())
    }

    /// The program's own.
    fn shipped() -> Self {
        let found = Self::in_folder(Path::new("src"));
        assert!(found.0.len() > 50, "only {} files", found.0.len());
        found
    }

    /// Those of the program and of every crate below `crates/`.
    fn all() -> Vec<Self> {
        let below = crates().into_iter().map(|name| Self::of_crate(&name));
        std::iter::once(Self::shipped()).chain(below).collect()
    }

    /// That of a name below `crates/`.
    fn of_crate(name: &str) -> Self {
        Self::in_folder(&Path::new("crates").join(name).join("src"))
    }

    /// What lies in a folder, named from the repository's root.
    fn in_folder(folder: &Path) -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut texts = Vec::new();
        let mut waiting = vec![root.join(folder)];
        while let Some(folder) = waiting.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    waiting.push(path);
                } else if path.extension().is_some_and(|extension| extension == "rs") {
                    let name = path
                        .strip_prefix(root)
                        .unwrap()
                        .to_str()
                        .unwrap()
                        .to_string();
                    texts.push((name, std::fs::read_to_string(&path).unwrap()));
                }
            }
        }
        Self::new(texts.iter().map(|(name, text)| (&name[..], &text[..])))
    }

    /// The file that a path from the crate's root leads to: the module it names or lies in, by way
    /// of what that module hands on from below itself.
    fn file_of(&self, path: &[String]) -> Option<&str> {
        let mut path = path.to_vec();
        // Each turn follows one name that is handed on; a chain of them is short.
        for _ in 0..16 {
            if path.first().is_none_or(|first| first != "crate") {
                return None;
            }
            let depth = (1..=path.len())
                .rev()
                .find(|n| self.module(&path[1..*n]).is_some())?;
            let (file, source) = self.module(&path[1..depth])?;
            let below =
                |there: &&Vec<String>| there.len() > depth && there[..depth] == path[..depth];
            let Some(name) = path.get(depth) else {
                return Some(file);
            };
            let by_name = source.handed_on.get(name).filter(below).cloned();
            let by_star = || {
                let mut whole = source.all_of.iter().filter(below);
                let has = |there: &&Vec<String>| {
                    let (_, child) = self.module(&there[1..])?;
                    child.items.contains(name).then_some(())
                };
                let there = whole.find(|there| has(there).is_some())?;
                Some(there.iter().cloned().chain([name.clone()]).collect())
            };
            let Some(there) = by_name.or_else(by_star) else {
                return Some(file);
            };
            path = there.into_iter().chain(path.split_off(depth + 1)).collect();
        }
        None
    }

    /// The file that is a module, and what it says.
    fn module(&self, module: &[String]) -> Option<(&str, &Source)> {
        let mut files = self.0.iter().filter(|(path, _)| *path != "src/main.rs");
        let found = files.find(|(_, source)| source.module == module);
        found.map(|(path, source)| (&path[..], source))
    }

    /// Which file names which, with the first place of each.
    fn graph(&self) -> Graph {
        let mut graph = Graph::new();
        for (from, source) in &self.0 {
            let ways = graph.entry(from.clone()).or_default();
            for named in &source.named {
                let Some(to) = self.file_of(&named.path) else {
                    continue;
                };
                // A folder's own file hands on what its children have: both are one there.
                let child = &self.0[to].module;
                let own = named.handed_on && child.starts_with(&source.module);
                if to != from && !own {
                    let place = || format!("{from}:{}: {}", named.line, named.path.join("::"));
                    ways.entry(to.to_string()).or_insert_with(place);
                }
            }
        }
        graph
    }

    /// Every name in a file of `from` that `forbidden` refuses, given the room it leads to or, for
    /// other crates, the crate's name.
    fn trespasses(&self, from: &str, forbidden: impl Fn(&str) -> bool) -> Vec<String> {
        let mut found = Vec::new();
        for (path, source) in self.0.iter().filter(|(path, _)| room_of(path) == from) {
            for named in &source.named {
                let there = match self.file_of(&named.path) {
                    Some(file) => room_of(file),
                    None => &named.path[0],
                };
                // What stands in the crate's root itself is no room.
                if there != "lib" && there != from && forbidden(there) {
                    found.push(format!("{path}:{}: {}", named.line, named.path.join("::")));
                }
            }
        }
        found
    }

    /// Where components and resources are made outside the room of the components.
    fn stray_data(&self) -> Vec<String> {
        let outside = |path: &str| room_of(path) != "components";
        let mut found = Vec::new();
        for (path, source) in self.0.iter().filter(|(path, _)| outside(path)) {
            let data = made_data(&source.tokens);
            found.extend(data.map(|token| format!("{path}:{}: {}", token.line, token.text)));
        }
        found
    }

    /// The names of the domains in a room.
    fn domains(&self, room: &str) -> BTreeSet<String> {
        let modules = self.0.values().map(|source| &source.module);
        let inside = modules.filter(|module| module.len() > 1 && module[0] == room);
        inside.map(|module| module[1].clone()).collect()
    }

    /// Domain names that not all three rooms have.
    fn unmatched_domains(&self) -> Vec<String> {
        let rooms = ["components", "systems", "plugins"];
        let have = rooms.map(|room| self.domains(room));
        let all: BTreeSet<&String> = have.iter().flatten().collect();
        let excused = |name: &str| ONE_ROOM_ONLY.iter().any(|(excused, _)| *excused == name);
        let mut found = Vec::new();
        for name in all.into_iter().filter(|name| !excused(name)) {
            let lacks = rooms
                .iter()
                .zip(&have)
                .filter(|(_, have)| !have.contains(name));
            found.extend(lacks.map(|(room, _)| format!("src/{room}: no {name}")));
        }
        found
    }

    /// Calls that end the program where a value is missing.
    fn hidden_panics(&self) -> Vec<String> {
        let mut found = Vec::new();
        for (path, source) in &self.0 {
            let panics = panics(&source.tokens);
            found.extend(panics.map(|token| format!("{path}:{}: {}", token.line, token.text)));
        }
        found
    }
}

/// The part of a path below its crate's `src`.
fn below_src(path: &str) -> &str {
    path.split_once("src/").map_or(path, |(_, below)| below)
}

/// The crates below `crates/`, by their folders' names.
fn crates() -> Vec<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates");
    let entries = std::fs::read_dir(folder).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort_unstable();
    names
}

/// The module that a file is: `src/a/mod.rs` and `src/a.rs` are `a`, the roots are nothing.
fn module_of(path: &str) -> Vec<String> {
    let path = below_src(path).trim_end_matches(".rs");
    let mut module: Vec<String> = path.split('/').map(String::from).collect();
    let last = module.last().map_or("", String::as_str);
    if last == "mod" || (module.len() == 1 && ["lib", "main"].contains(&last)) {
        module.pop();
    }
    module
}

/// The room of a file: its folder below `src`, or itself.
fn room_of(path: &str) -> &str {
    let path = below_src(path);
    let room = path.split('/').next().unwrap_or(path);
    room.trim_end_matches(".rs")
}

/// `Component` and `Resource` where they are derived or written out.
fn made_data(tokens: &[Token]) -> impl Iterator<Item = &Token> {
    let text = |i: usize| tokens.get(i).map_or("", |t| t.text.as_str());
    let derives = (0..tokens.len()).filter(move |i| text(*i) == "derive" && text(i + 1) == "(");
    let derived = derives.flat_map(move |i| {
        let end = (i..tokens.len()).find(|end| text(*end) == ")");
        i..end.unwrap_or(tokens.len())
    });
    let written = (0..tokens.len()).filter(move |i| text(i + 1) == "for");
    let data = |token: &&Token| ["Component", "Resource"].contains(&&token.text[..]);
    derived.chain(written).map(|i| &tokens[i]).filter(data)
}

/// `unwrap`, `expect` and the macros that panic.
fn panics(tokens: &[Token]) -> impl Iterator<Item = &Token> {
    let text = |i: usize| tokens.get(i).map_or("", |t| t.text.as_str());
    let panics = move |i: &usize| match text(*i) {
        "unwrap" | "expect" => *i > 0 && [".", "::"].contains(&text(i - 1)),
        "panic" | "todo" | "unimplemented" => text(i + 1) == "!",
        _ => false,
    };
    (0..tokens.len()).filter(panics).map(|i| &tokens[i])
}

/// Which file names which, and where.
type Graph = BTreeMap<String, BTreeMap<String, String>>;

/// The shortest circle through a file, as the places that name the next one.
fn circle_through(graph: &Graph, start: &str) -> Option<Vec<String>> {
    let mut came: BTreeMap<&str, (&str, &str)> = BTreeMap::new();
    let mut waiting = VecDeque::from([start]);
    while let Some(at) = waiting.pop_front() {
        for (to, place) in &graph[at] {
            if !came.contains_key(&to[..]) {
                came.insert(to, (at, place));
                waiting.push_back(to);
            }
            if to == start {
                let mut places = Vec::new();
                let mut back = start;
                loop {
                    let (from, place) = came[back];
                    places.push(place.to_string());
                    back = from;
                    if back == start {
                        places.reverse();
                        return Some(places);
                    }
                }
            }
        }
    }
    None
}

/// The files that can be reached from one.
fn reached<'a>(graph: &'a Graph, start: &'a str) -> BTreeSet<&'a str> {
    let mut found = BTreeSet::new();
    let mut waiting = vec![start];
    while let Some(at) = waiting.pop() {
        for to in graph[at].keys() {
            if found.insert(&to[..]) {
                waiting.push(to);
            }
        }
    }
    found
}

/// Every group of files that name each other in circles, with its shortest circle.
fn circles(graph: &Graph) -> Vec<String> {
    let reach: BTreeMap<&str, _> = graph.keys().map(|f| (&f[..], reached(graph, f))).collect();
    let mut seen = BTreeSet::new();
    let mut found = Vec::new();
    for file in graph.keys() {
        let group: Vec<&str> = reach[&file[..]]
            .iter()
            .copied()
            .filter(|to| reach[to].contains(&file[..]))
            .collect();
        if group.is_empty() || !seen.insert(group.clone()) {
            continue;
        }
        let circles = group.iter().filter_map(|file| circle_through(graph, file));
        let shortest = circles.min_by_key(Vec::len).unwrap_or_default();
        found.push(format!(
            "{} files: {}\n    {}",
            group.len(),
            group.join(", "),
            shortest.join("\n    ")
        ));
    }
    found
}

#[track_caller]
fn none(found: &[String], rule: &str) {
    assert!(found.is_empty(), "{rule}:\n{}", found.join("\n"));
}

fn of(rooms: &[&str]) -> impl Fn(&str) -> bool {
    let rooms: Vec<String> = rooms.iter().map(ToString::to_string).collect();
    move |room| rooms.iter().any(|forbidden| forbidden == room)
}

/// The rooms of `rooms` and the commands.
fn and_commands(rooms: &[&'static str]) -> Vec<&'static str> {
    rooms.iter().copied().chain(COMMANDS).collect()
}

/// The crates of the engine that a manifest asks for.
fn engines(manifest: &str) -> Vec<&str> {
    let names = manifest
        .lines()
        .filter_map(|line| line.split(['.', ' ', '=']).next());
    let crates = names.filter(|name| ENGINE.contains(&name.replace('-', "_").as_str()));
    crates.collect()
}

/// Where rooms, of which each may know those before it, know rooms above them.
fn rooms_that_look_up(sources: &Crate, rooms: &[&str]) -> Vec<String> {
    let above = |k: usize| of(&rooms[k + 1..]);
    let numbered = rooms.iter().enumerate();
    numbered
        .flat_map(|(k, room)| sources.trespasses(room, above(k)))
        .collect()
}

#[test]
fn what_stands_under_crates_knows_no_engine() {
    let mut found = Vec::new();
    for name in crates() {
        if WITH_ENGINE.contains(&name.as_str()) {
            continue;
        }
        let place = format!("crates/{name}/Cargo.toml");
        let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join(&place);
        let manifest = std::fs::read_to_string(manifest).unwrap();
        found.extend(
            engines(&manifest)
                .iter()
                .map(|engine| format!("{place}: {engine}")),
        );
    }
    none(&found, "crates do without the engine");
}

#[test]
fn rooms_of_a_crate_know_only_those_below_them() {
    for (name, rooms) in [("models", MODELS), ("geodata", GEODATA)] {
        let sources = Crate::of_crate(name);
        let found: BTreeSet<&str> = sources.0.keys().map(|path| room_of(path)).collect();
        let listed: BTreeSet<&str> = rooms.iter().copied().chain(["lib"]).collect();
        assert_eq!(found, listed);
        none(
            &rooms_that_look_up(&sources, rooms),
            "a room imports those that stand before it",
        );
    }
}

#[test]
fn rooms_know_only_the_rooms_below_them() {
    let sources = Crate::shipped();
    let mut found = Vec::new();
    for (room, above) in [
        (
            "components",
            &[
                "parameters",
                "systems",
                "plugins",
                "app",
                "simulation",
                "cli",
            ][..],
        ),
        (
            "parameters",
            &["bevy", "systems", "plugins", "app", "simulation", "cli"],
        ),
        ("systems", &["plugins", "app", "simulation", "cli"]),
        ("plugins", &["app", "simulation", "cli"]),
        ("app", &["simulation", "cli"]),
    ] {
        found.extend(sources.trespasses(room, of(&and_commands(above))));
    }
    found.extend(sources.trespasses("tune", of(&["systems", "plugins", "app", "simulation"])));
    let clip = sources.trespasses("eval", of(&["systems"]));
    found.extend(
        clip.into_iter()
            .filter(|place| place.starts_with("src/eval/clip/")),
    );
    none(
        &found,
        "imports run from simulation to app to plugins to systems to parameters to components",
    );
}

#[test]
fn nothing_but_the_program_knows_the_command_line() {
    let sources = Crate::shipped();
    let rooms: BTreeSet<&str> = sources.0.keys().map(|path| room_of(path)).collect();
    let others = rooms
        .into_iter()
        .filter(|room| !["main", "cli"].contains(room));
    let found: Vec<_> = others
        .flat_map(|room| sources.trespasses(room, of(&["cli"])))
        .collect();
    none(&found, "only main.rs imports cli");
}

#[test]
fn no_files_name_each_other_in_a_circle() {
    let crates = Crate::all();
    let found = crates.iter().flat_map(|sources| circles(&sources.graph()));
    none(
        &found.collect::<Vec<_>>(),
        "files that need each other cannot be read one after the other",
    );
}

#[test]
fn data_lives_among_the_components() {
    let found = Crate::shipped().stray_data();
    none(&found, "components and resources stand in src/components");
}

#[test]
fn a_domain_has_one_name_in_every_room() {
    let found = Crate::shipped().unmatched_domains();
    none(
        &found,
        "components, systems and plugins have the same domains",
    );
}

#[test]
fn nothing_panics_for_a_missing_value() {
    let crates = Crate::all();
    let found = crates.iter().flat_map(Crate::hidden_panics);
    none(
        &found.collect::<Vec<_>>(),
        "errors are typed; nothing unwraps outside tests",
    );
}

// ---- The rules on made-up sources --------------------------------------------------------------

#[test]
fn a_trespass_is_seen_however_it_is_written() {
    let sources = Crate::new([
        ("src/lib.rs", "pub mod app; pub mod cli; pub mod systems;"),
        ("src/main.rs", "fn main() { boresight::cli::run() }"),
        ("src/cli.rs", "pub fn run() { crate::app::go() }"),
        ("src/app.rs", "pub fn go() {}"),
        (
            "src/systems/mod.rs",
            "use crate::app as up;\nfn f() { up::go() }\n#[cfg(test)] mod tests { use crate::cli; }",
        ),
        ("src/systems/tests.rs", "use crate::cli::run;"),
    ]);
    assert_eq!(
        sources.trespasses("systems", of(&["app"])),
        [
            "src/systems/mod.rs:1: crate::app",
            "src/systems/mod.rs:2: crate::app::go"
        ]
    );
    assert!(sources.trespasses("systems", of(&["cli"])).is_empty());
    assert_eq!(
        sources.trespasses("main", of(&["cli"])),
        ["src/main.rs:1: crate::cli::run"]
    );
}

#[test]
fn a_room_that_looks_up_and_an_engine_are_found() {
    let sources = Crate::new([
        ("crates/models/src/lib.rs", "pub mod maths; pub mod air;"),
        ("crates/models/src/air.rs", "use super::maths::M;"),
        (
            "crates/models/src/maths/mod.rs",
            "use glam::DVec3;\nuse super::super::air::A;",
        ),
    ]);
    assert_eq!(
        rooms_that_look_up(&sources, MODELS),
        ["crates/models/src/maths/mod.rs:2: crate::air::A"]
    );
    let manifest =
        "[dependencies]\nglam.workspace = true\nbevy.workspace = true\nbig-space = \"1\"";
    assert_eq!(engines(manifest), ["bevy", "big-space"]);
    assert!(engines("description = \"without bevy\"").is_empty());
}

#[test]
fn a_circle_is_found_and_printed() {
    let circle = |texts: &[(&str, &str)]| {
        let found = circles(&Crate::new(texts.iter().copied()).graph());
        found.join("\n")
    };
    let straight = [
        ("src/lib.rs", "pub mod a; pub mod b; pub mod c;"),
        ("src/a.rs", "use crate::b::B; // crate::a\n"),
        (
            "src/b.rs",
            "fn f() { crate::c::g() } #[cfg(test)] mod tests { use crate::a; }",
        ),
        ("src/c.rs", "const A: &str = \"crate::a::A\";"),
    ];
    assert_eq!(circle(&straight), "");
    let mut closed = straight;
    closed[3].1 = "\nfn g() -> super::a::A {}";
    assert_eq!(
        circle(&closed),
        "3 files: src/a.rs, src/b.rs, src/c.rs\n    \
         src/a.rs:1: crate::b::B\n    src/b.rs:1: crate::c::g\n    src/c.rs:2: crate::a::A"
    );
    // Two that name each other within three.
    closed[1].1 = "use crate::b::B;";
    closed[2].1 = "use crate::{a::A, c};";
    let found = circle(&closed);
    assert!(
        found.starts_with("3 files") && found.lines().count() == 3,
        "{found}"
    );
}

#[test]
fn a_folder_hands_on_its_children_without_a_circle() {
    let folder = |own: &'static str, child: &'static str| {
        let sources = Crate::new([
            ("src/lib.rs", "pub mod a; pub mod b;"),
            ("src/a/mod.rs", own),
            ("src/a/kid.rs", child),
            ("src/a/twin.rs", "use super::Kid;"),
            ("src/b.rs", "use crate::a::{Kid, Own};"),
        ]);
        let graph = sources.graph();
        let to = graph["src/b.rs"].keys().cloned().collect::<Vec<_>>();
        (circles(&graph).len(), to)
    };
    let handed_on = "pub mod kid; pub mod twin; pub use kid::Kid; struct Own;";
    let child = "pub struct Kid(super::Own);";
    // The name that is handed on leads to the child, the other to the folder's own file.
    let both = vec!["src/a/kid.rs".to_string(), "src/a/mod.rs".to_string()];
    assert_eq!(folder(handed_on, child), (0, both.clone()));
    let star = "pub mod kid; pub mod twin; pub(crate) use self::kid::*; struct Own;";
    assert_eq!(folder(star, child), (0, both));
    // The folder's own file needs its child, and the child needs it.
    let needs = "pub mod kid; pub mod twin; pub use kid::Kid; struct Own; fn f() { kid::g() }";
    assert_eq!(folder(needs, child).0, 1);
    assert_eq!(folder(needs, "pub struct Kid;").0, 0);
}

#[test]
fn data_outside_its_room_is_found() {
    let sources = Crate::new([
        ("src/components/a.rs", "#[derive(Component)] struct A;"),
        (
            "src/systems/a.rs",
            "#[derive(Clone,\n bevy::prelude::Component)]\nstruct A;\nimpl Resource for B {}\nfn f(c: Component) {}",
        ),
        (
            "src/plugins/a.rs",
            "#[derive(Clone)] struct A; #[cfg(test)] mod tests { #[derive(Resource)] struct R; }",
        ),
    ]);
    assert_eq!(
        sources.stray_data(),
        [
            "src/systems/a.rs:2: Component",
            "src/systems/a.rs:4: Resource"
        ]
    );
}

#[test]
fn a_domain_that_a_room_lacks_is_found() {
    let sources = Crate::new([
        ("src/components/mod.rs", ""),
        ("src/components/a.rs", ""),
        ("src/systems/a/mod.rs", ""),
        ("src/systems/a/part.rs", ""),
        ("src/systems/b.rs", ""),
        ("src/plugins/a.rs", ""),
        ("src/plugins/a/tests.rs", ""),
    ]);
    assert_eq!(
        sources.unmatched_domains(),
        ["src/components: no b", "src/plugins: no b"]
    );
}

#[test]
fn a_hidden_panic_is_found() {
    let sources = Crate::new([
        (
            "src/a.rs",
            "/// x.unwrap()\nfn f() { x.unwrap_or(0); x\n.unwrap(); y.expect(\"z\"); panic!() }",
        ),
        (
            "src/b.rs",
            "fn g() { a.map(Option::unwrap) } #[cfg(test)] mod tests { fn h() { x.unwrap() } }",
        ),
        ("src/b/tests.rs", "fn h() { x.unwrap() }"),
    ]);
    assert_eq!(
        sources.hidden_panics(),
        [
            "src/a.rs:3: unwrap",
            "src/a.rs:3: expect",
            "src/a.rs:3: panic",
            "src/b.rs:1: unwrap"
        ]
    );
}
