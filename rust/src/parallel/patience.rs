//! The end of work that nobody waits for any more.

use std::any::Any;
use std::cell::{Cell, OnceCell};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

thread_local! {
    /// Whether nobody waits for this thread's pool any more; only threads of pools have it.
    static GIVEN_UP: OnceCell<Arc<AtomicBool>> = const { OnceCell::new() };
    /// The watch over a caller's work that this thread, the caller's own, does.
    static WATCH: Cell<Option<Watch>> = const { Cell::new(None) };
}

/// A question that a thread asks now and then.
#[derive(Clone, Copy)]
struct Watch {
    /// Returns whether the work goes on.
    question: fn() -> bool,
    every: Duration,
    next: Instant,
}

/// The panic payload of work that was given up.
struct GivenUp;

/// Makes this thread one of a pool, which may be given up.
pub(super) fn join_pool(given_up: Arc<AtomicBool>) {
    GIVEN_UP.with(|own| own.set(given_up).unwrap_or_default());
}

/// Returns whether this thread belongs to a pool.
pub(super) fn is_worker() -> bool {
    GIVEN_UP.with(|given_up| given_up.get().is_some())
}

/// Runs `work`, and asks each `every` whether it goes on; if not, it ends at the next [`go_on`].
pub(super) fn watch<T>(
    question: fn() -> bool,
    every: Duration,
    work: impl FnOnce() -> T,
) -> std::thread::Result<T> {
    // the question may lead to more such work
    let outer = WATCH.replace(Some(Watch { question, every, next: Instant::now() + every }));
    let answer = catch_unwind(AssertUnwindSafe(work));
    WATCH.set(outer);
    set_given_up(false);
    answer
}

/// Ends this thread's work if nobody waits for it any more. Long loops call it now and then.
#[inline]
pub(crate) fn go_on() {
    let given_up =
        || GIVEN_UP.with(|given_up| given_up.get().is_some_and(|given_up| given_up.load(Ordering::Relaxed)));
    if WATCH.get().is_some_and(is_refused) || given_up() {
        resume_unwind(Box::new(GivenUp));
    }
}

/// Returns whether a panic means that work was given up, not that there is a defect.
pub(crate) fn was_given_up(panic: &(dyn Any + Send)) -> bool {
    panic.is::<GivenUp>()
}

/// Asks a watch's question if it is time to; returns whether the work may not go on.
fn is_refused(watch: Watch) -> bool {
    if Instant::now() < watch.next {
        return false;
    }
    let goes_on = (watch.question)();
    WATCH.set(Some(Watch { next: Instant::now() + watch.every, ..watch }));
    if !goes_on {
        // the work's other parts end too
        set_given_up(true);
    }
    !goes_on
}

/// Says whether nobody waits for the work of this thread's pool any more.
fn set_given_up(value: bool) {
    GIVEN_UP.with(|given_up| {
        if let Some(given_up) = given_up.get() {
            given_up.store(value, Ordering::Relaxed);
        }
    });
}
