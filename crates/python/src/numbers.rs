//! Vectors and matrices as fresh arrays of float64.

use boresight::models::maths::kinematics::Pose;
use glam::{DMat3, DQuat, DVec2, DVec3};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

/// A vector.
pub type Vector<'py> = Bound<'py, PyArray1<f64>>;
/// A matrix.
pub type Matrix<'py> = Bound<'py, PyArray2<f64>>;

/// Two numbers.
pub fn two(py: Python<'_>, vector: DVec2) -> Vector<'_> {
    PyArray1::from_slice(py, &vector.to_array())
}

/// Three numbers.
pub fn three(py: Python<'_>, vector: DVec3) -> Vector<'_> {
    PyArray1::from_slice(py, &vector.to_array())
}

/// A rotation, as the 3 × 3 matrix that turns a column vector.
pub fn rotation(py: Python<'_>, q: DQuat) -> PyResult<Matrix<'_>> {
    let rows = DMat3::from_quat(q).transpose().to_cols_array();
    PyArray1::from_slice(py, &rows).reshape([3, 3])
}

/// A pose, as the 4 × 4 matrix that takes a camera's points (right, down, forward) to east, north, up [m].
pub fn pose<'py>(py: Python<'py>, pose: &Pose) -> PyResult<Matrix<'py>> {
    let turn = DMat3::from_quat(pose.q_enu_cam);
    let r = pose.r_enu_m;
    let rows: Vec<f64> = (0..3)
        .flat_map(|row| [turn.row(row).x, turn.row(row).y, turn.row(row).z, r[row]])
        .chain([0.0, 0.0, 0.0, 1.0])
        .collect();
    PyArray1::from_slice(py, &rows).reshape([4, 4])
}
