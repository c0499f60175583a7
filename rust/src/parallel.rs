//! The only owner of thread pools.
//!
//! Rayon's global pool does not survive `fork`, which is how Python's `multiprocessing` starts workers on
//! Linux: the child has the pool's memory but none of its threads, and would wait for ever. The pool here
//! is built on first use in each process.

use std::marker::PhantomData;
use std::sync::atomic::{AtomicPtr, AtomicUsize, Ordering};

use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// A pool, and the one that was built before it.
struct ProcessPool {
    process: u32,
    threads: usize,
    pool: ThreadPool,
    older: *const ProcessPool,
}

/// The pool that was built last.
static NEWEST: AtomicPtr<ProcessPool> = AtomicPtr::new(std::ptr::null_mut());
static WANTED_THREADS: AtomicUsize = AtomicUsize::new(0);
/// More threads than any machine can use here; tens of thousands would take minutes to start.
const MOST_THREADS: usize = 256;

/// Values of an image that are worked on at a time, and fewest rows: some need what is beside them.
const VALUES: usize = 1 << 16;
const FEWEST_ROWS: usize = 32;

/// Sets how many threads the kernels use from now on, at most 256; 0 means one for each core.
///
/// Results do not depend on it.
pub fn set_num_threads(threads: usize) {
    WANTED_THREADS.store(threads.min(MOST_THREADS), Ordering::Relaxed);
}

/// How many threads the kernels use.
pub fn num_threads() -> usize {
    match WANTED_THREADS.load(Ordering::Relaxed) {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        threads => threads,
    }
}

/// Runs `work` where rayon's parallel iterators use this process' pool.
pub(crate) fn run<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    match pool() {
        Some(pool) => pool.install(work),
        // the system gives no threads: rayon then runs the iterators on the calling one
        None => work(),
    }
}

/// Runs `work` in the pool that already runs, or in this process'.
fn within<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    if rayon::current_thread_index().is_some() { work() } else { run(work) }
}

/// Results of some work on each of several things, in parallel.
#[cfg(feature = "python")]
pub(crate) fn each<T: Sync, R: Send>(
    things: &[T],
    work: impl Fn(&T) -> crate::Result<R> + Sync + Send,
) -> crate::Result<Vec<R>> {
    run(|| things.par_iter().map(work).collect())
}

/// What some work makes of each of several things, in parallel; where a pool already runs, in that.
pub(crate) fn map<T: Sync, R: Send>(things: &[T], work: impl Fn(&T) -> R + Sync + Send) -> Vec<R> {
    within(|| things.par_iter().map(work).collect())
}

/// What two pieces of work make, in parallel.
pub(crate) fn both<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    within(|| rayon::join(a, b))
}

/// Works on an image's rows, in parallel: on stretches of them, given the number of the first.
pub(crate) fn rows<T: Send>(values: &mut [T], width: usize, work: impl Fn(usize, &mut [T]) + Sync + Send) {
    let many = (VALUES / width.max(1)).max(FEWEST_ROWS);
    let stretches = values.par_chunks_mut(many * width.max(1)).enumerate();
    within(|| stretches.for_each(|(k, part)| work(k * many, part)));
}

/// The pool of this process with the wanted number of threads.
///
/// Lock-free, because a lock that another thread holds at the moment of a fork stays locked in the child.
/// Pools are never ended: a worker may be inside one, and its number of threads may be wanted again.
fn pool() -> Option<&'static ThreadPool> {
    let (process, threads) = (std::process::id(), num_threads());
    let mut newest = NEWEST.load(Ordering::Acquire);
    let mut next: *const ProcessPool = newest;
    // SAFETY: a pointer in the list is null or came from Box::leak below, and is never freed
    while let Some(built) = unsafe { next.as_ref() } {
        if built.process == process && built.threads == threads {
            return Some(&built.pool);
        }
        next = built.older;
    }
    let pool =
        ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("strand-{i}")).build().ok()?;
    let made = Box::leak(Box::new(ProcessPool { process, threads, pool, older: newest }));
    while let Err(newer) = NEWEST.compare_exchange(newest, made, Ordering::AcqRel, Ordering::Acquire) {
        newest = newer;
        made.older = newer;
    }
    Some(&made.pool)
}

/// Places that tasks fill in any order.
pub(crate) struct Slots<'a, T> {
    first: *mut T,
    count: usize,
    slots: PhantomData<&'a mut [T]>,
}

// SAFETY: all that tasks can do with it is `put`, whose callers keep them apart
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
        // SAFETY: inside the slice, which is borrowed for as long as this lives, and no one else's place
        unsafe { self.first.add(place).write(value) };
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_pool_has_the_wanted_number_of_threads_and_is_built_once() {
        for threads in [1, 3, 2] {
            super::set_num_threads(threads);
            assert_eq!(super::run(rayon::current_num_threads), threads);
        }
        let address = || super::pool().map(std::ptr::from_ref);
        let two = address();
        super::set_num_threads(3);
        assert_ne!(address(), two);
        super::set_num_threads(2);
        assert_eq!(address(), two);
        super::set_num_threads(0);
        assert!(super::num_threads() >= 1);
    }
}
