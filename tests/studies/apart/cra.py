#!/usr/bin/env python3
"""What `cairn analyse` says of the examples of compas_cra, and what compas_cra says; and what both cost.

PYTHON tests/studies/apart/cra.py [CAIRN]

PYTHON has compas_cra (`pip install compas_cra==0.8.0`). The examples are those of its documentation that have one
density for all blocks, without those of curved blocks, for which it takes minutes. Prints a table: whether its solver
for rigid blocks (RBE) and its coupled one (CRA) find an equilibrium, whether Cairn does, and CPU seconds of each:
theirs with the finding of the interfaces, ours with the start of the program and all other figures.
"""

import contextlib
import io
import json
import math
import resource
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import compas
import compas_cra
from compas_cra.algorithms import assembly_interfaces_numpy
from compas_cra.equilibrium import cra_solve, rbe_solve
from compas_cra.geometry import Arch

CAIRN = sys.argv[1] if len(sys.argv) > 1 else str(Path(__file__).resolve().parents[3] / "target/release/cairn")

# Sample, supports, friction, degrees and axis of a turn of the whole, options of CRA.
CASES = [
    ("cubes", [0], 0.84, 0, (0, 1, 0), {}),
    ("cubes", [0], 0.84, 35, (0, 1, 0), {}),
    ("cubes", [0], 0.84, 48, (0, 1, 0), {}),
    *((f"type-{kind}", [0, 1], 0.84, 90, axis, {"d_bnd": 1e-2}) for kind in "abcd" for axis in [(0, 1, 0), (1, 0, 0)]),
    ("arch", None, 0.7, 0, (0, 1, 0), {}),
    ("shelf", [0], 0.9, 0, (0, 1, 0), {}),
    ("shelf-stable", [0], 0.9, 0, (0, 1, 0), {}),
    ("snake", [0], 0.7, 0, (0, 1, 0), {}),
    ("concave-short", [0], 0.84, 40, (0, 1, 0), {"eps": 1e-3, "d_bnd": 1e-2}),
    ("concave-long", [0], 0.84, 50, (0, 1, 0), {"eps": 1e-3, "d_bnd": 1e-2}),
]


def assembly_of(name, supports, degrees, axis):
    if name == "arch":
        return Arch(height=5, span=10, thickness=0.5, depth=0.5, num_blocks=20, extra_support=False).assembly()
    assembly = compas.json_load(str(Path(compas_cra.SAMPLE) / f"{name}.json"))
    assembly = assembly.copy(cls=compas_cra.datastructures.CRA_Assembly)
    assembly.set_boundary_conditions(supports)
    if degrees:
        assembly.rotate_assembly([0, 0, 0], list(axis), degrees)
    return assembly


def write(assembly, path):
    """A node for each block, in glTF's axes."""
    data, views, accessors, meshes, nodes = b"", [], [], [], []
    for node in assembly.graph.nodes():
        vertices, faces = assembly.graph.node_attribute(node, "block").to_vertices_and_faces(triangulated=True)
        points = [(x, z, -y) for x, y, z in vertices]
        for content, count, kind in (
            (b"".join(struct.pack("<3f", *p) for p in points), len(points), "VEC3"),
            (b"".join(struct.pack("<3I", *face) for face in faces), 3 * len(faces), "SCALAR"),
        ):
            views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(content)})
            accessor = {"bufferView": len(views) - 1, "count": count, "type": kind}
            accessor["componentType"] = 5126 if kind == "VEC3" else 5125
            if kind == "VEC3":
                # As single precision holds them.
                columns = list(zip(*(struct.unpack("<3f", struct.pack("<3f", *p)) for p in points), strict=True))
                accessor |= {"min": [min(c) for c in columns], "max": [max(c) for c in columns]}
            accessors.append(accessor)
            data += content
        primitive = {"attributes": {"POSITION": len(accessors) - 2}, "indices": len(accessors) - 1}
        meshes.append({"primitives": [primitive]})
        is_support = assembly.graph.node_attribute(node, "is_support")
        nodes.append({"mesh": len(meshes) - 1, "name": f"{'support' if is_support else 'block'} {node}"})
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": meshes,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data)) + struct.pack("<I4s", len(text), b"JSON")
    path.write_bytes(head + text + struct.pack("<I4s", len(data), b"BIN\0") + data)
    return len(nodes)


def theirs(solve, case, options):
    """Whether a solver finds an equilibrium, and its CPU seconds."""
    name, supports, mu, degrees, axis, _ = case
    assembly = assembly_of(name, supports, degrees, axis)
    begin = time.process_time()
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            assembly_interfaces_numpy(assembly, nmax=10, tmax=1e-3, amin=1e-4)
            solve(assembly, mu=mu, **options)
        found = "yes"
    except Exception as error:  # noqa: BLE001 its solvers say so by exceptions
        found = "no" if isinstance(error, ValueError) else f"{type(error).__name__}"
    return found, time.process_time() - begin


def ours(path, mu):
    used = lambda: sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])  # noqa: E731
    begin = used()
    command = [CAIRN, "analyse", str(path), "--json", "--no-ground", "--scenery", "support *", "--friction", str(mu)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    answers = json.loads(done.stdout)
    falling = sum("falls" in body["standing"] for body in answers["bodies"])
    return ("yes" if answers["stands"] else f"no, {falling} fall"), used() - begin


def main():
    print("| example | blocks | friction | turned | RBE | CRA | Cairn | RBE, s | CRA, s | Cairn, s |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            name, supports, mu, degrees, axis, options = case
            path = Path(folder) / "blocks.glb"
            blocks = write(assembly_of(name, supports, degrees, axis), path)
            rbe, rbe_seconds = theirs(rbe_solve, case, {})
            cra, cra_seconds = theirs(cra_solve, case, options)
            cairn, seconds = ours(path, mu)
            turned = f"{degrees}° about {'xyz'[axis.index(1)]}" if degrees else "no"
            row = [name, blocks, mu, turned, rbe, cra, cairn]
            row += [f"{value:.2g}" for value in (rbe_seconds, cra_seconds, seconds) if math.isfinite(value)]
            print("| " + " | ".join(map(str, row)) + " |", flush=True)


if __name__ == "__main__":
    main()
