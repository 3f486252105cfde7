//! Bakes a pile on a Cairn server: uploads the models, shows the progress, writes the .glb.
//!
//! ```text
//! cairn serve &
//! cargo run --release --example client -- examples/assets/cone-small.glb examples/assets/stick.glb pile.glb
//! ```
//!
//! The first model is the shape, the models between are props. Any protobuf compiler makes the types from
//! `proto/cairn/v1`.

use anyhow::{Context, Result, bail};
use cairn_service::api::pile_service_client::PileServiceClient;
use cairn_wire::proto::bake_event::Kind;
use cairn_wire::proto::{
    Accuracy, AssetHeader, AssetReference, BakeRequest, BakeSpec, ControlMesh, DownloadResultRequest, FrameSelection,
    GetServerInfoRequest, HaveAssetsRequest, Prop, Scene, Stage, UploadAssetRequest,
};
use sha2::{Digest, Sha256};
use tonic::transport::Channel;

const SERVER: &str = "http://127.0.0.1:50151";
const CHUNK: usize = 64 * 1024;

#[tokio::main]
async fn main() -> Result<()> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let [control, props @ .., output] = &paths[..] else { bail!("give a shape, props and the output") };
    let address = std::env::var("CAIRN_SERVER").unwrap_or_else(|_| SERVER.into());
    let mut server = PileServiceClient::connect(address).await.context("is `cairn serve` running?")?;
    server.get_server_info(GetServerInfoRequest { protocol_version: 1 }).await?;

    let mut scene = Scene {
        control_mesh: Some(ControlMesh { path: control.clone() }),
        props: props.iter().map(|path| Prop { path: path.clone(), ..Default::default() }).collect(),
        ..Default::default()
    };
    scene.set_accuracy(Accuracy::Draft);
    let mut assets = Vec::new();
    for path in paths.iter().take(paths.len() - 1) {
        assets.push(AssetReference { uri: path.clone(), sha256: upload(&mut server, path).await? });
    }
    let spec = BakeSpec { scene: Some(scene), assets, ..Default::default() };
    let bake_id = bake(&mut server, spec).await?;

    let request = DownloadResultRequest { bake_id, ..Default::default() };
    let mut parts = server.download_result(request).await?.into_inner();
    let mut result = Vec::new();
    while let Some(part) = parts.message().await? {
        result.extend_from_slice(&part.chunk);
    }
    std::fs::write(output, result)?;
    Ok(())
}

/// Sends a file in chunks, unless the server has it. Its hash is its address.
async fn upload(server: &mut PileServiceClient<Channel>, path: &str) -> Result<String> {
    let content = std::fs::read(path).with_context(|| path.to_owned())?;
    let sha256: String = Sha256::digest(&content).iter().map(|byte| format!("{byte:02x}")).collect();
    let have = HaveAssetsRequest { sha256: vec![sha256.clone()] };
    if !server.have_assets(have).await?.into_inner().missing_sha256.is_empty() {
        let header = AssetHeader { sha256: sha256.clone(), size_bytes: content.len().try_into()? };
        let mut messages = vec![UploadAssetRequest { header: Some(header), ..Default::default() }];
        let chunk = |bytes: &[u8]| UploadAssetRequest { chunk: bytes.to_vec().into(), ..Default::default() };
        messages.extend(content.chunks(CHUNK).map(chunk));
        server.upload_asset(tokio_stream::iter(messages)).await?;
    }
    Ok(sha256)
}

/// Bakes, and prints the events. `watch_bake` could resume a broken stream.
async fn bake(server: &mut PileServiceClient<Channel>, spec: BakeSpec) -> Result<String> {
    let request = BakeRequest { spec: Some(spec), frames: FrameSelection::Result.into(), ..Default::default() };
    let mut events = server.bake(request).await?.into_inner();
    let (mut bake_id, mut frames) = (String::new(), 0);
    while let Some(response) = events.message().await? {
        match response.event.and_then(|event| event.kind) {
            Some(Kind::Accepted(accepted)) => {
                bake_id = accepted.bake_id;
                println!("bake {bake_id}");
            }
            Some(Kind::Progress(p)) => {
                let stage = Stage::try_from(p.stage)?.as_str_name();
                println!("{stage}: {:.0} %, {} bodies", p.fraction * 100.0, p.body_count);
            }
            Some(Kind::Frame(_)) => frames += 1,
            Some(Kind::Summary(s)) => println!("{} bodies, {frames} frames streamed", s.body_count),
            Some(Kind::BodyTable(_)) | None => {}
        }
    }
    Ok(bake_id)
}
