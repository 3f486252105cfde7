"""Simulates a layout of `cairn clutter` in MuJoCo: python with_mujoco.py layouts 3"""

import sys

import cairn
import mujoco

layouts = {layout.number: layout for layout in cairn.clutter.read(sys.argv[1])}
model = cairn.clutter.mujoco_spec(layouts[int(sys.argv[2])]).compile()
data = mujoco.MjData(model)
while data.time < 2:
    mujoco.mj_step(model, data)
print(data.xpos[2:])
