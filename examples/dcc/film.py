"""A pile in MuJoCo, as a strip of pictures: it stands, then a ball hits it.

    pip install mujoco imageio
    MUJOCO_GL=egl python examples/dcc/film.py pile.xml film.jpg

The ball has as much mass as a quarter of the bodies that are free.
"""

import sys

import imageio.v3 as imageio
import mujoco
import numpy as np

model_path, picture = sys.argv[1:]
SECONDS = [0.0, 5.0, 5.15, 6.5]  # the ball starts at 5 s

spec = mujoco.MjSpec.from_file(model_path)
still = spec.compile()
data = mujoco.MjData(still)
mujoco.mj_forward(still, data)
shown = [g for g in range(still.ngeom) if still.geom_bodyid[g] > 0]
places = data.geom_xpos[shown]
low, high = places.min(0), places.max(0)
middle, size = (low + high) / 2, np.linalg.norm(high - low)
mass = 0.25 * still.body_mass[1:][still.body_dofnum[1:] > 0].sum()
start = middle + np.array([-0.9 * size, 0.0, 0.15 * size])

ball = spec.worldbody.add_body(name="ball", pos=start, gravcomp=1.0)
ball.add_freejoint()
ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.08 * size, 0, 0], mass=mass)
for geom in spec.geoms:
    geom.rgba = [0.8, 0.2, 0.1, 1] if geom.parent is ball else [0.72, 0.6, 0.44, 1]
for body in spec.bodies:
    if body.name == "world":
        for geom in body.geoms:
            geom.rgba = [0.55, 0.58, 0.6, 1]
spec.worldbody.add_light(pos=middle + size * np.array([0.5, -0.8, 1.5]), dir=[-0.5, 0.8, -1.5])
spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.45] * 3, [0.5] * 3
sky = dict(type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT, width=64, height=384)
spec.add_texture(name="sky", rgb1=[0.85, 0.9, 0.95], rgb2=[0.95, 0.95, 0.95], **sky)
spec.visual.global_.offwidth, spec.visual.global_.offheight = 360, 360
model = spec.compile()
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
camera = mujoco.MjvCamera()
camera.lookat, camera.distance, camera.azimuth, camera.elevation = middle, 2.5 * size, 70, -15
renderer = mujoco.Renderer(model, 360, 360)
first = model.body("ball").dofadr[0]
strip = []
for moment in SECONDS:
    while data.time < moment:
        if data.time < SECONDS[1]:
            data.qvel[first : first + 6] = 0
        elif np.linalg.norm(data.qvel[first : first + 3]) == 0:
            data.qvel[first] = 8 * size
        mujoco.mj_step(model, data)
    renderer.update_scene(data, camera)
    strip.append(renderer.render().copy())
imageio.imwrite(picture, np.hstack(strip), quality=80)
