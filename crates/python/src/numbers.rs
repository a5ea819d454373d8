//! Numbers as Python has them: fresh arrays, pairs, dictionaries. Each tells its type to the stubs, which the libraries'
//! own do not.

use boresight::models::maths::kinematics::Pose;
use glam::{DMat3, DQuat, DVec2, DVec3};
use numpy::{Element, Ix1, Ix2, Ix3, PyArray, PyArray1, PyArrayMethods};
use pyo3::inspect::{PyStaticExpr, PyStaticOperator};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::convert::Infallible;

/// A fresh array.
pub struct Array<'py, T, D>(Bound<'py, PyArray<T, D>>);

/// A vector of float64.
pub type Vector<'py> = Array<'py, f64, Ix1>;
/// A matrix of float64.
pub type Matrix<'py> = Array<'py, f64, Ix2>;
/// A picture of uint8: rows, columns, colours.
pub type Pixels<'py> = Array<'py, u8, Ix3>;

/// A number that NumPy has a name for.
pub trait Number: Element {
    /// The name.
    const NAME: &'static str;
}

impl Number for f64 {
    const NAME: &'static str = "float64";
}

impl Number for u8 {
    const NAME: &'static str = "uint8";
}

/// A name of a module, for the stubs.
const fn named(module: &'static PyStaticExpr, name: &'static str) -> PyStaticExpr {
    PyStaticExpr::Attribute {
        value: module,
        attr: name,
    }
}

const NUMPY: PyStaticExpr = PyStaticExpr::Name { id: "numpy" };
const TYPING: PyStaticExpr = PyStaticExpr::Name { id: "typing" };
const NUMPY_TYPING: PyStaticExpr = PyStaticExpr::Name { id: "numpy.typing" };
const ABC: PyStaticExpr = PyStaticExpr::Name {
    id: "collections.abc",
};

impl<'py, T: Number, D> IntoPyObject<'py> for Array<'py, T, D> {
    type Target = PyArray<T, D>;
    type Output = Bound<'py, Self::Target>;
    type Error = Infallible;

    const OUTPUT_TYPE: PyStaticExpr = PyStaticExpr::Subscript {
        value: &named(&NUMPY_TYPING, "NDArray"),
        slice: &named(&NUMPY, T::NAME),
    };

    fn into_pyobject(self, _: Python<'py>) -> Result<Self::Output, Self::Error> {
        Ok(self.0)
    }
}

/// Two numbers that Python gives.
pub struct Pair(pub [f64; 2]);

impl<'a, 'py> FromPyObject<'a, 'py> for Pair {
    type Error = PyErr;

    const INPUT_TYPE: PyStaticExpr = PyStaticExpr::BinOp {
        left: &PyStaticExpr::Subscript {
            value: &named(&ABC, "Sequence"),
            slice: &PyStaticExpr::Name { id: "float" },
        },
        op: PyStaticOperator::BitOr,
        right: &Vector::OUTPUT_TYPE,
    };

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        object.extract().map(Self)
    }
}

/// Fields by their names.
pub struct Fields<'py>(pub Bound<'py, PyDict>);

impl<'py> IntoPyObject<'py> for Fields<'py> {
    type Target = PyDict;
    type Output = Bound<'py, PyDict>;
    type Error = Infallible;

    const OUTPUT_TYPE: PyStaticExpr = PyStaticExpr::Subscript {
        value: &PyStaticExpr::Name { id: "dict" },
        slice: &PyStaticExpr::Tuple {
            elts: &[PyStaticExpr::Name { id: "str" }, named(&TYPING, "Any")],
        },
    };

    fn into_pyobject(self, _: Python<'py>) -> Result<Self::Output, Self::Error> {
        Ok(self.0)
    }
}

/// Two numbers.
pub fn two(py: Python<'_>, vector: DVec2) -> Vector<'_> {
    Array(PyArray1::from_slice(py, &vector.to_array()))
}

/// Three numbers.
pub fn three(py: Python<'_>, vector: DVec3) -> Vector<'_> {
    Array(PyArray1::from_slice(py, &vector.to_array()))
}

/// A rotation, as the 3 × 3 matrix that turns a column vector.
pub fn rotation(py: Python<'_>, q: DQuat) -> PyResult<Matrix<'_>> {
    let rows = DMat3::from_quat(q).transpose().to_cols_array();
    PyArray1::from_slice(py, &rows).reshape([3, 3]).map(Array)
}

/// A pose, as the 4 × 4 matrix that takes a camera's points (right, down, forward) to east, north, up [m].
pub fn pose<'py>(py: Python<'py>, pose: &Pose) -> PyResult<Matrix<'py>> {
    let turn = DMat3::from_quat(pose.q_enu_cam);
    let r = pose.r_enu_m;
    let rows: Vec<f64> = (0..3)
        .flat_map(|row| [turn.row(row).x, turn.row(row).y, turn.row(row).z, r[row]])
        .chain([0.0, 0.0, 0.0, 1.0])
        .collect();
    PyArray1::from_slice(py, &rows).reshape([4, 4]).map(Array)
}

/// Pixels of a picture of that width and height [px], three bytes each, row by row.
pub fn pixels<'py>(py: Python<'py>, rgb8: &[u8], size_px: [u32; 2]) -> PyResult<Pixels<'py>> {
    let [width, height] = size_px.map(|side| side as usize);
    let shape = [height, width, 3];
    PyArray1::from_slice(py, rgb8).reshape(shape).map(Array)
}
