#!/usr/bin/env python3
"""Builds the wheel `cairn-pile` of one platform: the program `cairn`, and the Python package `cairn`.

    python3 python/build.py                      with this machine's program, which it builds
    python3 python/build.py --program FILE       with a program of any platform, for that one
        --oldest 2.28                            the oldest glibc that it runs with; without it: not to be published

The wheel is in target/wheel/dist. The same program gives the same bytes. Where this Python lacks grpcio-tools or
hatchling, they are installed into target/wheel-tools.
"""

import argparse
import importlib.util
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

from executable import environment, include, kind_of

ROOT = Path(__file__).resolve().parent.parent
# A folder of its own: nothing that is generated stands between the sources.
STAGE = ROOT / "target" / "wheel"
NATIVE = ROOT / "target" / "release" / ("cairn.exe" if os.name == "nt" else "cairn")
TOOLS = ("grpcio-tools==1.85.1", "hatchling==1.33.0")
# 2020-02-02, the earliest that all tools take.
ZIP_TIME = "1580601600"
MACHINES = {
    ("windows", "x64"): "win_amd64",
    ("windows", "arm64"): "win_arm64",
    ("macos", "x64"): "macosx_10_12_x86_64",
    ("macos", "arm64"): "macosx_11_0_arm64",
    ("linux", "x64"): "x86_64",
    ("linux", "arm64"): "aarch64",
}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=Path, metavar="FILE", default=NATIVE)
    parser.add_argument("--oldest", metavar="VERSION", help="the oldest glibc that the program runs with")
    args = parser.parse_args()
    with_tools()
    if args.program == NATIVE:
        subprocess.run(["cargo", "build", "--release", "--locked", "--bin", "cairn"], cwd=ROOT, check=True)
    if not args.program.is_file():
        sys.exit(f"{args.program} is not there.")
    kind = kind_of(args.program)
    platform = MACHINES[kind]
    if kind.system == "linux":
        platform = f"{'manylinux_' + args.oldest.replace('.', '_') if args.oldest else 'linux'}_{platform}"

    for old in ("cairn", "bin"):
        shutil.rmtree(STAGE / old, ignore_errors=True)
    shutil.copytree(
        ROOT / "python", STAGE, ignore=shutil.ignore_patterns("__pycache__", "build.py"), dirs_exist_ok=True
    )
    for licence in ROOT.glob("LICENSE-*"):
        shutil.copy(licence, STAGE)
    generate(STAGE)
    include(args.program, STAGE / "bin" / kind.program)
    manifest = (ROOT / "python" / "pyproject.toml").read_text()
    for name, value in {"VERSION": version(), "PROGRAM": kind.program}.items():
        manifest = manifest.replace(f"@{name}@", value)
    (STAGE / "pyproject.toml").write_text(manifest)

    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", STAGE / "dist"]
    variables = {**os.environ, "CAIRN_PLATFORM": platform, "SOURCE_DATE_EPOCH": ZIP_TIME}
    subprocess.run(command, cwd=STAGE, env=variables, check=True, stdout=sys.stderr)
    print(STAGE / "dist" / f"cairn_pile-{version()}-py3-none-{platform}.whl")


def with_tools():
    """Goes on in a Python that has what this needs."""
    if all(importlib.util.find_spec(name) for name in ("grpc_tools", "hatchling")):
        return
    home = STAGE.with_name("wheel-tools")
    if Path(sys.prefix) == home:
        sys.exit(f"{home} is broken: delete it.")
    python = environment(home)
    subprocess.run([python, "-m", "pip", "--quiet", "--disable-pip-version-check", "install", *TOOLS], check=True)
    sys.exit(subprocess.run([python, *sys.argv]).returncode)


def version():
    """The workspace's version, which the wheel has, too."""
    return tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]


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
