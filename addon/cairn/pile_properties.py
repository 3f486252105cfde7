"""Data of bakes in the file: of running ones, of variants, of finished piles and their bodies."""

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)
from bpy.types import PropertyGroup


class CairnPointer(PropertyGroup):
    """An object or collection that a bake used. Its name is its key."""

    object: PointerProperty(type=bpy.types.Object)
    collection: PointerProperty(type=bpy.types.Collection)
    mesh: PointerProperty(type=bpy.types.Mesh)


class CairnAsked(PropertyGroup):
    """The objects of a running bake, so that they may be renamed."""

    token: StringProperty()
    pointers: CollectionProperty(type=CairnPointer)


class CairnVariant(PropertyGroup):
    """A bake that was tried, kept by the server: its name is unique."""

    bake_id: StringProperty()
    # JSON.
    recipe: StringProperty()
    # The result in a few words; empty before it is done.
    summary: StringProperty()
    # The objects of the variant, also after they were renamed.
    pointers: CollectionProperty(type=CairnPointer)


class CairnBody(PropertyGroup):
    """Data of an object of a pile."""

    # Number of its body in the pile, counted from 1, or of the first body that it shows; 0: none.
    number: IntProperty()
    # Index of its prop, counted from 0, and its size, as a factor.
    prop: IntProperty()
    size: FloatProperty(default=1.0)
    # While it is colored by state: its own color; of points, whether they were shown.
    # Its name and a digest of it, as the bake left it.
    made_name: StringProperty()
    mark: StringProperty()
    # Not a body, but the empty that a pile's bodies are parented to; and its place, scene units.
    is_root: BoolProperty()
    home: FloatVectorProperty(size=3)
    # Not a body, but inside of one.
    is_part: BoolProperty()
    # Not a body, but a shape: the settings that were last used with it (JSON), and their objects; and how it was shown
    # before its first bake.
    settings: StringProperty()
    pointers: CollectionProperty(type=CairnPointer)
    is_veiled: BoolProperty()
    was_hidden_in_render: BoolProperty()
    was_display_type: StringProperty()
    is_hidden_here: BoolProperty()
    is_coloured: BoolProperty()
    color: FloatVectorProperty(size=4)
    was_shown: BoolProperty()


def _retime(self, _):
    from . import timing

    timing.apply(self.id_data)


def _display(self, _):
    for body in self.id_data.objects:
        if body.cairn.number:
            body.display_type = self.display


def _answer(_, _context):
    from . import keeping

    keeping.forget_problems()


class CairnResult(PropertyGroup):
    """Data of a collection with a baked pile: enough to bake it again, and to show its report."""

    is_result: BoolProperty()
    bake_id: StringProperty()
    result_hash: StringProperty()
    mode: StringProperty()
    # JSON.
    settings: StringProperty()
    report: StringProperty()
    # As `states` packs them.
    states: StringProperty()
    # JSON: how many bodies each prop has.
    counts: StringProperty()
    # JSON: the server's bodies that no object shows.
    left_out: StringProperty()
    # JSON: the numbers in the bodies' names, where they are not 1, 2, 3, ...
    labels: StringProperty()
    use_keep: BoolProperty(
        name="Keep What Fits",
        description="Change this pile instead of filling the whole shape again: bodies with nothing new near them keep "
        "pose, name and object. What is new is found by itself, also in a sculpted shape",
        update=_answer,
    )
    # Frames of the result, and their timing: as set, and as applied to the pile (JSON).
    frame_count: IntProperty()
    timing_start: IntProperty(
        subtype="TIME",
        name="Start Frame",
        description="Scene frame at which the pile's animation begins",
        default=1,
        update=_retime,
    )
    timing_hold: IntProperty(
        subtype="TIME",
        name="Start Delay",
        description="Frames before the collapse starts",
        min=0,
        max=100000,
        update=_retime,
    )
    timing_speed: FloatProperty(
        name="Speed",
        description="How fast the collapse plays, as a factor: 2 is twice as fast as simulated, 0.5 is slow motion",
        default=1.0,
        min=0.001,
        soft_min=0.1,
        soft_max=10.0,
        max=1000.0,
        update=_retime,
    )
    timing_ease: FloatProperty(
        name="Ease",
        description="Above 0 the collapse begins slowly and becomes faster; below 0 it begins fast and becomes "
        "slower. Its length does not change",
        min=-2.0,
        max=2.0,
        update=_retime,
    )
    timed: StringProperty()
    display: EnumProperty(
        name="Display",
        description="How the bodies are shown in the 3D View. Renders do not change",
        items=[
            ("TEXTURED", "Full", "With all details"),
            ("SOLID", "Plain", "Without textures"),
            ("BOUNDS", "Boxes", "As boxes, which is fastest"),
        ],
        update=_display,
    )
    # Of an edited pile: the last settled states of its bodies (JSON).
    settled: StringProperty()
    # Not a result, but in one, with what shows points by state.
    is_of_state: BoolProperty()
    # Whether the bodies are in their props' collections, too; and not a result, but there: whose bodies it has.
    use_prop_collections: BoolProperty()
    of_pile: PointerProperty(type=bpy.types.Collection)
    control: PointerProperty(type=bpy.types.Object)
    # The objects of settings and bodies, by the recipe's keys.
    pointers: CollectionProperty(type=CairnPointer)
    # While a preview is drawn over it: the scenes and view layers in which it is hidden (JSON).
    aside: StringProperty()
    # Whether the bake ran to its end.
    is_whole: BoolProperty(default=True)
    # Not a result, but inside of bodies; and not a result, but the collection of what the artist had in that pile.
    is_part: BoolProperty()
    saved_of: PointerProperty(type=bpy.types.Collection)


CLASSES = [CairnPointer, CairnAsked, CairnVariant, CairnBody, CairnResult]
