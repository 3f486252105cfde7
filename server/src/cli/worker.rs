//! `cairn worker`: one bake for a server, which starts it. Not for the command line.

use super::Failure;
use crate::job::machine;
use crate::job::reuse::Cache;
use crate::service::news::News;
use crate::service::worker;
use std::path::PathBuf;

/// Bake in a folder of a server's store
#[derive(clap::Args)]
pub struct Args {
    task: Task,
    folder: PathBuf,

    /// Most memory to use, bytes
    #[arg(long)]
    memory: Option<u64>,

    /// Where earlier fills are kept
    #[arg(long)]
    cache: Option<PathBuf>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Task {
    Plan,
    Accept,
    Bake,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    worker::end_with_server();
    if let Some(bytes) = args.memory {
        machine::limit_memory(bytes).map_err(|error| Failure::Internal(error.to_string()))?;
    }
    machine::use_threads(0).map_err(|error| Failure::Internal(error.to_string()))?;
    let result = match args.task {
        Task::Plan => worker::plan(&args.folder),
        Task::Accept => worker::accept(&args.folder),
        Task::Bake => {
            let mut cache = args.cache.as_deref().map_or_else(Cache::none, Cache::at);
            worker::bake(&args.folder, &mut cache)
        }
    };
    match result {
        Ok(()) => Ok(()),
        Err(worker::Error::Invalid(invalid)) => {
            worker::tell(News::Invalid(invalid));
            Ok(())
        }
        Err(worker::Error::NotWritten(why)) => {
            worker::tell(News::NotWritten(why));
            Ok(())
        }
        Err(worker::Error::Broken(why)) => {
            worker::tell(News::Broken(why));
            Ok(())
        }
        Err(worker::Error::Internal(what)) => Err(Failure::Internal(what)),
    }
}
