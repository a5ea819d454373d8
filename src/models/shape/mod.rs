//! Meshes of what is rendered: primitives, UAVs and distractors, clutter.

pub mod clutter;
pub mod gltf;
pub mod mesh;
pub mod textured;
pub mod uav_mesh;
