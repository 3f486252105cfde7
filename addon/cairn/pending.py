"""Bakes that were under way when Blender closed: told of in files of the add-on's, one for each .blend, never in the
.blend itself."""

import hashlib
import json
import shutil

import bpy

from . import preferences

# Notes that are kept: the latest, since those are what somebody will come back to.
MOST = 50


def _folder():
    return preferences.folder() / "pending"


def _path():
    return _folder() / f"{hashlib.sha256(bpy.data.filepath.encode()).hexdigest()[:32]}.json"


def request_folder(recipe):
    """Where a request waits until the server has taken it."""
    return preferences.folder() / "asked" / recipe["token"]


def note(recipe, bake_id):
    """A bake of this file was asked for. Its id is empty before the server has taken it. A file without a name cannot
    be opened again."""
    if not bpy.data.filepath:
        return
    _folder().mkdir(parents=True, exist_ok=True)
    path = _path()
    # Another Blender may write one, too.
    part = path.with_suffix(f".{recipe['token']}")
    part.write_text(json.dumps({"file": bpy.data.filepath, "bake_id": bake_id, "recipe": recipe}))
    part.replace(path)
    notes = sorted(_folder().glob("*.json"), key=_age, reverse=True)
    for old in notes[MOST:]:
        told = _read(old)
        if told:
            shutil.rmtree(request_folder(told["recipe"]), ignore_errors=True)
        old.unlink(missing_ok=True)


def _age(path):
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def forget(recipe):
    """A bake of this file has ended. A later one, perhaps another Blender's, is still told of."""
    told = of_this_file()
    if told and told["recipe"]["token"] == recipe.get("token"):
        _path().unlink(missing_ok=True)


def of_this_file():
    """Id and recipe of a bake of this file that was under way; None if there is none."""
    return _read(_path()) if bpy.data.filepath else None


def give_up():
    """The bake of this file is not wanted any more."""
    told = of_this_file()
    if told:
        shutil.rmtree(request_folder(told["recipe"]), ignore_errors=True)
        _path().unlink(missing_ok=True)


def _read(path):
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return None
