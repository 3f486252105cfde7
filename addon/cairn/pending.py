"""Bakes that were running when Blender closed: notes in files of the add-on, one for each bake, never in the
.blend itself."""

import hashlib
import json
import shutil

import bpy

from . import preferences

# Number of notes and requests that are kept: the latest ones.
MOST = 50


def _folder():
    return preferences.folder() / "pending"


def _key():
    """The prefix of this file's notes: a file has several notes if several Blenders have it open."""
    return hashlib.sha256(bpy.data.filepath.encode()).hexdigest()[:32]


def request_folder(recipe):
    """The folder of a request until the server has accepted it."""
    return preferences.folder() / "asked" / recipe["token"]


def note(recipe, bake_id):
    """Notes a bake of this file. Its id is empty before the server has accepted it. A file without a name cannot be
    opened again."""
    _forget_oldest()
    if not bpy.data.filepath:
        return
    _folder().mkdir(parents=True, exist_ok=True)
    path = _folder() / f"{_key()}-{recipe['token']}.json"
    part = path.with_suffix(".part")
    part.write_text(json.dumps({"file": bpy.data.filepath, "bake_id": bake_id, "recipe": recipe}))
    part.replace(path)


def _forget_oldest():
    for path in _latest_first(_folder().glob("*.json"))[MOST:]:
        entry = _read(path)
        if entry:
            shutil.rmtree(request_folder(entry["recipe"]), ignore_errors=True)
        path.unlink(missing_ok=True)
    # Requests of files that never got a name.
    for folder in _latest_first((preferences.folder() / "asked").glob("*"))[MOST:]:
        shutil.rmtree(folder, ignore_errors=True)


def _latest_first(paths):
    return sorted(paths, key=_age, reverse=True)


def _age(path):
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def forget(recipe):
    """Deletes the note of a bake that has ended, also if its file was renamed. Notes of others, perhaps another
    Blender's, stay."""
    if recipe.get("token"):
        shutil.rmtree(request_folder(recipe), ignore_errors=True)
        for path in _folder().glob(f"*-{recipe['token']}.json"):
            path.unlink(missing_ok=True)


def of_this_file(besides=""):
    """Id and recipe of the latest running bake of this file; None if there is none. `besides`: the token of a bake to
    ignore."""
    for path in _latest_first(_folder().glob(f"{_key()}*.json")) if bpy.data.filepath else ():
        entry = _read(path)
        if entry and entry["recipe"]["token"] != besides:
            return entry
    return None


def give_up():
    """Forgets the latest bake of this file."""
    entry = of_this_file()
    if entry:
        forget(entry["recipe"])


def _read(path):
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return None
