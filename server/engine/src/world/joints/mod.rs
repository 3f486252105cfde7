//! Bodies joined to each other: clusters of glue, and nails.

mod clusters;
pub mod nails;
