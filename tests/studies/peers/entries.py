"""Who is compared, with which settings, and on which piles."""

from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
HERE = "tests/studies/peers"
TARGET = ROOT / "target" / "peers"
ENGINES = TARGET / "engines" / "release" / "cairn-peers"
CAIRN = ROOT / "target" / "release" / "examples" / "peers"
BLENDER_MODULE = ROOT / "target" / "addon" / "tools" / "blender-5.0.1" / "bin" / "python"


@dataclass(frozen=True)
class Pile:
    name: str
    file: str
    count: int
    scale: float = 1
    """Of its props."""

    def set(self, few=None):
        """Assignments: as many bodies, or few, but so much larger that they fill the same mesh."""
        if few is None:
            return [f"fill.count={self.count}"]
        scale = self.scale * (self.count / few) ** (1 / 3)
        sizes = [f"props.0.scale_{end}={scale:.3f}" for end in ("min", "max")]
        return [f"fill.count={few}", *sizes]


PILES = [
    Pile("sticks", "examples/sticks.toml", 609),
    Pile("column", "examples/column.toml", 593),
    Pile("books", "examples/books.toml", 879),
    Pile("bananas", f"{HERE}/bananas.toml", 1008, 2.25),
]
FEW = 60
"""Bodies of the small version."""

OURS = ["held", "glued"]
"""What each peer is paired with."""
BASELINES = ["natural", "off", "off-substeps", "off-damped", "random"]


@dataclass(frozen=True)
class Peer:
    """A row: an engine with its settings."""

    name: str
    settings: str
    command: tuple
    """What runs it; the scene, the result and `options` come behind."""
    options: tuple
    program: str = ""
    """A file that must be there, or a command on the path."""
    is_small: bool = True
    """Quick enough for the small version."""


def python(script):
    return (str(TARGET / "venv" / "bin" / "python"), f"{HERE}/{script}")


def options(hz, iterations, *more):
    return ("--hz", str(hz), "--iterations", str(iterations), *more)


def compiled(engine):
    return (str(ENGINES), engine)


DEBIAN = ("blender", "--background", "--factory-startup", "--python", f"{HERE}/in_blender.py", "--")
MODULE = (str(BLENDER_MODULE), f"{HERE}/in_blender.py", "--")

PEERS = [
    Peer("bullet-10", "240 Hz, 10 iterations (Bullet's own default)", python("in_bullet.py"), options(240, 10)),
    Peer("bullet-50", "240 Hz, 50 iterations (pybullet's default)", python("in_bullet.py"), options(240, 50)),
    Peer("bullet-sleep", "240 Hz, 50 iterations, sleeping", python("in_bullet.py"), options(240, 50, "--sleeping")),
    Peer("mujoco", "240 Hz, else as it comes", python("in_mujoco.py"), options(240, 100)),
    Peer(
        "mujoco-elliptic",
        "240 Hz, elliptic cones, impratio 10, 20 iterations",
        python("in_mujoco.py"),
        options(240, 20, "--cone", "elliptic", "--impratio", "10"),
    ),
    Peer("blender-3.4-10", "24 fps x 10 substeps, 10 iterations (defaults)", DEBIAN, options(240, 10), "blender"),
    Peer("blender-3.4-50", "24 fps x 20 substeps, 50 iterations", DEBIAN, options(480, 50), "blender", False),
    Peer(
        "blender-5.0-10",
        "24 fps x 10 substeps, 10 iterations (defaults)",
        MODULE,
        options(240, 10),
        str(BLENDER_MODULE),
        False,
    ),
    Peer("rapier", "60 Hz, 4 iterations (defaults)", compiled("rapier"), options(60, 4), str(ENGINES)),
    Peer("rapier-240", "240 Hz, 8 iterations", compiled("rapier"), options(240, 8), str(ENGINES)),
    Peer("box3d", "60 Hz, 4 substeps (defaults)", compiled("box3d"), options(60, 4), str(ENGINES)),
    Peer("box3d-240", "240 Hz, 8 substeps", compiled("box3d"), options(240, 8), str(ENGINES)),
    Peer("jolt", "60 Hz, 10 iterations (defaults)", compiled("jolt"), options(60, 10), str(ENGINES)),
    Peer("jolt-240", "240 Hz, 20 iterations", compiled("jolt"), options(240, 20), str(ENGINES)),
]
