"""Piles that a preview is drawn over: hidden in the view while it is shown, and shown again as before. What is hidden
is noted in the file, so that an undo or a file saved meanwhile does not keep it."""

import json

import bpy

from . import prop_collections, result

# What is drawn over the view now.
_drawn = set()


def begin(drawing):
    """Called when a preview is shown."""
    _drawn.add(drawing)
    refresh(bpy.context)


def end(drawing):
    """Called when a preview is removed."""
    _drawn.discard(drawing)
    refresh(bpy.context)


def refresh(context):
    """Hides the piles of the shape if a preview is shown, and otherwise shows what was hidden."""
    if not _drawn:
        bring_back()
        return
    scene, layer = context.scene, context.view_layer
    control = scene.cairn.control_mesh if scene else None
    for pile in result.piles(scene, control) if control else ():
        for collection in (pile, *prop_collections.of(pile)):
            place = _in(layer, collection)
            if place is not None and not place.hide_viewport:
                note = collection.cairn
                # Blender deselects what is hidden.
                selected = [shown.name for shown in collection.objects if shown.select_get(view_layer=layer)]
                where = [*json.loads(note.aside or "[]"), [scene.name, layer.name, selected]]
                note.aside, place.hide_viewport = json.dumps(where), True


def bring_back():
    """Shows again what was hidden."""
    for collection in bpy.data.collections:
        if not collection.cairn.aside:
            continue
        for scene_name, layer_name, selected in json.loads(collection.cairn.aside):
            scene = bpy.data.scenes.get(scene_name)
            layer = scene and scene.view_layers.get(layer_name)
            place = layer and _in(layer, collection)
            if place:
                place.hide_viewport = False
                layer.update()
                for name in selected:
                    if name in collection.objects and name in layer.objects:
                        collection.objects[name].select_set(True, view_layer=layer)
        collection.cairn.aside = ""


def forget():
    """Called when another file is opened or the add-on ends."""
    _drawn.clear()
    bring_back()


def _in(layer, collection):
    waiting = [layer.layer_collection]
    while waiting:
        here = waiting.pop()
        if here.collection == collection:
            return here
        waiting += here.children
    return None
