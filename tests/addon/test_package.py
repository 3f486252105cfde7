"""The zip: small, complete, and as Blender asks for."""

import ast
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import bpy
import pytest

WITHOUT_BLENDER = ("axes", "client", "glb", "job", "messages", "outline", "plainly", "recording", "server")


def test_it_is_small_and_has_licences():
    path = Path(os.environ["CAIRN_ADDON"])
    names = zipfile.ZipFile(path).namelist()
    assert path.stat().st_size < 1_000_000 or any("/bin/" in name for name in names)
    assert {"cairn/__init__.py", "cairn/blender_manifest.toml", "cairn/LICENSE"} <= set(names)
    licences = [name for name in names if name.startswith("cairn/_vendor/licences/")]
    assert len(licences) >= 7


@pytest.mark.skipif(bpy.app.version < (4, 2, 0), reason="extensions are of Blender 4.2 on")
def test_blender_finds_the_extension_valid(tmp_path):
    tool = Path(bpy.utils.system_resource("SCRIPTS"), "addons_core", "bl_pkg", "cli", "blender_ext.py")
    archive = os.environ["CAIRN_ADDON"]
    done = subprocess.run([sys.executable, tool, "validate", archive], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    zipfile.ZipFile(archive).extractall(tmp_path)
    build = [sys.executable, tool, "build", "--source-dir", tmp_path / "cairn", "--output-dir", tmp_path]
    done = subprocess.run(build, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert list(tmp_path.glob("cairn-*.zip"))


def test_what_needs_no_blender_asks_for_none(addon):
    package = Path(addon("client").__file__).parent
    for name in WITHOUT_BLENDER:
        for node in ast.walk(ast.parse((package / f"{name}.py").read_text())):
            if isinstance(node, ast.Import):
                assert not {alias.name.split(".")[0] for alias in node.names} & {"bpy", "mathutils", "gpu"}, name
            if isinstance(node, ast.ImportFrom):
                own = node.module if node.level and node.module else ""
                names = {own.split(".")[0]} if own else {alias.name for alias in node.names} if node.level else set()
                assert names <= {*WITHOUT_BLENDER, "_vendor"}, (name, names)
                assert node.level or node.module not in ("bpy", "mathutils", "gpu"), name


def test_no_other_add_on_sees_the_libraries(addon):
    addon("messages")
    assert not {"grpclib", "h2", "hpack", "google.protobuf", "multidict"} & set(sys.modules)
