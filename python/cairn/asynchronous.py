"""The client for asyncio."""

from __future__ import annotations

import contextlib
import json
import os
import re
import tempfile
from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from .request import Request, Scene, read
from .v1.event_pb2 import Accepted, Progress, Summary
from .v1.service_pb2 import AnalysePileResponse, BakeStatus, GetServerInfoResponse, PlanBakeResponse
from .wire import client
from .wire.client import Connection, Fault, Target
from .wire.messages import v1
from .wire.recording import Motion, Recording, Snapshot

Event = Accepted | Progress | Snapshot | Summary
# Formats by name, from the schema.
# By the ends of file names that differ from their names here, the longest first.
ENDINGS = {".physics.glb": "glb_physics", ".hulls.glb": "glb_hulls", ".pack.zip": "pack", ".xml": "mjcf"}
FORMATS = {name.removeprefix("OUTPUT_FORMAT_").lower(): number for name, number in v1.OutputFormat.items() if number}
# A name of a file beside a result.
PLAIN = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]*")


class AsyncClient:
    """A client of a server. Each call opens a connection, so that it holds nothing and may be used anywhere.

    `address`: HOST:PORT, https://HOST:PORT or unix:PATH. `token`: the server's, if it has one. `certificates`: a PEM
    file of the authority that signed the server's certificate; empty: this machine's. `route`: where several servers
    are behind a proxy, calls with the same text reach the same one; empty: a bake's calls have a hash of its request.
    `identity`: PEM files of this caller's certificate and its key, where the server asks for one.
    """

    def __init__(
        self,
        address: str = "127.0.0.1:50151",
        *,
        token: str = "",
        certificates: str = "",
        route: str = "",
        identity: tuple[str, str] | tuple[()] = (),
    ) -> None:
        self._target = Target(address, token, certificates, route, identity)

    async def info(self) -> GetServerInfoResponse:
        """Versions, limits and accuracy presets of the server."""
        async with Connection(self._target) as server:
            return await server.handshake()

    async def upload(self, scene: Scene, /, **settings: Any) -> Request:
        """Sends the files of a scene that the server does not have, and returns the request, ready to plan and bake.

        `scene`, `settings`: as `cairn.read` takes them.
        """
        request = read(scene, **settings)
        async with Connection(_routed(self._target, request)) as server:
            await server.handshake()
            await server.upload(request.contents)
        return request

    async def plan(self, scene: Scene, /, **settings: Any) -> PlanBakeResponse:
        """The plan of a bake and its cost: `.plan.expected_body_count`, `.plan.estimates` (CPU time, s; overlap, m)."""
        request = await self.upload(scene, **settings)
        async with Connection(_routed(self._target, request)) as server:
            return await server.plan(request.spec)

    def bake(
        self,
        scene: Scene,
        /,
        *,
        has_fill: bool = False,
        format: str = "glb",  # noqa: A002 as the program calls it
        labels: Mapping[str, str] | None = None,
        priority: int = 0,
        from_bake: str = "",
        **settings: Any,
    ) -> AsyncBake:
        """Requests a bake, which begins when the first event is read.

        `has_fill`: whether the fill's frames are sent, too. `format`: of the result’s file: glb, usdz, ...
        `labels`: names and values to find the bake by. `priority`: -100 to 100; above 0 for operators. `from_bake`: the
        id of a finished bake of this server that the bake changes: what nothing new is near stays, to the bit.
        """
        if format not in FORMATS:
            raise Fault(f"There is no format “{format}”. Choose one of {', '.join(FORMATS)}.")
        request = read(scene, **settings)
        spec = type(request.spec)()
        spec.CopyFrom(request.spec)
        spec.format, spec.from_bake_id = FORMATS[format], from_bake
        target = _routed(self._target, request)
        asked = {"labels": dict(labels or {}), "priority": priority}
        events = client.bake(_reach(target), spec, request.contents, has_fill=has_fill, **asked)
        return AsyncBake(target, events, format_number=spec.format)

    def watch(self, bake_id: str, *, has_fill: bool = False) -> AsyncBake:
        """An earlier bake, from its first event on."""
        return AsyncBake(self._target, client.watch(_reach(self._target), bake_id, has_fill=has_fill), bake_id)

    async def analyse(
        self, pile: str | os.PathLike[str] = "", /, *, bake_id: str = "", timeout: float | None = None, **settings: Any
    ) -> AnalysePileResponse:
        """What holds what in a pile: `.bodies`, `.touches`, and the whole in `.pile`.

        `pile`: a .glb, .usdz, or other file that names no files; or `bake_id`: a bake of the server that has succeeded,
        as it lies in the end. `timeout`: longest time of the call, s. `settings`: further fields of
        `AnalysePileRequest`, such as `scenery=["Table*"]` or `friction=0.5`.
        """
        asked: dict[str, Any] = {"bake_id": bake_id, **settings}
        answers = AnalysePileResponse()
        async with Connection(self._target) as server:
            if pile:
                content = Path(pile).read_bytes()
                asked["assets"] = [v1.AssetReference(uri=Path(pile).name, sha256=client.digest(content))]
                await server.upload({client.digest(content): content})
            async for reply in server.stream("AnalysePile", timeout, **asked):
                answers.MergeFrom(reply)
        return answers

    async def cancel(self, bake_id: str) -> None:
        """Withdraws from a waiting or running bake, which ends at once if nobody else wants it."""
        async with Connection(self._target) as server:
            await server.call("CancelBake", bake_id=bake_id)

    async def list(
        self,
        *,
        owner: str = "",
        labels: Mapping[str, str] | None = None,
        states: Sequence[str] = (),
    ) -> AsyncIterator[BakeStatus]:
        """The bakes of the server, the latest first, as it sends them.

        `owner`: only those that this caller owns or wants. `labels`: only those with all of these. `states`: queued,
        running, succeeded, failed or cancelled.
        """
        known = {name.removeprefix("BAKE_STATE_").lower(): number for name, number in v1.BakeState.items() if number}
        if wrong := [state for state in states if state not in known]:
            raise Fault(f"There is no state “{wrong[0]}”. Choose of {', '.join(known)}.")
        selected = {"owner": owner, "labels": dict(labels or {}), "states": [known[state] for state in states]}
        page = ""
        async with Connection(self._target) as server:
            while True:
                reply = await server.call("ListBakes", page_token=page, **selected)
                for bake in reply.bakes:
                    yield bake
                page = reply.next_page_token
                if not page:
                    return

    async def get(self, bake_id: str) -> BakeStatus:
        """The status of a bake, by its id or the first 6 or more digits of it."""
        async with Connection(self._target) as server:
            return (await server.call("GetBake", bake_id=bake_id)).bake

    async def delete(self, bake_id: str) -> None:
        """Ends a bake and removes its files; while other callers want it, only withdraws from it."""
        async with Connection(self._target) as server:
            await server.call("DeleteBake", bake_id=bake_id)


class AsyncBake:
    """A bake on a server: its events, in order, and its result.

    Events are `Accepted`, `Progress`, `Summary` (messages of `cairn.v1.event_pb2`) and `Snapshot` (numpy arrays of all
    bodies at a frame). A broken stream is resumed where it ended.
    """

    def __init__(self, target: Target, events: Any, bake_id: str = "", format_number: int = 0) -> None:
        self._target, self._events, self._format = target, events, format_number
        self._recording = Recording()
        # The bake's id; empty before it is accepted.
        self.id = bake_id
        # The plan, and the whole scene.
        self.accepted: Accepted | None = None
        # Figures, counts, warnings; None before the end.
        self.summary: Summary | None = None

    @property
    def route(self) -> str:
        """Routes calls to the bake's server, if several are behind a proxy: `Client(address, route=bake.route)`."""
        return self._target.route

    def __aiter__(self) -> AsyncIterator[Event]:
        return self._stream()

    async def _stream(self) -> AsyncIterator[Event]:
        async for event in self._events:
            kind = event.WhichOneof("kind")
            if kind == "body_table":
                self._recording.add_table(event.body_table)
            elif kind == "frame":
                yield self._recording.add_frame(event.frame)
            elif kind == "progress":
                self._recording.end_at(event.progress.frame_count)
                yield event.progress
            elif kind == "accepted":
                self.accepted, self.id = event.accepted, event.accepted.bake_id
                yield event.accepted
            elif kind == "summary":
                self.summary = event.summary
                self._recording.end_at(event.summary.frame_count)
                yield event.summary

    async def result(self) -> Motion:
        """The motion of all bodies, once the bake is done: positions [frame, body, 3] in m, rotations [frame, body, 4]
        as x, y, z, w; see `Motion`."""
        async for _ in self:
            pass
        motion = self._recording.motion()
        if self.summary is None or motion is None:
            raise Fault("The server ended the bake without a result. Bake again.")
        return motion

    async def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the result's file, complete or not at all, in the format of its name, otherwise in the requested one.

        The pictures of a .usda or .usdc are written into `textures` beside it.
        """
        await self.result()
        path = Path(path)
        ends = [name for ending, name in ENDINGS.items() if path.name.lower().endswith(ending)]
        wanted = FORMATS.get((ends or [path.suffix[1:].lower()])[0], self._format)
        async with Connection(self._target) as server:
            content, first = await server.download_file(self.id, format=wanted)
            for file in first.files:
                folder, _, name = file.name.partition("/")
                if folder != "textures" or not PLAIN.fullmatch(name):
                    raise Fault(f"The result names a file by “{file.name}”, which leads elsewhere.")
                beside = path.parent / folder / name
                beside.parent.mkdir(exist_ok=True)
                _write(beside, await server.download(self.id, format=wanted, file=file.name))
        _write(path, content)

    async def report(self) -> dict[str, Any]:
        """The report, as `cairn bake --report` writes it."""
        await self.result()
        async with Connection(self._target) as server:
            return json.loads(await server.download(self.id, v1.ARTIFACT_REPORT))

    async def cancel(self) -> None:
        """Ends the bake, at once."""
        async with Connection(self._target) as server:
            await server.call("CancelBake", bake_id=self.id)


def _routed(target: Target, request: Request) -> Target:
    """Calls about the same scene go to the same server."""
    scene = request.spec.SerializeToString(deterministic=True)
    return target if target.route else replace(target, route=client.digest(scene))


def _reach(target: Target) -> Any:
    async def reach() -> Target:
        return target

    return reach


def _write(path: Path, content: bytes) -> None:
    handle, part = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        # As any new file, not readable by this user alone.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(part, 0o666 & ~mask)
        os.replace(part, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(part)
        raise
