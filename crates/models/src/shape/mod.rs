//! Meshes of what is rendered: primitives, glTF, textured ones, clutter.

pub mod clutter;
pub mod gltf;
pub mod mesh;
pub mod textured;
