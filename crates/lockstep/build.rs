//! Compiles `proto/lockstep.proto` without a system `protoc`; the comments become the documentation of the Rust types.

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=proto/lockstep.proto");
    let descriptors = protox::compile(["lockstep.proto"], ["proto"])?;
    prost_build::Config::new().compile_fds(descriptors)?;
    Ok(())
}
