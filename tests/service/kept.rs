//! Files that a released version wrote (`kept/VERSION.zip`): this version goes on with them. Each archive has the data
//! folder of a server with one finished bake, the results of it and of a bake without a server, its scene, and a cache.

use crate::service::server::{PROGRAM, Server};
use cairn_wire::proto::{Artifact, BakeState, ListBakesRequest};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;
use zip::ZipArchive;

/// The archives, each unpacked into a folder.
fn kept() -> Vec<(PathBuf, tempfile::TempDir)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/service/kept");
    let unpacked = |entry: std::io::Result<std::fs::DirEntry>| {
        let path = entry.unwrap().path();
        let into = tempfile::tempdir().unwrap();
        ZipArchive::new(File::open(&path).unwrap()).unwrap().extract(into.path()).unwrap();
        (path, into)
    };
    std::fs::read_dir(folder).unwrap().map(unpacked).collect()
}

#[tokio::test]
async fn a_servers_folder_of_each_release_is_taken_over() {
    for (path, folder) in kept() {
        let version = path.file_stem().unwrap().to_str().unwrap();
        let server = Server::start_in(folder.path(), &[]);
        let mut connection = server.ready().await;
        let listed = connection.service.list_bakes(ListBakesRequest::default()).await.unwrap().into_inner().bakes;
        assert_eq!(listed.len(), 1, "{version}: {}", server.log());
        assert_eq!(listed[0].state(), BakeState::Succeeded);
        assert_eq!(listed[0].labels["kept"], version);
        let id = &listed[0].bake_id;
        // The bytes that the release delivered, and other formats of the same pile.
        let result = connection.download(id, Artifact::Result).await.unwrap();
        assert!(result == std::fs::read(server.path("pile.glb")).unwrap(), "{version}");
        let again = Command::new(PROGRAM)
            .args(["watch", id, "-o", "again.usda", "--quiet", "--server", &server.addresses[0]])
            .current_dir(folder.path())
            .output()
            .unwrap();
        assert!(again.status.success(), "{version}: {}", String::from_utf8_lossy(&again.stderr));
        assert!(std::fs::read_to_string(server.path("again.usda")).unwrap().starts_with("#usda"));
    }
}

/// Results are scenes, too; and what the cache has from before is not in the way.
#[test]
fn scenes_and_results_of_each_release_are_read() {
    for (path, folder) in kept() {
        let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
        for (number, scene) in ["pile.toml", "pile.glb", "pile.usda"].into_iter().enumerate() {
            let output = format!("{number}.glb");
            let bake = Command::new(PROGRAM)
                .args(["bake", scene, "-o", &output, "--quiet"])
                .current_dir(folder.path())
                .env("CAIRN_CACHE", folder.path().join("cache"))
                .output()
                .unwrap();
            assert!(bake.status.success(), "{}, {scene}: {}", path.display(), String::from_utf8_lossy(&bake.stderr));
            assert!(read(&output) == read("0.glb"), "{scene} says something else");
        }
    }
}
