"""examples/farm/openjd, held against the model of Open Job Description, and run by its own program.

bundle.py PROGRAM      with openjd-cli and openjd-model in this Python
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import yaml
from openjd.model import create_job, decode_job_template, preprocess_job_parameters

ROOT = Path(__file__).resolve().parents[2]
BUNDLE = ROOT / "examples" / "farm" / "openjd"
OPENJD = Path(sys.executable).parent / "openjd"


def main(program):
    template = decode_job_template(
        template=yaml.safe_load((BUNDLE / "template.yaml").read_text()), supported_extensions=["TASK_CHUNKING"]
    )
    values = yaml.safe_load((BUNDLE / "parameter_values.yaml").read_text())["parameterValues"]
    given = {value["name"]: str(value["value"]) for value in values}
    parameters = preprocess_job_parameters(
        job_template=template,
        job_parameter_values=given,
        job_template_dir=BUNDLE,
        current_working_dir=BUNDLE,
        allow_job_template_dir_walk_up=True,
    )
    job = create_job(job_template=template, job_parameter_values=parameters)
    assert [step.name for step in job.steps] == ["Bake", "Rank", "Verify"]
    assert all(parameter.userInterface for parameter in template.parameterDefinitions)
    kinds = {parameter.name: parameter for parameter in template.parameterDefinitions}
    assert kinds["Scenes"].dataFlow.name == "IN" and kinds["Output"].dataFlow.name == "OUT"
    references = yaml.safe_load((BUNDLE / "asset_references.yaml").read_text())["assetReferences"]
    folders = [(BUNDLE / folder).resolve() for folder in references["inputs"]["directories"]]
    assert all(folder.is_dir() for folder in folders)

    requests(program)
    with tempfile.TemporaryDirectory(prefix="cairn-openjd-") as work:
        scenes, output = Path(work) / "scenes", Path(work) / "out"
        scenes.mkdir()
        for name in ("sticks", "column"):
            small = ["--control", "cone-small.glb", "--prop", "stick.glb", "--set", "fill.count=8"]
            text = subprocess.run(
                [program, "scene", *small], cwd=ROOT / "examples" / "assets", capture_output=True, text=True, check=True
            ).stdout
            for asset in ("cone-small.glb", "stick.glb"):
                (scenes / asset).write_bytes((ROOT / "examples" / "assets" / asset).read_bytes())
            (scenes / f"{name}.toml").write_text(text)
        printed = run(program, scenes, output)
        assert printed.returncode == 0, printed.stdout[-3000:]
        piles = sorted(str(path.relative_to(output)) for path in output.rglob("*.glb"))
        assert piles == [f"{scene}/{seed}.glb" for scene in ("column", "sticks") for seed in range(4)], piles
        shares = [float(share) for share in re.findall(r"openjd_progress: ([\d.]+)", printed.stdout)]
        assert shares.count(100.0) == 4, f"one of each task: {shares}"
        assert "openjd_status: 2 of 2 bakes, 0 failed" in printed.stdout

        # Again: all is there. Then with what cannot be baked: the fault is reported as the format has it.
        again = run(program, scenes, output)
        assert again.returncode == 0 and "2 finished before" in again.stdout
        (scenes / "column.toml").write_text('control_mesh = "none.glb"\n')
        failed = run(program, scenes, output)
        assert failed.returncode != 0 and "openjd_fail: " in failed.stdout and "none.glb" in failed.stdout

        # A single bake reports its stages; its share only rises.
        bake = [program, "bake", scenes / "sticks.toml", "--no-cache", "-o", output / "one.glb", "--progress", "openjd"]
        lines = subprocess.run(bake, capture_output=True, text=True, check=True).stdout.splitlines()
        assert all(re.match(r"openjd_(progress: [\d.]+|status: \S.*)$", line) for line in lines), lines
        shares = [float(line.split()[1]) for line in lines if line.startswith("openjd_progress")]
        assert shares == sorted(shares) and shares[-1] == 100 and len(shares) > 3
        report = json.loads((output / "sticks" / "0.report.json").read_text())
        assert report["bodies"] > 0
    pasted(program)
    print("openjd: a valid bundle; 8 bakes in 4 tasks by openjd run")


def pasted(program):
    """The README's command, in a folder that has the examples and a path that has the program."""
    lines = (ROOT / "README.md").read_text().replace("\\\n", "").splitlines()
    (command,) = (line.strip() for line in lines if line.startswith("    openjd run "))
    with tempfile.TemporaryDirectory(prefix="cairn-openjd-") as work:
        shutil.copytree(ROOT / "examples", Path(work) / "examples", ignore=shutil.ignore_patterns("*.jpg", "*.png"))
        (Path(work) / "cairn").symlink_to(program)
        environment = {**os.environ, "PATH": f"{work}:{OPENJD.parent}:{os.environ['PATH']}"}
        done = subprocess.run(command, shell=True, cwd=work, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr
        assert len(list((Path(work) / "piles").rglob("*.glb"))) == 4, command


def run(program, scenes, output):
    given = {
        "Scenes": scenes,
        "Output": output,
        "LastSeed": 3,
        "BakesPerTask": 2,
        "Accuracy": "draft",
        "Program": program,
    }
    arguments = [word for name, value in given.items() for word in ("--job-param", f"{name}={value}")]
    command = [OPENJD, "run", BUNDLE / "template.yaml", "--step", "Bake", "--extensions", "TASK_CHUNKING", *arguments]
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def requests(program):
    """What tasks ask for follows the estimates of the scene."""

    def asked(scene, *given):
        command = [sys.executable, BUNDLE.parent / "requests.py", scene, "--program", program, *given]
        return subprocess.run(command, cwd=ROOT / "examples", capture_output=True, text=True, check=True).stdout

    few = json.loads(asked("sticks.toml", "--each", "4", "--accuracy", "draft", "--json"))
    many = json.loads(asked("sticks.toml", "--each", "8", "--accuracy", "draft", "--json"))
    careful = json.loads(asked("sticks.toml", "--each", "4", "--accuracy", "fine", "--json"))
    assert few["cores"] == many["cores"] == 2 and few["memory_mib"] == many["memory_mib"] > 2 * 26
    assert few["seconds"] < many["seconds"] and few["seconds"] < careful["seconds"]
    flags = asked("sticks.toml", "--each", "4", "--accuracy", "draft").split()
    assert [flag.split("=")[0] for flag in flags] == ["--cpus-per-task", "--mem-per-cpu", "--time"]
    filled = asked("sticks.toml", "--each", "4", "--accuracy", "draft", "--openjd", BUNDLE / "template.yaml")
    template = decode_job_template(template=yaml.safe_load(filled), supported_extensions=["TASK_CHUNKING"])
    amounts = {amount.name: amount.min for amount in template.steps[0].hostRequirements.amounts}
    assert amounts == {"amount.worker.vcpu": 2, "amount.worker.memory": few["memory_mib"]}
    assert "# The scene files, without their ending." in filled


if __name__ == "__main__":
    main(str(Path(sys.argv[1]).resolve()))
