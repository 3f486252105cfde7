"""Between Blender's space and the server's, in this one place.

Blender: Z up, lengths in scene units, quaternions w x y z. The server: glTF's axes, Y up, metres, quaternions x y z w.
`metres` is what one scene unit measures. Arrays have the components last.
"""

import numpy as np


def points_to_server(points, metres=1.0):
    """Shape [..., 3] in scene units -> metres, Y up."""
    points = np.asarray(points)
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1) * metres


def points_to_blender(points, metres=1.0):
    """Shape [..., 3] in metres, Y up -> scene units."""
    points = np.asarray(points)
    return np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1) / metres


def rotations_to_server(rotations):
    """Shape [..., 4], w x y z -> x y z w, Y up."""
    w, x, y, z = np.moveaxis(np.asarray(rotations), -1, 0)
    return np.stack([x, z, -y, w], axis=-1)


def rotations_to_blender(rotations):
    """Shape [..., 4], x y z w, Y up -> w x y z."""
    x, y, z, w = np.moveaxis(np.asarray(rotations), -1, 0)
    return np.stack([w, x, -z, y], axis=-1)


def matrices(positions, rotations, scales):
    """Poses in Blender's space -> shape [n, 3, 4]: positions [n, 3], quaternions [n, 4] w x y z, scales [n]."""
    w, x, y, z = np.moveaxis(rotations, -1, 0)
    turn = np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=-2,
    )
    return np.concatenate([turn * scales[:, None, None], positions[:, :, None]], axis=-1)
