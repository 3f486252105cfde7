"""A bake in the background: a thread talks to the server, and Blender's own thread reads a queue."""

import asyncio
import queue
import shutil
import threading
from dataclasses import dataclass, field

from . import client, plainly
from .client import Connection, Fault
from .messages import v1
from .recording import Recording

# Longest time for the server to receive a cancellation, s.
FAREWELL = 2.0
# The name of a kept request's message, beside the models.
SPEC = "spec"


@dataclass
class Server:
    """Where bakes go: a remote server's target, or a server on this machine with its program."""

    target: client.Target = None
    local: object = None
    program: object = None

    async def reach(self):
        if self.target:
            return self.target
        return await asyncio.get_running_loop().run_in_executor(None, self.local.reach, self.program)


@dataclass
class Job:
    """One bake. `messages` has pairs: `("state", text)`, `("accepted", message)`, `("progress", message)`, and at the
    end `("done", summary)`, `("stopped", None)` or `("failed", Fault)`."""

    server: Server
    # The request, and the models' bytes by SHA-256; or the id of a running or finished bake.
    spec: object = None
    contents: dict = field(default_factory=dict)
    # Known problems. The server is asked for the others, and nothing is baked.
    problems: list = field(default_factory=list)
    bake_id: str = ""
    # Whether the frames of the fill are sent, to show the pile as it forms.
    has_fill: bool = True
    # A folder where the request waits until the server has taken it; None: nowhere.
    kept: object = None
    messages: queue.SimpleQueue = field(default_factory=queue.SimpleQueue)
    recording: Recording = field(default_factory=Recording)
    # The latest bodies, for drawing.
    latest: object = None
    # As the server writes it, once the bake is done.
    report: dict = field(default_factory=dict)
    # How it ended, for callers that read no messages.
    end: str = ""
    _task: object = None
    _detached: bool = False

    def start(self):
        self._task = asyncio.run_coroutine_threadsafe(self._run(), _loop())

    def stop(self):
        """Ends the bake, here and on the server. Returns at once."""
        if self._task:
            self._task.cancel()

    def detach(self):
        """Stops listening only; the server continues the bake."""
        self._detached = True
        self.stop()

    async def _run(self):
        try:
            await self._follow()
        except asyncio.CancelledError:
            self.messages.put(("stopped", None))
            if not self._detached:
                self._forget_request()
                if self.bake_id:
                    # The task ends as cancelled; this one does not.
                    asyncio.ensure_future(self._cancel())
            raise
        except Fault as fault:
            if self.server.local and plainly.SERVER_FULL in fault.message:
                fault = plainly.full(self.server.local.folder)
            self.messages.put(("failed", fault))
        except Exception as error:  # noqa: BLE001 whatever it is, the artist gets a sentence
            known = plainly.fault_of(error, self.server.local.folder if self.server.local else self.kept)
            self.messages.put(("failed", known or Fault(f"The add-on has a fault: {type(error).__name__}: {error}")))

    async def _follow(self):
        if self.problems:
            # All problems are reported at once.
            await _plan(self.server, self.spec, self.contents, self.problems)
        if self.kept and self.spec:
            await asyncio.get_running_loop().run_in_executor(None, self._keep_request)
        elif self.kept and not self.bake_id:
            await asyncio.get_running_loop().run_in_executor(None, self._read_request)
        try:
            await self._follow_once()
        except Fault as fault:
            # A server that another Blender left behind finishes its bakes and takes no new ones, and one of another
            # version may not understand us. A new server does both, and resumes the old one's bakes.
            is_old = fault.reason in ("SHUTTING_DOWN", "PROTOCOL_MISMATCH")
            if not is_old or self.server.local is None or self.bake_id:
                raise
            await asyncio.get_running_loop().run_in_executor(None, self.server.local.stop_now)
            await self._follow_once()

    async def _follow_once(self):
        self.messages.put(("state", "Connecting"))
        if self.spec is None:
            events = client.watch(self.server.reach, self.bake_id, has_fill=self.has_fill)
        else:
            report_state = lambda state: self.messages.put(("state", state))  # noqa: E731
            events = client.bake(self.server.reach, self.spec, self.contents, report_state, self.has_fill)
        summary = None
        async for event in events:
            kind = event.WhichOneof("kind")
            if kind == "accepted":
                self.bake_id = event.accepted.bake_id
                self._forget_request()
                self.messages.put(("accepted", event.accepted))
            elif kind == "progress":
                self.recording.end_at(event.progress.frame_count)
                self.messages.put(("progress", event.progress))
            elif kind == "body_table":
                self.recording.add_table(event.body_table)
            elif kind == "frame":
                self.latest = self.recording.add_frame(event.frame)
            elif kind == "summary":
                summary = event.summary
                self.recording.end_at(summary.frame_count)
        if summary is None:
            raise Fault("The server ended the bake without a result. Bake again.")
        try:
            async with Connection(await self.server.reach()) as connection:
                self.report = await connection.report(self.bake_id)
        except Fault:
            # The pile does not need it.
            pass
        self.messages.put(("done", summary))

    def _keep_request(self):
        part = self.kept.with_suffix(".part")
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        for sha256, content in self.contents.items():
            (part / sha256).write_bytes(content)
        (part / SPEC).write_bytes(self.spec.SerializeToString())
        part.rename(self.kept)

    def _read_request(self):
        try:
            self.spec = v1.BakeSpec.FromString((self.kept / SPEC).read_bytes())
            self.contents = {asset.sha256: (self.kept / asset.sha256).read_bytes() for asset in self.spec.assets}
        except OSError as error:
            raise Fault("Blender closed before the bake had begun. Press Bake Pile.") from error

    def _forget_request(self):
        if self.kept:
            shutil.rmtree(self.kept, ignore_errors=True)

    async def _cancel(self):
        try:
            async with Connection(await self.server.reach()) as connection:
                await connection.call("CancelBake", timeout=FAREWELL, bake_id=self.bake_id)
        except Fault:
            # It has ended, or is out of reach.
            pass


async def _ask(server, name, **fields):
    async with Connection(await server.reach()) as connection:
        await connection.handshake()
        return await connection.call(name, **fields)


def ask(server, name, **fields):
    """One call in the background, as a future of its answer, which raises `Fault`."""
    return asyncio.run_coroutine_threadsafe(_ask(server, name, **fields), _loop())


async def _plan(server, spec, contents, problems):
    problems = list(problems)
    if problems and not ((spec.scene.control_mesh.path or spec.scene.fill.into) and spec.scene.props):
        # No more calls are needed.
        raise Fault("", problems=problems)
    try:
        async with Connection(await server.reach()) as connection:
            await connection.handshake()
            await connection.upload(contents)
            answer = await connection.plan(spec)
    except Fault as fault:
        if not problems or not fault.problems:
            raise
        problems += fault.problems
    if problems:
        raise Fault("", problems=problems)
    return answer


def plan(server, spec, contents, problems=()):
    """The plan of a bake, as a future. `problems`: those known already; the server's are reported with them."""
    return asyncio.run_coroutine_threadsafe(_plan(server, spec, contents, problems), _loop())


_background = None


def _loop():
    """The event loop of the one background thread."""
    global _background
    if _background is None:
        _background = asyncio.new_event_loop()
        threading.Thread(target=_background.run_forever, name="cairn", daemon=True).start()
    return _background


def end():
    """Ends the background thread."""
    global _background
    if _background is not None:
        _background.call_soon_threadsafe(_background.stop)
        _background = None
