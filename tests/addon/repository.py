"""repository.py ADDRESS OF_THE_OLD: installs the add-on from a repository, updates it, and goes back to the old one,
as an artist does in Preferences, Get Extensions. A Blender of its own, with nothing of a user's.

Reads one line before it updates: whoever runs it publishes the next version then.
"""

import importlib
import os
import sys
import tomllib
from pathlib import Path

import bpy

newest, old = sys.argv[-2:]
preferences = bpy.context.preferences
preferences.system.use_online_access = True
repository = preferences.extensions.repos.new(name="Cairn", module="cairn_stable", remote_url=newest)
number = list(preferences.extensions.repos).index(repository)
module = "bl_ext.cairn_stable.cairn"


def said():
    """The version that is installed, by its files."""
    manifest = Path(repository.directory) / "cairn" / "blender_manifest.toml"
    return tomllib.loads(manifest.read_text())["version"]


def works():
    assert module in preferences.addons, "it is not switched on"
    assert hasattr(bpy.types.Scene, "cairn"), "it is switched on, and is not there"
    # Blender's own unzipping loses the permission to run it.
    server = importlib.import_module(f"{module}.server")
    assert os.access(server.find(""), os.X_OK), "the server inside cannot be run"


bpy.ops.extensions.repo_sync(repo_index=number)
bpy.ops.extensions.package_install(repo_index=number, pkg_id="cairn", enable_on_install=True)
works()
print("installed", said(), flush=True)
sys.stdin.readline()

bpy.ops.extensions.repo_sync(repo_index=number)
bpy.ops.extensions.package_upgrade_all(use_active_only=False)
works()
print("updated", said(), flush=True)

repository.remote_url = old
bpy.ops.extensions.repo_sync(repo_index=number)
bpy.ops.extensions.package_uninstall(repo_index=number, pkg_id="cairn")
bpy.ops.extensions.package_install(repo_index=number, pkg_id="cairn", enable_on_install=True)
works()
print("back at", said(), flush=True)

sys.stdout.flush()
# As a module, Blender crashes at the end of the process.
os._exit(0)
