//! The only owner of thread pools.
//!
//! Rayon's global pool does not survive `fork`, with which Python's `multiprocessing` starts workers on Linux. The
//! child has the pool's memory but none of its threads, and would wait forever. The pools here are built on first use
//! in each process. A pool ends when the number of threads changes and its work is done.
//!
//! Python's main thread may give up work at Ctrl-C. Such work has a pool of its own. Its threads learn that nobody
//! waits for them, and stop at the next [`go_on`].

use std::any::Any;
use std::cell::{Cell, OnceCell};
use std::marker::PhantomData;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// A pool and its number of threads.
struct Pool {
    threads: usize,
    pool: ThreadPool,
    given_up: Arc<AtomicBool>,
}

/// The pools of a process, one for each [`Caller`].
struct Process {
    id: u32,
    pools: [Mutex<Option<Arc<Pool>>>; 2],
    /// Its cores, 0 before they are counted: counting for each call would take longer than small kernels do.
    cores: AtomicUsize,
}

/// The patience of a caller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Caller {
    /// Waits until the answer is there.
    Patient,
    /// May give up. One call at a time.
    Hasty,
}

/// The pools of this process, or of the process that it was forked from.
static NEWEST: AtomicPtr<Process> = AtomicPtr::new(std::ptr::null_mut());
static WANTED_THREADS: AtomicUsize = AtomicUsize::new(UNKNOWN);
const UNKNOWN: usize = usize::MAX; // the number of threads has not been set yet
const MAX_THREADS: usize = 256; // threads at most; tens of thousands would take minutes to start
pub(crate) const VARIABLE: &str = "STRAND_NUM_THREADS"; // the environment variable that sets the number of threads

const VALUES_PER_TASK: usize = 1 << 16; // values of an image that one task works on
/// Rows of an image that one task works on, at least: some tasks need the rows beside theirs too.
const MIN_ROWS_PER_TASK: usize = 32;

thread_local! {
    /// Whether nobody waits for this thread's pool any more; threads of pools have it, and those that worked alone.
    static GIVEN_UP: OnceCell<Arc<AtomicBool>> = const { OnceCell::new() };
    /// Whether work on this thread stays in its pool.
    static IN_POOL: Cell<bool> = const { Cell::new(false) };
}

/// The panic payload of work that was given up.
struct GivenUp;

/// Sets how many threads the kernels use from now on, at most 256; 0 means one for each core that there is now.
///
/// Results do not depend on the number. Before the first call, the environment variable `STRAND_NUM_THREADS` sets it.
/// Without that, or if it is no whole number, there is one thread for each core.
pub fn set_num_threads(threads: usize) {
    this_process().cores.store(0, Ordering::Relaxed);
    WANTED_THREADS.store(threads.min(MAX_THREADS), Ordering::Relaxed);
}

/// Returns how many threads the kernels use.
pub fn num_threads() -> usize {
    let mut wanted = WANTED_THREADS.load(Ordering::Relaxed);
    if wanted == UNKNOWN {
        let asked = threads_of_environment().ok().flatten().unwrap_or(0).min(MAX_THREADS);
        // a number that another thread set meanwhile wins
        let set = WANTED_THREADS.compare_exchange(UNKNOWN, asked, Ordering::Relaxed, Ordering::Relaxed);
        wanted = set.map_or_else(|set| set, |_| asked);
    }
    match wanted {
        0 => {
            let known = &this_process().cores;
            let mut counted = known.load(Ordering::Relaxed);
            if counted == 0 {
                counted = cores();
                known.store(counted, Ordering::Relaxed);
            }
            counted
        }
        threads => threads,
    }
}

/// Counts the cores that this process may use, by its affinity and its control group's CPU quota.
pub(crate) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Reads the number of threads from the environment: None if unset, the text itself if it is not a number.
pub(crate) fn threads_of_environment() -> Result<Option<usize>, String> {
    match std::env::var_os(VARIABLE) {
        None => Ok(None),
        Some(text) if text.is_empty() => Ok(None),
        Some(text) => {
            let text = text.to_string_lossy().into_owned();
            text.trim().parse().map(Some).map_err(|_| text)
        }
    }
}

/// Runs `work` with rayon's iterators in this process' pool, or in the pool that already runs.
pub(crate) fn run<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    if is_worker() {
        return work();
    }
    match pool(Caller::Patient) {
        Some(pool) => pool.pool.install(work),
        None => alone(work),
    }
}

/// Returns whether this thread belongs to a pool of this module, and its work stays there.
fn is_worker() -> bool {
    IN_POOL.get()
}

/// Runs `work` on this thread alone: the system gives no threads, or shall give none. The thread becomes a pool of its
/// own, permanently, but only this work stays there.
pub(crate) fn alone<T>(work: impl FnOnce() -> T) -> T {
    struct Leave;
    impl Drop for Leave {
        fn drop(&mut self) {
            IN_POOL.set(false);
        }
    }
    if is_worker() {
        return work();
    }
    GIVEN_UP.with(|given_up| {
        if given_up.get().is_none()
            && let Ok(pool) = ThreadPoolBuilder::new().num_threads(1).use_current_thread().build()
        {
            std::mem::forget(pool);
            given_up.get_or_init(Arc::default);
        }
    });
    IN_POOL.set(true);
    let _leave = Leave;
    work()
}

/// Ends this thread's work if nobody waits for it any more. Long loops call it now and then.
#[inline]
pub(crate) fn go_on() {
    if GIVEN_UP.with(|given_up| given_up.get().is_some_and(|given_up| given_up.load(Ordering::Relaxed))) {
        resume_unwind(Box::new(GivenUp));
    }
}

/// Work that runs in a pool.
pub(crate) struct Begun<T> {
    answer: Receiver<std::thread::Result<T>>,
    caller: Caller,
    pool: Arc<Pool>,
}

/// Starts `work` in the caller's pool; returns it unstarted if the system gives no threads.
pub(crate) fn begin<T: Send + 'static, F: FnOnce() -> T + Send + 'static>(
    caller: Caller,
    work: F,
) -> Result<Begun<T>, F> {
    let Some(pool) = pool(caller) else { return Err(work) };
    let (sender, answer) = sync_channel(1);
    pool.pool.spawn(move || {
        // nobody receives the answer of work that was given up
        let _ = sender.send(catch_unwind(AssertUnwindSafe(|| {
            go_on();
            work()
        })));
    });
    Ok(Begun { answer, caller, pool })
}

impl<T> Begun<T> {
    /// Returns the answer, or the payload if the work panicked; None if it takes longer.
    pub(crate) fn wait(&mut self, longest: Option<Duration>) -> Option<std::thread::Result<T>> {
        let lost = || Err(Box::new("a thread ended before its work") as Box<dyn Any + Send>);
        match longest {
            None => Some(self.answer.recv().unwrap_or_else(|_| lost())),
            Some(longest) => match self.answer.recv_timeout(longest) {
                Ok(answer) => Some(answer),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => Some(lost()),
            },
        }
    }

    /// Gives up the work: it ends soon, and its pool with it.
    pub(crate) fn give_up(self) {
        self.pool.given_up.store(true, Ordering::Relaxed);
        let mut current = locked(this_process(), self.caller);
        if current.as_ref().is_some_and(|current| Arc::ptr_eq(current, &self.pool)) {
            *current = None;
        }
    }
}

/// Returns whether a panic means that work was given up, not that there is a defect.
pub(crate) fn was_given_up(panic: &(dyn Any + Send)) -> bool {
    panic.is::<GivenUp>()
}

/// Applies work that may fail to each of several things, in parallel.
#[cfg(feature = "python")]
pub(crate) fn each<T: Sync, R: Send>(
    things: &[T],
    work: impl Fn(&T) -> crate::error::Result<R> + Sync + Send,
) -> crate::error::Result<Vec<R>> {
    let work = |thing: &T| {
        go_on();
        work(thing)
    };
    run(|| things.par_iter().map(work).collect())
}

/// Applies work to each of several things, in parallel.
pub(crate) fn map<T: Sync, R: Send>(things: &[T], work: impl Fn(&T) -> R + Sync + Send) -> Vec<R> {
    let work = |thing: &T| {
        go_on();
        work(thing)
    };
    run(|| things.par_iter().map(work).collect())
}

/// Does two pieces of work in parallel.
pub(crate) fn both<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    run(|| rayon::join(a, b))
}

/// Returns the number of an image's rows that one task of [`rows`] works on.
pub(crate) fn count_rows(width: usize) -> usize {
    (VALUES_PER_TASK / width.max(1)).max(MIN_ROWS_PER_TASK)
}

/// Works on stretches of an image's rows in parallel; `work` gets the number of the first row and the values.
pub(crate) fn rows<T: Send>(values: &mut [T], width: usize, work: impl Fn(usize, &mut [T]) + Sync + Send) {
    rows_by(values, width, count_rows(width), work);
}

/// Works on stretches of `many` rows as [`rows`] does; a row has `stride` values.
pub(crate) fn rows_by<T: Send>(
    values: &mut [T],
    stride: usize,
    many: usize,
    work: impl Fn(usize, &mut [T]) + Sync + Send,
) {
    let stretches = values.par_chunks_mut(many * stride.max(1)).enumerate();
    run(|| {
        stretches.for_each(|(k, part)| {
            go_on();
            work(k * many, part);
        });
    });
}

/// Returns the caller's pool with the wanted number of threads, or with one thread if the system gives no more.
///
/// A pool with another number of threads ends after its last work.
fn pool(caller: Caller) -> Option<Arc<Pool>> {
    let threads = num_threads();
    let mut current = locked(this_process(), caller);
    if let Some(pool) = current.as_ref().filter(|pool| pool.threads == threads) {
        return Some(pool.clone());
    }
    let pool = Arc::new([threads, 1].into_iter().find_map(|given| build(given, threads))?);
    *current = Some(pool.clone());
    Some(pool)
}

fn build(given: usize, threads: usize) -> Option<Pool> {
    let given_up = Arc::<AtomicBool>::default();
    let theirs = given_up.clone();
    let pool = ThreadPoolBuilder::new()
        .num_threads(given)
        .thread_name(|i| format!("strand-{i}"))
        .start_handler(move |_| {
            GIVEN_UP.with(|given_up| given_up.set(theirs.clone()).unwrap_or_default());
            IN_POOL.set(true);
        })
        .build()
        .ok()?;
    Some(Pool { threads, pool, given_up })
}

fn locked(process: &Process, caller: Caller) -> MutexGuard<'_, Option<Arc<Pool>>> {
    process.pools[caller as usize].lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the pools of this process.
///
/// It takes no lock, because a lock that another thread holds during a fork stays locked in the child. The locks inside
/// belong to this process. Forked children leave their parent's pools alone.
fn this_process() -> &'static Process {
    let id = std::process::id();
    let mut newest = NEWEST.load(Ordering::Acquire);
    loop {
        // SAFETY: the pointer is null or came from Box::leak below, and what it points to is never freed
        if let Some(process) = unsafe { newest.as_ref() }
            && process.id == id
        {
            return process;
        }
        let process =
            Box::leak(Box::new(Process { id, pools: Default::default(), cores: AtomicUsize::new(0) }));
        match NEWEST.compare_exchange(newest, process, Ordering::AcqRel, Ordering::Acquire) {
            Ok(_) => return process,
            Err(newer) => newest = newer,
        }
    }
}

/// Places that several tasks fill in any order.
pub(crate) struct Slots<'a, T> {
    first: *mut T,
    count: usize,
    slots: PhantomData<&'a mut [T]>,
}

// SAFETY: tasks can only call `put`, and its callers never share a place
unsafe impl<T: Send> Sync for Slots<'_, T> {}

impl<'a, T: Copy> Slots<'a, T> {
    pub(crate) fn new(slots: &'a mut [T]) -> Self {
        Self { first: slots.as_mut_ptr(), count: slots.len(), slots: PhantomData }
    }

    /// Fills a place.
    ///
    /// # Safety
    /// No two tasks may fill the same place.
    #[inline(always)]
    pub(crate) unsafe fn put(&self, place: usize, value: T) {
        assert!(place < self.count);
        // SAFETY: the place is inside the slice, which stays borrowed, and belongs to this task alone
        unsafe { self.first.add(place).write(value) };
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::time::{Duration, Instant};

    use super::*;

    /// The number of threads belongs to the process.
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

    fn alone() -> MutexGuard<'static, ()> {
        ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner)
    }

    #[test]
    fn the_pool_has_the_wanted_number_of_threads_and_ends_with_the_next() {
        let _alone = alone();
        let mut before: Option<std::sync::Weak<Pool>> = None;
        for threads in [1, 3, 2] {
            set_num_threads(threads);
            assert_eq!(run(rayon::current_num_threads), threads);
            assert!(before.is_none_or(|before| before.upgrade().is_none()));
            let (one, other) = (pool(Caller::Patient).unwrap(), pool(Caller::Patient).unwrap());
            assert!(Arc::ptr_eq(&one, &other));
            before = Some(Arc::downgrade(&one));
        }
        set_num_threads(0);
        assert!(num_threads() >= 1);
    }

    #[test]
    fn work_alone_stays_on_its_thread_and_later_work_does_not() {
        let _alone = alone();
        set_num_threads(3);
        let here = std::thread::current().id();
        let threads_of = || (rayon::current_num_threads(), map(&[0; 100], |_| std::thread::current().id()));
        for _ in 0..2 {
            let (threads, ids) = super::alone(|| run(threads_of));
            assert_eq!(threads, 1);
            assert!(ids.iter().all(|&id| id == here));
            assert_eq!(run(rayon::current_num_threads), 3);
        }
        let broken = || super::alone(|| map(&[0usize, 1], |&i| [1.0][i]));
        assert!(catch_unwind(broken).is_err());
        assert_eq!(run(rayon::current_num_threads), 3);
        set_num_threads(0);
    }

    #[test]
    fn work_that_was_given_up_ends_and_the_next_is_done() {
        let _alone = alone();
        let ended = Arc::new(AtomicBool::new(false));
        let mark = ended.clone();
        let begun = begin(Caller::Hasty, move || {
            struct AtEnd(Arc<AtomicBool>);
            impl Drop for AtEnd {
                fn drop(&mut self) {
                    self.0.store(true, Ordering::Relaxed);
                }
            }
            let _at_end = AtEnd(mark);
            let never: Vec<usize> = map(&[1, 2, 3], |_| {
                loop {
                    go_on();
                }
            });
            never.len()
        });
        let Ok(mut begun) = begun else { panic!("no threads") };
        assert!(begun.wait(Some(Duration::from_millis(20))).is_none());
        begun.give_up();
        let start = Instant::now();
        while !ended.load(Ordering::Relaxed) {
            assert!(start.elapsed() < Duration::from_secs(10));
            std::thread::yield_now();
        }
        let Ok(mut begun) = begin(Caller::Hasty, || map(&[1, 2, 3], |x| x + 1)) else { panic!("no threads") };
        assert_eq!(begun.wait(None).unwrap().unwrap(), [2, 3, 4]);
    }

    #[test]
    fn a_panic_in_the_pool_comes_back_to_who_waits() {
        let _alone = alone();
        let broken = || map(&[0usize, 1], |&i| [1.0][i]);
        let Ok(mut begun) = begin(Caller::Hasty, broken) else { panic!("no threads") };
        let panic = begun.wait(None).unwrap().unwrap_err();
        assert!(!was_given_up(panic.as_ref()));
        assert_eq!(run(|| 7), 7);
    }
}
