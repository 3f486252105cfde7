"""The server on this machine ends with the last Blender that uses it, however that ends."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import PROGRAM, once

PATIENCE = 60.0
# Blender has no part in it.
pytestmark = once
# The add-on's server, without Blender: prints that it is there, and stays.
USER = """
import sys, time, types
sys.path.append({numpy!r})
package = types.ModuleType("cairn")
package.__path__ = [{package!r}]
sys.modules["cairn"] = package
from cairn import server
local = server.LocalServer({folder!r})
print(local.reach({program!r}).address, flush=True)
sys.stdin.readline()
local.stop()
"""


@pytest.fixture
def blender(addon, tmp_path):
    """Starts another user of the server: gives its process and the server's address."""
    package = str(Path(addon("server").__file__).parent)
    started = []

    def start():
        places = {"package": package, "numpy": str(Path(np.__file__).parents[1])}
        script = USER.format(folder=str(tmp_path), program=str(PROGRAM), **places)
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        process = subprocess.Popen([sys.executable, "-c", script], **pipes)
        started.append(process)
        return process, process.stdout.readline().strip()

    yield start
    for process in started:
        process.kill()
        process.communicate()


def listens(addon, address):
    return addon("server")._listens(address)


def ends(addon, address):
    until = time.monotonic() + PATIENCE
    while listens(addon, address) and time.monotonic() < until:
        time.sleep(0.2)
    return not listens(addon, address)


@pytest.mark.skipif(os.name == "nt", reason="signals are not of Windows")
def test_a_server_ends_with_the_last_blender_that_was_killed(blender, addon):
    (first, address), (second, same) = blender(), blender()
    assert address == same and listens(addon, address)
    first.send_signal(signal.SIGKILL)
    first.wait()
    # Longer than the server waits between two looks.
    time.sleep(3.0)
    assert listens(addon, address), "another Blender uses it"
    second.send_signal(signal.SIGKILL)
    second.wait()
    assert ends(addon, address)


def test_a_blender_that_quits_leaves_the_server_to_another(blender, addon, tmp_path):
    (first, address), (second, _) = blender(), blender()
    first.communicate("\n")
    assert listens(addon, address) and len(list((tmp_path / "users").glob("*.lock"))) == 1
    second.communicate("\n")
    assert ends(addon, address) and not list((tmp_path / "users").glob("*.lock"))


def test_a_program_that_may_not_run_where_nobody_can_write_is_copied(addon, monkeypatch, tmp_path):
    server = addon("server")
    program = tmp_path / "studio" / server.NAME
    program.parent.mkdir()
    program.write_text("#!/bin/sh\necho it runs\n")
    program.chmod(0o444)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    # As for a user who is not its owner; whoever runs the tests may be.
    allowed = type(program).chmod

    def refused(path, mode):
        if path == program:
            raise PermissionError(1, "Operation not permitted")
        allowed(path, mode)

    monkeypatch.setattr(type(program), "chmod", refused)
    found = server.runnable(program)
    assert found != program and server.runnable(program) == found
    assert subprocess.run([found], capture_output=True, text=True, check=True).stdout == "it runs\n"
    (tmp_path / "blocked").write_text("")
    monkeypatch.setenv("HOME", str(tmp_path / "blocked"))
    with pytest.raises(addon("client").Fault, match="chmod"):
        server.runnable(program)
