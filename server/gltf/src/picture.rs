//! Pictures: found, and known by their first bytes.

use std::borrow::Cow;

use crate::document::{Document, Object, reference};
use crate::media::media_type;
use crate::source::Resolver;
use crate::uri::{self, Reach};

/// A picture of a file.
#[derive(Debug, PartialEq, Eq)]
pub struct Picture<'a> {
    /// Its media type, if it is known.
    pub media: Option<&'static str>,
    pub bytes: Cow<'a, [u8]>,
}

/// Why a picture cannot be had.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PictureFault {
    /// The image names neither data nor a file, or its data cannot be read.
    #[error("its data cannot be read: {0}")]
    Broken(String),
    /// The URI leads to no file. The paths that were tried are relative to the glTF's folder.
    #[error("{why}")]
    NotFound { why: String, tried: Vec<String> },
    /// The file is there.
    #[error("it is no PNG, JPEG, WebP, AVIF, KTX2 or DDS file")]
    UnknownFormat,
}

impl Document<'_> {
    /// A picture, in the file or beside it.
    pub fn picture(&self, index: usize, resolve: &Resolver) -> Result<Picture<'_>, PictureFault> {
        let broken = |why: &dyn ToString| PictureFault::Broken(why.to_string());
        let image = self.get("images", index).map_err(|error| broken(&error))?;
        if let Some(view) = reference(image, "bufferView") {
            let bytes = self.view(view).map_err(|error| broken(&error))?;
            return Ok(Picture { media: media_type(bytes), bytes: Cow::Borrowed(bytes) });
        }
        let uri = uri_of(image).ok_or_else(|| broken(&"it names no data"))?;
        let bytes = if uri::is_data(uri) {
            uri::decode_data(uri).map_err(|why| broken(&why))?
        } else {
            let found = uri::find(uri, Reach::Above, resolve, |bytes| media_type(bytes).is_some());
            found.map_err(|missing| PictureFault::NotFound { why: missing.why, tried: missing.tried })?.1
        };
        match media_type(&bytes) {
            Some(media) => Ok(Picture { media: Some(media), bytes: Cow::Owned(bytes) }),
            None => Err(PictureFault::UnknownFormat),
        }
    }
}

/// The URI of an image.
pub fn uri_of(image: &Object) -> Option<&str> {
    image.get("uri")?.as_str()
}
