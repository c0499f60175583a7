//! Work without the GIL. Ctrl-C ends it, and panics become errors.

use std::any::Any;
use std::cell::RefCell;
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

thread_local! {
    /// The exception of a signal handler that ended this thread's work.
    static RAISED: RefCell<Option<PyErr>> = const { RefCell::new(None) };
}

/// The place of the last panic.
static PLACE: Mutex<String> = Mutex::new(String::new());

/// Runs `work` without the GIL: in the pool, or on Python's main thread itself if one thread shall do all the work.
///
/// If Python's main thread calls, signal handlers run meanwhile. If a handler raises, the call ends at once. Work in the
/// pool owns all its data, ends on its own soon after, and its answer is dropped.
///
/// # Errors
/// The error of a signal handler; `StrandError` if the work panics.
pub(super) fn released<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> T + Send + 'static,
) -> PyResult<T> {
    let main = is_main_thread(py)?;
    if main && parallel::num_threads() == 1 {
        let answer = py.detach(|| parallel::watched(run_handlers, PATIENCE, work));
        return answer.map_err(|panic| RAISED.take().unwrap_or_else(|| internal(panic)));
    }
    hand_over(py, main, work)
}

/// Runs `work` as [`released`] does, but always in the pool: it may not ask for a long time whether it goes on.
///
/// # Errors
/// As [`released`].
pub(super) fn handed_over<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> T + Send + 'static,
) -> PyResult<T> {
    hand_over(py, is_main_thread(py)?, work)
}

fn hand_over<T: Send + 'static>(
    py: Python<'_>,
    main: bool,
    work: impl FnOnce() -> T + Send + 'static,
) -> PyResult<T> {
    let (caller, patience) = if main { (Caller::Hasty, Some(PATIENCE)) } else { (Caller::Patient, None) };
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

/// Runs signal handlers; returns whether none raised.
fn run_handlers() -> bool {
    let handled = Python::attach(|py| py.check_signals());
    handled.map_err(|raised| RAISED.set(Some(raised))).is_ok()
}

/// Returns whether the calling thread is the one that runs signal handlers.
fn is_main_thread(py: Python<'_>) -> PyResult<bool> {
    let threading = py.import(intern!(py, "threading"))?;
    let main = called_method(&threading, "main_thread", ())?;
    // a property in Python
    let ident = called_method(&main, "__getattribute__", ("ident",))?;
    threading.call_method0(intern!(py, "get_ident"))?.eq(ident)
}
