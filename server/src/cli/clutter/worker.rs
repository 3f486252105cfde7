//! The process that makes layouts: it reads the catalogue once, and makes those whose numbers come on its standard
//! input, until that ends.

use super::{Args, Stands, judge::Mujoco};
use crate::cli::Failure;
use crate::cli::bounds;
use cairn_clutter::line::{Judge, Line, make};
use cairn_clutter::{Catalogue, Library};
use cairn_files::failpoints;
use cairn_job::machine;
use cairn_job::reuse::BakeCache;
use serde_json::json;
use std::io::{BufRead, Write};
use std::path::Path;

/// `shapes`: the folder that has its collision shapes.
pub fn run(args: &Args, shapes: &Path) -> Result<(), Failure> {
    // Layouts are small: each process makes one at a time, and all of them together use the machine.
    bounds::use_threads(1)?;
    let catalogue = Catalogue::read(&args.catalogue).map_err(Failure::Input)?;
    let library = Library::read(catalogue, args.bounds.limits(), &BakeCache::at(shapes)).map_err(Failure::Refused)?;
    let mut new_shapes = library.new_shapes;
    let mut mujoco = match args.stands.contains(&Stands::Mujoco) {
        true => Some(Mujoco::start(&args.python, &args.output.join(super::ASSETS)).map_err(Failure::Internal)?),
        false => None,
    };
    let mut stdout = std::io::stdout().lock();
    for text in std::io::stdin().lock().lines().map_while(Result::ok) {
        let Ok(number) = text.trim().parse() else { continue };
        failpoints::at("clutter-layout").map_err(|error| Failure::Internal(error.to_string()))?;
        let began = machine::cpu_seconds();
        let mut judge = |line: &Line| mujoco.as_mut().map_or(Ok(0.0), |mujoco| mujoco.drift(line));
        let judge: Option<Judge> = if args.stands.contains(&Stands::Mujoco) { Some(&mut judge) } else { None };
        let answer = match make(&library, number, args.gates(), judge) {
            Ok(line) => {
                let seconds = machine::cpu_seconds() - began;
                // Once.
                let new_shapes = std::mem::take(&mut new_shapes);
                json!({ "line": line, "seconds": seconds, "memory": machine::peak_memory(), "new_shapes": new_shapes })
            }
            Err(why) => json!({ "error": why }),
        };
        let sent = writeln!(stdout, "{answer}").and_then(|()| stdout.flush());
        if sent.is_err() {
            break;
        }
    }
    Ok(())
}
