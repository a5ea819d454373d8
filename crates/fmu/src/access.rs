//! Getting and setting variables.

use crate::guard::{Instance, Status, call, row, row_mut};
use crate::station::Value;

/// One getter and one setter of a type that variables are of.
macro_rules! access {
    ($($get:ident $set:ident $of:ty: $value:ident;)*) => {$(
        /// Gets variables of this type.
        ///
        /// # Safety
        ///
        /// As FMI 3.0 says: the instance is one of this library, and the rows are as long as their counts say.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $get(
            instance: *mut Instance,
            references: *const u32,
            references_count: usize,
            values: *mut $of,
            values_count: usize,
        ) -> Status {
            // SAFETY: by this function's own condition.
            unsafe {
                call(instance, stringify!($get), |station| {
                    let references = row(references, references_count);
                    let values = row_mut(values, values_count);
                    same_length(references.len(), values.len())?;
                    for (number, place) in references.iter().zip(values) {
                        match station.get(*number)? {
                            Value::$value(value) => *place = value,
                            _ => return Err(format!("variable {number}: is of another type")),
                        }
                    }
                    Ok(())
                })
            }
        }

        /// Sets variables of this type.
        ///
        /// # Safety
        ///
        /// As FMI 3.0 says: the instance is one of this library, and the rows are as long as their counts say.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $set(
            instance: *mut Instance,
            references: *const u32,
            references_count: usize,
            values: *const $of,
            values_count: usize,
        ) -> Status {
            // SAFETY: by this function's own condition.
            unsafe {
                call(instance, stringify!($set), |station| {
                    let references = row(references, references_count);
                    let values = row(values, values_count);
                    same_length(references.len(), values.len())?;
                    let mut all = references.iter().zip(values);
                    all.try_for_each(|(number, value)| station.set(*number, Value::$value(*value)))
                })
            }
        }
    )*};
}

fn same_length(references: usize, values: usize) -> Result<(), String> {
    match references == values {
        true => Ok(()),
        false => Err(format!(
            "{references} variables have {values} values; each has one"
        )),
    }
}

access! {
    fmi3GetFloat64 fmi3SetFloat64 f64: Float64;
    fmi3GetInt64 fmi3SetInt64 i64: Int64;
    fmi3GetUInt64 fmi3SetUInt64 u64: UInt64;
}

/// Gets variables that are yes or no.
///
/// # Safety
///
/// As FMI 3.0 says: the instance is one of this library, and the rows are as long as their counts say.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetBoolean(
    instance: *mut Instance,
    references: *const u32,
    references_count: usize,
    values: *mut u8,
    values_count: usize,
) -> Status {
    // SAFETY: by this function's own condition; C's bool is a byte.
    unsafe {
        call(instance, "fmi3GetBoolean", |station| {
            let references = row(references, references_count);
            let values = row_mut(values, values_count);
            same_length(references.len(), values.len())?;
            for (number, place) in references.iter().zip(values) {
                match station.get(*number)? {
                    Value::Boolean(value) => *place = value.into(),
                    _ => return Err(format!("variable {number}: is of another type")),
                }
            }
            Ok(())
        })
    }
}

/// Sets variables that are yes or no.
///
/// # Safety
///
/// As FMI 3.0 says: the instance is one of this library, and the rows are as long as their counts say.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetBoolean(
    instance: *mut Instance,
    references: *const u32,
    references_count: usize,
    values: *const u8,
    values_count: usize,
) -> Status {
    // SAFETY: by this function's own condition; C's bool is a byte, and one that is neither 0 nor 1 does no harm as such.
    unsafe {
        call(instance, "fmi3SetBoolean", |station| {
            let references = row(references, references_count);
            let values = row(values, values_count);
            same_length(references.len(), values.len())?;
            let mut all = references.iter().zip(values);
            all.try_for_each(|(number, value)| station.set(*number, Value::Boolean(*value != 0)))
        })
    }
}
