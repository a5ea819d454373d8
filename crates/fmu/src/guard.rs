//! The border: C's types, instances behind pointers, and what is said of a call that fails.

use crate::station::Station;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// fmi3Status.
pub type Status = c_int;
/// The call was carried out.
pub const OK: Status = 0;
/// It was refused, or failed; the instance may only be freed or reset.
pub const ERROR: Status = 3;
/// Nothing of the instance can be used any more.
pub const FATAL: Status = 4;

/// fmi3LogMessageCallback.
pub type Log = Option<unsafe extern "C" fn(*mut c_void, Status, *const c_char, *const c_char)>;

/// Category of what is logged.
const CATEGORY: &CStr = c"logStatusError";

/// Where a unit says what went wrong.
#[derive(Clone, Copy)]
pub struct Logger {
    environment: *mut c_void,
    log: Log,
}

impl Logger {
    /// The importer's own.
    pub fn new(environment: *mut c_void, log: Log) -> Self {
        Self { environment, log }
    }

    /// Says a line.
    pub fn say(&self, status: Status, line: &str) {
        let Some(log) = self.log else { return };
        let text: String = line.chars().filter(|c| *c != '\0').collect();
        let Ok(text) = CString::new(text) else { return };
        // SAFETY: the importer gave the function and its environment for this, for as long as the instance lives; both
        // texts end with a zero and live until it returns.
        unsafe { log(self.environment, status, CATEGORY.as_ptr(), text.as_ptr()) };
    }
}

/// An instance, as the importer holds a pointer to it.
pub struct Instance {
    /// Where it says what went wrong.
    pub logger: Logger,
    /// The simulation.
    pub station: Station,
    /// Nothing of it can be used any more.
    dead: bool,
}

impl Instance {
    /// Gives an instance to the importer.
    pub fn hand_over(logger: Logger, station: Station) -> *mut Self {
        Box::into_raw(Box::new(Self {
            logger,
            station,
            dead: false,
        }))
    }

    /// Takes one back.
    ///
    /// # Safety
    ///
    /// The pointer is null or one that was handed over, and is used no more.
    pub unsafe fn take_back(instance: *mut Self) {
        if instance.is_null() {
            return;
        }
        // SAFETY: by this function's own condition.
        let instance = unsafe { Box::from_raw(instance) };
        // Even what ends badly ends here.
        let _ = catch_unwind(AssertUnwindSafe(move || drop(instance)));
    }
}

/// Carries out a call on an instance. An error is logged; a panic kills the instance and no more.
///
/// # Safety
///
/// The pointer is null or one that was handed over and not taken back, and no other call on it goes on.
pub unsafe fn call(
    instance: *mut Instance,
    name: &str,
    work: impl FnOnce(&mut Station) -> Result<(), String>,
) -> Status {
    // SAFETY: by this function's own condition.
    let Some(instance) = (unsafe { instance.as_mut() }) else {
        return ERROR;
    };
    let logger = instance.logger;
    if instance.dead {
        logger.say(
            FATAL,
            &format!("{name}: the instance has failed before: free it"),
        );
        return FATAL;
    }
    let station = &mut instance.station;
    match catch_unwind(AssertUnwindSafe(|| work(station))) {
        Ok(Ok(())) => OK,
        Ok(Err(why)) => {
            logger.say(ERROR, &format!("{name}: {why}"));
            ERROR
        }
        Err(panic) => {
            instance.dead = true;
            logger.say(
                FATAL,
                &format!(
                    "{name}: a fault of the program, please report it: {}",
                    said(&*panic)
                ),
            );
            FATAL
        }
    }
}

/// What a panic says.
pub fn said(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(ToString::to_string);
    text.or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_default()
}

/// A text of the importer's; none where the pointer is null.
///
/// # Safety
///
/// The pointer is null or leads to a text that ends with a zero and lives as long as what is returned.
pub unsafe fn text<'a>(pointer: *const c_char) -> Option<&'a str> {
    if pointer.is_null() {
        return None;
    }
    // SAFETY: by this function's own condition.
    unsafe { CStr::from_ptr(pointer) }.to_str().ok()
}

/// A row of the importer's; empty where there is none.
///
/// # Safety
///
/// The pointer is null or leads to so many values, which live as long as what is returned.
pub unsafe fn row<'a, T>(pointer: *const T, count: usize) -> &'a [T] {
    match pointer.is_null() || count == 0 {
        true => &[],
        // SAFETY: by this function's own condition.
        false => unsafe { std::slice::from_raw_parts(pointer, count) },
    }
}

/// The same, to be written.
///
/// # Safety
///
/// As for [`row`], and nobody else uses it meanwhile.
pub unsafe fn row_mut<'a, T>(pointer: *mut T, count: usize) -> &'a mut [T] {
    match pointer.is_null() || count == 0 {
        true => &mut [],
        // SAFETY: by this function's own condition.
        false => unsafe { std::slice::from_raw_parts_mut(pointer, count) },
    }
}
