"""Layouts of `cairn clutter`, and what simulators need of them. Nothing but Python is needed to read them.

    for layout in cairn.clutter.read("layouts"):
        layout.positions  # m, [body, 3]; numpy's array where numpy is, else lists
        model = cairn.clutter.mujoco_spec(layout).compile()

Lines have SI units and glTF's axes: right-handed, Y up. A pose takes a prop's own frame, scaled, to that of the place's
file; quaternions are x, y, z, w. `z_up` turns both to Z up.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

try:
    import numpy
except ImportError:
    numpy = None  # type: ignore[assignment]

_HALF = 0.5**0.5


@dataclass
class Layout:
    """A layout: its line, and the assets of its folder."""

    line: dict[str, Any]
    assets: dict[str, Any]
    folder: Path

    @property
    def number(self) -> int:
        return int(self.line["layout"])

    @property
    def bodies(self) -> list[dict[str, Any]]:
        return list(self.line["bodies"])

    @property
    def place(self) -> dict[str, Any]:
        """Label, file, friction and convex solids of the place."""
        return dict(self.assets["places"][self.line["place_number"]])

    @property
    def labels(self) -> list[str]:
        return [body["label"] for body in self.bodies]

    @property
    def positions(self) -> Any:
        """Of the props' own origins, m. Shape [body, 3]."""
        return _array([body["position"] for body in self.bodies])

    @property
    def rotations(self) -> Any:
        """Quaternions x, y, z, w. Shape [body, 4]."""
        return _array([body["rotation"] for body in self.bodies])

    @property
    def scales(self) -> Any:
        return _array([body["scale"] for body in self.bodies])

    @property
    def masses(self) -> Any:
        return _array([body["mass"] for body in self.bodies])

    @property
    def visible(self) -> Any:
        """Share of each body's outline in the camera's picture that is seen, past other bodies and the place; `None`:
        the catalogue has no camera. Shape [body]."""
        return None if self.line["view"] is None else _array([body["visible"] for body in self.bodies])

    @property
    def overlap(self) -> float | None:
        """Mean share of a body's outline in the camera's picture that other bodies hide; `None`: there is no camera."""
        return None if self.line["view"] is None else float(self.line["view"]["overlap"])

    @property
    def target(self) -> int | None:
        """The body that is looked for; its prop's label and its visible share are as those of all bodies."""
        return None if self.line["target"] is None else int(self.line["target"])

    def prop(self, body: dict[str, Any]) -> dict[str, Any]:
        """Label, file, friction, mass and solids of a body's prop, at scale 1."""
        return dict(self.assets["props"][body["prop"]])


def read(folder: str | Path, failed: bool = False) -> Iterator[Layout]:
    """The layouts of a folder, by number, one in memory at a time for each of its files. `failed`: those, too, that
    were not made; they have no bodies."""
    folder = Path(folder)
    assets = json.loads((folder / "assets.json").read_text(encoding="utf-8"))
    last = -1
    for path in sorted(folder.glob("layouts*.jsonl"), key=_first):
        with open(path, encoding="utf-8") as lines:
            for text in lines:
                # A run that was cut off may have left a part of a line.
                line = json.loads(text) if text.endswith("\n") else None
                if line and line["layout"] > last and (failed or line["failed"] is None):
                    last = line["layout"]
                    yield Layout(line, assets, folder)


def _first(path: Path) -> int:
    """The first number of a file of layouts."""
    parts = path.stem.split("-")
    return int(parts[1]) if len(parts) > 1 else 0


def _array(values: list[Any]) -> Any:
    return values if numpy is None else numpy.array(values)


def z_up(position: Any, rotation: Any, models_too: bool = False) -> tuple[list[float], list[float]]:
    """A pose with Z up: the position, and the quaternion as w, x, y, z. `models_too`: the program turns the models to Z
    up as well when it reads them, as Blender does; else they stay as their files have them."""
    x, y, z = (float(value) for value in position)
    i, j, k, w = (float(value) for value in rotation)
    turned = [_HALF * (w - i), _HALF * (i + w), _HALF * (j - k), _HALF * (k + j)]
    if models_too:
        turned = [w, i, -k, j]
    return [x, -z, y], turned


def mujoco_spec(layout: Layout) -> Any:
    """The layout as an `MjSpec` with Z up, at MuJoCo's defaults: bodies `body0`, `body1`, ... with free joints."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.option.gravity = [0, 0, -layout.assets["gravity"]]
    meshes: dict[Any, str] = {}

    def add(body: Any, name: str, solids: list[dict[str, Any]], friction: float, scale: float = 1.0) -> None:
        for number, solid in enumerate(solids):
            geom = body.add_geom(friction=[friction, 0.005, 0.0001])
            if solid["kind"] == "hull":
                key = (name, number, scale)
                if key not in meshes:
                    meshes[key] = f"{name}.{number}.{len(meshes)}"
                    points = [scale * value for point in solid["points"] for value in point]
                    convex = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
                    spec.add_mesh(name=meshes[key], uservert=points, inertia=convex)
                geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, meshes[key]
                continue
            geom.pos = [scale * value for value in solid["center"]]
            if solid["kind"] == "box":
                x, y, z, w = solid["rotation"]
                geom.type, geom.quat = mujoco.mjtGeom.mjGEOM_BOX, [w, x, y, z]
                geom.size = [scale * value for value in solid["half"]]
            else:
                geom.type, geom.size = mujoco.mjtGeom.mjGEOM_SPHERE, [scale * solid["radius"], 0, 0]

    place = layout.place
    add(spec.worldbody.add_body(quat=[_HALF, _HALF, 0, 0]), "place", place["solids"], place["friction"])
    for number, line in enumerate(layout.bodies):
        position, rotation = z_up(line["position"], line["rotation"])
        body = spec.worldbody.add_body(name=f"body{number}", pos=position, quat=rotation)
        body.add_freejoint()
        body.explicitinertial = True
        body.mass, body.ipos, body.fullinertia = line["mass"], line["center_of_mass"], line["inertia"]
        prop = layout.prop(line)
        add(body, f"prop{line['prop']}", prop["solids"], prop["friction"], line["scale"])
    return spec


def mujoco_drift(layout: Layout, seconds: float = 2.0) -> float:
    """The largest way of a body's center of mass in MuJoCo, m."""
    import mujoco

    model = mujoco_spec(layout).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    # The world and the place come first.
    before = data.xipos[2:].copy()
    while data.time < seconds:
        mujoco.mj_step(model, data)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return float(((data.xipos[2:] - before) ** 2).sum(1).max() ** 0.5)


def _answer_drifts() -> None:
    """For `cairn clutter --stands mujoco`: a line in, its drift out."""
    assets = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    for text in sys.stdin:
        print(mujoco_drift(Layout(json.loads(text), assets, Path(sys.argv[1]).parent)), flush=True)
