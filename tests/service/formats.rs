//! Formats of results: one bake gives all of them.

use crate::service::server::{Server, accepted_id, assert_fault, events, fields, request, sha256, short};
use cairn_wire::proto::bake_event::Kind;
use cairn_wire::proto::{Artifact, DeleteBakeRequest, DownloadResultRequest, OutputFormat, UpAxis, UsdLayout};
use tonic::Code;

/// The result of a bake in any format is that of a bake in this format.
#[tokio::test]
async fn one_bake_gives_every_format() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let formats = [
        OutputFormat::Glb,
        OutputFormat::Json,
        OutputFormat::Csv,
        OutputFormat::Usda,
        OutputFormat::Usdc,
        OutputFormat::Usdz,
        OutputFormat::Pack,
    ];
    let mut made = Vec::new();
    let mut id = String::new();
    for own in formats {
        let mut wanted = short(1);
        wanted.set_format(own);
        let stream = connection.service.bake(request(wanted)).await.unwrap().into_inner();
        let (answer, end) = events(stream).await;
        end.unwrap();
        let Some(Kind::Summary(summary)) = &answer.last().unwrap().kind else { panic!("the summary last") };
        assert!(id.is_empty() || id == accepted_id(&answer), "one bake");
        id = accepted_id(&answer);
        for format in formats {
            let request = DownloadResultRequest { bake_id: id.clone(), format: format.into(), ..Default::default() };
            let result = connection.download_file(&request).await.unwrap();
            assert_eq!(sha256(&result.bytes), result.first.sha256);
            if format == own {
                assert_eq!(result.first.sha256, summary.result_sha256);
                made.push(result.first.sha256.clone());
            }
            if ![OutputFormat::Json, OutputFormat::Csv, OutputFormat::Pack].contains(&format) {
                let origin = cairn_export::origin(&result.bytes).unwrap();
                assert_eq!(origin["result_blake3"], summary.result_blake3.as_str());
                assert_eq!(origin["request_blake3"], id.as_str());
            }
            let request = DownloadResultRequest { artifact: Artifact::Report.into(), ..request };
            let report = connection.download_file(&request).await.unwrap();
            assert_eq!(sha256(&report.bytes), report.first.sha256);
            let report: serde_json::Value = serde_json::from_slice(&report.bytes).unwrap();
            assert_eq!(report["output_blake3"], blake3::hash(&result.bytes).to_hex().as_str(), "{own:?} {format:?}");
            assert_eq!(report["request_blake3"], id.as_str());
            // The same file from either bake.
            let place = formats.iter().position(|other| *other == format).unwrap();
            if let Some(first) = made.get(place) {
                assert_eq!(*first, result.first.sha256, "{format:?} of a bake in {own:?}");
            }
        }
        connection.service.delete_bake(DeleteBakeRequest { bake_id: id.clone() }).await.unwrap();
    }
}

#[tokio::test]
async fn formats_and_files_that_there_are_not() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let stream = connection.service.bake(request(short(1))).await.unwrap().into_inner();
    let (answer, end) = events(stream).await;
    end.unwrap();
    let request = DownloadResultRequest { bake_id: accepted_id(&answer), ..Default::default() };
    for (field, wrong) in [
        ("format", DownloadResultRequest { format: 77, ..request.clone() }),
        ("file", DownloadResultRequest { file: "textures/gone.png".into(), ..request.clone() }),
        ("file", DownloadResultRequest { file: "../status.binpb".into(), ..request.clone() }),
        ("file", DownloadResultRequest { file: "report.json".into(), ..request.clone() }),
    ] {
        let answer = connection.service.download_result(wrong).await.unwrap_err();
        assert_eq!(fields(&assert_fault(&answer, Code::InvalidArgument, "REQUEST_INVALID")), [field]);
    }
    // As of an earlier server.
    let folder = server.path("data/bakes").join(&request.bake_id);
    for name in ["baked.postcard", "result.glb.head"] {
        std::fs::remove_file(folder.join(name)).unwrap();
    }
    let own = connection.download(&request.bake_id, Artifact::Result).await.unwrap();
    assert_eq!(own, std::fs::read(folder.join("result.glb")).unwrap());
    let other = DownloadResultRequest { format: OutputFormat::Usdz.into(), ..request };
    let answer = connection.service.download_result(other).await.unwrap_err();
    assert_fault(&answer, Code::FailedPrecondition, "FORMAT_UNAVAILABLE");
}

/// One bake is laid out as each caller asks.
#[tokio::test]
async fn each_caller_has_a_layout_of_its_own() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let layout = UsdLayout { up_axis: UpAxis::Z.into(), start_frame: Some(1001.0), ..Default::default() };
    let mut asked = short(1);
    asked.set_format(OutputFormat::Usda);
    let plain = asked.clone();
    asked.scene.as_mut().unwrap().usd = Some(layout.clone());
    let mut ids = Vec::new();
    for spec in [asked, plain] {
        let (answer, end) = events(connection.service.bake(request(spec)).await.unwrap().into_inner()).await;
        end.unwrap();
        ids.push(accepted_id(&answer));
    }
    assert_eq!(ids[0], ids[1], "the layout does not change the bake");
    let request = |usd: Option<UsdLayout>| DownloadResultRequest {
        bake_id: ids[0].clone(),
        format: OutputFormat::Usda.into(),
        usd,
        ..Default::default()
    };
    let mut text = async |request: &DownloadResultRequest| {
        let result = connection.download_file(request).await.unwrap();
        assert_eq!(sha256(&result.bytes), result.first.sha256);
        String::from_utf8(result.bytes).unwrap()
    };
    let own = text(&request(None)).await;
    assert!(own.contains("upAxis = \"Z\"") && own.contains("startTimeCode = 1001"), "{}", &own[..600]);
    assert_eq!(text(&request(Some(layout.clone()))).await, own);
    let plain = text(&request(Some(UsdLayout::default()))).await;
    assert!(plain.contains("upAxis = \"Y\"") && plain.contains("startTimeCode = 0"), "{}", &plain[..600]);
    assert!(!plain.contains("up_axis"), "its scene is the one that asks for nothing");
    let other = UsdLayout { default_prim: Some("heap".into()), ..layout.clone() };
    let report = DownloadResultRequest { artifact: Artifact::Report.into(), ..request(Some(other.clone())) };
    let report: serde_json::Value = serde_json::from_str(&text(&report).await).unwrap();
    let other = text(&request(Some(other))).await;
    assert!(other.contains("def Xform \"heap\""));
    assert_eq!(report["output_blake3"], blake3::hash(other.as_bytes()).to_hex().as_str());

    // What cannot be asked for.
    let wrong = UsdLayout { default_prim: Some("a/b".into()), ..Default::default() };
    let far = DownloadResultRequest { asset_folder: "a@b".into(), ..request(None) };
    for (field, wrong) in [("usd.default_prim", request(Some(wrong))), ("asset_folder", far)] {
        let answer = connection.service.download_result(wrong).await.unwrap_err();
        let details = assert_fault(&answer, Code::InvalidArgument, "REQUEST_INVALID");
        assert_eq!(fields(&details), [field]);
    }
    // Of many layouts, those go that were not used for longest: nobody is refused.
    let folder = server.path("data/bakes").join(&ids[0]);
    for number in 0..40 {
        std::fs::write(folder.join(format!("usd-layout-{number:016x}.binpb")), "").unwrap();
    }
    let last = UsdLayout { start_frame: Some(7.0), ..Default::default() };
    let result = connection.download_file(&request(Some(last))).await.unwrap().bytes;
    assert!(String::from_utf8(result).unwrap().contains("startTimeCode = 7"));
    let entries = std::fs::read_dir(folder).unwrap().flatten();
    assert_eq!(entries.filter(|entry| entry.file_name().to_string_lossy().starts_with("usd-layout-")).count(), 32);
}
