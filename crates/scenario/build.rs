//! The catalogue's UAVs are compiled in: without this the compiler does not see a file that is new.

fn main() {
    println!("cargo::rerun-if-changed=../../assets/uavs");
}
