"""Bodies in their props' collections. Each of these gets its own collection for the bodies, so that thousands of
bodies are not among the props, and a hidden pile is also hidden there."""

import bpy

from . import pointers, visibility


def refresh(pile, sources):
    """Links a pile's bodies as its settings say. `sources`: the props' objects."""
    remove(pile)
    if not pile.cairn.use_prop_collections or pile.cairn.mode == "POINTS":
        return
    apart = _apart(pile)
    wanted = [[c for c in source.users_collection if c not in apart and _is_own(c)] for source in sources]
    made = {}
    for body in pile.objects:
        for outer in wanted[body.cairn.prop] if body.cairn.number else ():
            if outer not in made:
                made[outer] = bpy.data.collections.new(f"{pile.name} in {outer.name}")
                made[outer].cairn.of_pile = pile
                made[outer].hide_viewport, made[outer].hide_render = pile.hide_viewport, pile.hide_render
                outer.children.link(made[outer])
            made[outer].objects.link(body)


def _apart(pile):
    """Collections that only choose the props of a pile, and the scenes' own."""
    found = {key: value for key, value in pointers.read(pile.cairn.pointers).items() if key.startswith("settings.")}
    return {pile, *found.values(), *(scene.collection for scene in bpy.data.scenes)}


def _is_own(collection):
    return not collection.library and not collection.cairn.is_result and collection.cairn.of_pile is None


def of(pile):
    return [collection for collection in bpy.data.collections if collection.cairn.of_pile == pile]


def show(scene, pile, on):
    """Shows or hides a pile in all its collections."""
    for collection in (pile, *of(pile)):
        visibility.show(scene, collection, on)


def remove(pile):
    """Removes these collections. What the artist put there comes into the collections that they are in."""
    made = of(pile)
    for inner in made:
        outers = [outer for outer in bpy.data.collections if inner.name in outer.children]
        for shown in inner.objects:
            if shown.name not in pile.objects:
                for outer in outers:
                    if shown.name not in outer.objects:
                        outer.objects.link(shown)
    bpy.data.batch_remove(made)


def members(collection):
    """All objects of a collection and of its children, without the bodies of piles that are only linked there."""
    if not any(child.cairn.of_pile for child in collection.children_recursive):
        return list(collection.all_objects)
    found = {}
    waiting = [collection]
    while waiting:
        here = waiting.pop()
        found.update(dict.fromkeys(here.objects))
        waiting += [child for child in here.children if child.cairn.of_pile is None]
    return list(found)
