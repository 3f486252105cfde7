//! Work that waits for the disk or takes long, kept off the threads that answer calls.

use crate::status::Fault;
use tokio::runtime::{Handle, RuntimeFlavor};

/// Runs it on a thread for such work.
pub async fn on_disk<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, Fault> {
    tokio::task::spawn_blocking(work).await.map_err(|error| Fault::Internal(error.to_string()))
}

/// Runs it here and to its end, while another thread goes on with the calls that this one has.
pub fn in_place<T>(work: impl FnOnce() -> T) -> T {
    let has_others = Handle::try_current().is_ok_and(|now| now.runtime_flavor() == RuntimeFlavor::MultiThread);
    if has_others { tokio::task::block_in_place(work) } else { work() }
}
