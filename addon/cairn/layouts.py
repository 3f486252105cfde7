"""Drawing functions of several panels."""

import bpy

# Width of a character of the interface's font, in pixels at scale 1, on average.
SIGN = 6.2


def signs_of(context, icon="NONE"):
    """The characters that a line has room for in the sidebar."""
    scale = context.preferences.system.ui_scale
    return max(16, int((context.region.width / scale - (62 if icon == "NONE" else 84)) / SIGN))


def wrapped(layout, context, text, icon="NONE"):
    """Draws a text in as many lines as the sidebar's width needs."""
    signs = signs_of(context, icon)
    column = layout.column(align=True)
    line = ""
    lines = []
    for word in text.split():
        if line and len(line) + 1 + len(word) > signs:
            lines.append(line)
            line = word
        else:
            line = f"{line} {word}".strip()
    for number, text in enumerate([*lines, line]):
        column.label(text=text, icon=icon if number == 0 else ("NONE" if icon == "NONE" else "BLANK1"))


def draw_sentences(layout, context, pairs, icon="ERROR"):
    """Draws sentences, each with a button for every object that it is about: pairs of a text and the objects' names."""
    for text, names in pairs:
        column = layout.column(align=True)
        wrapped(column, context, text, icon)
        for name in names:
            if name in bpy.data.objects:
                column.operator("cairn.select", text=f"Select “{name}”", icon="RESTRICT_SELECT_OFF").object = name


def draw_folded(layout, context, pairs):
    """The same, behind one line."""
    if not pairs:
        return
    manager = context.window_manager
    is_open = manager.cairn_warnings
    row = layout.row()
    row.alignment = "LEFT"
    title = "1 Warning" if len(pairs) == 1 else f"{len(pairs)} Warnings"
    row.prop(manager, "cairn_warnings", text=title, icon="TRIA_DOWN" if is_open else "TRIA_RIGHT", emboss=False)
    if is_open:
        draw_sentences(layout, context, pairs)
