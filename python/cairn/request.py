"""Requests for a server. The program reads scenes, so that they mean the same as for `cairn bake`."""

import json
import os
import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .program import program
from .v1.service_pb2 import BakeSpec
from .wire.client import Fault, Problem


@dataclass(frozen=True)
class Request:
    """A scene to bake, with its files."""

    # The message: the scene, and the hashes of all files by the names that the scene has for them.
    spec: BakeSpec
    # The files' bytes by SHA-256, 64 lower-case hexadecimal digits.
    contents: Mapping[str, bytes]


Scene = str | os.PathLike[str] | Mapping[str, Any] | Request


def read(scene: Scene, /, **settings: Any) -> Request:
    """Reads a scene and all files that it names.

    `scene`: the path of a scene file, .toml or .json; or the same as a dict, with paths relative to the current folder.
    `settings`: fields of the scene that replace those of `scene`: `seed=7, control="off", fill={"count": 200}`.

    Raises `Fault` with all errors in `problems`.
    """
    if isinstance(scene, Request):
        if settings:
            raise Fault("A request is whole. Give settings with its scene, to `cairn.read`.")
        return scene
    arguments: list[str] = []
    if not isinstance(scene, Mapping):
        arguments.append(os.fspath(scene))
        scene = {}
    for field, value in [*_fields(scene), *_fields(settings)]:
        arguments += ["--set", f"{field}={value}"]
    with tempfile.TemporaryDirectory(prefix="cairn-") as folder:
        command = [program(), "scene", "--request", folder, *arguments]
        done = subprocess.run(command, capture_output=True, stdin=subprocess.DEVNULL)
        if done.returncode:
            lines = done.stderr.decode(errors="replace").splitlines()
            messages = [line.removeprefix("error: ") for line in lines if line]
            raise Fault("\n".join(messages), "SCENE_INVALID", [Problem(line) for line in messages])
        spec = BakeSpec.FromString((Path(folder) / "spec").read_bytes())
        return Request(spec, {asset.sha256: (Path(folder) / asset.sha256).read_bytes() for asset in spec.assets})


def _fields(tree: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Each value of a scene with its path, as `--set` takes them."""
    named = tree.items() if isinstance(tree, Mapping) else enumerate(tree) if _is_groups(tree) else None
    if named is None:
        yield path, tree if isinstance(tree, str) else json.dumps(tree)
        return
    for name, value in named:
        yield from _fields(value, f"{path}.{name}" if path else str(name))


def _is_groups(tree: Any) -> bool:
    return isinstance(tree, (list, tuple)) and any(isinstance(value, (Mapping, str)) for value in tree)
