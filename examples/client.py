"""Bakes a pile on a Cairn server: uploads the models, shows the progress, writes the .glb.

pip install grpcio grpcio-tools
mkdir -p build && python -m grpc_tools.protoc -I proto --python_out build --grpc_python_out build proto/cairn/v1/*.proto
cairn serve &
PYTHONPATH=build python examples/client.py examples/assets/cone-small.glb examples/assets/stick.glb -o pile.glb
"""

import argparse
import hashlib
from pathlib import Path

import grpc
from cairn.v1 import event_pb2, scene_pb2, service_pb2, service_pb2_grpc

CHUNK = 64 * 1024


def upload(server, path, sha256):
    """Sends a file in chunks; its hash is its address."""

    def messages():
        content = path.read_bytes()
        header = service_pb2.AssetHeader(sha256=sha256, size_bytes=len(content))
        yield service_pb2.UploadAssetRequest(header=header)
        for start in range(0, len(content), CHUNK):
            yield service_pb2.UploadAssetRequest(chunk=content[start : start + CHUNK])

    server.UploadAsset(messages())


def bake(server, spec):
    """Yields the events; takes the stream up again where it breaks off."""
    request = service_pb2.BakeRequest(spec=spec, frames=service_pb2.FRAME_SELECTION_RESULT)
    stream, bake_id, last = server.Bake(request), None, 0
    while True:
        try:
            for response in stream:
                event = response.event
                bake_id = event.accepted.bake_id or bake_id
                last = event.sequence_number or last
                yield event
            return
        except grpc.RpcError as error:
            if error.code() != grpc.StatusCode.UNAVAILABLE or bake_id is None:
                raise
            watch = service_pb2.WatchBakeRequest(
                bake_id=bake_id, from_sequence_number=last + 1, frames=service_pb2.FRAME_SELECTION_RESULT
            )
            stream = server.WatchBake(watch, wait_for_ready=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("control", type=Path)
    parser.add_argument("props", type=Path, nargs="+")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--server", default="127.0.0.1:50151")
    args = parser.parse_args()

    server = service_pb2_grpc.PileServiceStub(grpc.insecure_channel(args.server))
    server.GetServerInfo(service_pb2.GetServerInfoRequest(protocol_version=1))

    files = {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in {args.control, *args.props}}
    missing = server.HaveAssets(service_pb2.HaveAssetsRequest(sha256=files.values())).missing_sha256
    for path, sha256 in files.items():
        if sha256 in missing:
            upload(server, path, sha256)

    scene = scene_pb2.Scene(
        control_mesh=scene_pb2.ControlMesh(path=str(args.control)),
        props=[scene_pb2.Prop(path=str(path)) for path in args.props],
        accuracy=scene_pb2.ACCURACY_DRAFT,
    )
    assets = [service_pb2.AssetReference(uri=str(path), sha256=sha256) for path, sha256 in files.items()]
    frames = 0
    for event in bake(server, service_pb2.BakeSpec(scene=scene, assets=assets)):
        frames += event.HasField("frame")
        if event.HasField("accepted"):
            bake_id = event.accepted.bake_id
            print(f"bake {bake_id}: about {event.accepted.plan.expected_body_count} bodies")
        elif event.HasField("progress"):
            stage = event_pb2.Stage.Name(event.progress.stage).removeprefix("STAGE_").lower()
            print(f"{stage}: {event.progress.fraction:.0%}, {event.progress.body_count} bodies")
        elif event.HasField("summary"):
            print(f"{event.summary.body_count} bodies, {frames} frames streamed")

    with args.output.open("wb") as file:
        for part in server.DownloadResult(service_pb2.DownloadResultRequest(bake_id=bake_id)):
            file.write(part.chunk)


if __name__ == "__main__":
    main()
