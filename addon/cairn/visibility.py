"""What a scene shows of shapes and piles. Another scene that has the same objects does not change."""

import bpy

# Edges of a shape up to which its wire lets its pile be seen.
MOST_EDGES = 3000


def others(scene, collection):
    """The other scenes that have a collection."""
    return [other for other in bpy.data.scenes if other != scene and collection in other.collection.children_recursive]


def _layers(scene, collection):
    """The places of a collection in a scene's view layers."""
    waiting = [layer.layer_collection for layer in scene.view_layers]
    while waiting:
        here = waiting.pop()
        if here.collection == collection:
            yield here
        waiting += here.children


def is_shown(scene, collection):
    """Whether a scene shows a collection, as far as this module hides it."""
    is_in = [not layer.exclude for layer in _layers(scene, collection)]
    return not collection.hide_viewport and (any(is_in) or not is_in)


def show(scene, collection, on):
    """Shows or hides a collection, in this scene alone."""
    if others(scene, collection):
        for layer in _layers(scene, collection):
            if layer.exclude == on:
                layer.exclude = not on
    else:
        collection.hide_viewport = collection.hide_render = not on
        for layer in _layers(scene, collection) if on else ():
            if layer.exclude:
                layer.exclude = False


def leave(scene, collection):
    """Takes a collection out of this scene alone."""
    if collection.name in scene.collection.children:
        scene.collection.children.unlink(collection)
    else:
        show(scene, collection, False)


def thin(control):
    """How a shape is shown around its pile: as wire; of a dense mesh, that would hide the pile: as its box."""
    # Not brought up to date: all new objects would be evaluated for it.
    graph = bpy.context.view_layer.depsgraph
    mesh = (control.evaluated_get(graph) if graph else control).data
    return "BOUNDS" if len(getattr(mesh, "edges", ())) > MOST_EDGES else "WIRE"


def veil(scene, control):
    """Shows a shape as wire, and not in renders: its pile is in its place. Gives a sentence about what is not
    possible; empty if all is."""
    note = control.cairn
    elsewhere = [other for other in bpy.data.scenes if other != scene and control.name in other.objects]
    elsewhere = [other for other in elsewhere if other.objects[control.name] == control]
    if elsewhere and not note.is_veiled:
        _hide_here(scene, control, True)
        note.is_hidden_here = True
        name = elsewhere[0].name
        return (
            f"The shape “{control.name}” is also in the scene “{name}”, which does not change: here it is hidden in "
            "the view, but not in renders. To hide it there, put it into a collection of its own"
        )
    if not note.is_veiled:
        note.is_veiled = True
        note.was_hidden_in_render, note.was_display_type = control.hide_render, control.display_type
    control.hide_render = True
    control.display_type = thin(control)
    return ""


def unveil(scene, control, stays=False):
    """Shows a shape as before its first pile, but for what the artist has changed since. `stays`: even if it has a
    pile."""
    note = control.cairn
    if note.is_hidden_here:
        _hide_here(scene, control, False)
        note.is_hidden_here = False
    is_used = any(c.cairn.is_result and c.cairn.control == control for c in bpy.data.collections)
    if not note.is_veiled or is_used and not stays:
        return
    note.is_veiled = False
    control.hide_render = note.was_hidden_in_render
    if control.display_type in {"WIRE", thin(control)}:
        control.display_type = note.was_display_type or "TEXTURED"


def _hide_here(scene, control, on):
    for layer in scene.view_layers:
        if layer.objects.get(control.name) == control:
            control.hide_set(on, view_layer=layer)
