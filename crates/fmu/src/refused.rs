//! Functions of the standard that are not offered. Each says so in the log.

use crate::guard::{Instance, Log, Logger, Status, call};
use std::ffi::{c_char, c_int, c_void};
use std::ptr::null_mut;

macro_rules! refused {
    ($($name:ident($($argument:ty),*);)*) => {$(
        /// Is not offered: returns fmi3Error, and says so.
        ///
        /// # Safety
        ///
        /// As FMI 3.0 says: the instance is one of this library.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(instance: *mut Instance $(, _: $argument)*) -> Status {
            // SAFETY: by this function's own condition.
            unsafe { call(instance, stringify!($name), |_| Err("is not offered by this unit".to_owned())) }
        }
    )*};
}

type In<T> = *const T;
type Out<T> = *mut T;
type State = *mut c_void;

refused! {
    fmi3EnterEventMode();
    fmi3EnterConfigurationMode();
    fmi3ExitConfigurationMode();

    fmi3GetFloat32(In<u32>, usize, Out<f32>, usize);
    fmi3GetInt8(In<u32>, usize, Out<i8>, usize);
    fmi3GetUInt8(In<u32>, usize, Out<u8>, usize);
    fmi3GetInt16(In<u32>, usize, Out<i16>, usize);
    fmi3GetUInt16(In<u32>, usize, Out<u16>, usize);
    fmi3GetInt32(In<u32>, usize, Out<i32>, usize);
    fmi3GetUInt32(In<u32>, usize, Out<u32>, usize);
    fmi3GetString(In<u32>, usize, Out<*const c_char>, usize);
    fmi3GetBinary(In<u32>, usize, Out<usize>, Out<*const u8>, usize);
    fmi3GetClock(In<u32>, usize, Out<u8>);
    fmi3SetFloat32(In<u32>, usize, In<f32>, usize);
    fmi3SetInt8(In<u32>, usize, In<i8>, usize);
    fmi3SetUInt8(In<u32>, usize, In<u8>, usize);
    fmi3SetInt16(In<u32>, usize, In<i16>, usize);
    fmi3SetUInt16(In<u32>, usize, In<u16>, usize);
    fmi3SetInt32(In<u32>, usize, In<i32>, usize);
    fmi3SetUInt32(In<u32>, usize, In<u32>, usize);
    fmi3SetString(In<u32>, usize, In<*const c_char>, usize);
    fmi3SetBinary(In<u32>, usize, In<usize>, In<*const u8>, usize);
    fmi3SetClock(In<u32>, usize, In<u8>);

    fmi3GetNumberOfVariableDependencies(u32, Out<usize>);
    fmi3GetVariableDependencies(u32, Out<usize>, Out<u32>, Out<usize>, Out<c_int>, usize);

    fmi3GetFMUState(Out<State>);
    fmi3SetFMUState(State);
    fmi3FreeFMUState(Out<State>);
    fmi3SerializedFMUStateSize(State, Out<usize>);
    fmi3SerializeFMUState(State, Out<u8>, usize);
    fmi3DeserializeFMUState(In<u8>, usize, Out<State>);

    fmi3GetDirectionalDerivative(In<u32>, usize, In<u32>, usize, In<f64>, usize, Out<f64>, usize);
    fmi3GetAdjointDerivative(In<u32>, usize, In<u32>, usize, In<f64>, usize, Out<f64>, usize);
    fmi3GetOutputDerivatives(In<u32>, usize, In<i32>, Out<f64>, usize);

    fmi3GetIntervalDecimal(In<u32>, usize, Out<f64>, Out<c_int>);
    fmi3GetIntervalFraction(In<u32>, usize, Out<u64>, Out<u64>, Out<c_int>);
    fmi3GetShiftDecimal(In<u32>, usize, Out<f64>);
    fmi3GetShiftFraction(In<u32>, usize, Out<u64>, Out<u64>);
    fmi3SetIntervalDecimal(In<u32>, usize, In<f64>);
    fmi3SetIntervalFraction(In<u32>, usize, In<u64>, In<u64>);
    fmi3SetShiftDecimal(In<u32>, usize, In<f64>);
    fmi3SetShiftFraction(In<u32>, usize, In<u64>, In<u64>);
    fmi3EvaluateDiscreteStates();
    fmi3UpdateDiscreteStates(Out<u8>, Out<u8>, Out<u8>, Out<u8>, Out<u8>, Out<f64>);

    fmi3EnterContinuousTimeMode();
    fmi3CompletedIntegratorStep(u8, Out<u8>, Out<u8>);
    fmi3SetTime(f64);
    fmi3SetContinuousStates(In<f64>, usize);
    fmi3GetContinuousStateDerivatives(Out<f64>, usize);
    fmi3GetEventIndicators(Out<f64>, usize);
    fmi3GetContinuousStates(Out<f64>, usize);
    fmi3GetNominalsOfContinuousStates(Out<f64>, usize);
    fmi3GetNumberOfEventIndicators(Out<usize>);
    fmi3GetNumberOfContinuousStates(Out<usize>);

    fmi3ActivateModelPartition(u32, f64);
}

fn not_this_kind(environment: *mut c_void, log: Log, name: &str) -> *mut Instance {
    let line = format!("{name}: is not offered: the unit is for co-simulation");
    Logger::new(environment, log).say(crate::guard::ERROR, &line);
    null_mut()
}

/// Is not offered: returns null, and says so.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateModelExchange(
    _instance_name: *const c_char,
    _instantiation_token: *const c_char,
    _resource_path: *const c_char,
    _visible: u8,
    _logging_on: u8,
    instance_environment: *mut c_void,
    log_message: Log,
) -> *mut Instance {
    not_this_kind(
        instance_environment,
        log_message,
        "fmi3InstantiateModelExchange",
    )
}

/// Is not offered: returns null, and says so.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateScheduledExecution(
    _instance_name: *const c_char,
    _instantiation_token: *const c_char,
    _resource_path: *const c_char,
    _visible: u8,
    _logging_on: u8,
    instance_environment: *mut c_void,
    log_message: Log,
    _clock_update: *const c_void,
    _lock_preemption: *const c_void,
    _unlock_preemption: *const c_void,
) -> *mut Instance {
    not_this_kind(
        instance_environment,
        log_message,
        "fmi3InstantiateScheduledExecution",
    )
}
