"""The client for everyone else: each call waits."""

from __future__ import annotations

import asyncio
import functools
import os
import threading
from collections.abc import Coroutine, Iterator, Mapping
from typing import Any, TypeVar

from .asynchronous import AsyncBake, AsyncClient, Event
from .request import Request, Scene
from .v1.event_pb2 import Accepted, Summary
from .v1.service_pb2 import GetServerInfoResponse, PlanBakeResponse
from .wire.recording import Motion

T = TypeVar("T")


@functools.cache
def _loop() -> asyncio.AbstractEventLoop:
    """The one event loop of all clients that wait, in a thread of its own: callers may have a loop themselves."""
    loop = asyncio.new_event_loop()
    threading.Thread(target=loop.run_forever, name="cairn", daemon=True).start()
    return loop


def _wait(work: Coroutine[Any, Any, T]) -> T:
    future = asyncio.run_coroutine_threadsafe(work, _loop())
    try:
        return future.result()
    except BaseException:
        future.cancel()
        raise


class Client:
    """A server, as a caller sees it. As `AsyncClient`, but each call waits for its answer."""

    def __init__(
        self, address: str = "127.0.0.1:50151", *, token: str = "", certificates: str = "", route: str = ""
    ) -> None:
        self._client = AsyncClient(address, token=token, certificates=certificates, route=route)

    def info(self) -> GetServerInfoResponse:
        """Versions, limits and accuracy presets of the server."""
        return _wait(self._client.info())

    def upload(self, scene: Scene, /, **settings: Any) -> Request:
        """Sends the files of a scene that the server does not have, and gives what can be planned and baked at once."""
        return _wait(self._client.upload(scene, **settings))

    def plan(self, scene: Scene, /, **settings: Any) -> PlanBakeResponse:
        """What a bake would do and cost: `.plan.expected_body_count`, `.plan.estimates` (CPU time, s; overlap, m)."""
        return _wait(self._client.plan(scene, **settings))

    def bake(
        self,
        scene: Scene,
        /,
        *,
        has_fill: bool = False,
        format: str = "glb",  # noqa: A002 as the program calls it
        labels: Mapping[str, str] | None = None,
        priority: int = 0,
        **settings: Any,
    ) -> Bake:
        """Asks for a bake, which begins with the first event that is asked for: as `AsyncClient.bake`."""
        asked: dict[str, Any] = {"has_fill": has_fill, "format": format, "labels": labels, "priority": priority}
        return Bake(self._client.bake(scene, **asked, **settings))

    def watch(self, bake_id: str, *, has_fill: bool = False) -> Bake:
        """A bake that was asked for before, from its first event on."""
        return Bake(self._client.watch(bake_id, has_fill=has_fill))

    def cancel(self, bake_id: str) -> None:
        """Ends a bake that waits or runs, at once."""
        _wait(self._client.cancel(bake_id))


class Bake:
    """A bake on a server: its events, in their order, and what comes of it. As `AsyncBake`, but each call waits."""

    def __init__(self, bake: AsyncBake) -> None:
        self._bake = bake

    @property
    def id(self) -> str:
        """By which the bake is found again; empty before it is accepted."""
        return self._bake.id

    @property
    def route(self) -> str:
        """Where several servers are behind a proxy, what finds the bake's one: `Client(address, route=bake.route)`."""
        return self._bake.route

    @property
    def accepted(self) -> Accepted | None:
        """What it will do, and its whole scene."""
        return self._bake.accepted

    @property
    def summary(self) -> Summary | None:
        """Figures, counts, warnings; None before the end."""
        return self._bake.summary

    def __iter__(self) -> Iterator[Event]:
        events = aiter(self._bake)

        async def following() -> Event | None:
            return await anext(events, None)

        while (event := _wait(following())) is not None:
            yield event

    def result(self) -> Motion:
        """The motion of all bodies, once the bake is done: positions [frame, body, 3] in m, rotations [frame, body, 4]
        as x, y, z, w; see `Motion`."""
        return _wait(self._bake.result())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the result's file, in the format that was asked for: complete or not at all."""
        _wait(self._bake.save(path))

    def report(self) -> dict[str, Any]:
        """How good the pile is and how it was made, as `cairn bake --report` writes it."""
        return _wait(self._bake.report())

    def cancel(self) -> None:
        """Ends the bake, at once."""
        _wait(self._bake.cancel())
