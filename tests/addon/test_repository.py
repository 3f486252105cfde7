"""The add-on in a repository of its own, as `.ci/repository` lays it out: install, update, go back; and a studio's
central folder."""

import functools
import http.server
import os
import re
import shutil
import subprocess
import sys
import threading
import zipfile
from pathlib import Path

import bpy
import pytest

HERE = Path(__file__).parent
TOOL = Path(bpy.utils.system_resource("SCRIPTS"), "addons_core", "bl_pkg", "cli", "blender_ext.py")
pytestmark = pytest.mark.skipif(bpy.app.version < (4, 2, 0), reason="extensions are of Blender 4.2 on")


def publish(folder, version):
    """Puts the add-on's zip there with another version, and with a program inside; and its index."""
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.zip"):
        old.unlink()
    with (
        zipfile.ZipFile(os.environ["CAIRN_ADDON"]) as archive,
        zipfile.ZipFile(folder / f"cairn-{version}.zip", "w", zipfile.ZIP_DEFLATED) as made,
    ):
        for entry in archive.infolist():
            content = archive.read(entry)
            if entry.filename == "cairn/blender_manifest.toml":
                content = re.sub(rb'(?m)^version = ".*"', b'version = "%s"' % version.encode(), content)
            made.writestr(entry, content)
        program = zipfile.ZipInfo("cairn/bin/cairn")
        program.external_attr = 0o100755 << 16
        made.writestr(program, "#!/bin/sh\n")
    done = subprocess.run(
        [sys.executable, TOOL, "server-generate", "--repo-dir", folder], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture
def address(tmp_path):
    quiet = type("Quiet", (http.server.SimpleHTTPRequestHandler,), {"log_message": lambda *_: None})
    handler = functools.partial(quiet, directory=str(tmp_path / "web"))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def a_blender(home, script, *arguments, **environment):
    """Another Blender, of a user of its own."""
    home.mkdir()
    environment = {**os.environ, "HOME": str(home), "XDG_CONFIG_HOME": str(home / ".config"), **environment}
    command = [sys.executable, str(HERE / script), *arguments]
    return subprocess.Popen(
        command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


def test_install_update_and_go_back(tmp_path, address):
    web = tmp_path / "web"
    web.mkdir()
    publish(web / "stable", "0.1.7")
    publish(web / "2026-01-31", "0.1.7")
    blender = a_blender(
        tmp_path / "home", "repository.py", f"{address}/stable/index.json", f"{address}/2026-01-31/index.json"
    )
    printed = []
    for line in blender.stdout:
        printed.append(line.strip())
        if line.startswith("installed"):
            publish(web / "stable", "0.1.8")
            blender.stdin.write("\n")
            blender.stdin.flush()
    assert blender.wait() == 0, "\n".join(printed)
    said = [line for line in printed if line.startswith(("installed", "updated", "back"))]
    assert said == ["installed 0.1.7", "updated 0.1.8", "back at 0.1.7"], "\n".join(printed)


def test_a_studio_has_it_once_for_all_and_nobody_can_write_there(tmp_path):
    place = tmp_path / "studio" / "system"
    zipfile.ZipFile(os.environ["CAIRN_ADDON"]).extractall(place)
    before = {path.relative_to(place): path.stat().st_mtime_ns for path in place.rglob("*")}
    for path in [place, *place.rglob("*")]:
        path.chmod(path.stat().st_mode & ~0o222)
    environment = {"BLENDER_SYSTEM_EXTENSIONS": str(tmp_path / "studio"), "PYTHONDONTWRITEBYTECODE": "1"}
    # Offline, as workstations of studios are.
    blender = a_blender(tmp_path / "home", "central.py", **environment)
    printed = blender.communicate()[0]
    shutil.rmtree(tmp_path / "home")
    assert blender.returncode == 0 and "works" in printed, printed
    assert {path.relative_to(place): path.stat().st_mtime_ns for path in place.rglob("*")} == before
