//! Stopping a command from outside: the first Ctrl-C or SIGTERM asks for it, the second ends the program at once.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

/// Number of the signal that came; 0 before. A signal is of the whole process.
static ASKED: OnceLock<Arc<AtomicUsize>> = OnceLock::new();

/// What a process ends with after a signal: this and the signal's number.
const BY_SIGNAL: i32 = 128;

/// What asked a command to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// Ctrl-C (SIGINT).
    Interrupt,
    /// SIGTERM.
    Terminate,
}

impl Stop {
    /// Its name in a sentence.
    pub fn name(self) -> &'static str {
        match self {
            Self::Interrupt => "Ctrl-C",
            Self::Terminate => "SIGTERM",
        }
    }

    /// What the program ends with: 130 or 143, as after the signal itself.
    pub fn exit_code(self) -> u8 {
        let signal = match self {
            Self::Interrupt => SIGINT,
            Self::Terminate => SIGTERM,
        };
        (BY_SIGNAL + signal) as u8
    }
}

/// Begins to listen: from now on the first signal only asks, and [`asked`] tells of it. Where the system allows no
/// handler, a signal ends the program.
pub fn listen() {
    ASKED.get_or_init(|| {
        let asked = Arc::new(AtomicUsize::new(0));
        let once = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            // In the order in which a signal meets them: the first finds nothing to end.
            let _ = flag::register_conditional_shutdown(signal, BY_SIGNAL + signal, once.clone())
                .and_then(|_| flag::register(signal, once.clone()))
                .and_then(|_| flag::register_usize(signal, asked.clone(), signal as usize));
        }
        asked
    });
}

/// What asked the command to stop, if anything has.
pub fn asked() -> Option<Stop> {
    let signal = ASKED.get()?.load(Ordering::Relaxed);
    match i32::try_from(signal) {
        Ok(SIGINT) => Some(Stop::Interrupt),
        Ok(SIGTERM) => Some(Stop::Terminate),
        _ => None,
    }
}

/// What a command that was asked to stop says of it: what there is, and how to go on.
pub fn said(there: &str) -> Option<String> {
    asked().map(|stop| format!("stopped by {}: {there}", stop.name()))
}
