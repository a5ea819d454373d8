//! What the targets share.

#![allow(dead_code)]

use std::path::PathBuf;

/// Panics end the process as libFuzzer wants it, but for those of two libraries that the program catches.
pub fn init() {
    std::panic::set_hook(Box::new(|panic| {
        let calls = std::backtrace::Backtrace::force_capture().to_string();
        let caught = ["draco_core", "basisu"]
            .iter()
            .any(|name| calls.contains(name));
        if !caught {
            eprintln!("{panic}\n{calls}");
            std::process::abort();
        }
    }));
}

/// Writes a file into this process's folder in memory, where there is one.
pub fn file(name: &str, data: &[u8]) -> PathBuf {
    let memory = PathBuf::from("/dev/shm");
    let root = if memory.is_dir() {
        memory
    } else {
        std::env::temp_dir()
    };
    let folder = root.join(format!("boresight-fuzz-{}", std::process::id()));
    let file = folder.join(name);
    std::fs::create_dir_all(&folder).expect("a folder");
    std::fs::write(&file, data).expect("a file");
    file
}

/// Whether data may name an address or a file elsewhere: nothing shall be fetched or opened by chance.
pub fn leads_away(data: &[u8]) -> bool {
    let lower = data.to_ascii_lowercase();
    let holds = |word: &[u8]| lower.windows(word.len()).any(|part| part == word);
    holds(b"http") || holds(b"//") || holds(b"\"/") || holds(b"\\u") || holds(b"..")
}
