"""Detects changes of the scene by properties that are quick to read."""

import json

from . import others, request

# With more objects or vertices, reading would be noticeable: then only the buttons ask.
MAX_VERTICES = 500_000
MAX_OBJECTS = 300


def of(scene):
    """A text that changes with the scene; None if the scene is too large."""
    settings = scene.cairn
    tops = [settings.control_mesh, settings.region, settings.drop_mesh, *request.colliders_of(settings)]
    tops += [source for source, _ in request.props_of(settings)]
    tops += [*request.objects_of(settings.keep), *request.objects_of(settings.impact)]
    tops += [settings.entrance_source, settings.entrance_curve]
    objects = [member for top in tops if top for member in (top, *top.children_recursive)]
    if len(objects) > MAX_OBJECTS:
        return None
    parts, vertices = [], 0
    for source in objects:
        count = len(source.data.vertices) if source.type == "MESH" else 0
        vertices += count
        box = [round(value, 5) for corner in source.bound_box for value in corner]
        parts.append((source.name, count, box, [round(v, 5) for row in source.matrix_world for v in row]))
    if vertices > MAX_VERTICES:
        return None
    values = request.to_dict(settings)
    # All objects are read at once, and the form of the text costs nothing.
    for name in ("output_mode", "active_prop", "use_replace", "use_prop_collections"):
        values.pop(name)
    # The plan has every quality; only the goal of the automatic one changes which of them it is.
    goal = [values.pop(name) for name in ("accuracy", "goal", "goal_seconds", "goal_overlap")]
    units = scene.unit_settings.scale_length, scene.render.fps, scene.use_gravity, *scene.gravity
    piles = [(pile.name, pile.cairn.bake_id) for pile in others.of(scene, settings.control_mesh)]
    return json.dumps([values, goal if settings.accuracy == "AUTO" else None, parts, units, piles])
