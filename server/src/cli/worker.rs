//! `cairn worker`: runs one bake for a server. Servers start it; it is not for users.

use super::{Failure, bounds};
use cairn_job::machine;
use cairn_job::reuse::BakeCache;
use cairn_service::priority::{self, Priority};
use cairn_service::worker::{self, WorkerError};
use cairn_service::{analysis, sandbox};
use std::path::PathBuf;

/// Bakes in a folder of a server's store
#[derive(clap::Args)]
pub struct Args {
    task: WorkerCommand,
    folder: PathBuf,

    /// Limit of the memory, bytes
    #[arg(long)]
    memory: Option<u64>,

    /// Slowness of this machine, if the server has measured it
    #[arg(long)]
    slowness: Option<f64>,

    /// Format of an export
    #[arg(long)]
    format: Option<String>,

    /// Number of the layout of an export in USD
    #[arg(long)]
    layout: Option<String>,

    /// Folder of cached fills
    #[arg(long)]
    cache: Option<PathBuf>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum WorkerCommand {
    Plan,
    Accept,
    Bake,
    Export,
    Analyse,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    priority::lower(match args.task {
        WorkerCommand::Accept => Priority::Soon,
        _ => Priority::Later,
    });
    // Before any thread, which would be outside. What is missing of it, the server has said.
    let folders = std::iter::once(args.folder.as_path()).chain(args.cache.as_deref());
    args.cache.iter().for_each(|cache| drop(std::fs::create_dir_all(cache)));
    let _ = sandbox::enter(&folders.collect::<Vec<_>>());
    worker::end_with_server();
    // The threads come before the limit, under which they may not start.
    bounds::use_threads(0)?;
    if let Some(bytes) = args.memory {
        machine::limit_memory(bytes).map_err(|error| Failure::Internal(error.to_string()))?;
    }
    if let Some(slowness) = args.slowness {
        machine::set_slowness(slowness);
    }
    let result = match args.task {
        WorkerCommand::Plan => worker::plan(&args.folder, true),
        WorkerCommand::Accept => worker::plan(&args.folder, false),
        WorkerCommand::Bake => {
            let mut cache = args.cache.as_deref().map_or_else(BakeCache::none, BakeCache::at);
            worker::bake(&args.folder, &mut cache)
        }
        WorkerCommand::Export => {
            worker::export(&args.folder, args.format.as_deref().unwrap_or_default(), args.layout.as_deref())
        }
        WorkerCommand::Analyse => analysis::analyse(&args.folder),
    };
    match result {
        Ok(()) => Ok(()),
        Err(WorkerError::Message(message)) => {
            worker::send(*message);
            Ok(())
        }
        Err(WorkerError::Internal(what)) => Err(Failure::Internal(what)),
    }
}
