"""The messages of `cairn.v1`, generated, in one place: `v1.BakeRequest`, `v1.ACCURACY_DRAFT`."""

from types import SimpleNamespace

import numpy as np

# Registers the errors' details.
from google.rpc import error_details_pb2, status_pb2  # noqa: F401

from cairn.v1 import event_pb2, params_pb2, scene_pb2, service_pb2

v1 = SimpleNamespace(
    **{
        name: value
        for module in (params_pb2, scene_pb2, event_pb2, service_pb2)
        for name, value in vars(module).items()
        if not name.startswith("_") and name != "DESCRIPTOR"
    }
)


def floats(values):
    """Numbers of a message as numpy's, [n]."""
    return np.array(values, np.float32)
