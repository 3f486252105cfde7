"""How props lie: the panel's settings, and their fields in a request."""

import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty
from bpy.types import PropertyGroup

from . import axes
from .schema import knows

# Words for the sliders' values, each with the largest value that it is for.
WORDS = {
    "order": ((0.0, "As They Fall"), (0.66, "Tidied"), (0.99, "Stacks"), (1.0, "Stacked")),
    "surface": ((0.25, "Loose"), (0.75, "Natural"), (1.0, "Cast")),
    "shake": ((0.0, "Not Shaken"), (100.0, "Shaken")),
}
# A .blend file keeps the numbers.
UPS = [
    ("AUTO", "Automatic", "The direction in which the prop lies flattest; Tilt is measured from its Z axis", "NONE", 0),
    *(
        (name.replace("-", "NEGATIVE_"), name, f"The prop's own {name} axis is up", "NONE", number)
        for number, name in enumerate(("X", "Y", "Z", "-X", "-Y", "-Z"), start=1)
    ),
]
TURNS = [
    ("ANY", "Any", "Random rotation; a higher Order reduces it", "NONE", 1),
    ("QUARTER", "Quarter Turns", "By 0°, 90°, 180° or 270° relative to the pile's sides", "NONE", 2),
    ("NONE", "None", "No turns", "NONE", 3),
]
LAYOUTS = [
    ("MIXED", "Mixed", "All props everywhere", "NONE", 1),
    ("BANDS", "Bands", "One band per kind, one above the other, each as high as its share of the volume", "NONE", 2),
    ("GRADIENT", "Gradient", "Bands that blend into each other", "NONE", 3),
    ("CLUSTERS", "Clusters", "Each kind in its own clusters", "NONE", 4),
]
SORTS = [
    ("SIZE", "Size", "By size", "NONE", 1),
    ("MASS", "Mass", "By mass", "NONE", 2),
    ("NAME", "Name", "By name, in alphabetical order", "NONE", 3),
]
# Labels of `descending`.
BELOW = {"SIZE": "Largest Below", "MASS": "Heaviest Below", "NAME": "Last Name Below"}


class CairnArrangement(PropertyGroup):
    """How props lie, and where each kind goes."""

    order: FloatProperty(
        subtype="FACTOR",
        name="Order",
        description="How tidily props lie. 0: as they fall. 0.4: a tidied heap; most props lie flat, turned in all "
        "directions. 0.9: stacks, not quite straight. 1: stacked; all props lie flat and straight, long ones "
        "crosswise, bowls and plates nested",
        default=0.0,
        min=0.0,
        max=1.0,
    )
    surface: FloatProperty(
        subtype="FACTOR",
        name="Surface",
        description="How the pile meets the surface of the shape. 0: loose, as if no container had been around it; "
        "many props stick out. 0.5: natural; some props lie against the surface, a few stick out. 1: cast; many "
        "props lie flush with the surface, as in a mold",
        default=0.5,
        min=0.0,
        max=1.0,
    )
    shake: FloatProperty(
        name="Shake",
        description="Time for which the full shape is shaken, so that wedged props settle lower. In one unit of this "
        "time a prop falls half its own size: 0.14 s for a prop of 20 cm. 3: to each side once or twice. 10: five "
        "times. Undone if the pile then fills the shape less",
        default=0.0,
        min=0.0,
        max=100.0,
        soft_max=10.0,
        precision=1,
    )
    layout: EnumProperty(name="Mixture", description="Where each kind of prop goes", items=LAYOUTS, default="MIXED")
    sort_by: EnumProperty(
        name="Sort By", description="Property that decides which props are at the bottom", items=SORTS, default="SIZE"
    )
    descending: BoolProperty(
        name="Largest Below",
        description="Sort in reverse: largest, heaviest or last name at the bottom",
    )
    gaps: BoolProperty(
        name="Small Props Fill Gaps",
        description="Add props less than half as large as the largest last, into the gaps between the others",
    )


def word(chosen, name):
    """The word for a slider's value."""
    return next(word for most, word in WORDS[name] if getattr(chosen, name) <= most)


def is_sorted(chosen):
    """Whether the mixture has an order from below."""
    return chosen.layout in {"BANDS", "GRADIENT"}


def set_fill(v1, fill, settings):
    """Sets the fields that differ from their defaults."""
    if not knows("Fill", "order"):
        return
    chosen = settings.arrangement
    # The method `stack` means full order where no order is set.
    is_stacked = settings.fill.use_method and settings.fill.method == "STACK"
    for name, is_needed in (("order", is_stacked), ("surface", False), ("shake", False)):
        value = getattr(chosen, name)
        if is_needed or value != chosen.bl_rna.properties[name].default:
            # As the artist typed it: Blender keeps single precision.
            setattr(fill, name, float(f"{value:.7g}"))
    if chosen.layout != "MIXED":
        fill.layout = getattr(v1, f"LAYOUT_{chosen.layout}")
    if is_sorted(chosen) and chosen.sort_by != "SIZE":
        fill.sort_by = getattr(v1, f"SORT_BY_{chosen.sort_by}")
    if is_sorted(chosen) and chosen.descending:
        fill.descending = True
    if chosen.gaps:
        fill.gaps = True


def set_prop(v1, prop, item):
    """Sets the fields that differ from their defaults."""
    if not knows("Prop", "turns"):
        return
    if item.up != "AUTO":
        way = np.zeros(3)
        way["XYZ".index(item.up[-1])] = -1.0 if item.up.startswith("NEGATIVE") else 1.0
        # No -0.
        prop.up.extend((axes.points_to_server(way) + 0.0).tolist())
    if item.turns != "ANY":
        prop.turns = getattr(v1, f"TURNS_{item.turns}")
    if item.skew != 0.0:
        prop.scale_skew = round(item.skew, 6)
