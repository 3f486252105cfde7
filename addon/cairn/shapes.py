"""Settings of several shapes in one file: each shape keeps its own, which the panels show while it is chosen."""

import json

from . import pointers, request


def keep(settings, shape):
    """Remembers the settings with a shape."""
    note = shape.cairn
    note.settings = json.dumps(request.to_dict(settings))
    pointers.write(note.pointers, pointers.of(settings))


def choose(settings):
    """Called when another shape was chosen: the settings are the ones that were last used with it, if there are any."""
    before, shape = settings.last_shape, settings.control_mesh
    if before == shape:
        return
    settings.last_shape = shape
    if before is not None and before.library is None:
        keep(settings, before)
    if shape is not None and shape.cairn.settings:
        values = json.loads(shape.cairn.settings)
        # The choice itself is made already.
        values = {name: value for name, value in values.items() if name not in ("control_mesh", "last_shape")}
        request.from_dict(settings, values, pointers.read(shape.cairn.pointers))
