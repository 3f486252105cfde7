"""The program `cairn` of this package, and a server run with it."""

import contextlib
import json
import os
import shutil
import subprocess
import sysconfig
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from .wire.client import Fault

NAME = "cairn.exe" if os.name == "nt" else "cairn"


def program() -> Path:
    """The path of the program: among the scripts of this Python, else on the system's path."""
    own = Path(sysconfig.get_path("scripts")) / NAME
    found = own if own.is_file() else shutil.which(NAME)
    if not found:
        raise Fault(f"The program `{NAME}` is not here. Install this package again: `pip install --force-reinstall`.")
    return Path(found)


@contextlib.contextmanager
def serve(data: str | os.PathLike[str] | None = None, workers: int = 1) -> Iterator[str]:
    """A server on this machine, for as long as the `with` lasts; gives its address.

    `data`: the folder for assets and bakes, which the next server can use; None: they are deleted with the server.
    `workers`: bakes that run at once.
    """
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="cairn-"))
        # Only this user can reach a socket.
        listen = "127.0.0.1:0" if os.name == "nt" else f"unix:{folder}/socket"
        log = stack.enter_context(open(Path(folder) / "log", "w+", encoding="utf-8", errors="replace"))
        command = [program(), "serve", "--listen", listen, "--workers", str(workers), "--drain-seconds", "0"]
        command += ["--data", data or Path(folder) / "data"]
        server = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True))
        stack.callback(server.terminate)
        assert server.stdout is not None
        address = server.stdout.readline().strip()
        if not address:
            server.wait()
            log.seek(0)
            raise Fault(f"The server does not start: {log.read().strip()}")
        yield address


def analyse(
    pile: str | os.PathLike[str],
    *,
    scenery: Iterable[str] = (),
    without: Iterable[str] = (),
    friction: float | None = None,
    density: float | None = None,
    ground: float | None = None,
    safety: float | None = None,
) -> dict[str, Any]:
    """What holds what in a glTF or USD file whose nodes are bodies: the answers of `cairn analyse --json`.

    `scenery`, `without`: names of nodes that stand still, and of nodes that are left out; a name that ends in `*`
    stands for all that begin so. `friction`: Coulomb's coefficient. `density`: kg/m^3. `ground`: its height, m.
    `safety`: a body is safe to remove if the others stand with this share of their friction. None: as the program does
    by default.
    """
    command = [str(program()), "analyse", os.fspath(pile), "--json"]
    for flag, names in (("--scenery", scenery), ("--without", without)):
        command += [word for name in names for word in (flag, name)]
    numbers = {"--friction": friction, "--density": density, "--ground": ground, "--safety": safety}
    command += [f"{flag}={number}" for flag, number in numbers.items() if number is not None]
    return _answers(command)


def pack(
    pile: str | os.PathLike[str], folder: str | os.PathLike[str], *, levels: int | None = None, meshopt: bool = False
) -> dict[str, Any]:
    """Packs a `.glb` of a bake for games and the web into a folder, and gives its manifest, as `cairn pack` does.

    `levels`: levels of detail at most; None: as the program does by default. `meshopt`: meshes are compressed by
    EXT_meshopt_compression.
    """
    command = [str(program()), "pack", os.fspath(pile), "--json", f"--output={os.fspath(folder)}"]
    command += [f"--levels={levels}"] if levels is not None else []
    command += ["--meshopt"] if meshopt else []
    return _answers(command)


def _answers(command: list[str]) -> dict[str, Any]:
    """What a command prints as JSON."""
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", errors="replace")
    if done.returncode != 0:
        raise Fault(done.stderr.strip().removeprefix("error: "))
    answers: dict[str, Any] = json.loads(done.stdout)
    return answers
