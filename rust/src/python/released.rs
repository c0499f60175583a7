//! Work without the GIL. Ctrl-C ends it, and panics become errors.

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::intern;
use pyo3::prelude::*;

use super::called::called_method;
use super::errors::StrandError;
use crate::parallel::{self, Caller};

const PATIENCE: Duration = Duration::from_millis(50); // longest time that a signal waits for its handler
const FEW_ITEMS: usize = 20_000; // items whose work takes less time than that
pub(super) const CHEAP: usize = 16; // points that count as one item, where each takes some nanoseconds
const HANDING_OVER: usize = 200_000; // work for which waking other threads pays, nanoseconds at least

thread_local! {
    /// The process in which this thread is known to be Python's main one. After a fork, another thread may be that.
    static MAIN_IN: Cell<Option<u32>> = const { Cell::new(None) };
}

/// The place of the last panic.
static PLACE: Mutex<String> = Mutex::new(String::new());

/// Runs `work` in the pool without the GIL.
///
/// If Python's main thread calls, signal handlers run meanwhile. If a handler raises, the call ends at once. The work
/// owns all its data, ends on its own soon after, and its answer is dropped.
///
/// # Errors
/// The error of a signal handler; `StrandError` if the work panics.
pub(super) fn released<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> T + Send + 'static,
) -> PyResult<T> {
    let (caller, patience) = match is_main_thread(py)? {
        true => (Caller::Hasty, Some(PATIENCE)),
        false => (Caller::Patient, None),
    };
    let mut begun = match py.detach(|| parallel::begin(caller, work)) {
        Ok(begun) => begun,
        Err(work) => return py.detach(|| catch_unwind(AssertUnwindSafe(work))).map_err(internal),
    };
    loop {
        if let Some(answer) = py.detach(|| begun.wait(patience)) {
            return answer.map_err(internal);
        }
        if let Err(raised) = py.check_signals() {
            begun.give_up();
            return Err(raised);
        }
    }
}

/// Runs `work` as [`released`] does; at once if it has few items, because handing over costs more.
///
/// # Errors
/// As [`released`].
pub(super) fn released_if_many<T: Send + 'static>(
    py: Python<'_>,
    things: usize,
    work: impl FnOnce() -> T + Send + 'static,
) -> PyResult<T> {
    if things > FEW_ITEMS { released(py, work) } else { guarded(work) }
}

/// Runs `work` as [`released`] does; at once if it is shorter than handing it over.
///
/// `nanoseconds` is about how long it takes on one thread. Python's main thread works alone and keeps the GIL. Other
/// threads may be many, so they make no pools of their own: they release the GIL and share the pool.
///
/// # Errors
/// As [`released`].
pub(super) fn released_if_long<T: Send + 'static>(
    py: Python<'_>,
    nanoseconds: usize,
    work: impl FnOnce() -> T + Send + 'static,
) -> PyResult<T> {
    if nanoseconds >= HANDING_OVER {
        return released(py, work);
    }
    match is_main_thread(py)? {
        true => guarded(|| parallel::alone(work)),
        false => py.detach(|| catch_unwind(AssertUnwindSafe(work))).map_err(internal),
    }
}

/// Runs `work` at once.
///
/// # Errors
/// `StrandError` if it panics.
pub(super) fn guarded<T>(work: impl FnOnce() -> T) -> PyResult<T> {
    catch_unwind(AssertUnwindSafe(work)).map_err(internal)
}

/// Makes panics report their place in an error, not on the standard error stream.
pub(super) fn keep_panics_quiet() {
    std::panic::set_hook(Box::new(|info| {
        let place = info.location().map(|place| format!(" at {}:{}", place.file(), place.line()));
        *PLACE.lock().unwrap_or_else(PoisonError::into_inner) = place.unwrap_or_default();
    }));
}

/// Converts a panic to an error.
#[allow(clippy::needless_pass_by_value)]
fn internal(panic: Box<dyn Any + Send>) -> PyErr {
    if parallel::was_given_up(panic.as_ref()) {
        return PyKeyboardInterrupt::new_err("the call was given up with another");
    }
    let text = match (panic.downcast_ref::<&str>(), panic.downcast_ref::<String>()) {
        (Some(text), _) => text,
        (_, Some(text)) => text.as_str(),
        _ => "a panic",
    };
    let place = PLACE.lock().unwrap_or_else(PoisonError::into_inner);
    StrandError::new_err(format!("internal error: {text}{place}; please report this"))
}

/// Returns whether the calling thread is the one that runs signal handlers.
fn is_main_thread(py: Python<'_>) -> PyResult<bool> {
    let process = Some(std::process::id());
    if MAIN_IN.get() == process {
        return Ok(true);
    }
    let threading = py.import(intern!(py, "threading"))?;
    let main = called_method(&threading, "main_thread", ())?;
    // a property in Python
    let ident = called_method(&main, "__getattribute__", ("ident",))?;
    let is_main = threading.call_method0(intern!(py, "get_ident"))?.eq(ident)?;
    if is_main {
        MAIN_IN.set(process);
    }
    Ok(is_main)
}
