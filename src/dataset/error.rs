//! What keeps a set from being made.

use crate::app::RunError;
use crate::eval::EvalError;
use crate::inference::DetectorError;
use crate::media::clip_boxes::ListFault;
use crate::media::image::ImageError;
use crate::media::video::VideoError;
use crate::models::air::wind::WindError;
use crate::models::flight::class::ObjectClass;
use crate::models::ground::city::CityError;
use crate::models::optics::camera::CameraError;
use crate::models::optics::sensor::SensorError;
use crate::output::OutputError;
use crate::scenario::InputError;
use crate::scenario::catalogue::UavError;
use crate::simulation::SimulationError;
use crate::systems::capture::CaptureError;
use crate::warning::StrictError;
use std::path::PathBuf;

/// Why a set cannot be made; each prints as one line.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// A run whose tracks are wanted.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// The recipe.
    #[error(transparent)]
    Recipe(#[from] InputError),
    /// The scenes that are asked for.
    #[error("--scenes: '{text}' is no range of the scenes; write FROM..TO within 0..{count}")]
    Range {
        /// What was given.
        text: String,
        /// Scenes of the whole set.
        count: u32,
    },
    /// The folder holds another set.
    #[error(
        "{path}: holds a set of another recipe or program version; name another folder with --out, \
         or empty this one"
    )]
    OtherRecipe {
        /// The folder.
        path: PathBuf,
    },
    /// A folder of tracks holds others.
    #[error(
        "{path}: holds tracks that another detector, rate, seed, setting or recipe made; name another folder with --out, or \
         remove this one"
    )]
    OtherTracks {
        /// The folder.
        path: PathBuf,
    },
    /// A file of the set cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A record of a scene is damaged.
    #[error("{path}: {source}; delete the file, and the scene is made anew")]
    Record {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: serde_json::Error,
    },
    /// The city of a scene cannot be generated.
    #[error("scene {scene}: city: {source}")]
    City {
        /// The scene.
        scene: u32,
        /// What is wrong.
        source: CityError,
    },
    /// The camera of a scene is impossible.
    #[error("scene {scene}: camera: {source}")]
    Camera {
        /// The scene.
        scene: u32,
        /// What is wrong.
        source: CameraError,
    },
    /// The wind of a scene is impossible.
    #[error("scene {scene}: weather: {source}")]
    Wind {
        /// The scene.
        scene: u32,
        /// What is wrong.
        source: WindError,
    },
    /// A model of the recipe.
    #[error(transparent)]
    Uav(#[from] UavError),
    /// A class without a model.
    #[error(
        "targets.models: none of them is of the class {}; add one, or set targets.{} = 0",
        class.name(),
        class.name()
    )]
    NoModel {
        /// The class.
        class: ObjectClass,
    },
    /// It was stopped from outside; what is whole by then is told where this is caught.
    #[error("stopped before the first scene; the same command begins again")]
    Stopped,
    /// No view of a scene shows what the recipe wants.
    #[error(
        "scene {scene} has no view that the recipe allows; widen camera.hfov_deg or camera.height_m"
    )]
    NoView {
        /// The scene.
        scene: u32,
    },
    /// A sensor of a scene.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// A frame without its picture.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// A picture cannot be encoded, or not be read for the page of the set.
    #[error("{path}: {source}; delete the record of its scene, and the scene is made anew")]
    Picture {
        /// The picture.
        path: PathBuf,
        /// What is wrong.
        source: image::ImageError,
    },
    /// A picture of the page cannot be encoded.
    #[error("the page: {0}; this is a fault of the program: please report it")]
    Preview(#[from] ImageError),
    /// Records and statistics that cannot be encoded.
    #[error(
        "a file of the set cannot be encoded: {0}; this is a fault of the program: please report it"
    )]
    Json(#[from] serde_json::Error),
    /// The renderer.
    #[error(transparent)]
    Renderer(Box<RunError>),
    /// Real pictures without a place to take them from.
    #[error(
        "real.pictures: the recipe wants {pictures} real pictures; name the folder of the clips with --real"
    )]
    RealMissing {
        /// Pictures that are wanted.
        pictures: u32,
    },
    /// A place for real pictures, of which the recipe wants none.
    #[error(
        "--real: the recipe wants no real pictures; give real.pictures in it, or leave --real out"
    )]
    RealUnasked,
    /// The boxes of real clips.
    #[error("--real: {path}: {fault}")]
    Real {
        /// The file of boxes.
        path: PathBuf,
        /// What is wrong with it.
        fault: RealFault,
    },
    /// Warnings where they are errors.
    #[error(transparent)]
    Strict(#[from] StrictError),
    /// A real clip.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// The detector of tracks of real clips.
    #[error(transparent)]
    Model(#[from] DetectorError),
    /// The tracker on real clips.
    #[error(transparent)]
    Follow(Box<EvalError>),
}

impl From<EvalError> for DatasetError {
    fn from(error: EvalError) -> Self {
        Self::Follow(Box::new(error))
    }
}

/// What is wrong with the boxes of real clips.
#[derive(Debug, thiserror::Error)]
pub enum RealFault {
    /// The list itself.
    #[error(transparent)]
    List(#[from] ListFault),
    /// A label without a class.
    #[error(
        "what '{label}' is is not clear; give real.labels.{label} = \"quadcopter\", or another class, in the recipe"
    )]
    Label {
        /// The label.
        label: String,
    },
    /// A clip for validation that is not there.
    #[error("it lists no clip '{clip}'; correct real.val in the recipe")]
    Val {
        /// The clip's name.
        clip: String,
    },
    /// Two clips whose pictures would be called alike.
    #[error(
        "{} and {} have one name but for their endings; rename one, in the list, too",
        files[0], files[1]
    )]
    SameName {
        /// Their files.
        files: [String; 2],
    },
    /// The entry of a clip is of another length.
    #[error(
        "it lists {listed} frames of {clip}, which has {frames}; list the boxes of every frame"
    )]
    Length {
        /// The clip's file.
        clip: String,
        /// Frames of the entry.
        listed: usize,
        /// Frames of the clip.
        frames: usize,
    },
}

impl From<std::io::Error> for RealFault {
    fn from(error: std::io::Error) -> Self {
        Self::List(error.into())
    }
}

impl From<RunError> for DatasetError {
    fn from(error: RunError) -> Self {
        Self::Renderer(Box::new(error))
    }
}
