"""The poses that a result's table holds, as matrices."""

import json

TOLERANCE = 1e-4  # m, and without unit in the linear part


def frames(table):
    """Three frames to look at: the first, one in the middle, the last."""
    last = len(table["frames"]) - 1
    return [0, last // 2, last]


def load(path):
    with open(path) as file:
        return json.load(file)


def matrix(table, frame, body):
    """Rows of the body's 4x4 matrix: metres, Y up."""
    x, y, z, qx, qy, qz, qw = table["frames"][frame][body]
    s = table["bodies"][body]["scale"]
    return [
        [s * (1 - 2 * (qy * qy + qz * qz)), s * 2 * (qx * qy - qz * qw), s * 2 * (qx * qz + qy * qw), x],
        [s * 2 * (qx * qy + qz * qw), s * (1 - 2 * (qx * qx + qz * qz)), s * 2 * (qy * qz - qx * qw), y],
        [s * 2 * (qx * qz - qy * qw), s * 2 * (qy * qz + qx * qw), s * (1 - 2 * (qx * qx + qy * qy)), z],
        [0, 0, 0, 1],
    ]


def compare(program, table, poses, tolerance=TOLERANCE):
    """Ends the program unless `poses`, {(frame, body): rows}, are those of the table."""
    worst = 0.0
    for frame in frames(table):
        for body in range(len(table["bodies"])):
            expected, found = matrix(table, frame, body), poses[frame, body]
            worst = max(worst, *(abs(found[r][c] - expected[r][c]) for r in range(4) for c in range(4)))
    print(f"{program}: {len(table['bodies'])} bodies at frames {frames(table)} within {worst:.1e}")
    if not worst <= tolerance:
        raise SystemExit(f"{program}: more than {tolerance}")
    moved = max(
        abs(a - b)
        for body in range(len(table["bodies"]))
        for a, b in zip(table["frames"][0][body][:3], table["frames"][-1][body][:3])
    )
    if moved < 10 * TOLERANCE:
        raise SystemExit("nothing moves: the comparison says nothing")
