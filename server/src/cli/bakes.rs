//! `cairn bakes`: lists, shows, awaits and deletes the bakes of a server.

use super::remote::{self, ConnectionArgs, RemoteBake};
use super::{Failure, interrupt, print, table};
use cairn_service::client::Target;
use cairn_service::status_json::{STATES, object, seconds, state_of, time};
use cairn_wire::proto::{BakeState, BakeStatus, ListBakesRequest};
use clap::Subcommand;
use serde_json::Value;

/// Lists, shows, awaits and deletes the bakes of a server
///
/// Bakes are named by their ids, or by the first 6 or more digits of these.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn bakes list --server farm:50151 --state running --label shot=a010
  cairn bakes show 6e0f4c
  cairn bakes wait 6e0f4c && cairn watch 6e0f4c -o pile.glb
  cairn bakes delete 6e0f4c")]
pub struct Args {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// Lists bakes, the latest first
    List(ListArgs),
    /// Shows the status of a bake
    Show(OneArgs),
    /// Waits until a bake has ended; the exit code is 0 if it has a result, otherwise that of `cairn bake`
    Wait(OneArgs),
    /// Ends a bake and removes its files; while other callers want it, only withdraws from it
    Delete(OneArgs),
}

#[derive(clap::Args)]
struct ListArgs {
    /// Only bakes that this caller owns or wants
    #[arg(long, value_name = "NAME")]
    owner: Option<String>,

    /// Only bakes with this label; repeat it for several
    #[arg(long = "label", value_name = "KEY=VALUE", value_parser = remote::label)]
    labels: Vec<(String, String)>,

    /// Only bakes in this state; repeat it for several
    #[arg(long = "state", value_name = "STATE", value_parser = STATES.map(|(name, _)| name))]
    states: Vec<String>,

    /// Print the latest bakes only, this many
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..))]
    first: Option<u64>,

    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,

    /// HOST:PORT or unix:PATH of a `cairn serve`
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:50151", help_heading = "Server")]
    server: String,

    #[command(flatten)]
    connection: ConnectionArgs,
}

#[derive(clap::Args)]
struct OneArgs {
    #[command(flatten)]
    bake: RemoteBake,

    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    interrupt::listen();
    match &args.action {
        Action::List(args) => list(args),
        Action::Show(args) => {
            let id = args.bake.id().to_owned();
            let bake = remote::ask(&args.bake.target()?, async move |mut server| server.status(&id).await)?;
            shown(&bake, args.json)
        }
        Action::Wait(args) => {
            let id = args.bake.id().to_owned();
            let ended = async move |mut server: cairn_service::client::Connection| {
                // The end of the stream is that of the bake; how it ended is in its status.
                let _ = server.watch(&id, |_| ()).await;
                server.status(&id).await
            };
            let bake = remote::ask(&args.bake.target()?, ended)?;
            shown(&bake, args.json)?;
            match bake.failure {
                Some(failure) => Err(cairn_service::status::status_of(&failure).into()),
                None if bake.state() == BakeState::Succeeded => Ok(()),
                None => Err(tonic::Status::unavailable("the stream of its events has ended").into()),
            }
        }
        Action::Delete(args) => {
            let id = args.bake.id().to_owned();
            remote::ask(&args.bake.target()?, async move |mut server| server.delete(&id).await)
        }
    }
}

fn list(args: &ListArgs) -> Result<(), Failure> {
    let state = |name: &String| STATES.iter().find(|(known, _)| known == name).map(|(_, state)| (*state).into());
    let request = ListBakesRequest {
        owner: args.owner.clone().unwrap_or_default(),
        labels: args.labels.iter().cloned().collect(),
        states: args.states.iter().filter_map(state).collect(),
        ..Default::default()
    };
    let most = args.first.map_or(usize::MAX, |first| usize::try_from(first).unwrap_or(usize::MAX));
    let target: Target = args.connection.at(&args.server)?;
    let bakes = remote::ask(&target, async move |mut server| server.list(request, most).await)?;
    if args.json {
        return print(&format!("{:#}\n", bakes.iter().map(object).collect::<Value>()));
    }
    let header = ["id", "state", "requested", "seconds", "owner", "labels"].map(str::to_owned).into();
    let row = |bake: &BakeStatus| {
        let seconds = seconds(bake).map_or(String::new(), |seconds| format!("{seconds:.0}"));
        let id = bake.bake_id.get(..12).unwrap_or(&bake.bake_id).to_owned();
        vec![id, state_of(bake).into(), time(bake.create_time), seconds, bake.owner.clone(), labels(bake)]
    };
    print(&table(header, bakes.iter().map(row)))
}

/// Prints a bake.
fn shown(bake: &BakeStatus, as_json: bool) -> Result<(), Failure> {
    if as_json {
        return print(&format!("{:#}\n", object(bake)));
    }
    let callers: Vec<&str> = bake.callers.iter().map(|caller| &*caller.name).collect();
    let failure = bake.failure.as_ref().map(|failure| format!("{}: {}", failure.reason, failure.message));
    let summary = bake.summary.as_ref();
    let lines = [
        ("id", Some(bake.bake_id.clone())),
        ("state", Some(state_of(bake).into())),
        ("requested", Some(time(bake.create_time))),
        ("owner", Some(bake.owner.clone())),
        ("project", Some(bake.project.clone()).filter(|project| !project.is_empty())),
        ("wanted by", Some(callers.join(", "))),
        ("labels", Some(labels(bake))),
        ("seconds", seconds(bake).map(|seconds| format!("{seconds:.1}"))),
        ("progress", bake.progress.map(|progress| format!("{:.0} %", 100.0 * progress.fraction))),
        ("bodies", summary.map(|summary| summary.body_count.to_string())),
        ("result", summary.map(|summary| format!("{} bytes", summary.result_bytes))),
        ("failure", failure),
    ];
    let line = |(name, value): (&str, Option<String>)| {
        value.filter(|value| !value.is_empty()).map(|value| format!("{name:<11}{value}\n"))
    };
    print(&lines.into_iter().filter_map(line).collect::<String>())
}

fn labels(bake: &BakeStatus) -> String {
    let all = bake.callers.iter().flat_map(|caller| &caller.labels);
    let mut texts: Vec<String> = all.chain(&bake.labels).map(|(name, value)| format!("{name}={value}")).collect();
    texts.sort();
    texts.dedup();
    texts.join(", ")
}
