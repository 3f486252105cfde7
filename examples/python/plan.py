"""Prints the expected cost of each accuracy, and shows the pile as it forms.

python examples/python/plan.py examples/assets/cone-small.glb examples/assets/stick.glb
"""

import sys

import cairn

control, *props = sys.argv[1:]
scene = {"control_mesh": control, "props": props, "accuracy": "draft"}
with cairn.serve() as address:
    client = cairn.Client(address)
    for estimate in client.plan(scene).plan.estimates:
        print(f"accuracy {estimate.accuracy}: {estimate.cpu_seconds:.0f} s, overlap {estimate.overlap * 1000:.2f} mm")
    for event in client.bake(scene, has_fill=True):
        if isinstance(event, cairn.Snapshot):
            print(f"{event.present.sum()} bodies, mean height {event.positions[event.present, 1].mean():.3f} m")
