"""What the panels set."""

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
)
from bpy.types import PropertyGroup

from . import pile_properties
from .arrangement import TURNS, UPS, CairnArrangement
from .pile_properties import CairnAsked, CairnBody, CairnResult, CairnVariant
from .schema import ACCURACIES, GROUPS, PARAMETERS


def _is_solid(_, source):
    return source.type == "MESH"


def _is_placed(_, source):
    return source.type not in {"CAMERA", "LIGHT", "SPEAKER", "LIGHT_PROBE"}


class CairnProp(PropertyGroup):
    """One of the things that a pile is made of."""

    object: PointerProperty(
        name="Prop",
        description="An object, with everything below it; or an instance of a collection",
        type=bpy.types.Object,
        poll=_is_placed,
    )
    weight: FloatProperty(
        name="Weight",
        description="How often it is drawn, relative to the other props. 2 is twice as often as 1",
        default=1.0,
        min=0.001,
        soft_max=100.0,
        precision=2,
    )
    scale_min: FloatProperty(
        name="Smallest",
        description="Smallest size, as a factor on the object's own. Each body's size is drawn between the two: "
        "evenly, unless Size Skew says otherwise",
        default=1.0,
        min=0.001,
        soft_max=10.0,
        precision=2,
    )
    scale_max: FloatProperty(
        name="Largest",
        description="Largest size, as a factor on the object's own",
        default=1.0,
        min=0.001,
        soft_max=10.0,
        precision=2,
    )
    density: FloatProperty(
        name="Density", description="Density, kg/m³", default=1000.0, min=0.001, max=1e6, soft_max=20000.0, precision=0
    )
    friction: FloatProperty(
        name="Friction",
        description="Coulomb friction coefficient, no unit. Two things that touch have the mean of theirs",
        default=0.7,
        min=0.0,
        max=2.0,
    )
    tilt: FloatProperty(
        name="Tilt",
        description="Largest angle between the prop's own Z axis, or what Up says, and the vertical when it is put in "
        "or dropped, degrees; 180 takes all rotations alike",
        default=180.0,
        min=0.0,
        max=180.0,
        precision=0,
    )
    up: EnumProperty(
        name="Up",
        description="Which of the prop's own directions is up where it is laid with care (Order above 0), and from "
        "which Tilt counts",
        items=UPS,
        default="AUTO",
    )
    turns: EnumProperty(
        name="Turns",
        description="How the prop may be turned about its up direction where it is laid with care (Order above 0)",
        items=TURNS,
        default="ANY",
    )
    skew: FloatProperty(
        name="Size Skew",
        description="How sizes spread between the smallest and the largest. -1: mostly large ones. 0: all sizes alike. "
        "1: mostly small ones, and few large ones",
        default=0.0,
        min=-1.0,
        max=1.0,
    )
    restitution: FloatProperty(
        name="Bounce",
        description="How much of the speed of an impact is given back, 0 to 1",
        default=0.0,
        min=0.0,
        max=1.0,
    )


# How much may be glued. A .blend file keeps the numbers.
KEPT_SHAPES = [
    (
        "AS_MODELLED",
        "As Modelled",
        "The pile keeps the shape: where friction cannot carry it, as few bodies as possible are glued. Nothing is "
        "where the fill or the control is off, nor at the accuracy Paper",
        "NONE",
        0,
    ),
    (
        "TACKY",
        "Tacky",
        "Bodies are glued where that needs no more than the strength below; what would need stronger glue falls",
        "NONE",
        1,
    ),
    ("NATURAL", "Natural", "Nothing is glued: what friction cannot carry falls", "NONE", 2),
]
OUTPUTS = [
    ("AUTO", "Automatic", "Animated objects up to 2000 bodies, instanced points beyond"),
    ("ANIMATION", "Animated Objects", "One object with keyframes for each body"),
    ("POSE", "Final Pose", "One object for each body where it ends, without animation"),
    ("POINTS", "Instanced Points", "One object for all bodies: points with Geometry Nodes instances, for large piles"),
]


class CairnSettings(PropertyGroup):
    """What the next bake does."""

    control_mesh: PointerProperty(
        name="Shape",
        description="The shape that the pile shall have: a closed mesh, standing on the ground. The server calls it "
        "the control mesh",
        type=bpy.types.Object,
        poll=_is_solid,
    )
    kept_shape: EnumProperty(
        name="Kept Shape", description="How far the pile keeps its shape", items=KEPT_SHAPES, default="AS_MODELLED"
    )
    glue_strength: FloatProperty(
        name="Glue Strength",
        description="The most that a dot of glue carries, in weights of a typical prop: at 5, five such props could "
        "hang from it. With less glue more of the pile falls, with more of it the shape is kept better",
        default=5.0,
        min=0.0,
        max=1e9,
        soft_min=0.1,
        soft_max=100.0,
        precision=2,
        step=10,
    )
    arrangement: PointerProperty(type=CairnArrangement)
    prop_source: EnumProperty(
        name="Props",
        description="Where the props come from",
        items=[
            ("COLLECTION", "Collection", "All objects of a collection; children belong to their parents"),
            ("LIST", "List", "Objects chosen one by one, with weights and sizes"),
        ],
    )
    prop_collection: PointerProperty(
        name="Props",
        description="The things that the pile is made of: every object in this collection",
        type=bpy.types.Collection,
    )
    # Of all objects of the collection.
    prop_common: PointerProperty(type=CairnProp)
    props: CollectionProperty(type=CairnProp)
    active_prop: IntProperty(name="Active Prop", description="The prop whose weight and size are shown", default=0)
    colliders: PointerProperty(
        name="Colliders",
        description="Scenery that the bodies collide with, besides the ground: every object in this collection",
        type=bpy.types.Collection,
    )
    collider_friction: FloatProperty(
        name="Friction",
        description="Coulomb friction coefficient of the colliders and the ground, no unit",
        default=0.7,
        min=0.0,
        max=2.0,
    )
    region: PointerProperty(
        name="Region",
        description="Where the pile is kept in shape, if not in the shape itself: a closed mesh. What is outside moves "
        "freely",
        type=bpy.types.Object,
        poll=_is_solid,
    )
    keep: PointerProperty(
        name="Keep",
        description="Objects that stay exactly as you placed them: the rest is filled around them and may lean on them",
        type=bpy.types.Collection,
    )
    impact: PointerProperty(
        name="Projectiles",
        description="Objects that are thrown into the pile from where they stand. The pile has copies of them: hide "
        "the objects themselves",
        type=bpy.types.Collection,
    )
    impact_frame: IntProperty(
        name="Frame", description="Frame of the scene at which they are thrown", default=50, min=-100000, max=100000
    )
    impact_velocity: FloatVectorProperty(
        name="Velocity", description="Their velocity along X, Y and Z, m/s", default=(0.0, 0.0, -10.0), precision=2
    )
    use_impact_mass: BoolProperty(name="Set Mass", description="Give their mass, instead of that of their density")
    impact_mass: FloatProperty(
        name="Mass", description="Mass of each, kg", default=10.0, min=1e-6, soft_max=10000.0, precision=3
    )
    drop_mesh: PointerProperty(
        name="Drop From",
        description="A closed mesh inside which further props appear, one after the other, and fall",
        type=bpy.types.Object,
        poll=_is_solid,
    )
    drop_frame: IntProperty(
        name="Frame",
        description="Frame of the scene at which the first one appears",
        default=50,
        min=-100000,
        max=100000,
    )
    drop_rate: FloatProperty(name="Rate", description="Props per second", default=10.0, min=0.001, soft_max=1000.0)
    drop_count: IntProperty(name="Count", description="Props in all", default=100, min=1, max=100000)
    drop_velocity: FloatVectorProperty(
        name="Velocity", description="Velocity along X, Y and Z with which they appear, m/s", precision=2
    )
    use_ground: BoolProperty(
        name="Ground",
        description="Whether there is a ground plane. Without one, what misses the colliders falls and is set aside",
        default=True,
    )
    use_ground_height: BoolProperty(
        name="Set Ground Height",
        description="Give the ground's height, instead of the shape's lowest point",
    )
    ground_height: FloatProperty(
        name="Ground Height", description="Height of the ground plane, in scene units", unit="LENGTH", precision=3
    )
    gravity: FloatProperty(
        name="Gravity", description="Acceleration of gravity, downwards, m/s²", default=9.81, min=0.01, max=1000.0
    )
    accuracy: EnumProperty(
        name="Accuracy",
        description="How carefully is simulated. Beside each: the CPU time that a bake is expected to take",
        items=ACCURACIES,
        default="STANDARD",
    )
    seed: IntProperty(
        name="Seed",
        description="The same seed and scene give the same pile; another seed gives another pile",
        default=1,
        min=0,
    )
    use_replace: BoolProperty(
        name="Replace",
        description="Put the new pile in the place of that which is shown. Off: a pile of another seed stays, hidden; "
        "of the same seed, it is replaced",
    )
    output_mode: EnumProperty(name="Output", description="What the pile becomes in Blender", items=OUTPUTS)
    use_prop_collections: BoolProperty(
        name="Props' Collections",
        description="Put each body also into the collections that its prop is in, for light linking, overrides and "
        "export by collection. Each of them gets a collection of its own for that. Not into the one that the props "
        "are chosen by, and not for instanced points",
    )
    use_report: BoolProperty(
        name="Report",
        description="Measure the pile once it is made: how far it keeps its shape, what friction carries. The "
        "keyframes never wait for it. Off: the CPU time is saved",
        default=True,
    )
    start_frame: IntProperty(
        name="Start Frame",
        description="Frame at which the pile, just filled, begins to be let go. The scene is taken as it stands then",
        default=1,
    )
    use_frame_count: BoolProperty(
        name="Set Frames", description="Bake a number of frames, instead of until the pile is at rest"
    )
    frame_count: IntProperty(name="Frames", description="Frames after the start frame", default=250, min=0, max=100000)


CLASSES = [*PARAMETERS.values(), CairnArrangement, CairnProp, CairnSettings, *pile_properties.CLASSES]


def register():
    CairnSettings.__annotations__.update(
        {GROUPS[message]: PointerProperty(type=group) for message, group in PARAMETERS.items()}
    )
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.cairn = PointerProperty(type=CairnSettings)
    bpy.types.Scene.cairn_asked = PointerProperty(type=CairnAsked)
    bpy.types.Scene.cairn_variants = CollectionProperty(type=CairnVariant)
    bpy.types.Collection.cairn = PointerProperty(type=CairnResult)
    bpy.types.Object.cairn = PointerProperty(type=CairnBody)


def unregister():
    del bpy.types.Object.cairn
    del bpy.types.Collection.cairn
    del bpy.types.Scene.cairn_variants
    del bpy.types.Scene.cairn_asked
    del bpy.types.Scene.cairn
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
