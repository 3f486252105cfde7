"""The data-blocks of a file, to compare before and after; and the bodies of a pile."""

import bpy


def bodies_of(pile):
    """The bodies of a pile, in the order of the server's: not the empty that they hang on."""
    return [body for body in pile.objects if not body.cairn.is_root]


def all_blocks():
    """Everything in the file, by kind: names, users, what the add-on keeps there, and where objects are."""
    kinds = (name for name in dir(bpy.data) if isinstance(getattr(bpy.data, name), bpy.types.bpy_prop_collection))
    return {name: sorted(map(values_of, getattr(bpy.data, name))) for name in kinds}


def plain(value):
    """A property, whatever kind it is of, as a text."""
    if isinstance(value, bpy.types.PropertyGroup):
        names = [prop.identifier for prop in value.bl_rna.properties if prop.identifier != "rna_type"]
        return repr([(name, plain(getattr(value, name))) for name in names])
    if isinstance(value, bpy.types.ID):
        return value.name_full
    if hasattr(value, "values") or hasattr(value, "foreach_get"):
        return repr([plain(item) for item in value])
    return repr(value)


def values_of(block):
    own = plain(block.cairn) if hasattr(block, "cairn") else ""
    parts = [block.name, str(block.users), own]
    if isinstance(block, bpy.types.Object):
        shown = block.hide_viewport, block.hide_render, block.hide_select, block.display_type
        parts += [repr(block.matrix_basis), repr(block.color[:]), repr(shown)]
    if isinstance(block, bpy.types.Collection):
        parts += [repr(sorted(one.name for one in block.objects)), repr((block.hide_viewport, block.hide_render))]
    if isinstance(block, bpy.types.Scene):
        parts.append(repr((block.frame_current, block.frame_subframe, block.frame_start, block.frame_end)))
    return parts
