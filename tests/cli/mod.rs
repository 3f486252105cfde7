//! The program `cairn` as users run it: arguments in, files, messages and exit codes out.

mod analyse;
mod bad_input;
mod bake;
mod batch;
mod beside;
mod clutter;
mod cost;
mod desk;
mod effects;
mod examples;
mod faults;
mod former;
mod goals;
mod mcp;
mod measures;
mod messages;
mod models;
mod outputs;
mod readme;
mod scenes;
mod shop;
mod study;
mod tools;
mod usd;
