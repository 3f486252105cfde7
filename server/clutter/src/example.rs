//! A catalogue of the examples' bricks and bowls in their bin, for unit tests.

use crate::{Catalogue, Library};
use cairn_input::asset::Limits;
use cairn_job::reuse::BakeCache;
use std::path::Path;

const PROPS: &str = "count = [4, 6]\n[[props]]\npath = \"../assets/brick.glb\"\n\
                     [[props]]\npath = \"../assets/bowl.glb\"\n[[places]]\npath = \"../assets/bin.glb\"\n";

/// `settings`: lines of TOML.
pub fn library(settings: &str) -> Library {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/clutter/test.toml");
    let catalogue = Catalogue::parse(&path, &format!("{settings}\n{PROPS}")).unwrap();
    Library::read(catalogue, Limits::default(), &BakeCache::none()).map_err(|refused| refused.problems).unwrap()
}
