//! Where a command looks for earlier fills and bakes.

use super::tell;
use crate::job::reuse::Cache;
use anstyle::AnsiColor;
use clap::builder::{FalseyValueParser, OsStringValueParser};
use std::ffi::OsString;
use std::path::Path;

#[derive(clap::Args)]
#[command(next_help_heading = "Cache")]
pub struct CacheArgs {
    /// Where fills and bakes are kept, to be used again where nothing that they depend on has changed [default: the user's own
    /// cache folder]
    #[arg(long, value_name = "FOLDER", env = "CAIRN_CACHE", value_parser = OsStringValueParser::new())]
    cache: Option<OsString>,

    /// Make everything anew, and keep nothing
    #[arg(long, env = "CAIRN_NO_CACHE", value_parser = FalseyValueParser::new())]
    no_cache: bool,
}

impl CacheArgs {
    /// Whether anything is to be kept.
    pub fn keeps(&self) -> bool {
        !self.no_cache
    }

    /// The same arguments, for another process.
    pub fn again(&self) -> Vec<OsString> {
        let cache = self.cache.iter().flat_map(|folder| ["--cache".into(), folder.clone()]);
        cache.chain(self.no_cache.then(|| "--no-cache".into())).collect()
    }

    pub fn open(&self) -> Cache {
        match self.cache.as_ref().filter(|folder| !folder.is_empty()) {
            _ if self.no_cache => Cache::none(),
            Some(folder) => {
                let cache = Cache::at(Path::new(folder));
                if let Some(error) = cache.fault() {
                    let text = format!(
                        "{}: nothing can be kept there ({error}); name another folder, or give --no-cache",
                        folder.display()
                    );
                    tell("warning", AnsiColor::Yellow, &text);
                }
                cache
            }
            None => Cache::of_user(),
        }
    }
}
