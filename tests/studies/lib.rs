//! Studies are examples of this package; it has no code of its own.
