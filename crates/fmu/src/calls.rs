//! The life of an instance: made, initialised, stepped, ended.

use crate::guard::{ERROR, Instance, Log, Logger, Status, call, said, text};
use crate::station::Station;
use std::ffi::{c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::ptr::null_mut;

/// The version of the standard.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

/// Errors are always logged, and nothing else is.
///
/// # Safety
///
/// As FMI 3.0 says: the instance is one of this library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetDebugLogging(
    instance: *mut Instance,
    _logging_on: u8,
    _categories_count: usize,
    _categories: *const *const c_char,
) -> Status {
    // SAFETY: by this function's own condition.
    unsafe { call(instance, "fmi3SetDebugLogging", |_| Ok(())) }
}

/// Makes an instance for co-simulation; null where that fails, with a line to the log.
///
/// # Safety
///
/// As FMI 3.0 says: texts end with a zero, and the log's function and environment live as long as the instance.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateCoSimulation(
    _instance_name: *const c_char,
    instantiation_token: *const c_char,
    resource_path: *const c_char,
    _visible: u8,
    _logging_on: u8,
    event_mode_used: u8,
    _early_return_allowed: u8,
    _required_intermediate_variables: *const u32,
    required_intermediate_variables_count: usize,
    instance_environment: *mut c_void,
    log_message: Log,
    _intermediate_update: *const c_void,
) -> *mut Instance {
    let logger = Logger::new(instance_environment, log_message);
    let made = catch_unwind(AssertUnwindSafe(|| {
        if event_mode_used != 0 {
            return Err("has no event mode".to_owned());
        }
        if required_intermediate_variables_count != 0 {
            return Err("has no intermediate variables".to_owned());
        }
        // SAFETY: by this function's own condition.
        let [token, resources] = unsafe { [text(instantiation_token), text(resource_path)] };
        let token = token.ok_or("the instantiation token is no text")?;
        let resources = resources.ok_or("the resource path is no text")?;
        // Some importers give the address that FMI 2.0 had.
        let resources = resources.strip_prefix("file://").unwrap_or(resources);
        Station::open(Path::new(resources), token).map_err(|error| error.to_string())
    }));
    let why = match made {
        Ok(Ok(station)) => return Instance::hand_over(logger, station),
        Ok(Err(why)) => why,
        Err(panic) => format!(
            "a fault of the program, please report it: {}",
            said(&*panic)
        ),
    };
    logger.say(ERROR, &format!("fmi3InstantiateCoSimulation: {why}"));
    null_mut()
}

/// Ends an instance.
///
/// # Safety
///
/// As FMI 3.0 says: the instance is null or one of this library, and is used no more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeInstance(instance: *mut Instance) {
    // SAFETY: by this function's own condition.
    unsafe { Instance::take_back(instance) }
}

/// Begins to initialise it.
///
/// # Safety
///
/// As FMI 3.0 says: the instance is one of this library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3EnterInitializationMode(
    instance: *mut Instance,
    _tolerance_defined: u8,
    _tolerance: f64,
    start_time: f64,
    _stop_time_defined: u8,
    _stop_time: f64,
) -> Status {
    // SAFETY: by this function's own condition.
    unsafe {
        call(instance, "fmi3EnterInitializationMode", |station| {
            station.enter_initialization(start_time)
        })
    }
}

/// Builds the run.
///
/// # Safety
///
/// As FMI 3.0 says: the instance is one of this library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3ExitInitializationMode(instance: *mut Instance) -> Status {
    // SAFETY: by this function's own condition.
    unsafe {
        call(
            instance,
            "fmi3ExitInitializationMode",
            Station::exit_initialization,
        )
    }
}

/// Ends the run; its variables can still be got.
///
/// # Safety
///
/// As FMI 3.0 says: the instance is one of this library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3Terminate(instance: *mut Instance) -> Status {
    // SAFETY: by this function's own condition.
    unsafe { call(instance, "fmi3Terminate", Station::terminate) }
}

/// Makes it as it was after instantiation.
///
/// # Safety
///
/// As FMI 3.0 says: the instance is one of this library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3Reset(instance: *mut Instance) -> Status {
    // SAFETY: by this function's own condition.
    unsafe {
        call(instance, "fmi3Reset", |station| {
            station.reset();
            Ok(())
        })
    }
}

/// Lets time pass; the step is a whole number of ticks.
///
/// # Safety
///
/// As FMI 3.0 says: the instance is one of this library, and the pointers lead to values of their types.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3DoStep(
    instance: *mut Instance,
    current_communication_point: f64,
    communication_step_size: f64,
    _no_set_fmu_state_prior_to_current_point: u8,
    event_handling_needed: *mut u8,
    terminate_simulation: *mut u8,
    early_return: *mut u8,
    last_successful_time: *mut f64,
) -> Status {
    // SAFETY: by this function's own condition.
    unsafe {
        call(instance, "fmi3DoStep", |station| {
            for flag in [event_handling_needed, terminate_simulation, early_return] {
                put(flag, 0);
            }
            put(last_successful_time, current_communication_point);
            let stepped = station.step(current_communication_point, communication_step_size)?;
            put(terminate_simulation, stepped.over.into());
            put(last_successful_time, stepped.t_s);
            Ok(())
        })
    }
}

/// Writes a value where there is a place for it.
///
/// # Safety
///
/// The pointer is null or leads to a value of its type.
unsafe fn put<T>(place: *mut T, value: T) {
    // SAFETY: by this function's own condition.
    if let Some(place) = unsafe { place.as_mut() } {
        *place = value;
    }
}

/// A unit is always in step mode once it is initialised.
///
/// # Safety
///
/// As FMI 3.0 says: the instance is one of this library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3EnterStepMode(instance: *mut Instance) -> Status {
    // SAFETY: by this function's own condition.
    unsafe {
        call(instance, "fmi3EnterStepMode", |_| {
            Err("is not offered: there is no event mode to leave".to_owned())
        })
    }
}

/// What an importer checks at compile time of this library: an instance that nobody has is an error, and no crash.
#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::{fmi3GetFloat64, fmi3SetBoolean};
    use std::ffi::{CStr, CString};
    use std::sync::Mutex;

    static LINES: Mutex<Vec<String>> = Mutex::new(Vec::new());

    unsafe extern "C" fn keep(
        _: *mut c_void,
        status: Status,
        _: *const c_char,
        line: *const c_char,
    ) {
        let line = unsafe { CStr::from_ptr(line) }
            .to_string_lossy()
            .into_owned();
        LINES.lock().unwrap().push(format!("{status} {line}"));
    }

    #[test]
    fn nothing_is_no_instance() {
        unsafe {
            assert_eq!(fmi3Terminate(null_mut()), ERROR);
            assert_eq!(fmi3Reset(null_mut()), ERROR);
            fmi3FreeInstance(null_mut());
            let mut x = 0.0;
            assert_eq!(fmi3GetFloat64(null_mut(), &0, 1, &mut x, 1), ERROR);
            assert_eq!(fmi3SetBoolean(null_mut(), &0, 1, &1, 1), ERROR);
        }
        assert_eq!(unsafe { CStr::from_ptr(fmi3GetVersion()) }, c"3.0");
    }

    #[test]
    fn what_cannot_be_made_is_null_and_says_why() {
        let token = CString::new("of another").unwrap();
        let folder = CString::new("/nonexistent/resources").unwrap();
        let made = unsafe {
            fmi3InstantiateCoSimulation(
                token.as_ptr(),
                token.as_ptr(),
                folder.as_ptr(),
                0,
                0,
                0,
                0,
                std::ptr::null(),
                0,
                null_mut(),
                Some(keep),
                std::ptr::null(),
            )
        };
        assert!(made.is_null());
        let lines = LINES.lock().unwrap();
        assert!(lines.iter().any(|line| line.starts_with("3 fmi3Instantiate") && line.contains("scenario.toml")));
    }
}
