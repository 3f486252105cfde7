"""examples/farm/slurm.sh on a Slurm of two nodes, all on this machine: 64 bakes, and one node is killed in the middle.
Every result is there, whole, and has the hash that it has without Slurm. Then: a stopped task runs again.

slurm.py PROGRAM      with slurmctld, slurmd and munged on this machine, as root
"""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SCENE = ["--control", "examples/assets/cone-small.glb", "--prop", "examples/assets/stick.glb", "--accuracy", "draft"]
COUNT, EACH = 64, 4
# Timeout of a step, s. It measures nothing.
LIMIT = 240
CONF = """
ClusterName=cairn
SlurmctldHost=localhost(127.0.0.1)
SlurmctldPort=16817
SlurmUser=root
AuthType=auth/munge
AuthInfo=cred_expire=10
StateSaveLocation={work}/state
SlurmdSpoolDir={work}/spool-%n
SlurmctldPidFile={work}/slurmctld.pid
SlurmdPidFile={work}/slurmd-%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
ReturnToService=2
SlurmdTimeout=10
RequeueExit=75
MinJobAge=300
SchedulerParameters=sched_interval=1,batch_sched_delay=0
NodeName=n1 NodeHostname=localhost NodeAddr=127.0.0.1 Port=16818 CPUs=2 RealMemory=4000
NodeName=n2 NodeHostname=localhost NodeAddr=127.0.0.1 Port=16819 CPUs=2 RealMemory=4000
PartitionName=farm Nodes=n1,n2 Default=YES MaxTime=INFINITE State=UP
"""


class Farm:
    """The daemons of a cluster. Use it as `with Farm(work) as farm`."""

    def __init__(self, work, program):
        self.work, self.daemons = work, {}
        (work / "state").mkdir()
        (work / "bin").mkdir()
        shutil.copy(program, work / "bin" / "cairn")
        self.conf = work / "slurm.conf"
        self.conf.write_text(CONF.format(work=work))
        self.env = {"PATH": f"{work}/bin:/usr/sbin:/usr/bin:/bin", "SLURM_CONF": str(self.conf), "HOME": str(work)}

    def __enter__(self):
        Path("/run/munge").mkdir(exist_ok=True)
        shutil.chown("/run/munge", "munge", "munge")
        # With a key and a socket of its own: another one of this machine stays as it is.
        if not Path("/run/munge/munge.socket.2").exists() or not self._munge_answers():
            self.start(
                "munge", "setpriv", "--reuid=munge", "--regid=munge", "--clear-groups", "munged", "-F", "--force"
            )
        wait_for("munge", self._munge_answers)
        self.start("control", "slurmctld", "-D", "-f", self.conf)
        for node in ("n1", "n2"):
            self.start(node, "slurmd", "-D", "-N", node, "-f", self.conf)
        wait_for("both nodes", lambda: self.ask("sinfo", "-h", "-o", "%T %D") == "idle 2")
        return self

    def _munge_answers(self):
        return subprocess.run(["munge", "-n"], capture_output=True).returncode == 0

    def start(self, name, *command):
        log = open(self.work / f"{name}.log", "ab")
        self.daemons[name] = subprocess.Popen(command, env=self.env, stdout=log, stderr=log)

    def ask(self, *command):
        done = subprocess.run(command, env=self.env, cwd=ROOT, capture_output=True, text=True)
        return done.stdout.strip()

    def submit(self, *arguments):
        done = subprocess.run(
            ["sbatch", "--parsable", *arguments], env=self.env, cwd=ROOT, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    def tasks_of(self, node):
        """Processes that Slurm has started on a node, by id, those that watch over them included."""
        found = set()
        for entry in Path("/proc").glob("[0-9]*"):
            # One that ends meanwhile is none.
            with contextlib.suppress(OSError):
                variables = (entry / "environ").read_bytes().split(b"\0")
                if f"SLURMD_NODENAME={node}".encode() in variables and f"SLURM_CONF={self.conf}".encode() in variables:
                    found.add(int(entry.name))
                    parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
                    if b"slurmstepd" in command_of(parent):
                        found.add(parent)
        return found

    def kill_node(self, node):
        """As if its power failed. Returns how many processes of tasks went with it."""
        self.daemons.pop(node).kill()
        killed = set()
        # A process may end, or begin another, while they are listed.
        while tasks := self.tasks_of(node) - killed:
            for pid in tasks:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
                killed.add(pid)
        return len(killed)

    def is_done(self, job):
        return not self.ask("squeue", "-h", "-j", job)

    def __exit__(self, *_):
        for job in self.ask("squeue", "-h", "-o", "%A").split():
            self.ask("scancel", job)
        for daemon in reversed(self.daemons.values()):
            daemon.terminate()
        for daemon in self.daemons.values():
            try:
                daemon.wait(timeout=60)
            except subprocess.TimeoutExpired:
                # After a fault: a node waits for its tasks, which nobody ends any more.
                daemon.kill()
                daemon.wait()


def wait_for(what, is_so):
    until = time.monotonic() + LIMIT
    while not is_so():
        assert time.monotonic() < until, f"this did not come: {what}"
        time.sleep(0.2)


def command_of(pid):
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def hashes(folder):
    """The hash in each report, by the result's name."""
    reports = {path.name: json.loads(path.read_text()) for path in folder.glob("*.report.json")}
    return {name.replace(".report.json", ".glb"): report["result_blake3"] for name, report in reports.items()}


def main(program):
    work = Path(tempfile.mkdtemp(prefix="cairn-slurm-"))
    scene = work / "scene.toml"
    flags = [*SCENE, "--set", "fill.count=12"]
    scene_text = subprocess.run([program, "scene", *flags], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    scene.write_text(scene_text.replace("examples/assets", str(ROOT / "examples/assets")))
    batch = [program, "batch", scene, "--seeds", f"0..{COUNT - 1}", "--no-cache", "--progress", "none"]

    # Undisturbed.
    (work / "alone").mkdir()
    subprocess.run([*batch, "-o", work / "alone" / "{seed}.glb"], check=True, stdout=subprocess.DEVNULL)
    expected = hashes(work / "alone")
    assert len(expected) == COUNT

    with Farm(work, program) as farm:
        farm.env["CAIRN_NO_CACHE"] = "1"
        out = work / "piles"
        asked = [sys.executable, ROOT / "examples/farm/requests.py", scene, "--each", str(EACH), "--program", program]
        needs = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.split()
        script = ["--output", work / "tasks.log", *needs, "examples/farm/slurm.sh"]
        job = farm.submit(f"--array=0-{COUNT // EACH - 1}", *script, scene, out, f"0..{COUNT - 1}", str(EACH))
        wait_for(
            "some results, and a task on the second node",
            lambda: len(list(out.glob("*.glb"))) > 4 and farm.tasks_of("n2"),
        )
        killed = farm.kill_node("n2")
        before = len(list(out.glob("*.glb")))
        assert killed >= 2 and before < COUNT, f"{killed} processes, {before} results"
        wait_for("the end of all tasks", lambda: farm.is_done(job))
        assert hashes(out) == expected, "results differ from those of an undisturbed run"
        # Unfinished files of the killed node have temporary names. A later command removes them once they are old.
        names = sorted(path.name for path in out.iterdir() if not path.match(".cairn-*.part"))
        wanted = sorted(f"{seed}{ending}" for seed in range(COUNT) for ending in (".glb", ".report.json"))
        assert names == wanted, f"there is more or less than results and reports: {set(names) ^ set(wanted)}"
        for name in expected:
            assert (out / name).read_bytes() == (work / "alone" / name).read_bytes(), name
        print(
            f"slurm: {COUNT} results, each once, as without Slurm; node killed with {killed} processes after {before}"
        )

        # Asked to end: exit 75, queued again, and then done.
        late = work / "late"
        settings = ["--set", "accuracy=reference"]
        long = subprocess.run([program, "scene", scene, *settings], capture_output=True, text=True, check=True).stdout
        (work / "long.toml").write_text(long.replace("count = 12", "count = 150"))
        script = ["--output", work / "tasks.log", "--cpus-per-task=2", "--mem-per-cpu=1000", "examples/farm/slurm.sh"]
        job = farm.submit("--array=0", *script, work / "long.toml", late, "0..0", "1")
        wait_for(
            "the task's process",
            lambda: any(b"batch" in command_of(p) for p in farm.tasks_of("n1")),
        )
        time.sleep(1)
        farm.ask("scancel", "--signal=TERM", "--batch", job)
        wait_for("the task in the queue again", lambda: "Restarts=1" in farm.ask("scontrol", "show", "job", job))
        assert not list(late.iterdir()), "something half-written is left"
        assert "ExitCode=75:0" in farm.ask("scontrol", "show", "job", job)
        farm.ask("scancel", job)
        print("slurm: a stopped task left nothing, ended with 75, and was queued again")
    shutil.rmtree(work)


if __name__ == "__main__":
    main(str(Path(sys.argv[1]).resolve()))
