//! The only owner of thread pools.
//!
//! Rayon's global pool does not survive `fork`, which is how Python's `multiprocessing` starts workers on
//! Linux: the child has the pool's memory but none of its threads, and would wait for ever. The pool here
//! is built on first use in each process.

use std::sync::atomic::{AtomicPtr, AtomicUsize, Ordering};

use rayon::{ThreadPool, ThreadPoolBuilder};

struct ProcessPool {
    process: u32,
    threads: usize,
    pool: ThreadPool,
}

static CURRENT: AtomicPtr<ProcessPool> = AtomicPtr::new(std::ptr::null_mut());
static WANTED_THREADS: AtomicUsize = AtomicUsize::new(0);

/// Sets how many threads the kernels use from now on; 0 means one for each core.
///
/// Results do not depend on it.
pub fn set_num_threads(threads: usize) {
    WANTED_THREADS.store(threads, Ordering::Relaxed);
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

/// The pool of this process with the wanted number of threads.
///
/// Lock-free, because a lock that another thread holds at the moment of a fork stays locked in the child.
/// Pools that were replaced are left to the process: a worker may still be inside one.
fn pool() -> Option<&'static ThreadPool> {
    let (process, threads) = (std::process::id(), num_threads());
    let current = CURRENT.load(Ordering::Acquire);
    // SAFETY: the pointer is null or came from Box::leak below, and is never freed
    if let Some(found) = unsafe { current.as_ref() }
        && found.process == process
        && found.threads == threads
    {
        return Some(&found.pool);
    }
    let pool =
        ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("strand-{i}")).build().ok()?;
    let made: &'static ProcessPool = Box::leak(Box::new(ProcessPool { process, threads, pool }));
    CURRENT.store(std::ptr::from_ref(made).cast_mut(), Ordering::Release);
    Some(&made.pool)
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_pool_has_the_wanted_number_of_threads() {
        for threads in [1, 3, 2] {
            super::set_num_threads(threads);
            assert_eq!(super::run(rayon::current_num_threads), threads);
        }
        super::set_num_threads(0);
        assert!(super::num_threads() >= 1);
    }
}
