"""A run of all tests takes two processes: most of it is compiling kernels, one core at a time.

The second is pytest with the same arguments, which goes through the files from the last to the first. Whoever makes a file's
mark, in a folder of both, has its tests: each runs once, and both end together. The second writes its reports there, a line
each, and the first tells them as its own. Kernels land in one cache. `pytest --processes 1` does without.
"""

import os
import pickle
import subprocess
import sys
import tempfile
import time
from itertools import groupby
from pathlib import Path

import pytest

FEW = 6               # files: below, one process is enough


def pytest_addoption(parser):
    parser.addoption("--processes", type=int, choices=(1, 2), default=2 if (os.cpu_count() or 1) > 1 else 1,
                     help=f"that share the tests of {FEW} files and more (default: 2, on one core 1)")
    parser.addoption("--marks", type=Path, help="the folder of the process that started this one")


def pytest_configure(config):
    if config.option.marks:
        config.pluginmanager.register(Second(config, config.option.marks))


@pytest.hookimpl(wrapper=True)
def pytest_runtestloop(session):
    option = session.config.option
    alone = option.processes < 2 or option.marks or option.collectonly or option.basetemp or option.capture == "no"
    if alone or option.usepdb or session.testsfailed or len({item.path for item in session.items}) < FEW:
        return (yield)
    with tempfile.TemporaryDirectory(prefix="wsim-tests-") as folder, First(session.config, Path(folder)) as first:
        session.config.pluginmanager.register(first)
        done = yield
        session.shouldfail = first.wait() or session.shouldfail
        if session.shouldfail:
            raise session.Failed(session.shouldfail)
        return done


class Share:
    """Passes over the tests of files whose mark another process has made."""

    def __init__(self, config, folder: Path):
        self.config, self.folder, self.own = config, folder, {}

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item):
        if item.path not in self.own:
            try:
                (self.folder / item.path.name).touch(exist_ok=False)
                self.own[item.path] = True
            except FileExistsError:
                self.own[item.path] = False
        return None if self.own[item.path] else True         # True: dealt with


class Second(Share):
    def pytest_collection_modifyitems(self, items):
        files = [list(group) for _, group in groupby(items, lambda item: item.path)]
        items[:] = [item for file in reversed(files) for item in file]

    def pytest_runtest_logreport(self, report):
        values = self.config.hook.pytest_report_to_serializable(config=self.config, report=report)
        with open(self.folder / "reports", "a") as file:
            file.write(pickle.dumps(values).hex() + "\n")


class First(Share):
    def __enter__(self):
        given = self.config.invocation_params
        command = [sys.executable, "-m", "pytest", *map(str, given.args), f"--marks={self.folder}"]
        self.said, self.reports = open(self.folder / "said", "w+"), open(self.folder / "reports", "a+")
        self.rest = ""                                        # of a line that was not whole when it was read
        self.second = subprocess.Popen(command, cwd=given.dir, stdout=self.said, stderr=subprocess.STDOUT)
        return self

    def __exit__(self, *_):
        self.second.terminate()
        self.second.wait()
        self.said.close()
        self.reports.close()

    @pytest.hookimpl(trylast=True)
    def pytest_runtest_logfinish(self):
        *lines, self.rest = (self.rest + self.reports.read()).split("\n")
        for line in lines:
            values, hook = pickle.loads(bytes.fromhex(line)), self.config.hook
            hook.pytest_runtest_logreport(report=hook.pytest_report_from_serializable(config=self.config, data=values))

    def wait(self) -> str:
        """Until the second is done. What is wrong if it did not end as pytest ends, else nothing."""
        while self.second.poll() is None:
            time.sleep(0.1)
            self.pytest_runtest_logfinish()
        self.pytest_runtest_logfinish()
        if self.second.returncode in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
            return ""
        self.said.seek(0)
        return f"the second process ended with {self.second.returncode}: {self.said.read()[-8000:]}"
