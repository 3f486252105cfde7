"""The blocking client."""

from __future__ import annotations

import asyncio
import functools
import os
import threading
from collections.abc import Coroutine, Iterator, Mapping, Sequence
from typing import Any, TypeVar

from .asynchronous import AsyncBake, AsyncClient, Event
from .request import Request, Scene
from .v1.event_pb2 import Accepted, Summary
from .v1.service_pb2 import AnalysePileResponse, BakeStatus, GetServerInfoResponse, PlanBakeResponse
from .wire.recording import Motion

T = TypeVar("T")


@functools.cache
def _loop() -> asyncio.AbstractEventLoop:
    """The one event loop of all blocking clients, in its own thread: callers may have their own loop."""
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
    """A client of a server, like `AsyncClient`, but each call waits for its answer."""

    def __init__(
        self,
        address: str = "127.0.0.1:50151",
        *,
        token: str = "",
        certificates: str = "",
        route: str = "",
        identity: tuple[str, str] | tuple[()] = (),
    ) -> None:
        self._client = AsyncClient(address, token=token, certificates=certificates, route=route, identity=identity)

    def info(self) -> GetServerInfoResponse:
        """Versions, limits and accuracy presets of the server."""
        return _wait(self._client.info())

    def upload(self, scene: Scene, /, **settings: Any) -> Request:
        """Sends the files of a scene that the server does not have, and returns the request, ready to plan and bake."""
        return _wait(self._client.upload(scene, **settings))

    def plan(self, scene: Scene, /, **settings: Any) -> PlanBakeResponse:
        """The plan of a bake and its cost: `.plan.expected_body_count`, `.plan.estimates` (CPU time, s; overlap, m)."""
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
        from_bake: str = "",
        **settings: Any,
    ) -> Bake:
        """Requests a bake, which begins when the first event is read, like `AsyncClient.bake`."""
        asked: dict[str, Any] = {"has_fill": has_fill, "format": format, "labels": labels, "priority": priority}
        return Bake(self._client.bake(scene, **asked, from_bake=from_bake, **settings))

    def watch(self, bake_id: str, *, has_fill: bool = False) -> Bake:
        """An earlier bake, from its first event on."""
        return Bake(self._client.watch(bake_id, has_fill=has_fill))

    def analyse(
        self, pile: str | os.PathLike[str] = "", /, *, bake_id: str = "", timeout: float | None = None, **settings: Any
    ) -> AnalysePileResponse:
        """What holds what in a pile, like `AsyncClient.analyse`: `.bodies`, `.touches`, and the whole in `.pile`."""
        return _wait(self._client.analyse(pile, bake_id=bake_id, timeout=timeout, **settings))

    def cancel(self, bake_id: str) -> None:
        """Withdraws from a waiting or running bake, which ends at once if nobody else wants it."""
        _wait(self._client.cancel(bake_id))

    def list(
        self,
        *,
        owner: str = "",
        labels: Mapping[str, str] | None = None,
        states: Sequence[str] = (),
    ) -> Iterator[BakeStatus]:
        """The bakes of the server, the latest first, like `AsyncClient.list`."""
        bakes = aiter(self._client.list(owner=owner, labels=labels, states=states))

        async def following() -> BakeStatus | None:
            return await anext(bakes, None)

        while (bake := _wait(following())) is not None:
            yield bake

    def get(self, bake_id: str) -> BakeStatus:
        """The status of a bake, by its id or the first 6 or more digits of it."""
        return _wait(self._client.get(bake_id))

    def delete(self, bake_id: str) -> None:
        """Ends a bake and removes its files; while other callers want it, only withdraws from it."""
        _wait(self._client.delete(bake_id))


class Bake:
    """A bake on a server: its events, in order, and its result. Like `AsyncBake`, but each call waits."""

    def __init__(self, bake: AsyncBake) -> None:
        self._bake = bake

    @property
    def id(self) -> str:
        """The bake's id; empty before it is accepted."""
        return self._bake.id

    @property
    def route(self) -> str:
        """Routes calls to the bake's server, if several are behind a proxy: `Client(address, route=bake.route)`."""
        return self._bake.route

    @property
    def accepted(self) -> Accepted | None:
        """The plan, and the whole scene."""
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
        """Writes the result's file, complete or not at all, in the format of its name, otherwise in the requested one.

        The pictures of a .usda or .usdc are written into `textures` beside it.
        """
        _wait(self._bake.save(path))

    def report(self) -> dict[str, Any]:
        """The report, as `cairn bake --report` writes it."""
        return _wait(self._bake.report())

    def cancel(self) -> None:
        """Ends the bake, at once."""
        _wait(self._bake.cancel())
