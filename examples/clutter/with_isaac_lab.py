"""Spawns a layout of `cairn clutter` in Isaac Lab: call `spawn` inside a running app, once for each environment.

`usd` names the USD file of a prop's or a place's model, for which Isaac Lab has converters. Not tested: no machine with
Isaac Sim was at hand.
"""

import cairn


def spawn(layout, usd, prefix="/World/envs/env_0"):
    import isaaclab.sim as sim

    place = sim.UsdFileCfg(usd_path=usd(layout.place["file"]))
    place.func(f"{prefix}/place", place)
    for number, body in enumerate(layout.bodies):
        position, rotation = cairn.clutter.z_up(body["position"], body["rotation"], models_too=True)
        config = sim.UsdFileCfg(
            usd_path=usd(layout.prop(body)["file"]),
            scale=[body["scale"]] * 3,
            rigid_props=sim.RigidBodyPropertiesCfg(),
            mass_props=sim.MassPropertiesCfg(mass=body["mass"]),
            semantic_tags=[("class", body["label"])],
        )
        config.func(f"{prefix}/body{number}", config, translation=position, orientation=rotation)
