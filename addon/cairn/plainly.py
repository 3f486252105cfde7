"""Faults of the system and of Blender's own operators, in words for an artist."""

import errno

from .client import Fault

FULL = {errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)}
# How a server says that its own disk is full.
SERVER_FULL = "the disk of its data directory is full"


def full(folder):
    return Fault(f"The disk is full: there is no room for more in the folder {folder}. Make room, and try again.")


def fault_of(error, folder):
    """The fault that an exception stands for; None for a fault of the add-on. `folder`: where the add-on writes."""
    if isinstance(error, OSError) and error.errno in FULL:
        return full(folder)
    if isinstance(error, OSError) and error.filename:
        return Fault(f"{error.filename} cannot be used: {error.strerror}. Check the disk and its permissions.")
    return None
