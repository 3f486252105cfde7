//! The real server as callers use it: started on port 0, called over gRPC.

mod access;
mod analyses;
mod assets;
mod attacks;
mod audit;
mod bakes;
mod callers;
mod certificates;
mod command_line;
mod create;
mod damage;
mod earlier;
mod ends;
mod faults;
mod formats;
mod hostile;
mod kept;
mod large;
mod lists;
mod load;
mod page;
mod quotas;
mod server;
mod siege;
mod versions;
mod worker;
