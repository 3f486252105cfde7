//! The arguments that choose the cache of fills and bakes.

use super::print_warning;
use cairn_job::reuse::BakeCache;
use clap::builder::{FalseyValueParser, OsStringValueParser};
use std::ffi::OsString;
use std::path::Path;

#[derive(clap::Args)]
#[command(next_help_heading = "Cache")]
pub struct CacheArgs {
    /// Folder of the cache of fills and bakes, which are reused if everything that they depend on is unchanged
    /// [default: the user's cache folder]
    #[arg(long, value_name = "FOLDER", env = "CAIRN_CACHE", value_parser = OsStringValueParser::new())]
    cache: Option<OsString>,

    /// Simulate everything again, and cache nothing
    #[arg(long, env = "CAIRN_NO_CACHE", value_parser = FalseyValueParser::new())]
    no_cache: bool,
}

impl CacheArgs {
    /// Whether the cache is used.
    pub fn is_used(&self) -> bool {
        !self.no_cache
    }

    /// The arguments for another process.
    pub fn to_args(&self) -> Vec<OsString> {
        let cache = self.cache.iter().flat_map(|folder| ["--cache".into(), folder.clone()]);
        cache.chain(self.no_cache.then(|| "--no-cache".into())).collect()
    }

    pub fn open(&self) -> BakeCache {
        match self.cache.as_ref().filter(|folder| !folder.is_empty()) {
            _ if self.no_cache => BakeCache::none(),
            Some(folder) => {
                let cache = BakeCache::at(Path::new(folder));
                if let Some(error) = cache.fault() {
                    let text = format!(
                        "{}: the cache cannot be written there ({error}); name another folder, or give --no-cache",
                        folder.display()
                    );
                    print_warning(&text);
                }
                cache
            }
            None => BakeCache::of_user(),
        }
    }
}
