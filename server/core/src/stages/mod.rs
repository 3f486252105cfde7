//! The stages of a bake, each a function of the one before.

pub mod cache;
pub mod calibrate;
pub mod collapse;
pub mod containers;
pub mod entrance;
pub mod fill;
pub mod free_pour;
pub mod free_standing;
pub mod glue;
pub mod hold;
pub mod release;
pub mod separate;
pub mod taking_apart;
pub mod turn_over;
