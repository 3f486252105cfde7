"""The server on this machine: found, started when a bake needs it, stopped with Blender."""

import json
import os
import secrets
import shutil
import signal
import socket
import stat
import subprocess
import tempfile
import threading
import time
from pathlib import Path

from .client import Fault, Target

NAME = "cairn.exe" if os.name == "nt" else "cairn"
# How long a server may take to listen, and to end after a second signal, s.
START = 20.0
END = 5.0
# Longest time for a running bake to finish after Blender quits, s; its result is offered when the file is opened again.
DRAIN = 3600
# Files of Blenders that are gone are removed after this time, s: a new one may not have locked its file yet.
OLD = 60.0


def find(chosen):
    """The program `cairn`: the one chosen in the preferences, the add-on's own, or one on the path."""
    if chosen:
        path = Path(chosen).expanduser()
        path = path / NAME if path.is_dir() else path
        if not path.is_file():
            raise Fault(f"There is no program at {path}. Choose `{NAME}` in the add-on's preferences.")
        return path
    own = Path(__file__).parent / "bin" / NAME
    if own.is_file():
        return runnable(own)
    found = shutil.which(NAME)
    if not found:
        raise Fault(
            f"The program `{NAME}` is not on this computer. Install the add-on's zip for this platform, or choose "
            "the program in the add-on's preferences."
        )
    return Path(found)


def runnable(program):
    """The program that came with the add-on, or a copy of it. Unzipping may lose the permission to run it, and it may
    lie where only an administrator can write."""
    if os.access(program, os.X_OK):
        return program
    about = program.stat()
    try:
        program.chmod(about.st_mode | stat.S_IXUSR)
        return program
    except OSError:
        pass
    copy = Path.home() / ".cache" / "cairn" / f"{about.st_size}-{about.st_mtime_ns}" / NAME
    if not copy.is_file():
        try:
            copy.parent.mkdir(parents=True, exist_ok=True)
            part = copy.with_name(f"{NAME}.{os.getpid()}")
            shutil.copyfile(program, part)
            part.chmod(0o700)
            # Another Blender may do the same at this moment.
            os.replace(part, copy)
        except OSError as error:
            raise Fault(
                f"{program} is not allowed to run, and cannot be copied to {copy.parent} ({error}). Ask whoever "
                "installed the add-on for `chmod +x`, or choose another program in the add-on's preferences."
            ) from error
    return copy


class LocalServer:
    """One server for all Blenders of one user, which share its store in `folder`."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.lock = threading.Lock()
        self.is_used = False
        # Held while this Blender uses the server: the system releases it also when Blender is killed.
        self.held = None

    @property
    def note(self):
        """The file that describes a running server: address, token, process id."""
        return self.folder / "server.json"

    def reach(self, program):
        """The target of a server that runs; starts one if there is none."""
        with self.lock:
            self.is_used = True
            self._hold()
            return self._running() or self._start(program)

    def _read_note(self):
        try:
            return json.loads(self.note.read_text())
        except (OSError, ValueError):
            return None

    def _running(self):
        note = self._read_note()
        if not note or not _listens(note["address"]):
            return None
        return Target(note["address"], note["token"])

    def _start(self, program):
        self.folder.mkdir(parents=True, exist_ok=True)
        token, listen = secrets.token_hex(32), "127.0.0.1:0"
        if hasattr(socket, "AF_UNIX") and os.name != "nt":
            # Only this user can reach it.
            listen = f"unix:{tempfile.mkdtemp(prefix='cairn-')}/socket"
        command = [program, "serve", "--listen", listen, "--data", self.folder / "data", "--drain-seconds", str(DRAIN)]
        log = self.folder / "server.log"
        environment = {**os.environ, "CAIRN_TOKEN": token}
        if self.held:
            # Not as a flag: an older program does not know it.
            environment["CAIRN_USERS"] = str(self.users)
        try:
            with log.open("wb") as errors:
                process = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=errors,
                    env=environment,
                    # Ctrl-C in Blender's terminal is not the server's.
                    start_new_session=True,
                    creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
                )
        except OSError as error:
            raise Fault(f"{program} does not start: {error}. Choose another in the add-on's preferences.") from error
        address = _first_line(process)
        if not address:
            process.kill()
            process.wait()
            # Another Blender may have been quicker.
            running = self._running()
            if running:
                return running
            lines = log.read_text(errors="replace").strip().splitlines()[-8:]
            raise Fault("The server does not start: " + ("\n".join(lines) or f"{program} prints nothing."))
        self._write({"address": address, "token": token, "pid": process.pid})
        return Target(address, token)

    def _write(self, note):
        # Readable by this user alone from the beginning, and whole at any time.
        part = self.note.with_suffix(".part")
        part.unlink(missing_ok=True)
        with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            json.dump(note, file)
        part.replace(self.note)

    def _hold(self):
        """Locks a file of this Blender's own."""
        if self.held:
            return
        try:
            self.users.mkdir(parents=True, exist_ok=True)
            self.held = (self.users / f"{os.getpid()}-{secrets.token_hex(4)}.lock").open("wb")
            _lock(self.held)
        except OSError:
            # A drive without locks: the server then stays until it is asked to end.
            self.held = None

    @property
    def users(self):
        return self.folder / "users"

    def _others(self):
        """Whether another Blender uses the server. Removes the files of those that are gone."""
        found = False
        for path in self.users.glob("*.lock"):
            if self.held and path.name == Path(self.held.name).name:
                continue
            try:
                with path.open("rb+") as file:
                    _lock(file)
                    is_old = time.time() - path.stat().st_mtime > OLD
                if is_old:
                    path.unlink(missing_ok=True)
            except FileNotFoundError:
                continue
            except OSError:
                found = True
        return found

    def stop(self):
        """Asks the server to end, which it does after its last bake; not if another Blender uses it."""
        note = self._read_note()
        if self.is_used and not self._others() and note and _listens(note["address"]):
            _signal(note["pid"])
        self.is_used = False
        if self.held:
            self.held.close()
            try:
                os.unlink(self.held.name)
            except OSError:
                pass
            self.held = None

    def stop_now(self):
        """Kills a server that is already ending. The next one resumes its bakes."""
        with self.lock:
            note = self._read_note()
            if not note:
                return
            _signal(note["pid"])
            until = time.monotonic() + END
            while _listens(note["address"]) and time.monotonic() < until:
                _signal(note["pid"])
                time.sleep(0.1)


def _lock(file):
    """Locks a file until it is closed, or raises `OSError` if another holds it."""
    if os.name == "nt":
        import msvcrt

        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _listens(address):
    try:
        if address.startswith("unix:"):
            with socket.socket(socket.AF_UNIX) as probe:
                probe.settimeout(1.0)
                probe.connect(address.removeprefix("unix:"))
        else:
            host, _, port = address.rpartition(":")
            socket.create_connection((host, int(port)), timeout=1.0).close()
    except OSError:
        return False
    return True


def _signal(pid):
    try:
        os.kill(pid, signal.SIGTERM)
    except OSError:
        pass


def _first_line(process):
    """The first line of the server's output; empty if it ends or prints nothing in time."""
    timer = threading.Timer(START, process.kill)
    timer.start()
    try:
        return process.stdout.readline().decode(errors="replace").strip()
    finally:
        timer.cancel()
        # Not a child to wait for: a server outlives its Blender until its bakes are done.
        threading.Thread(target=process.wait, daemon=True).start()
