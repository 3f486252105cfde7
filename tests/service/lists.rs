//! Lists of very many bakes.

use crate::service::server::Server;
use cairn_wire::proto::{BakeState, BakeStatus, ListBakesRequest};
use prost::Message;

/// A page size above the limit gives the largest page, as in AIP-158.
#[tokio::test]
async fn a_page_size_beyond_the_limit_is_lowered() {
    const LIMIT: usize = 1000;
    let folder = tempfile::tempdir().unwrap();
    for number in 0..=LIMIT as i64 {
        let mut status = BakeStatus { bake_id: format!("{number:064x}"), ..Default::default() };
        status.create_time = Some(prost_types::Timestamp { seconds: number, nanos: 0 });
        status.set_state(BakeState::Succeeded);
        let bake = folder.path().join("data/bakes").join(&status.bake_id);
        std::fs::create_dir_all(&bake).unwrap();
        for (name, bytes) in
            [("status.binpb", status.encode_to_vec()), ("events.log", Vec::new()), ("result.glb", Vec::new())]
        {
            std::fs::write(bake.join(name), bytes).unwrap();
        }
    }
    let server = Server::start_in(folder.path(), &[]);
    let mut connection = server.connect().await;
    let mut pages = Vec::new();
    let mut list = ListBakesRequest { page_size: i32::MAX, ..Default::default() };
    loop {
        let page = connection.service.list_bakes(list.clone()).await.unwrap().into_inner();
        pages.push(page.bakes.len());
        if page.next_page_token.is_empty() {
            break;
        }
        list.page_token = page.next_page_token;
    }
    assert_eq!(pages, [LIMIT, 1]);
}
