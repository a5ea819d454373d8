//! Meshes of what is rendered: primitives, glTF, textured ones, structures.

pub mod gltf;
pub mod mesh;
pub mod structures;
pub mod textured;
