"""The groups of parameters, made from the scene's schema. Its comments are their tooltips."""

import json
from pathlib import Path

from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty
from bpy.types import PropertyGroup

FIELDS = json.loads((Path(__file__).parent / "fields.json").read_text())
# Fields that the add-on sets itself, from its own properties or from Blender's scene.
OWN = {
    *(("Fill", name) for name in ("order", "surface", "shake", "layout", "sort_by", "descending", "gaps")),
    ("Output", "fps"),
    ("Output", "frames"),
    ("Output", "trim"),
    ("Output", "instancing"),
    ("Effects", "frames"),
    ("Glue", "mode"),
    ("Glue", "strength"),
}
# Fields that say how far a container is filled.
OF_CONTAINERS = {("Fill", name) for name in ("level", "share", "heap")}
# Names of groups in the settings, by message: those whose fields have values in the accuracy's preset.
GROUPS = {
    "Physics": "physics",
    "Base": "base",
    "Fill": "fill",
    "Release": "release",
    "Entrance": "entrance",
    "Control": "control",
    "Glue": "glue",
    "Hold": "hold",
    "Output": "output",
    "Effects": "effects",
    "Figures": "report",
}
# Labels of fields and values whose name does not say what they do, has no unit, or is not in US English.
TITLES = {
    "as_modelled": "As Modeled",
    "contact_frequency": "Stiffness (Relative)",
    "contact_tolerance": "Contact Gap (Share)",
    "distance": "Distance (Sizes)",
    "duration": "Duration (s)",
    "full_below": "Full Below (Share)",
    "growth": "Growth (Relative)",
    "heap": "Heap (°)",
    "height": "Height (Share)",
    "interval_natural": "Interval (Relative)",
    "interval_seconds": "Interval (s)",
    "kappa": "Nail Strength (N·s/kg)",
    "least_seconds": "At Least (s)",
    "kind": "Bodies",
    "layer": "Layer (Sizes)",
    "level": "Level (m)",
    "neighbours": "Neighbors",
    "overlap": "Overlap (Share)",
    "patience": "Patience (Relative)",
    "period": "Period (Steps)",
    "plausibility": "Guided at Most (Share)",
    "protrusion": "Protrusion (Sizes)",
    "residual_overlap": "Overlap Left (Share)",
    "round": "Round (Share)",
    "settle": "Settle (Relative)",
    "settled": "Settle Before Start",
    "shape_gap": "Shape Gap (Share)",
    "shape_tolerance": "Shape Tolerance (Share)",
    "shell": "Only Near the Surface",
    "speed": "Speed (Relative)",
    "spread": "Spread (°)",
    "spread_area": "Spread (m²)",
    "spread_relative": "Spread (Relative)",
    "stand": "Stand by Itself",
    "start": "Start (s)",
    "step": "Step (Relative)",
    "step_natural": "Step (Relative)",
    "step_seconds": "Step (s)",
    "until_frame": "Until Frame",
    "until_seconds": "Until (s)",
    "wall_tolerance": "Wall Tolerance (Sizes)",
}
# First values of fields that the accuracy leaves open.
FIRST = {"shell": 1.0}


def knows(message, field=None):
    """Whether the schema has a message, or a field in it."""
    return message in FIELDS and (field is None or any(known["name"] == field for known in FIELDS[message]))


def fields_of(message):
    return [field for field in FIELDS.get(message, []) if (message, field["name"]) not in OWN]


def _limits(field, whole):
    number = (lambda value: int(max(min(value, 2**31 - 1), -(2**31)))) if whole else float
    limits = {}
    if field.get("min") is not None:
        limits["min"] = number(field["min"])
    if field.get("max") is not None:
        limits["max"] = number(field["max"])
    return limits


def _default(field, kind, otherwise):
    try:
        return kind(field["default"])
    except (TypeError, ValueError):
        return FIRST.get(field["name"]) or max(otherwise, kind(field.get("min") or 0))


def _property(field):
    about = {"name": title(field["name"]), "description": field["description"]}
    if field["kind"] == "bool":
        return BoolProperty(default=field["default"] == "true", **about)
    if field["kind"] == "int":
        return IntProperty(default=_default(field, int, 0), **_limits(field, True), **about)
    if field["kind"] == "float":
        return FloatProperty(default=_default(field, float, 0.0), precision=3, **_limits(field, False), **about)
    items = items_of(field)
    default = (field["default"] or "").upper()
    return EnumProperty(items=items, default=next((i[0] for i in items if i[0] == default), items[0][0]), **about)


def items_of(field):
    """An enum's values, with the schema's numbers: those are what a .blend file keeps."""
    return [(name, title(name), description, "NONE", number) for name, description, number in field["items"]]


def title(name):
    return TITLES.get(name.lower()) or name.replace("_", " ").title()


def _only_one(message, field):
    """Of the fields that exclude each other, one at most is set."""
    rivals = [
        "use_" + other["name"]
        for other in fields_of(message)
        if field.get("choice") and other.get("choice") == field["choice"] and other is not field
    ]

    def update(self, _):
        for rival in rivals:
            if getattr(self, "use_" + field["name"]) and getattr(self, rival):
                setattr(self, rival, False)

    return update if rivals else None


def _group(message):
    properties = {}
    for field in fields_of(message):
        properties[field["name"]] = _property(field)
        # An artist looks at the tick first.
        properties["use_" + field["name"]] = BoolProperty(
            name="Set " + title(field["name"]), description=field["description"], update=_only_one(message, field)
        )
    return type(f"Cairn{message}", (PropertyGroup,), {"__annotations__": properties})


PARAMETERS = {message: _group(message) for message in GROUPS if message in FIELDS}


# In ascending order of cost; only those in the schema. Last, the one that a goal chooses.
BY_COST = ("DRAFT", "PREVIEW", "STANDARD", "FINE", "REFERENCE", "PAPER", "AUTO")
ACCURACIES = sorted(
    (
        (name, "Automatic" if name == "AUTO" else label, *rest)
        for name, label, *rest in items_of(next(field for field in FIELDS["Scene"] if field["name"] == "accuracy"))
    ),
    key=lambda item: BY_COST.index(item[0]) if item[0] in BY_COST else len(BY_COST),
)
