"""The objects of a bake, found again after they were renamed: pointers that Blender keeps, by the recipe's keys."""

import bpy


def of(group, path=""):
    """Objects and collections that a property group points to, by path; those of the groups inside it, too."""
    found = {}
    for prop in group.bl_rna.properties:
        if prop.identifier in ("rna_type", "last_shape"):
            continue
        value = getattr(group, prop.identifier)
        name = path + prop.identifier
        if prop.type == "COLLECTION":
            for number, item in enumerate(value):
                found.update(of(item, f"{name}.{number}."))
        elif prop.type == "POINTER" and isinstance(value, bpy.types.PropertyGroup):
            found.update(of(value, f"{name}."))
        elif prop.type == "POINTER" and isinstance(value, (bpy.types.Object, bpy.types.Collection)):
            found[name] = value
    return found


def write(owner, pointers):
    """Writes them into a collection of `CairnPointer`."""
    owner.clear()
    for key, value in pointers.items():
        made = owner.add()
        made.name = key
        kinds = (("object", bpy.types.Object), ("collection", bpy.types.Collection), ("mesh", bpy.types.Mesh))
        setattr(made, next(name for name, kind in kinds if isinstance(value, kind)), value)


def read(owner):
    """The ones that are still in the file, by key."""
    found = {item.name: item.object or item.collection or item.mesh for item in owner}
    return {key: value for key, value in found.items() if value}


def ask(scene, token, pointers):
    """Called when a bake of a scene begins."""
    scene.cairn_asked.token = token
    write(scene.cairn_asked.pointers, pointers)


def asked(recipe):
    """The scene of a bake, and the objects that its recipe names. After an undo both may be missing."""
    for scene in bpy.data.scenes:
        if scene.cairn_asked.token and scene.cairn_asked.token == recipe.get("token"):
            return scene, read(scene.cairn_asked.pointers)
    return bpy.data.scenes.get(recipe["scene"]), {}


def forget(recipe):
    """Called when the bake has ended."""
    for scene in bpy.data.scenes:
        if scene.cairn_asked.token and scene.cairn_asked.token == recipe.get("token"):
            scene.cairn_asked.token = ""
            scene.cairn_asked.pointers.clear()
