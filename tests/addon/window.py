"""A real window with the add-on, a scene for it, and the walk that is taken there."""

import os
import sys
import traceback

import bpy
from blocks import bodies_of
from hands import picture, view, wait


def make_scene(area, stick_at):
    """A cone, and a stick in the props' collection."""
    for source in list(bpy.data.objects):
        bpy.data.objects.remove(source)
    with view(area):
        bpy.ops.mesh.primitive_cone_add(vertices=32, radius1=0.6, depth=1.0, location=(0, 0, 0.5))
        bpy.context.object.name = "Cone"
        bpy.ops.mesh.primitive_cube_add(size=1, location=stick_at)
        stick = bpy.context.object
    stick.name, stick.scale = "Stick", (0.3, 0.08, 0.06)
    props = bpy.data.collections.new("Props")
    bpy.context.scene.collection.children.link(props)
    stick.users_collection[0].objects.unlink(stick)
    props.objects.link(stick)
    settings = bpy.context.scene.cairn
    settings.control_mesh, settings.prop_collection = bpy.data.objects["Cone"], props
    with view(area):
        bpy.ops.object.select_all(action="DESELECT")


def follow_changes():
    """Live is on: a draft comes, and the next one once the shape has changed."""
    from cairn import live

    bpy.context.window_manager.cairn_live = True
    yield from wait(lambda: live.status().startswith("Draft of"), "a draft")
    bpy.data.objects["Cone"].scale.z = 0.7
    yield from wait(lambda: not live.status().startswith("Draft of"), "the change to be seen")
    yield from wait(lambda: live.status().startswith("Draft of"), "the next draft")


def take_out(area, near, count):
    """The pile is worked on: the bodies nearest to a place are removed, and it settles again."""
    from cairn import result, running

    with view(area):
        bpy.ops.cairn.edit_pile()
    pile = result.chosen(bpy.context)
    nearest = sorted(bodies_of(pile), key=lambda body: (body.location - near).length)
    with view(area):
        for body in nearest[:count]:
            body.select_set(True)
        bpy.ops.cairn.remove_bodies()
        bpy.ops.cairn.settle("INVOKE_DEFAULT")
    yield from wait(lambda: running.bake is None, "the pile to settle")


def install():
    bpy.context.preferences.view.show_splash = False
    bpy.ops.preferences.addon_install(filepath=os.environ["CAIRN_ADDON"], overwrite=True)
    bpy.ops.preferences.addon_enable(module="cairn")
    bpy.context.preferences.addons["cairn"].preferences.program = os.environ["CAIRN_PROGRAM"]


def start(steps):
    """Takes the steps, each after the pause that the one before yields, and ends Blender: with 1 if one fails."""

    def tick():
        try:
            return next(steps)
        except StopIteration:
            end(0)
        except Exception:  # noqa: BLE001 the window would stay open
            traceback.print_exc()
            picture("failed.png")
            end(1)

    bpy.app.timers.register(tick, first_interval=2.0)


def end(code):
    bpy.ops.preferences.addon_disable(module="cairn")
    sys.stdout.flush()
    os._exit(code)
