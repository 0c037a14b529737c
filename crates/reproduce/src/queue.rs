//! Experiments on all cores, the longest first.

use pigtail_session::job::Ended;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Does all of some work and returns the results in its order, whatever the number of threads. What costs most
/// begins first, and each thread takes the next from one queue, so that no long one begins last.
///
/// # Errors
///
/// The first error of a thread, which leaves the rest of the work to the others.
pub(crate) fn work<J: Sync, T: Send>(
    jobs: &[J],
    cost: impl Fn(&J) -> u32,
    each: impl Fn(&J) -> Result<T, Ended> + Sync,
) -> Result<Vec<T>, Ended> {
    let mut sorted: Vec<(usize, &J)> = jobs.iter().enumerate().collect();
    sorted.sort_by_key(|(order, job)| (std::cmp::Reverse(cost(job)), *order));
    let queue = Mutex::new(sorted.into_iter());
    let mut done: Vec<(usize, T)> = (0..rayon::current_num_threads())
        .into_par_iter()
        .with_max_len(1)
        .map(|_| {
            let mut done = Vec::new();
            loop {
                let next = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
                let Some((order, job)) = next else {
                    return Ok(done);
                };
                done.push((order, each(job)?));
            }
        })
        .collect::<Result<Vec<_>, Ended>>()?
        .into_iter()
        .flatten()
        .collect();
    done.sort_by_key(|(order, _)| *order);
    Ok(done.into_iter().map(|(_, result)| result).collect())
}
