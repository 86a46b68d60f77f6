"""Ctrl-C where an exception would be swallowed: in a destructor, while USD is imported."""

import os
import signal
import subprocess
import sys

import pytest

from tests.cli.test_cli import ROOT, heard, out, run, samples, stage  # noqa: F401   fixtures
from wsim.simulation import interrupt
from wsim.simulation.simulation import Simulation


class Pressed:
    """Ctrl-C in a destructor: Python ignores what is raised there."""

    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)


def test_a_ctrl_c_in_a_destructor_ends_a_run_behind_the_frame(stage, out, heard, monkeypatch, capsys):  # noqa: F811
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
def test_a_ctrl_c_that_became_something_else_is_still_one(came, heard, monkeypatch, capsys):  # noqa: F811
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
    interrupt.check()                                          # it is over


def test_a_ctrl_c_while_usd_is_imported_ends_the_command_with_one_line():
    """USD swallows it there, or tells of converters that it lacks."""
    code = ("import os, signal, sys\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
            "class Press:\n    def find_spec(self, name, path=None, target=None):\n"
            "        if name == 'pxr.Vt.__DOC':\n            os.kill(os.getpid(), signal.SIGINT)\n"
            "sys.meta_path.insert(0, Press())\nsys.argv = ['wsim', 'check', 'scenes/hanging_cloth.usda']\n"
            "from wsim.__main__ import main\nsys.exit(main())")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stderr) == (130, "interrupted\n")
