"""The motion of a bake, from its events: SI units, right-handed, Y up. The Blender add-on has this file, too."""

from dataclasses import dataclass

import numpy as np

from .messages import floats, v1


@dataclass(frozen=True)
class Snapshot:
    """All bodies at a moment. Never changed once made: threads may share it."""

    stage: int
    # Shape [n]: which prop; [n]: its scale; [n, 3]: m; [n, 4]: x y z w; [n]: whether the body is there;
    # [n]: its `BodyState`.
    props: np.ndarray
    scales: np.ndarray
    positions: np.ndarray
    rotations: np.ndarray
    present: np.ndarray
    states: np.ndarray


class Recording:
    """Takes tables and frames in their order."""

    def __init__(self):
        self._start()
        # The result's frames, in order; and how many it has, once that is known.
        self.frames = []
        self.count = None

    def _start(self):
        self.props = np.empty(0, np.int32)
        self.scales = np.empty(0, np.float32)
        self.positions = np.empty((0, 3), np.float32)
        self.rotations = np.empty((0, 4), np.float32)
        self.present = np.empty(0, bool)
        self.states = np.empty(0, np.uint8)
        # The numbers in the names of the result's nodes.
        self.numbers = np.empty(0, np.int32)

    def add_table(self, table):
        """Bodies that later frames speak of."""
        first, new = table.first_body_index, len(table.prop_indices)
        if table.stage == v1.STAGE_RELEASE and first == 0:
            self._start()
            self.frames = []
        if first < len(self.props):
            # A repeated frame, after a connection broke.
            return
        identity = np.tile(np.float32([0, 0, 0, 1]), (new, 1))
        self.props = np.concatenate([self.props, np.asarray(table.prop_indices, np.int32)])
        self.scales = np.concatenate([self.scales, floats(table.scales)])
        self.positions = np.concatenate([self.positions, np.zeros((new, 3), np.float32)])
        self.rotations = np.concatenate([self.rotations, identity])
        self.present = np.concatenate([self.present, np.zeros(new, bool)])
        self.states = np.concatenate([self.states, np.zeros(new, np.uint8)])
        numbers = table.numbers or np.arange(first, first + new)
        self.numbers = np.concatenate([self.numbers, np.asarray(numbers, np.int32)])

    def add_frame(self, frame):
        """Returns the bodies as they are now."""
        moved = np.asarray(frame.body_indices, np.intp)
        positions, rotations = self.positions.copy(), self.rotations.copy()
        present, scales = self.present.copy(), self.scales
        positions[moved] = floats(frame.positions).reshape(-1, 3)
        rotations[moved] = floats(frame.rotations).reshape(-1, 4)
        present[moved] = True
        present[np.asarray(frame.removed_body_indices, np.intp)] = False
        if frame.scales:
            scales = scales.copy()
            scales[moved] = floats(frame.scales)
        self.positions, self.rotations, self.present, self.scales = positions, rotations, present, scales
        if frame.state_body_indices:
            self.states = self.states.copy()
            self.states[np.asarray(frame.state_body_indices, np.intp)] = frame.states
        snapshot = Snapshot(frame.stage, self.props, scales, positions, rotations, present, self.states)
        if frame.stage != v1.STAGE_FILL and frame.frame_number == len(self.frames) != self.count:
            self.frames.append(snapshot)
        return snapshot

    def end_at(self, count):
        """Takes the number of the result's frames; 0 where it is not known yet. It leaves out the last (`output.trim`),
        whether they have arrived or will."""
        if count:
            self.count = count
            del self.frames[count:]

    def motion(self):
        """The result's frames as one. None if there is none yet."""
        frames = list(self.frames)
        return Motion.of(frames, self.numbers) if frames else None


@dataclass(frozen=True)
class Motion:
    """The result: n bodies in f frames. Frame 0 is the pile right after turning over.

    A pose takes a point of the prop's own frame, first scaled by the body's scale, to the world.
    """

    # [n]: which of the scene's props.
    props: np.ndarray
    # [n]: uniform scale of the prop.
    scales: np.ndarray
    # [f, n, 3]: x, y, z, m.
    positions: np.ndarray
    # [f, n, 4]: unit quaternions x, y, z, w.
    rotations: np.ndarray
    # [f, n]: whether the body is there.
    present: np.ndarray
    # [f, n]: its `BodyState`.
    states: np.ndarray
    # [n]: the number in its name, by which a body is found again in a bake that changes this one.
    numbers: np.ndarray = None

    @staticmethod
    def of(frames, numbers=None):
        last = frames[-1]
        count = len(last.props)

        def all_of(name, shape):
            out = np.zeros((len(frames), count, *shape), getattr(last, name).dtype)
            for number, frame in enumerate(frames):
                values = getattr(frame, name)
                out[number, : len(values)] = values
            return out

        return Motion(
            last.props,
            last.scales,
            all_of("positions", (3,)),
            all_of("rotations", (4,)),
            all_of("present", ()),
            all_of("states", ()),
            np.arange(count) if numbers is None else numbers[:count],
        )
