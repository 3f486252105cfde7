"""A client of `cairn.v1.PileService`, by gRPC. The Blender add-on has this file, too."""

import asyncio
import hashlib
import json
import ssl
from dataclasses import dataclass, field

from grpclib.client import Channel, StreamUnaryMethod, UnaryStreamMethod, UnaryUnaryMethod
from grpclib.const import Status
from grpclib.exceptions import GRPCError, StreamTerminatedError

from .messages import v1

PROTOCOL = 1
CHUNK = 64 * 1024
# Pauses before a broken stream is resumed: how many in a row; each doubles from the first, s.
ATTEMPTS = 6
FIRST_PAUSE = 0.2
# The place where a person sets the server, as the end of a sentence; a program with a window sets it.
place = ""
# Longest time of a call that is answered from memory, s.
SHORT = 30.0
# Information of the latest server, presets included; None before the first answer.
info = None


@dataclass(frozen=True)
class Target:
    """How to reach a server. `address`: HOST:PORT, https://HOST:PORT or unix:PATH."""

    address: str
    token: str = ""
    # PEM file of the authority that signed the server's certificate. Empty: those that this machine trusts.
    certificates: str = ""
    # Where several servers are behind a proxy: calls with the same text reach the same server. Empty: any server.
    route: str = ""
    # PEM files of the caller's own certificate and its key, for a server that asks for them.
    identity: tuple = ()


@dataclass(frozen=True)
class Problem:
    """One error of a scene."""

    text: str
    # The object's name, or the server's name for it; empty if there is none.
    about: str = ""


@dataclass
class Fault(Exception):
    """An error, in words for a person."""

    message: str
    # As in google.rpc.ErrorInfo: SCENE_INVALID, QUEUE_FULL, ...; empty if the call never arrived.
    reason: str = ""
    # All errors of the scene.
    problems: list = field(default_factory=list)
    # The same call may succeed on a new connection.
    is_broken: bool = False

    def __str__(self):
        return self.message


class Connection:
    """A connection. Use it in the event loop that it was made in, as `async with Connection(target) as server`."""

    def __init__(self, target):
        self.target = target
        self.metadata = {"authorization": f"Bearer {target.token}"} if target.token else {}
        if target.route:
            self.metadata["cairn-route"] = target.route
        self.channel = _channel(target)

    async def __aenter__(self):
        return self

    async def __aexit__(self, *_):
        self.channel.close()

    def _method(self, kind, name, reply=None):
        request, reply = getattr(v1, f"{name}Request"), getattr(v1, f"{reply or name}Response")
        return kind(self.channel, f"/cairn.v1.PileService/{name}", request, reply)

    async def call(self, name, timeout=SHORT, **fields):
        """One request, one reply: `await server.call("GetBake", bake_id=id)`."""
        method = self._method(UnaryUnaryMethod, name)
        with _faults(self.target):
            return await method(method.request_type(**fields), timeout=timeout, metadata=self.metadata)

    async def stream(self, name, timeout=None, **fields):
        """One request, many replies."""
        method = self._method(UnaryStreamMethod, name)
        with _faults(self.target):
            async with method.open(timeout=timeout, metadata=self.metadata) as stream:
                await stream.send_message(method.request_type(**fields), end=True)
                async for reply in stream:
                    yield reply

    async def handshake(self):
        """Server information; a fault if the two do not understand each other."""
        global info
        info = await self.call("GetServerInfo", protocol_version=PROTOCOL)
        return info

    async def upload(self, contents, on_progress=lambda share: None):
        """Uploads the files that the server does not have. `contents`: bytes by SHA-256."""
        missing = (await self.call("HaveAssets", sha256=sorted(contents))).missing_sha256
        total = sum(len(contents[sha256]) for sha256 in missing)
        sent = 0
        for sha256 in missing:
            method = self._method(StreamUnaryMethod, "UploadAsset")
            content = contents[sha256]
            with _faults(self.target):
                async with method.open(metadata=self.metadata) as stream:
                    header = v1.AssetHeader(sha256=sha256, size_bytes=len(content))
                    await stream.send_message(v1.UploadAssetRequest(header=header), end=not content)
                    for start in range(0, len(content), CHUNK):
                        part = content[start : start + CHUNK]
                        is_last = start + CHUNK >= len(content)
                        await stream.send_message(v1.UploadAssetRequest(chunk=part), end=is_last)
                        sent += len(part)
                        on_progress(sent / total)
                    await stream.recv_message()

    async def download(self, bake_id, artifact=v1.ARTIFACT_RESULT, **wanted):
        """A whole file of a finished bake. `wanted`: further fields of the request."""
        return (await self.download_file(bake_id, artifact=artifact, **wanted))[0]

    async def download_file(self, bake_id, **wanted):
        """A whole file, and the first message, which describes it."""
        replies = [reply async for reply in self.stream("DownloadResult", bake_id=bake_id, **wanted)]
        return b"".join(reply.chunk for reply in replies), replies[0] if replies else v1.DownloadResultResponse()

    async def report(self, bake_id):
        """The whole report of a bake."""
        return json.loads(await self.download(bake_id, v1.ARTIFACT_REPORT))

    async def plan(self, spec):
        """The plan of a bake. The server reads every model, which may take a while."""
        return await self.call("PlanBake", timeout=600.0, spec=spec)


def _selection(has_fill):
    return v1.FRAME_SELECTION_ALL if has_fill else v1.FRAME_SELECTION_RESULT


async def bake(reach, spec, contents, report_state=lambda state: None, has_fill=True, **asked):
    """Uploads, bakes, and yields the events to the end, over as many connections as it takes.

    `reach`: gives the target, awaited before each connection. `report_state`: called with what is done before the
    first event. `has_fill`: whether the fill's frames are sent, too. `asked`: more fields of the request.
    """
    async with Connection(await reach()) as server:
        await server.handshake()
        await server.upload(contents, lambda share: report_state(f"Sending props, {share:.0%}"))
        # The server reads all models before it accepts the bake.
        report_state("Reading props")
        bake_id, last = "", 0
        try:
            async for reply in server.stream("Bake", spec=spec, frames=_selection(has_fill), **asked):
                bake_id = reply.event.accepted.bake_id or bake_id
                last = max(last, reply.event.sequence_number)
                yield reply.event
            return
        except Fault as fault:
            if not fault.is_broken or not bake_id:
                raise
    async for event in watch(reach, bake_id, last + 1, has_fill):
        yield event


async def watch(reach, bake_id, first=1, has_fill=True):
    """Yields the events of a bake from number `first` on."""
    attempt = 0
    while True:
        try:
            async with Connection(await reach()) as server:
                await server.handshake()
                wanted = {"bake_id": bake_id, "from_sequence_number": first, "frames": _selection(has_fill)}
                async for reply in server.stream("WatchBake", **wanted):
                    first = max(first, reply.event.sequence_number + 1)
                    attempt = 0
                    yield reply.event
                return
        except Fault as fault:
            attempt += 1
            if not fault.is_broken or attempt > ATTEMPTS:
                raise
            await asyncio.sleep(FIRST_PAUSE * 2**attempt)


def digest(content):
    """The name of an asset: the SHA-256 of its bytes."""
    return hashlib.sha256(content).hexdigest()


def _channel(target):
    if target.address.startswith("unix:"):
        return Channel(path=target.address.removeprefix("unix:"))
    address = target.address.removeprefix("http://")
    is_encrypted = address.startswith("https://") or target.certificates or target.identity
    host, _, port = address.removeprefix("https://").rpartition(":")
    if not host or not port.isdecimal():
        raise Fault(f"The server's address is “{target.address}”. Write it as HOST:PORT{place}.")
    context = None
    if is_encrypted:
        try:
            context = ssl.create_default_context(cafile=target.certificates or None)
            if target.identity:
                context.load_cert_chain(*target.identity)
        except (OSError, ssl.SSLError) as error:
            files = ", ".join(name for name in (target.certificates, *target.identity) if name)
            raise Fault(f"{files}: {error}. Choose PEM files{place}.") from error
        context.set_alpn_protocols(["h2"])
    return Channel(host.strip("[]"), int(port), ssl=context)


class _faults:
    """Turns exceptions of the libraries into faults."""

    def __init__(self, target):
        self.target = target

    def __enter__(self):
        return self

    def __exit__(self, kind, error, _):
        if isinstance(error, GRPCError):
            raise _fault(error) from error
        if isinstance(error, asyncio.TimeoutError):
            raise Fault(f"The server at {self.target.address} does not answer.", is_broken=True) from error
        if isinstance(error, (OSError, StreamTerminatedError)):
            message = f"The server at {self.target.address} cannot be reached: {error or kind.__name__}. {_check()}"
            raise Fault(message, is_broken=True) from error
        return False


def _check():
    return f"Check address, token and certificates{place}."


def _fault(error):
    reason, problems = "", []
    for detail in error.details or ():
        name = type(detail).__name__
        if name == "ErrorInfo":
            reason = detail.reason
        elif name == "BadRequest":
            problems = [Problem(wrong.description) for wrong in detail.field_violations]
    if reason == "TOKEN_INVALID":
        return Fault(f"The server does not take the token. {_check()}", reason)
    # A server that shuts down leaves its bakes to the next one.
    is_broken = error.status in (Status.UNAVAILABLE, Status.UNKNOWN)
    return Fault(error.message or error.status.name, reason, problems, is_broken)
