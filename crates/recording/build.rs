//! Compiles `proto/boresight.proto` without a system `protoc`: Rust types, the topics of those that are one,
//! and the descriptor set that every recording carries as its schema.

use std::{env, error::Error, fmt::Write as _, fs, path::PathBuf};

use protox::prost::Message as _;
use protox::prost_reflect::prost_types::FileDescriptorProto;

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=proto/boresight.proto");
    let mut descriptors = protox::compile(["boresight.proto"], ["proto"])?;
    // The comments become the documentation of the Rust types; the recordings do without them.
    prost_build::Config::new().compile_fds(descriptors.clone())?;
    let out_dir = PathBuf::from(env::var_os("OUT_DIR").ok_or("OUT_DIR is not set")?);
    let file = descriptors.file.last().ok_or("no file was compiled")?;
    fs::write(out_dir.join("topics.rs"), topics(file)?)?;
    for file in &mut descriptors.file {
        file.source_code_info = None;
    }
    fs::write(out_dir.join("boresight.bin"), descriptors.encode_to_vec())?;
    Ok(())
}

/// The channels of the messages whose comments begin with "Topic of the run" or "Topic of every station", in their
/// order; `UavState` has the topic `uav_state`.
fn topics(file: &FileDescriptorProto) -> Result<String, Box<dyn Error>> {
    /// Field number of the messages in a file's descriptor.
    const MESSAGES: i32 = 4;
    let comment = |index: usize| {
        let mut found = file.source_code_info.iter().flat_map(|info| &info.location);
        let comment = found.find(|at| at.path == [MESSAGES, index as i32])?;
        Some(comment.leading_comments().trim_start().to_owned())
    };
    let (mut code, mut names, mut of_station) = (String::new(), Vec::new(), Vec::new());
    for (index, message) in file.message_type.iter().enumerate() {
        let comment = comment(index).unwrap_or_default();
        if comment.starts_with("Topic of every station") {
            of_station.push(names.len());
        } else if !comment.starts_with("Topic of the run") {
            continue;
        }
        let name = message.name();
        let index = names.len();
        writeln!(
            code,
            "impl OwnMessage for proto::{name} {{ const INDEX: usize = {index}; }}"
        )?;
        let mut topic = String::new();
        for letter in name.chars() {
            if letter.is_uppercase() && !topic.is_empty() {
                topic.push('_');
            }
            topic.extend(letter.to_lowercase());
        }
        names.push((format!("/boresight/{topic}"), format!("boresight.{name}")));
    }
    let [first, .., last] = of_station[..] else {
        return Err("no topics of every station".into());
    };
    if last + 1 - first != of_station.len() {
        return Err(
            "proto/boresight.proto: the topics of every station must stand together".into(),
        );
    }
    let count = names.len();
    writeln!(code, "/// Topic and schema name of the own channels.")?;
    writeln!(
        code,
        "const OWN_CHANNELS: [(&str, &str); {count}] = {names:?};"
    )?;
    writeln!(code, "/// The own channels that every station has.")?;
    let end = last + 1;
    writeln!(
        code,
        "const OF_STATION: std::ops::Range<usize> = {first}..{end};"
    )?;
    Ok(code)
}
