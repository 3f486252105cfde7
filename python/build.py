#!/usr/bin/env python3
"""Builds the wheel `cairn-pile` of this platform: the program `cairn`, and the Python package `cairn`.

python -m pip install grpcio-tools==1.85.1 grpclib==0.4.9 maturin==1.16.0
python python/build.py                    into target/wheel/dist

What Cargo has built by `cargo build --release` is used again.
"""

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# A folder of its own: nothing that is generated stands between the sources.
STAGE = ROOT / "target" / "wheel"
TOOLS = Path(sys.executable).parent


def main():
    shutil.rmtree(STAGE, ignore_errors=True)
    shutil.copytree(ROOT / "python", STAGE, ignore=shutil.ignore_patterns("__pycache__", "build.py"))
    generate(STAGE)
    manifest = STAGE / "pyproject.toml"
    manifest.write_text(manifest.read_text() + f'manifest-path = "{(ROOT / "Cargo.toml").as_posix()}"\n')
    command = [TOOLS / "maturin", "build", "--release", "--locked", "--out", STAGE / "dist"]
    subprocess.run(command, cwd=STAGE, check=True)
    # maturin moves the program; restore it for the next build.
    subprocess.run(["cargo", "build", "--release", "--locked", "--bin", "cairn"], cwd=ROOT, check=True)
    (wheel,) = (STAGE / "dist").glob("*.whl")
    print(wheel)


def generate(output):
    """The messages of `proto/cairn/v1` and their types, below the package."""
    protos = sorted(path.relative_to(ROOT / "proto") for path in (ROOT / "proto").glob("cairn/v1/*.proto"))
    into = [f"--{kind}_out={output}" for kind in ("python", "pyi")]
    compiler = [sys.executable, "-m", "grpc_tools.protoc", f"-I{ROOT / 'proto'}"]
    subprocess.run([*compiler, *into, *map(str, protos)], check=True)
    for path in (output / "cairn" / "v1").glob("*_pb2.py"):
        path.write_text(unbound(path.read_text()))
    (output / "cairn" / "v1" / "__init__.py").write_text('"""The messages of the service, generated."""\n')


def unbound(code):
    """Generated code without its check that the library is no older than the compiler: programs such as Houdini and
    Maya bring older ones of their own, and what is left works with each since 3.20 (`tests/python/run` tries some)."""
    start, end = "from google.protobuf import runtime_version", "# @@protoc_insertion_point(imports)"
    head, found, rest = code.partition(start)
    names, is_checked, rest = rest.partition(end)
    if not found or not is_checked or "ValidateProtobufRuntimeVersion" not in names:
        raise SystemExit("python/build.py: the compiler writes other code than it did; see `unbound`")
    # What else is imported there stays.
    lines = [
        line for line in names.splitlines() if line.startswith(("from ", "import ")) and "runtime_version" not in line
    ]
    return head + "\n".join(lines) + "\n" + end + rest


if __name__ == "__main__":
    main()
