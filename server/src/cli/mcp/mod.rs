//! `cairn mcp`: the commands as tools for agents, by the Model Context Protocol on standard input and output.
//!
//! Each call runs the command in a process of its own, so that a crash or a limit ends only that call, and a call that
//! the client cancels ends its process. What the command prints as JSON is the tool's result.

mod command;
mod lines;
mod place;
mod types;

use super::{Failure, allowed};
use command::Cairn;
use place::WriteFolder;
use rmcp::handler::server::tool::schema_for_type;
use rmcp::handler::server::wrapper::Parameters;
use rmcp::model::{CallToolResult, ContentBlock, Implementation, ServerCapabilities, ServerConfig};
use rmcp::service::RequestContext;
use rmcp::transport::stdio;
use rmcp::{Json, RoleServer, ServerHandler, ServiceExt, tool, tool_handler, tool_router};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio::io::BufReader;
use tokio::sync::Mutex;
use types::{
    Analysis, AnalysisArgs, BakeArgs, BakeResult, CheckResult, PackArgs, PackResult, PictureResult, PlanResult,
    RankArgs, Ranking, RenderArgs, SceneArgs,
};

/// Offers Cairn's commands to agents, by the Model Context Protocol (MCP)
///
/// Speaks on standard input and output: a client starts this command by itself. The tools are check, plan, bake,
/// render, rank, analyse and pack. They write below one folder alone. They read the files that a call names, and
/// others, which only a scene or a model names, below the scene's folder and those of --allow. A client shows each call
/// to its user before, if it is set up so.
#[derive(clap::Args)]
#[command(after_help = "\
Example, as most clients take it:
  { \"mcpServers\": { \"cairn\": { \"command\": \"cairn\",
    \"args\": [\"mcp\", \"--folder\", \"/home/me/piles\"] } } }")]
pub struct Args {
    /// Folder that the tools write below, and that paths are relative to [default: the current folder]
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,

    /// Folder whose files may be read although only a scene names them; repeat it for several, or set CAIRN_ALLOW to
    /// folders as in PATH [default: the scene's own folder]
    #[arg(long, value_name = "FOLDER")]
    allow: Vec<PathBuf>,
}

/// Bytes of lines on their way.
const BUFFER: usize = 1 << 16;
/// A larger picture is not in the answer, only its path.
const MOST_PICTURE: usize = 1 << 20;

const INSTRUCTIONS: &str = "\
Cairn bakes piles of props in the shape of a closed mesh. Call check or plan first: they say what is wrong with a \
scene and what a bake will take. Then bake, and render to look at the result. A scene is a file (.toml or .json), or \
control meshes and props by path; `set` changes any field, such as fill.count=200. Lengths are metres, Y is up.";

pub fn run(args: &Args) -> Result<(), Failure> {
    let folder = WriteFolder::new(args.folder.as_deref().unwrap_or(Path::new(".")))?;
    let allowed = allowed::folders(&args.allow)?.into_iter().map(|folder| folder.canonicalize().unwrap_or(folder));
    let allowed = std::env::join_paths(allowed).map_err(|error| {
        Failure::usage("--allow", error.to_string(), "Rename the folder, so that its name can be in a list.")
    })?;
    let internal = |error: &dyn std::fmt::Display| Failure::Internal(error.to_string());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(|error| internal(&error))?;
    let done = runtime.block_on(async {
        let cairn = Cairn::new(folder, allowed).map_err(|error| internal(&error))?;
        let (input, output) = stdio();
        let output = Arc::new(Mutex::new(output));
        let (to_server, from_client) = tokio::io::duplex(BUFFER);
        let (to_client, from_server) = tokio::io::duplex(BUFFER);
        tokio::spawn(lines::pass_in(BufReader::new(input), output.clone(), to_server));
        let answers = tokio::spawn(lines::pass_out(BufReader::new(from_server), output));
        let done = match cairn.serve((from_client, to_client)).await {
            Ok(server) => server.waiting().await.map(drop).map_err(|error| internal(&error)),
            // A client that ends before it has said hello is no fault.
            Err(_) => Ok(()),
        };
        // All that was answered goes out.
        let _ = answers.await;
        done
    });
    // A read of the standard input that is still waiting cannot be cancelled.
    runtime.shutdown_background();
    done
}

type Context = RequestContext<RoleServer>;

#[tool_router]
impl Cairn {
    /// Validates a scene with all its files, without simulating it, and reports all problems at once, each with a
    /// remedy
    #[tool(annotations(read_only_hint = true))]
    async fn check(
        &self,
        Parameters(scene): Parameters<SceneArgs>,
        context: Context,
    ) -> Result<Json<CheckResult>, String> {
        // A scene that is wrong is an answer, too.
        self.run(scene.call("check")?.flag("--json"), &context).await?.json_in_any_case().map(Json)
    }

    /// Summarizes the bake of a scene without simulating it: bodies, seconds, memory, and the size of each format
    #[tool(annotations(read_only_hint = true))]
    async fn plan(
        &self,
        Parameters(scene): Parameters<SceneArgs>,
        context: Context,
    ) -> Result<Json<PlanResult>, String> {
        self.run(scene.call("plan")?.flag("--json"), &context).await?.json().map(Json)
    }

    /// Bakes a scene: fills its shape with props by physics, and writes their motion to a file. Takes seconds to
    /// minutes, and reports progress
    #[tool(annotations(destructive_hint = true, idempotent_hint = true))]
    async fn bake(&self, Parameters(args): Parameters<BakeArgs>, context: Context) -> Result<Json<BakeResult>, String> {
        self.folder.check("output", &args.output)?;
        args.report.iter().try_for_each(|report| self.folder.check_report(report))?;
        let own = tempfile::tempdir().map_err(|error| format!("no folder for the report: {error}"))?;
        let report = args.report.clone().unwrap_or_else(|| own.path().join("report.json").display().to_string());
        let call = args.scene.call("bake")?.option("--output", &args.output).option("--report", &report);
        let done = self.run(call.flag("--progress=json"), &context).await?;
        done.success()?;
        BakeResult::read(&args.output, &self.folder.path().join(report), done.notes()).map(Json)
    }

    /// Renders a picture of a pile, .png or .jpg, and shows it
    #[tool(
        annotations(destructive_hint = true, idempotent_hint = true),
        output_schema = schema_for_type::<PictureResult>()
    )]
    async fn render(
        &self,
        Parameters(args): Parameters<RenderArgs>,
        context: Context,
    ) -> Result<CallToolResult, String> {
        self.folder.check("output", &args.output)?;
        self.run(args.call(), &context).await?.success()?;
        let result = PictureResult { picture: args.output.clone() };
        let value = serde_json::to_value(&result).map_err(|error| error.to_string())?;
        let mut answer = CallToolResult::structured(value);
        if let Ok(bytes) = std::fs::read(self.folder.path().join(&args.output))
            && bytes.len() <= MOST_PICTURE
        {
            use base64::Engine;
            let kind = if bytes.starts_with(b"\x89PNG") { "image/png" } else { "image/jpeg" };
            let text = base64::engine::general_purpose::STANDARD.encode(bytes);
            answer.content.push(ContentBlock::image(text, kind));
        }
        Ok(answer)
    }

    /// Ranks the results of a folder, as `cairn batch` writes them, by figures of their reports
    #[tool(annotations(read_only_hint = true))]
    async fn rank(&self, Parameters(args): Parameters<RankArgs>, context: Context) -> Result<Json<Ranking>, String> {
        let ranking = self.run(args.call(), &context).await?.json()?;
        Ok(Json(Ranking { ranking }))
    }

    /// Reports what holds what in a pile as it stands: loads, margins, what may be removed, where glue is needed. By
    /// statics, with proofs; nothing is simulated. Takes any glTF or USD file whose nodes are bodies
    #[tool(annotations(read_only_hint = true))]
    async fn analyse(
        &self,
        Parameters(args): Parameters<AnalysisArgs>,
        context: Context,
    ) -> Result<Json<Analysis>, String> {
        args.output.iter().try_for_each(|output| self.folder.check("output", output))?;
        self.run(args.call(), &context).await?.json().map(Json)
    }

    /// Packs a pile for games and the web: static meshes in levels of detail, colliders, instances, a skeleton with a
    /// clip, textures of the motion
    #[tool(annotations(destructive_hint = true, idempotent_hint = true))]
    async fn pack(&self, Parameters(args): Parameters<PackArgs>, context: Context) -> Result<Json<PackResult>, String> {
        self.folder.check("output", &args.output)?;
        self.run(args.call(), &context).await?.json().map(Json)
    }
}

#[tool_handler]
impl ServerHandler for Cairn {
    fn get_info(&self) -> ServerConfig {
        ServerConfig::new(ServerCapabilities::builder().enable_tools().build())
            .with_server_info(Implementation::new("cairn", cairn_files::version::VERSION))
            .with_instructions(INSTRUCTIONS)
    }
}
