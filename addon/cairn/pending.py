"""Bakes that were under way when Blender closed: told of in a file of the add-on's, never in the .blend."""

import json

import bpy

from . import preferences

MOST = 50


def _path():
    return preferences.folder() / "pending.json"


def _read():
    try:
        return json.loads(_path().read_text())
    except (OSError, ValueError):
        return {}


def _write(notes):
    # The latest are those that somebody will come back to.
    latest = dict(list(notes.items())[-MOST:])
    part = _path().with_suffix(".part")
    part.write_text(json.dumps(latest))
    part.replace(_path())


def note(bake_id, recipe):
    """A bake of this file runs. A file without a name cannot be opened again."""
    if bpy.data.filepath:
        notes = _read()
        notes.pop(bpy.data.filepath, None)
        notes[bpy.data.filepath] = {"bake_id": bake_id, "recipe": recipe}
        _write(notes)


def forget():
    """The bake of this file has ended, or is not wanted."""
    notes = _read()
    if notes.pop(bpy.data.filepath, None):
        _write(notes)


def of_this_file():
    """Id and recipe of a bake of this file that was under way; None if there is none."""
    return _read().get(bpy.data.filepath) if bpy.data.filepath else None
