//! Compiles `proto/boresight.proto` without a system `protoc`: Rust types and the descriptor set that
//! every recording carries as its schema.

use std::{env, error::Error, fs, path::PathBuf};

use protox::prost::Message as _;

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=proto/boresight.proto");
    // Compiled in; without this line the compiler does not see a file that is new.
    println!("cargo::rerun-if-changed=assets/uavs");
    let mut descriptors = protox::compile(["boresight.proto"], ["proto"])?;
    // The comments become the documentation of the Rust types; the recordings do without them.
    prost_build::Config::new().compile_fds(descriptors.clone())?;
    for file in &mut descriptors.file {
        file.source_code_info = None;
    }
    let out_dir = PathBuf::from(env::var_os("OUT_DIR").ok_or("OUT_DIR is not set")?);
    fs::write(out_dir.join("boresight.bin"), descriptors.encode_to_vec())?;
    Ok(())
}
