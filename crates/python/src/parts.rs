//! Detectors and pointing laws that are Python objects.

use crate::frame::Frame;
use crate::numbers::{Pair, Pixels, Vector, pixels, three, two};
use boresight::models::control::law::{Aim, HandOver, PointingInput as Input, PointingOutput};
use boresight::models::control::tuning::MountPlant;
use boresight::models::mount::gimbal::{GimbalCommand, GimbalParams};
use boresight::simulation::FrameView;
use boresight::simulation::parts::{
    Detection, Detector, PartError, PointingLaw, Question, Reading,
};
use glam::DVec2;
use numpy::{AllowTypeChange, PyArrayLike2};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// What a Python part raised: it becomes the cause of the run's error.
#[derive(Clone, Default)]
pub struct Raised(Arc<Mutex<Option<PyErr>>>);

impl Raised {
    /// Keeps an error unless one came before it, and says its line.
    pub fn keep(&self, py: Python, error: PyErr) -> String {
        let line = error.to_string();
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.get_or_insert_with(|| error.clone_ref(py));
        line
    }

    /// What was raised first, once.
    pub fn take(&self) -> Option<PyErr> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.take()
    }
}

/// What a detector is asked about.
#[pyclass(frozen, module = "boresight")]
pub struct Picture {
    question: Question,
    tick_hz: u32,
}

#[pymethods]
impl Picture {
    /// The pixels in which to look, red, green, blue; boxes are answered in these pixels.
    ///
    /// Shape [height, width, 3].
    #[getter]
    fn pixels<'py>(&self, py: Python<'py>) -> PyResult<Pixels<'py>> {
        let frame = FrameView::asked(&self.question);
        let (rect, look) = (frame.rect(), self.question.look);
        let rgb8 = frame.rgb8().unwrap_or_default();
        let [left, top] =
            [0, 1].map(|axis| (look.offset_px[axis].saturating_sub(rect.offset_px[axis])) as usize);
        let [width, height] = look.size_px.map(|side| side as usize);
        let row_px = rect.size_px[0] as usize;
        let rows: Vec<u8> = (top..top + height)
            .filter_map(|row| rgb8.get(3 * (row * row_px + left)..)?.get(..3 * width))
            .flatten()
            .copied()
            .collect();
        pixels(py, &rows, look.size_px)
    }

    /// Column and row of the whole sensor at which they begin [px].
    #[getter]
    fn offset_px(&self) -> (u32, u32) {
        self.question.look.offset_px.into()
    }

    /// The frame that they are of. It carries its truth, for tests: a detector that reads it proves nothing.
    #[getter]
    fn frame(&self) -> Frame {
        Frame::of(FrameView::asked(&self.question).keep(), self.tick_hz)
    }
}

/// A detector that is a Python object.
pub struct PyDetector {
    detect: Py<PyAny>,
    classes: Vec<String>,
    reading: Reading,
    wants_pictures: bool,
    tick_hz: u32,
    questions: VecDeque<Question>,
    raised: Raised,
}

impl PyDetector {
    /// Reads what the object says of itself.
    pub fn new(py: Python, object: &Py<PyAny>, tick_hz: u32, raised: Raised) -> PyResult<Self> {
        let object = object.bind(py);
        let number = |name: &str, default: f64| -> PyResult<f64> {
            match object.getattr_opt(name)? {
                Some(value) => value.extract(),
                None => Ok(default),
            }
        };
        let (start, weak) = (number("start_score", 0.5)?, number("weak_score", 0.25)?);
        let neutral = number("neutral_score", 0.289)?;
        for (name, value) in [
            ("start_score", start),
            ("weak_score", weak),
            ("neutral_score", neutral),
        ] {
            if !(value > 0.0 && value < 1.0) {
                let line = format!("{name} is {value}; give a number between 0 and 1");
                return Err(PyValueError::new_err(line));
            }
        }
        let roi_px: Option<u32> = match object.getattr_opt("roi_px")? {
            Some(value) => value.extract()?,
            None => None,
        };
        let classes = match object.getattr_opt("classes")? {
            Some(value) => value.extract()?,
            None => vec!["uav".to_owned()],
        };
        let wants_pictures = match object.getattr_opt("wants_pictures")? {
            Some(value) => value.extract()?,
            None => true,
        };
        Ok(Self {
            detect: object.getattr("detect")?.unbind(),
            classes,
            reading: Reading::of_network(start, weak, neutral, roi_px),
            wants_pictures,
            tick_hz,
            questions: VecDeque::new(),
            raised,
        })
    }

    fn found(&self, py: Python, question: Question) -> PyResult<Vec<Detection>> {
        let offset_px = question.look.offset_px;
        let picture = Picture {
            question,
            tick_hz: self.tick_hz,
        };
        let answer = self.detect.bind(py).call1((picture,))?;
        // An empty list has no second axis.
        if answer.len().is_ok_and(|len| len == 0) {
            return Ok(Vec::new());
        }
        let answer: PyArrayLike2<f64, AllowTypeChange> = answer.extract().map_err(|_| {
            PyTypeError::new_err(
                "detect must return rows of x0, y0, x1, y1, score and, if there are classes, label",
            )
        })?;
        let rows = answer.as_array();
        let columns = rows.ncols();
        if columns != 5 && columns != 6 {
            let line = format!(
                "detect returned rows of {columns} numbers; give x0, y0, x1, y1, score and, if there are classes, label"
            );
            return Err(PyValueError::new_err(line));
        }
        (rows.rows().into_iter().enumerate())
            .map(|(at, row)| {
                let wrong = |why: String| PyValueError::new_err(format!("detect: row {at}: {why}"));
                if !row.iter().all(|value| value.is_finite()) {
                    return Err(wrong("holds a number that is not finite".to_owned()));
                }
                let (box_px, score) = ([row[0], row[1], row[2], row[3]], row[4]);
                if box_px[2] < box_px[0] || box_px[3] < box_px[1] {
                    return Err(wrong(format!(
                        "box {box_px:?} ends before it begins; give x0, y0, x1, y1"
                    )));
                }
                if !(0.0..=1.0).contains(&score) {
                    return Err(wrong(format!("score {score} is not from 0 to 1")));
                }
                let label = row.get(5).copied().unwrap_or(0.0);
                if label.fract() != 0.0 || label < 0.0 || label >= self.classes.len() as f64 {
                    return Err(wrong(format!(
                        "label {label} is none of the {} classes; count them from 0",
                        self.classes.len()
                    )));
                }
                Ok(Detection::new(box_px, score, label as u32).shifted(offset_px))
            })
            .collect()
    }
}

impl Detector for PyDetector {
    fn classes(&self) -> &[String] {
        &self.classes
    }

    fn reading(&self) -> Reading {
        self.reading
    }

    fn wants_pictures(&self) -> bool {
        self.wants_pictures
    }

    fn ask(&mut self, questions: Vec<Question>) {
        self.questions.extend(questions);
    }

    fn answer(&mut self) -> Result<Vec<Detection>, PartError> {
        let Some(question) = self.questions.pop_front() else {
            return Ok(Vec::new());
        };
        Python::attach(|py| {
            self.found(py, question).map_err(|error| {
                let line = self.raised.keep(py, error);
                format!("the detector in Python failed: {line}").into()
            })
        })
    }
}

/// What a pointing law is made for.
#[pyclass(frozen, get_all, module = "boresight")]
pub struct Plant {
    /// Time between two commands [s].
    dt_s: f64,
    /// Farthest that the mirror deflects the line of sight, to each side [rad].
    mirror_stroke_rad: f64,
    /// Fastest rates of azimuth and elevation [rad/s].
    rate_limits_radps: (f64, f64),
    /// Bandwidths of the rate loops of azimuth and elevation [Hz].
    bandwidths_hz: (f64, f64),
}

/// What a pointing law reads at the start of a tick. Azimuths run clockwise from north; deflections are right and up.
#[pyclass(frozen, module = "boresight")]
pub struct PointingInput {
    gimbal: GimbalParams,
    input: Input,
    aim: Aim,
    hand_over: Mutex<HandOver>,
}

impl PointingInput {
    fn hand_over(&self) -> std::sync::MutexGuard<'_, HandOver> {
        self.hand_over
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl PointingInput {
    /// Predicted azimuth and elevation of the line of sight [rad].
    ///
    /// Shape [2].
    #[getter]
    fn los_az_el_rad<'py>(&self, py: Python<'py>) -> Vector<'py> {
        two(py, DVec2::new(self.input.los.az_rad, self.input.los.el_rad))
    }

    /// Rates of that [rad/s].
    ///
    /// Shape [2].
    #[getter]
    fn los_rates_radps<'py>(&self, py: Python<'py>) -> Vector<'py> {
        let los = &self.input.los;
        two(py, DVec2::new(los.az_rate_radps, los.el_rate_radps))
    }

    /// Angles of azimuth and elevation still to turn [rad].
    ///
    /// Shape [2].
    #[getter]
    fn error_rad<'py>(&self, py: Python<'py>) -> Vector<'py> {
        two(py, self.aim.error_rad)
    }

    /// Rates of the line of sight relative to the moving base [rad/s].
    ///
    /// Shape [2].
    #[getter]
    fn rates_radps<'py>(&self, py: Python<'py>) -> Vector<'py> {
        two(py, self.aim.rates_radps)
    }

    /// Deflection by the mirror that would put the boresight on the target [rad].
    ///
    /// Shape [2].
    #[getter]
    fn deflection_rad<'py>(&self, py: Python<'py>) -> Vector<'py> {
        two(py, self.aim.deflection_rad)
    }

    /// Azimuth and elevation by the encoders [rad].
    ///
    /// Shape [2].
    #[getter]
    fn gimbal_az_el_rad<'py>(&self, py: Python<'py>) -> Vector<'py> {
        two(py, self.input.gimbal_az_el_rad)
    }

    /// Rates by the gyros [rad/s].
    ///
    /// Shape [2].
    #[getter]
    fn gimbal_rates_radps<'py>(&self, py: Python<'py>) -> Vector<'py> {
        two(py, self.input.gimbal_rates_radps)
    }

    /// Deflection by the mirror's sensor [rad].
    ///
    /// Shape [2].
    #[getter]
    fn mirror_rad<'py>(&self, py: Python<'py>) -> Vector<'py> {
        two(py, self.input.mirror_rad)
    }

    /// Rate of that [rad/s].
    ///
    /// Shape [2].
    #[getter]
    fn mirror_rates_radps<'py>(&self, py: Python<'py>) -> Vector<'py> {
        two(py, self.input.mirror_rates_radps)
    }

    /// Tilt of the base by its gyro, a rotation vector about east, north, up [rad].
    ///
    /// Shape [3].
    #[getter]
    fn base_tilt_rad<'py>(&self, py: Python<'py>) -> Vector<'py> {
        three(py, self.input.base_tilt_rad)
    }

    /// Angular velocity of the base by its gyro [rad/s].
    ///
    /// Shape [3].
    #[getter]
    fn base_rate_radps<'py>(&self, py: Python<'py>) -> Vector<'py> {
        three(py, self.input.base_rate_radps)
    }

    /// Rates for the gimbal [rad/s] that turn it to the target by these gains [1/s], and no faster than its motors can
    /// follow from the rate in force.
    ///
    /// Shape [2].
    fn gimbal_rates<'py>(&self, py: Python<'py>, gains_per_s: Pair) -> Vector<'py> {
        let present_radps = self.input.gimbal_rates_radps;
        let mut hand_over = self.hand_over();
        two(
            py,
            hand_over.gimbal_rates(&self.gimbal, gains_per_s.0, &self.aim, present_radps),
        )
    }

    /// Deflection to be set [rad] on the mirror's way to the one wanted [rad], at a bounded rate.
    ///
    /// Shape [2].
    fn mirror<'py>(&self, py: Python<'py>, wanted_rad: Pair) -> Vector<'py> {
        two(py, self.hand_over().mirror(wanted_rad.0.into()))
    }
}

/// A pointing law that is a Python object.
pub struct PyLaw {
    object: Arc<Py<PyAny>>,
    lead_s: f64,
    rests: bool,
    resting: bool,
    fault: Option<String>,
    raised: Raised,
}

impl Clone for PyLaw {
    /// A copy with a memory of its own. One that cannot be copied ends the run that goes on with it.
    fn clone(&self) -> Self {
        let copied = Python::attach(|py| {
            let copy = PyModule::import(py, "copy").and_then(|copy| copy.getattr("deepcopy"));
            let object = copy.and_then(|copy| copy.call1((self.object.bind(py),)));
            object
                .map(Bound::unbind)
                .map_err(|error| self.raised.keep(py, error))
        });
        let (object, fault) = match copied {
            Ok(object) => (Arc::new(object), self.fault.clone()),
            Err(line) => (self.object.clone(), Some(line)),
        };
        Self {
            object,
            fault,
            raised: self.raised.clone(),
            ..*self
        }
    }
}

impl std::fmt::Debug for PyLaw {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str("PyLaw")
    }
}

impl PyLaw {
    /// Makes one by calling `make` with the plant.
    pub fn new(py: Python, make: &Py<PyAny>, plant: &MountPlant, raised: Raised) -> PyResult<Self> {
        let axes = [&plant.gimbal.azimuth, &plant.gimbal.elevation];
        let plant = Plant {
            dt_s: plant.dt_s,
            mirror_stroke_rad: plant.mirror.stroke_rad,
            rate_limits_radps: axes.map(|axis| axis.rate_limit_radps).into(),
            bandwidths_hz: axes.map(|axis| axis.bandwidth_hz).into(),
        };
        let object = make.bind(py).call1((plant,))?;
        let lead_s = match object.getattr_opt("lead_s")? {
            Some(value) => value.extract()?,
            None => 0.0,
        };
        // A law without it fails here, and not in the middle of a run.
        object.getattr("command")?;
        Ok(Self {
            rests: object.hasattr("rest")?,
            object: Arc::new(object.unbind()),
            lead_s,
            resting: true,
            fault: None,
            raised,
        })
    }

    fn commands(&self, py: Python, input: &Bound<'_, PointingInput>) -> PyResult<PointingOutput> {
        let answer = self.object.bind(py).call_method1("command", (input,))?;
        let ([az, el], [right, up]): ([f64; 2], [f64; 2]) = answer.extract().map_err(|_| {
            PyTypeError::new_err(
                "command must return two pairs: rates of azimuth and elevation [rad/s], deflection right and up [rad]",
            )
        })?;
        if ![az, el, right, up].iter().all(|value| value.is_finite()) {
            return Err(PyValueError::new_err(format!(
                "command returned rates {az}, {el} rad/s and deflection {right}, {up} rad; they must be finite"
            )));
        }
        Ok(PointingOutput {
            gimbal: GimbalCommand {
                rate_radps: [az, el],
            },
            mirror_rad: DVec2::new(right, up),
        })
    }
}

impl PointingLaw for PyLaw {
    fn lead_s(&self) -> f64 {
        self.lead_s
    }

    fn command(
        &mut self,
        hand_over: &mut HandOver,
        gimbal: &GimbalParams,
        input: &Input,
    ) -> PointingOutput {
        self.resting = false;
        let said = Python::attach(|py| {
            let input = PointingInput {
                gimbal: *gimbal,
                input: *input,
                aim: Aim::new(gimbal, input, self.lead_s),
                hand_over: Mutex::new(*hand_over),
            };
            let said = Bound::new(py, input).and_then(|input| {
                let output = self.commands(py, &input)?;
                *hand_over = *input.get().hand_over();
                Ok(output)
            });
            said.map_err(|error| self.raised.keep(py, error))
        });
        said.unwrap_or_else(|line| {
            self.fault = Some(line);
            PointingOutput {
                gimbal: GimbalCommand {
                    rate_radps: [f64::NAN; 2],
                },
                mirror_rad: DVec2::NAN,
            }
        })
    }

    fn fault(&mut self) -> Option<String> {
        self.fault.take()
    }

    fn rest(&mut self) {
        // A station that searches rests in every tick.
        if !self.rests || std::mem::replace(&mut self.resting, true) {
            return;
        }
        Python::attach(|py| {
            if let Err(error) = self.object.bind(py).call_method0("rest") {
                self.fault = Some(self.raised.keep(py, error));
            }
        });
    }
}
