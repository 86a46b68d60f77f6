"""Ctrl-C where an exception would be swallowed: in a destructor, while USD is imported."""

import os
import signal
import subprocess
import sys
import time

import pytest

from tests.make.cli.cli import ROOT, run, samples
from wsim.simulation import interrupt
from wsim.simulation.simulation import Simulation


class Pressed:
    """Ctrl-C in a destructor: Python ignores what is raised there."""

    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)


def test_a_ctrl_c_in_a_destructor_ends_a_run_behind_the_frame(stage, out, heard, monkeypatch, capsys):
    step = Simulation.step

    def third(self):
        if self.frame == 2:
            Pressed()
        step(self)
    monkeypatch.setattr(Simulation, "step", third)
    assert run(stage, out, "--frames", "50", "--quiet") == 130
    kept = str(out).replace(".usdc", ".partial.usdc")
    assert capsys.readouterr().err.splitlines()[-1].startswith(f"interrupted: {kept} holds the 2 frames so far")
    assert list(samples(kept)) == [0, 1, 2] and signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("came", ["swallowed", "turned"])
def test_a_ctrl_c_that_became_something_else_is_still_one(came, heard, monkeypatch, capsys):
    from wsim import cli
    from wsim.cli import commands

    def check(args):
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt:
            if came == "turned":
                raise ImportError("initialization failed") from None
        return 0
    monkeypatch.setattr(commands, "check", check)
    assert cli.main(["check", "x.usda"]) == 130
    assert capsys.readouterr().err == "interrupted\n"
    interrupt.raise_if_interrupted()                           # it is over


def test_a_ctrl_c_while_usd_is_imported_ends_the_command_with_one_line():
    """USD swallows it there, or tells of converters that it lacks."""
    code = ("import os, signal, sys\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
            "class Press:\n    def find_spec(self, name, path=None, target=None):\n"
            "        if name == 'pxr.Vt.__DOC':\n            os.kill(os.getpid(), signal.SIGINT)\n"
            "sys.meta_path.insert(0, Press())\nsys.argv = ['wsim', 'check', 'scenes/hanging_cloth.usda']\n"
            "from wsim.__main__ import main\nsys.exit(main())")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stderr) == (130, "interrupted\n")


LASTS = """
import hashlib, sys
from wsim.simulation import interrupt
interrupt.start_watching_interrupts("leave")
interrupt.set_interrupt_mode("wait", "out.partial.usdc holds the frames saved so far")
print("ready", flush=True)
hashlib.pbkdf2_hmac("sha256", b"a", b"b", {rounds})          # a call of C that lasts, as a graph of many substeps does
try:
    interrupt.raise_if_interrupted()
except KeyboardInterrupt:
    print("behind the frame", flush=True)
    sys.exit(130)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="a signal wakes no pipe there")
@pytest.mark.parametrize("presses", [1, 2])
def test_ctrl_c_within_a_call_of_c(presses, heard):
    """The first waits until the call returns; the second ends the process though it would last an hour."""
    rounds = 2_000_000 if presses == 1 else 2_000_000_000
    child = subprocess.Popen([sys.executable, "-c", LASTS.format(rounds=rounds)], stdout=subprocess.PIPE,
                             stderr=subprocess.PIPE, text=True, cwd=ROOT)
    assert child.stdout.readline() == "ready\n"
    told = []
    for _ in range(presses):
        child.send_signal(signal.SIGINT)
        while not told and (line := child.stderr.readline()):
            told += [line] if line.strip() else []
    rest, err = child.communicate(timeout=120)
    assert child.returncode == 130 and told == ["wsim: the run ends when this frame does; Ctrl-C again ends it at once\n"]
    assert (rest, err.strip()) == (("behind the frame\n", "") if presses == 1 else
                                   ("", "interrupted: out.partial.usdc holds the frames saved so far"))


@pytest.mark.skipif(os.name == "nt", reason="Windows wakes sockets alone")
def test_presses_that_are_heard_when_a_run_is_over_end_nothing():
    """They wait in a pipe: two of them started a timer that ended the process."""
    for _ in range(20):
        listener = interrupt._SignalListener()
        listener.begin()
        os.write(listener.ends[1], bytes([signal.SIGINT, signal.SIGINT]))
        listener.end()
        time.sleep(0.01)
        assert not listener.ending.is_alive()
