"""The right to write one file, held by one process at a time, and freed by the system when that process ends in any way.

A lock file beside the output is locked with flock(2) (Windows: LockFile), which does not outlive its process; what the file
says (process, host, since when) is for whoever comes second. Where a file system knows no locks, that text is all there is: it
counts while a process of that number lives, and on another host for ever.
"""

import errno
import json
import os
import socket
import stat
import time
from contextlib import suppress

try:
    import fcntl
except ImportError:                        # Windows
    fcntl = None                           # type: ignore[assignment]

SAYS = "wsim lock"                         # a file without it is somebody else's
FAR = 1 << 40                              # byte that Windows locks: others may still read the text
TRIES = 100                                # each fails only if the file before it was removed just then


class OutputLock:
    """Taken when made. `release` frees it; so does the end of the process.

    path    of the lock file           output    of what is written, for messages
    Raises BlockingIOError, with who has it, if it is held; FileExistsError if a file of another kind has that name; OSError
    where it cannot be made.
    """

    def __init__(self, path: str, output: str):
        self.path, self.output = path, output
        try:
            self.file: int | None = self._open_locked_file()
        except (BlockingIOError, FileExistsError):
            raise
        except OSError as error:
            raise type(error)(f"{output} cannot be written ({error.strerror or error}); write elsewhere with -o") from None
        self.pid = os.getpid()
        said = {"what": SAYS, "pid": self.pid, "host": socket.gethostname(), "since": time.strftime("%Y-%m-%d %H:%M:%S"),
                "output": os.path.basename(output)}
        os.ftruncate(self.file, 0)
        os.lseek(self.file, 0, os.SEEK_SET)
        os.write(self.file, json.dumps(said).encode())

    def _open_locked_file(self) -> int:
        """The file, locked, and still the one at the path."""
        for _ in range(TRIES):
            try:
                file = os.open(self.path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
                               | getattr(os, "O_CLOEXEC", 0), 0o666)
            except OSError as error:
                if error.errno in (errno.ELOOP, errno.EISDIR):
                    raise self._foreign_lock_error() from None
                raise
            try:
                self._take(file)
                if _is_file_at_path(file, self.path):
                    return file
            except BaseException:
                os.close(file)
                raise
            os.close(file)
        raise OSError(f"{self.path} could not be locked")

    def _take(self, file: int) -> None:
        """Locks an open file. Raises as the class says."""
        text = os.read(file, 4096)
        said = _parse_lock_file(text)
        if not stat.S_ISREG(os.fstat(file).st_mode) or (text and said is None):
            raise self._foreign_lock_error()
        try:
            _system_lock(file)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EACCES, errno.EDEADLK):
                raise self._held(said) from None
            if said and _is_process_alive(said):          # a file system without locks
                raise self._held(said, f"; if there is no such run any more, remove {self.path}") from None

    def _held(self, said: dict | None, more: str = "") -> BlockingIOError:
        who = (f"process {said['pid']} on {said['host']}, since {said['since']}" if said else "it has just begun")
        mine = " (this process: close its Recorder)" if said and said["pid"] == os.getpid() else ""
        return BlockingIOError(f"{self.output} is being written by another run: {who}{mine}. Wait until it ends, or choose "
                               f"another output{more}")

    def _foreign_lock_error(self) -> FileExistsError:
        return FileExistsError(f"{self.path} is in the way: a lock is kept under that name while {self.output} is written, and "
                               "wsim did not make this file. Move it away, or choose another output")

    def release(self) -> None:
        if self.file is None:
            return
        mine = self.pid == os.getpid() and _is_file_at_path(self.file, self.path)  # not in a child that was forked
        if not fcntl:                                                      # Windows removes no open file
            os.close(self.file)
        with suppress(OSError):
            if mine:
                os.remove(self.path)
        if fcntl:
            os.close(self.file)
        self.file = None

    def __del__(self):
        if getattr(self, "file", None) is not None:
            self.release()


def _system_lock(file: int) -> None:
    if fcntl:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return
    import msvcrt

    os.lseek(file, FAR, os.SEEK_SET)
    msvcrt.locking(file, msvcrt.LK_NBLCK, 1)              # type: ignore[attr-defined]
    os.lseek(file, 0, os.SEEK_SET)


def _parse_lock_file(text: bytes) -> dict | None:
    """What a lock file says; None if it is none."""
    try:
        said = json.loads(text)
        return said if said["what"] == SAYS and {"pid", "host", "since"} <= said.keys() else None
    except (ValueError, KeyError, TypeError):
        return None


def _is_process_alive(said: dict) -> bool:
    """Whether the process that a lock names may still run."""
    if said["host"] != socket.gethostname() or os.name == "nt":
        return True
    try:
        os.kill(int(said["pid"]), 0)
    except ProcessLookupError:
        return False
    except (OSError, ValueError, OverflowError):
        return True
    return True


def _is_file_at_path(file: int, path: str) -> bool:
    """Whether an open file is the one at a path."""
    try:
        return os.path.samestat(os.fstat(file), os.stat(path, follow_symlinks=False))
    except OSError:
        return False
