//! One exposure of a camera, with its truth.

use crate::numbers::{Matrix, Pixels, pixels, pose};
use boresight::components::capture::UavInFrame;
use boresight::simulation as sim;
use pyo3::prelude::*;

/// One exposure of a camera, with the truth of its very tick. It stays as it is while the run goes on.
#[pyclass(frozen, module = "boresight")]
pub struct Frame {
    frame: sim::Frame,
    tick_hz: u32,
}

impl Frame {
    /// A frame of a run of `tick_hz` \[Hz\].
    pub fn of(frame: sim::Frame, tick_hz: u32) -> Self {
        Self { frame, tick_hz }
    }
}

#[pymethods]
impl Frame {
    /// Name of the camera.
    #[getter]
    fn camera(&self) -> &str {
        self.frame.view().camera()
    }

    /// "search", "coarse" or "precise".
    #[getter]
    fn tier(&self) -> &'static str {
        self.frame.view().tier().word()
    }

    /// Tick of the exposure.
    #[getter]
    fn tick(&self) -> u64 {
        self.frame.view().tick()
    }

    /// Simulated time of the exposure [s].
    #[getter]
    fn t_s(&self) -> f64 {
        self.frame.view().tick() as f64 / f64::from(self.tick_hz)
    }

    /// Exposures of this camera before this one.
    #[getter]
    fn number(&self) -> u64 {
        self.frame.view().number()
    }

    /// Column and row of the sensor at which the pixels that were read out begin [px].
    #[getter]
    fn offset_px(&self) -> (u32, u32) {
        self.frame.view().rect().offset_px.into()
    }

    /// Width and height of what was read out [px].
    #[getter]
    fn size_px(&self) -> (u32, u32) {
        self.frame.view().rect().size_px.into()
    }

    /// The pixels that were read out, red, green, blue; a fresh array each time. None in a run without pictures.
    ///
    /// Shape [height, width, 3].
    #[getter]
    fn pixels<'py>(&self, py: Python<'py>) -> PyResult<Option<Pixels<'py>>> {
        let view = self.frame.view();
        let size_px = view.rect().size_px;
        let rgb8 = view.rgb8();
        rgb8.map(|rgb8| pixels(py, rgb8, size_px)).transpose()
    }

    /// Focal length over pixel pitch [px]; the optical axis meets the sensor in its middle.
    #[getter]
    fn focal_px(&self) -> f64 {
        self.frame.view().pinhole().focal_px
    }

    /// Width and height of the whole sensor [px].
    #[getter]
    fn sensor_px(&self) -> (u32, u32) {
        let pinhole = self.frame.view().pinhole();
        (pinhole.width_px, pinhole.height_px)
    }

    /// True pose: takes points of the camera (right, down, forward) to east, north, up of the site [m].
    ///
    /// Shape [4, 4].
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        pose(py, &self.frame.view().pose())
    }

    /// The same as the station believed it.
    ///
    /// Shape [4, 4].
    #[getter]
    fn believed_pose<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        pose(py, &self.frame.view().believed())
    }

    /// Truth: the UAVs and distractors in front of the camera.
    #[getter]
    fn truth(&self) -> Vec<Seen> {
        self.frame.view().truth().iter().map(Seen::of).collect()
    }

    fn __repr__(&self) -> String {
        let (width, height) = self.size_px();
        format!(
            "<Frame {} of '{}' at {:.4} s, {width} x {height} px>",
            self.number(),
            self.camera(),
            self.t_s()
        )
    }
}

/// A UAV or distractor in front of a camera, in truth. Boxes are x0, y0, x1, y1 in pixels of the whole sensor.
#[pyclass(frozen, get_all, module = "boresight")]
pub struct Seen {
    /// Its number in the scenario; distractors come after all UAVs.
    uav: usize,
    /// Whether it is no UAV.
    distractor: bool,
    /// Box around the projection of its airframe [px].
    box_px: (f64, f64, f64, f64),
    /// Projection of the point aimed at [px].
    aim_px: (f64, f64),
    /// Distance from the camera [m].
    range_m: f64,
    /// Whether nothing stands between the camera and the point aimed at.
    clear: bool,
    /// Box around its visible pixels [px]; None where none is visible, and in a run without pictures.
    visible_box_px: Option<(f64, f64, f64, f64)>,
    /// Visible share of its outline, 0 to 1; None in a run without pictures.
    visible_fraction: Option<f64>,
}

impl Seen {
    fn of(seen: &UavInFrame) -> Self {
        Self {
            uav: seen.uav,
            distractor: seen.distractor,
            box_px: seen.box_px.into(),
            aim_px: seen.aim_px.into(),
            range_m: seen.range_m,
            clear: seen.clear,
            visible_box_px: (seen.rendered).and_then(|rendered| rendered.box_px.map(Into::into)),
            visible_fraction: seen.rendered.map(|rendered| rendered.visible_fraction),
        }
    }
}

#[pymethods]
impl Seen {
    fn __repr__(&self) -> String {
        let (x0, y0, x1, y1) = self.box_px;
        let what = if self.distractor { "distractor" } else { "UAV" };
        format!(
            "<Seen {what} {} at {:.0} m, box {x0:.1}, {y0:.1}, {x1:.1}, {y1:.1} px>",
            self.uav, self.range_m
        )
    }
}
