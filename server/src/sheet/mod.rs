//! Ranks results by figures, and makes a contact sheet of them as a page and as a picture.

mod page;
mod picture;
mod rank;

pub use page::page;
pub use picture::{Thumbnail, sheet, thumbnail};
pub use rank::{Candidate, SortKey, read, sort};
