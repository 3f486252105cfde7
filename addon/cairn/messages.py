"""The messages of `cairn.v1`, made of their descriptors: `v1.BakeRequest`, `v1.ACCURACY_DRAFT`."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from ._vendor.google.protobuf import descriptor_pb2, descriptor_pool, message_factory

# Registers the errors' details.
from ._vendor.google.rpc import error_details_pb2, status_pb2  # noqa: F401

Field = descriptor_pb2.FieldDescriptorProto


def floats(values):
    """Packed numbers as numpy's, [n]."""
    return np.frombuffer(values, "<f4")


def _load():
    files = descriptor_pb2.FileDescriptorSet.FromString((Path(__file__).parent / "descriptors.binpb").read_bytes())
    pool = descriptor_pool.DescriptorPool()
    names = []
    for file in files.file:
        for message in file.message_type:
            for field in message.field:
                # Packed numbers stand on the wire as bytes do. numpy reads those at once; one by one, Python would
                # take longer for the frames than the server for the physics.
                if field.type == Field.TYPE_FLOAT and field.label == Field.LABEL_REPEATED:
                    field.type, field.label = Field.TYPE_BYTES, Field.LABEL_OPTIONAL
        pool.Add(file)
        names.append(file.name)
    classes = message_factory.GetMessageClassesForFiles(names, pool)
    v1 = {name.rpartition(".")[2]: kind for name, kind in classes.items() if name.startswith("cairn.v1.")}
    for file in files.file:
        if file.package == "cairn.v1":
            for enum in file.enum_type:
                v1.update((value.name, value.number) for value in enum.value)
    return SimpleNamespace(**v1)


v1 = _load()
