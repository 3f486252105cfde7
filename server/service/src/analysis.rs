//! The worker's side of an analysis. It reads the folder that the server has made, and sends the answers.

use crate::folder::SPEC;
use crate::seal::unsealed;
use crate::worker::{NOT_UPLOADED, Uploads, WorkerError, invalid_fields, send};
use crate::worker_message::WorkerMessage;
use bytes::Bytes;
use cairn_analysis::{AnalysisOptions, PileAnalysis};
use cairn_export::analysis::{FoundPile, Selection};
use cairn_files::FileSource;
use cairn_files::problem::{Cause, Problem};
use cairn_input::observer::{Observer, Progress};
use cairn_job::{InputFile, machine};
use cairn_wire::analysis::{NamedNode, to_messages};
use cairn_wire::proto;
use prost::Message;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Interval of progress.
const PAUSE: Duration = Duration::from_millis(100);

/// Sends how far an analysis is.
struct Reporting(Instant);

impl Observer for Reporting {
    fn progress(&mut self, progress: &Progress) -> ControlFlow<()> {
        if self.0.elapsed() >= PAUSE {
            self.0 = Instant::now();
            let fraction = progress.fraction;
            send(WorkerMessage::Analysed(Box::new(proto::AnalysePileResponse { fraction, ..Default::default() })));
        }
        ControlFlow::Continue(())
    }

    fn cpu_seconds(&mut self) -> f64 {
        machine::cpu_seconds()
    }
}

/// Analyses the pile of a folder, and sends the answers.
pub fn analyse(folder: &Path) -> Result<(), WorkerError> {
    let request = proto::AnalysePileRequest::decode(Bytes::from(unsealed(std::fs::read(folder.join(SPEC))?)?))
        .map_err(|error| WorkerError::Internal(error.to_string()))?;
    let limits = cairn_input::asset::Limits::default();
    let selection = Selection {
        scenery: request.scenery.clone(),
        left_out: request.without.clone(),
        friction: request.friction,
        density: request.density,
        ground: request.ground_height,
        no_ground: request.no_ground,
        seconds: request.time_seconds,
        most_triangles: limits.triangles,
    };
    let name = request.assets.first().map(|asset| asset.uri.clone()).unwrap_or_default();
    let uploads: Arc<dyn FileSource> = Arc::new(Uploads::of(folder, &request.assets));
    let file = InputFile::read(Path::new(&name), &uploads).map_err(|problem| refused(&problem))?;
    let options = AnalysisOptions::default();
    let options =
        AnalysisOptions { friction_share: request.friction_share.unwrap_or(options.friction_share), ..options };
    let run = |pile: &FoundPile| {
        let found = cairn_core::analyse(&pile.scene, &pile.params, &options, &mut Reporting(Instant::now()));
        match found {
            Ok(found) => {
                messages(pile, &found).into_iter().for_each(|part| send(WorkerMessage::Analysed(Box::new(part))));
                Ok(())
            }
            Err(cairn_core::Error::Invalid(problems)) => {
                let about = |problem| field(&Problem::from(problem));
                Err(invalid_fields(problems.into_iter().map(about).collect(), false))
            }
            Err(error) => Err(WorkerError::Internal(error.to_string())),
        }
    };
    cairn_job::analysis::with_pile(&file, &selection, |_, pile| run(pile)).map_err(|problem| refused(&problem))?
}

fn messages(pile: &FoundPile, found: &PileAnalysis) -> Vec<proto::AnalysePileResponse> {
    let nodes = pile.bodies.iter().map(|body| NamedNode { name: &body.name, node: body.node });
    let about = proto::PileAnalysis {
        gravity: pile.params.gravity,
        ground_height: pile.params.ground_height.filter(|_| pile.params.ground),
        notes: pile.notes.clone(),
        ..Default::default()
    };
    to_messages(found, nodes, about)
}

fn field(problem: &Problem) -> proto::FieldProblem {
    proto::FieldProblem { field: "assets".into(), description: problem.to_string() }
}

fn refused(problem: &Problem) -> WorkerError {
    let is_missing = problem.cause == Cause::NotUploaded || problem.to_string().contains(NOT_UPLOADED);
    invalid_fields(vec![field(problem)], is_missing)
}
