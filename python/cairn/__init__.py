"""Bakes piles of props in the shape of a mesh, on a server of this machine or of a farm.

    import cairn

    with cairn.serve() as address:
        bake = cairn.Client(address).bake("pile.toml", seed=7)
        motion = bake.result()
    motion.positions  # numpy, [frame, body, 3], m

SI units; axes are glTF's: right-handed, Y up. `Client` blocks, `AsyncClient` is for asyncio; both have the same calls.
An error raises `Fault`; its `problems` lists all errors of a scene.
"""

from . import clutter
from .asynchronous import AsyncBake, AsyncClient, Event
from .program import analyse, pack, program, serve
from .request import Request, read
from .synchronous import Bake, Client
from .wire.client import Fault, Problem
from .wire.recording import Motion, Snapshot

__all__ = [
    "AsyncBake",
    "AsyncClient",
    "Bake",
    "Client",
    "Event",
    "Fault",
    "Motion",
    "Problem",
    "Request",
    "Snapshot",
    "analyse",
    "clutter",
    "pack",
    "program",
    "read",
    "serve",
]
