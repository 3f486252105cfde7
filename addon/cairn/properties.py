"""Settings of the panels."""

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

from . import pile_properties, shapes
from .arrangement import TURNS, UPS, CairnArrangement
from .export import SOLID
from .pile_properties import CairnAsked, CairnBody, CairnResult, CairnVariant
from .schema import ACCURACIES, GROUPS, PARAMETERS


def _is_solid(_, source):
    return source.type in SOLID


def _is_curve(_, source):
    return source.type == "CURVE"


def _is_placed(_, source):
    return source.type not in {"CAMERA", "LIGHT", "SPEAKER", "LIGHT_PROBE"}


def _choose(self, _):
    shapes.choose(self)


class CairnProp(PropertyGroup):
    """A prop of the pile."""

    object: PointerProperty(
        name="Prop",
        description="An object with all its children, or an instance of a collection",
        type=bpy.types.Object,
        poll=_is_placed,
    )
    weight: FloatProperty(
        name="Weight",
        description="Frequency of this prop relative to the others: 2 is twice as often as 1",
        default=1.0,
        min=0.001,
        soft_max=100.0,
        precision=2,
    )
    scale_min: FloatProperty(
        name="Smallest",
        description="Smallest size, as a factor of the object's own size. The size of each body is random between "
        "Smallest and Largest; Size Skew shifts it",
        default=1.0,
        min=0.001,
        soft_max=10.0,
        precision=2,
    )
    scale_max: FloatProperty(
        name="Largest",
        description="Largest size, as a factor of the object's own size",
        default=1.0,
        min=0.001,
        soft_max=10.0,
        precision=2,
    )
    density: FloatProperty(
        name="Density (kg/m³)",
        description="Mass per volume",
        default=1000.0,
        min=0.001,
        max=1e6,
        soft_max=20000.0,
        precision=0,
    )
    friction: FloatProperty(
        name="Friction",
        description="Friction coefficient. A pair in contact has the mean of both",
        default=0.7,
        min=0.0,
        max=2.0,
    )
    tilt: FloatProperty(
        name="Tilt (°)",
        description="Largest tilt of the prop's up axis from the vertical. 180: any rotation",
        default=180.0,
        min=0.0,
        max=180.0,
        precision=0,
    )
    up: EnumProperty(
        name="Up",
        description="Axis of the prop that points up where Order is above 0. Tilt is measured from it",
        items=UPS,
        default="AUTO",
    )
    turns: EnumProperty(
        name="Turns",
        description="Allowed turns about the up axis where Order is above 0",
        items=TURNS,
        default="ANY",
    )
    skew: FloatProperty(
        name="Size Skew",
        description="How sizes are distributed between Smallest and Largest. -1: mostly large. 0: all sizes alike. "
        "1: mostly small, with few large",
        default=0.0,
        min=-1.0,
        max=1.0,
    )
    restitution: FloatProperty(
        name="Bounce",
        subtype="FACTOR",
        description="Speed after an impact, as a share of the speed before it",
        default=0.0,
        min=0.0,
        max=1.0,
    )


# Amounts of glue. A .blend file keeps the numbers.
KEPT_SHAPES = [
    (
        "AS_MODELLED",
        "As Modeled",
        "The pile keeps the shape. Where friction cannot carry it, as few bodies as possible are glued. Nothing is "
        "glued if the fill or the control is off, or at the accuracy Paper",
        "NONE",
        0,
    ),
    (
        "TACKY",
        "Tacky",
        "Bodies are glued where no more than the strength below is needed. Bodies that need stronger glue fall",
        "NONE",
        1,
    ),
    ("NATURAL", "Natural", "Nothing is glued. Bodies that friction cannot carry fall", "NONE", 2),
]
OUTPUTS = [
    ("AUTO", "Automatic", "Animated objects up to 2000 bodies, instanced points beyond"),
    ("ANIMATION", "Animated Objects", "One object with keyframes for each body"),
    ("POSE", "Final Pose", "One object for each body at its final pose, without animation"),
    ("POINTS", "Instanced Points", "One object for all bodies: points with Geometry Nodes instances, for large piles"),
]


class CairnSettings(PropertyGroup):
    """Settings of the next bake."""

    control_mesh: PointerProperty(
        name="Shape",
        description="Closed mesh, text, curve or metaball that the pile fills, standing on the ground. Each shape "
        "keeps its own settings",
        type=bpy.types.Object,
        poll=_is_solid,
        update=_choose,
    )
    # The one before, whose settings are kept when another is chosen.
    last_shape: PointerProperty(name="Last Shape", description="Shape whose settings these are", type=bpy.types.Object)
    use_inside: BoolProperty(
        name="Fill Its Inside",
        description="The shape is a container that stays: a bowl, a jar, a crate or a cart, open at its top. The props "
        "fill it up to its rim, and it collides with them",
    )
    kept_shape: EnumProperty(
        name="Shape Support",
        description="How much glue keeps the pile in shape",
        items=KEPT_SHAPES,
        default="AS_MODELLED",
    )
    glue_strength: FloatProperty(
        name="Glue Strength",
        description="Largest load of a dot of glue, in weights of a typical prop: at 5, five such props could hang "
        "from it. With lower strength more of the pile falls; with higher strength the pile keeps its shape better",
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
            ("COLLECTION", "Collection", "All objects of a collection. Children belong to their parents"),
            ("LIST", "List", "Objects chosen one by one, each with its weight and size"),
        ],
    )
    prop_collection: PointerProperty(
        name="Props",
        description="Every object in this collection is a prop of the pile",
        type=bpy.types.Collection,
    )
    weigh_by: EnumProperty(
        name="Weights By",
        description="What the weights of several props share out",
        items=[
            ("COUNT", "Count", "A prop of weight 2 is tried twice as often as one of weight 1"),
            ("VOLUME", "Volume", "A prop of weight 2 takes twice the volume of one of weight 1: small props are more"),
        ],
    )
    use_rendered: BoolProperty(
        name="Skip Unrendered Props",
        description="Leave out the collection's objects whose own camera icon in the outliner is off",
    )
    # Of all objects of the collection.
    prop_common: PointerProperty(type=CairnProp)
    props: CollectionProperty(type=CairnProp)
    active_prop: IntProperty(name="Active Prop", description="Prop whose weight and size are shown", default=0)
    colliders: PointerProperty(
        name="Colliders",
        description="The bodies collide with every object in this collection, besides the ground, and the fill leaves "
        "room for them",
        type=bpy.types.Collection,
    )
    collider_friction: FloatProperty(
        name="Friction",
        description="Friction coefficient of the colliders and the ground",
        default=0.7,
        min=0.0,
        max=2.0,
    )
    use_piles: BoolProperty(
        name="Other Piles",
        description="Build the pile around the other piles that the scene shows, as they lie in the end, and let it "
        "lean on them",
        default=True,
    )
    region: PointerProperty(
        name="Region",
        description="Closed mesh inside which the pile keeps its shape. If empty, the shape itself. Bodies outside "
        "it move freely",
        type=bpy.types.Object,
        poll=_is_solid,
    )
    keep: PointerProperty(
        name="Build Around",
        description="Objects that stay exactly as you placed them. The pile is built around them and may lean on them",
        type=bpy.types.Collection,
    )
    impact: PointerProperty(
        name="Projectiles",
        description="Objects that are thrown into the pile from where they are. Copies are thrown: hide the originals",
        type=bpy.types.Collection,
    )
    impact_frame: IntProperty(
        name="Frame",
        description="Scene frame at which the projectiles are thrown",
        default=50,
        subtype="TIME",
        min=-100000,
        max=100000,
    )
    impact_velocity: FloatVectorProperty(
        name="Velocity (m/s)",
        description="Velocity of the projectiles along X, Y and Z",
        default=(0.0, 0.0, -10.0),
        precision=2,
    )
    use_impact_mass: BoolProperty(
        name="Set Mass", description="Set the mass of the projectiles, instead of computing it from their density"
    )
    impact_mass: FloatProperty(
        name="Mass (kg)", description="Mass of each projectile", default=10.0, min=1e-6, soft_max=10000.0, precision=3
    )
    drop_mesh: PointerProperty(
        name="Drop From",
        description="Closed mesh inside which more props appear, one after the other, and fall",
        type=bpy.types.Object,
        poll=_is_solid,
    )
    drop_frame: IntProperty(
        subtype="TIME",
        name="Frame",
        description="Scene frame at which the first dropped prop appears",
        default=50,
        min=-100000,
        max=100000,
    )
    drop_rate: FloatProperty(
        name="Rate (1/s)", description="Number of dropped props per second", default=10.0, min=0.001, soft_max=1000.0
    )
    drop_count: IntProperty(name="Count", description="Total number of dropped props", default=100, min=1, max=100000)
    drop_velocity: FloatVectorProperty(
        name="Velocity (m/s)", description="Initial velocity of the dropped props along X, Y and Z", precision=2
    )
    entrance_source: PointerProperty(
        name="Comes From",
        description="Object out of whose origin bodies pour or are thrown, such as an empty at the rim of a tipped jar",
        type=bpy.types.Object,
    )
    entrance_curve: PointerProperty(
        name="Follows",
        description="Curve along which bodies land, instead of along the longer side of the pile",
        type=bpy.types.Object,
        poll=_is_curve,
    )
    use_ground: BoolProperty(
        name="Ground",
        description="Use a ground plane. Without it, bodies that miss the colliders fall and are set aside",
        default=True,
    )
    use_ground_height: BoolProperty(
        name="Set Ground Height",
        description="Set the height of the ground, instead of using the shape's lowest point",
    )
    ground_height: FloatProperty(
        name="Ground Height", description="Height of the ground plane", unit="LENGTH", precision=3
    )
    use_gravity: BoolProperty(
        name="Own Gravity", description="Use another gravity than the scene's, which is in Scene Properties, Gravity"
    )
    gravity: FloatProperty(
        name="Gravity (m/s²)", description="Acceleration of gravity, downward", default=9.81, min=0.01, max=1000.0
    )
    accuracy: EnumProperty(
        name="Simulation Quality",
        description="Accuracy of the simulation. Beside each are the time that nine of ten bakes stay below and "
        "the size of visible overlaps between bodies",
        items=ACCURACIES,
        default="STANDARD",
    )
    use_collapse: BoolProperty(
        name="Let It Collapse",
        description="Once the pile rests, it comes down, one body first, to one side. Glue and control end then",
    )
    collapse_angle: FloatProperty(
        name="Toward (°)",
        description="Side to which the pile falls, seen from above: 0 is +X, 90 is +Y, -90 is toward the front view",
        default=0.0,
        min=-360.0,
        max=360.0,
        precision=0,
    )
    use_collapse_first: BoolProperty(
        name="Set First Body", description="Choose the body that goes first, instead of one low on the side of the fall"
    )
    collapse_first: IntProperty(
        name="First Body",
        description="Number of the body that goes first, as at the end of its name in a pile of the same settings",
        default=1,
        min=1,
    )
    use_collapse_frame: BoolProperty(
        name="Set Frame", description="Choose when the collapse begins at the earliest, instead of once the pile rests"
    )
    collapse_frame: IntProperty(
        subtype="TIME",
        name="Frame",
        description="Scene frame at which the collapse begins at the earliest",
        default=50,
        min=-100000,
        max=100000,
    )
    goal: EnumProperty(
        name="Goal",
        description="What the automatic quality is chosen by",
        items=[
            ("TIME", "Time", "The best quality that is expected to be finished in this time"),
            ("OVERLAP", "Overlap", "The quickest quality that is expected to leave no larger overlaps"),
        ],
        default="TIME",
    )
    goal_seconds: FloatProperty(
        name="Time (s)",
        description="Time from the start to the pile. Nine of ten bakes are expected to take at most a quarter longer",
        default=60.0,
        min=0.0,
        max=1e9,
        precision=1,
    )
    goal_overlap: FloatProperty(
        name="Overlap",
        description="Overlap of bodies that is seen: 95 of 100 that touch overlap by no more",
        unit="LENGTH",
        default=0.0005,
        min=0.0,
        max=1e6,
        precision=5,
    )
    seed: IntProperty(
        name="Seed",
        description="The same seed and scene give the same pile; another seed gives another pile",
        default=1,
        min=0,
    )
    use_replace: BoolProperty(
        name="Replace Old Pile",
        description="A bake with another seed replaces the shown pile. If off, the piles of other seeds stay, hidden",
    )
    output_mode: EnumProperty(name="Output", description="Objects that the pile becomes in Blender", items=OUTPUTS)
    use_prop_collections: BoolProperty(
        name="Props' Collections",
        description="Link each body also to the collections of its prop, for light linking, overrides and export by "
        "collection. Each of them gets its own collection for the bodies. The collection that the props are chosen "
        "by is left out. Not for instanced points",
    )
    use_report: BoolProperty(
        name="Report",
        description="Measure the finished pile: how well it keeps its shape, and what friction carries. The "
        "keyframes do not wait for it. Switch off to save CPU time",
        default=True,
    )
    start_frame: IntProperty(
        subtype="TIME",
        name="Start Frame",
        description="Frame at which the release of the filled pile begins. The bake uses the scene as it is at this "
        "frame",
        default=1,
    )
    use_frame_count: BoolProperty(
        name="Set Frames", description="Bake a fixed number of frames, instead of until the pile is at rest"
    )
    frame_count: IntProperty(
        subtype="TIME",
        name="Frames",
        description="Number of frames after the start frame",
        default=250,
        min=0,
        max=100000,
    )


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
    # A digest of a mesh that a bake made; empty of others.
    bpy.types.Mesh.cairn_made = StringProperty()


def unregister():
    del bpy.types.Mesh.cairn_made
    del bpy.types.Object.cairn
    del bpy.types.Collection.cairn
    del bpy.types.Scene.cairn_variants
    del bpy.types.Scene.cairn_asked
    del bpy.types.Scene.cairn
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
