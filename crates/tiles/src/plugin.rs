//! 3D Tiles for any Bevy app: [`TilesPlugin`].

use crate::{StandardPaint, TileFailed, TileLoaded, TilePaint};
use crate::{settle, stream, watch};
use bevy::asset::AssetEventSystems;
use bevy::camera::visibility::VisibilitySystems;
use bevy::prelude::*;
use std::marker::PhantomData;

/// Shows every [`crate::Tiles`] for the cameras with [`crate::SeesTiles`]: needs Bevy's own rendering
/// plugins, and of Boresight nothing else. With big_space, add its plugins beside it.
///
/// Materials are Bevy's, or those of a [`TilePaint`] that the app inserts as a resource; without the resource nothing
/// is shown.
#[derive(Clone, Copy, Debug)]
pub struct TilesPlugin<P: TilePaint = StandardPaint>(PhantomData<P>);

impl<P: TilePaint> TilesPlugin<P> {
    /// A plugin whose materials are made by `P`.
    pub fn painted() -> Self {
        Self(PhantomData)
    }
}

impl Default for TilesPlugin {
    fn default() -> Self {
        Self::painted()
    }
}

/// When tilesets follow their cameras: in [`PostUpdate`], before transforms and visibility are propagated and the news of
/// assets are told. Were a tile shown a frame before its mesh is known to the renderer, a hole would flash there.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FollowTiles;

impl<P: TilePaint> Plugin for TilesPlugin<P> {
    fn build(&self, app: &mut App) {
        // Bevy's own paint needs no set-up; another's comes with its app.
        if std::any::TypeId::of::<P>() == std::any::TypeId::of::<StandardPaint>() {
            app.init_resource::<StandardPaint>();
        }
        app.add_message::<TileLoaded>()
            .add_message::<TileFailed>()
            .add_systems(
                PostUpdate,
                (watch::watch, stream::stream::<P>, settle::settle_all::<P>)
                    .chain()
                    .run_if(resource_exists::<P>)
                    .in_set(FollowTiles)
                    .before(TransformSystems::Propagate)
                    .before(VisibilitySystems::VisibilityPropagate)
                    .before(AssetEventSystems),
            );
    }
}
