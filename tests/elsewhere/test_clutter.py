"""Layouts of `cairn clutter` stand in MuJoCo, from the lines alone."""

import pathlib
import subprocess
import sys

import mujoco
import pytest

ROOT = pathlib.Path(__file__).parents[2]
# Of the package, this module needs nothing but Python.
sys.path.insert(0, str(ROOT / "python/cairn"))

import clutter  # noqa: E402

LAYOUTS = 3


@pytest.fixture(scope="module")
def layouts(tmp_path_factory):
    folder = tmp_path_factory.mktemp("layouts")
    command = [ROOT / "target/release/cairn", "clutter", ROOT / "examples/clutter/bin.toml", "-o", folder]
    subprocess.run([*command, "-n", str(LAYOUTS), "--sheet", "0", "--progress", "none"], check=True)
    return list(clutter.read(folder))


def test_layouts_stand(layouts):
    assert len(layouts) == LAYOUTS
    for layout in layouts:
        model = clutter.mujoco_spec(layout).compile()
        # The world and the place come first.
        assert model.nbody == 2 + len(layout.bodies)
        assert abs(sum(model.body_mass[2:]) - sum(layout.masses)) < 1e-6
        assert clutter.mujoco_drift(layout) < 0.002


def test_a_body_that_is_lifted_falls(layouts):
    layout = layouts[0]
    spec = clutter.mujoco_spec(layout)
    spec.bodies[2].pos[2] += 0.2
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    before = data.xipos[2, 2]
    while data.time < 1:
        mujoco.mj_step(model, data)
    assert before - data.xipos[2, 2] > 0.05
