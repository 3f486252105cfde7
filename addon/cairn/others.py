"""The other piles of a scene, as they lie in the end: a new pile is built around them, and leans on them."""

from . import belongings, timing, visibility


def of(scene, control):
    """The shown piles of other shapes than `control`."""
    if not scene.cairn.use_piles:
        return []
    inside = [pile for pile in scene.collection.children_recursive if pile.cairn.is_result]
    others = [pile for pile in inside if pile.cairn.control != control and visibility.is_shown(scene, pile)]
    return [pile for pile in others if belongings.bodies(pile)]


def scenery(context, exporter, control):
    """A generator: one mesh in the world of each of them, with the pile."""
    models = []
    for pile in of(context.scene, control):
        model = _model(context.scene, exporter, pile)
        if model:
            models.append((pile, model))
        yield
    return models


def _model(scene, exporter, pile):
    shown = [member for body in belongings.bodies(pile) for member in (body, *body.children_recursive)]
    frame, end = scene.frame_current, timing.end_of(pile)
    if exporter.passive or frame == end:
        return exporter.together(pile.name, shown)
    try:
        scene.frame_set(end)
        return exporter.together(pile.name, shown)
    finally:
        scene.frame_set(frame)
