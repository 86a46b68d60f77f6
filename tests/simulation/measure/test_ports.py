"""Ports: a method's offer is found by its name, of lists all entries; a name that there is not is an error at once."""

import subprocess
import sys

import pytest

from tools.lint import ROOT
from wsim.model.ports import Ports
from wsim.model.stage import Method, Methods

WRITTEN = "from wsim.model.stage import Methods\nMethods().ports.{name}.lam\n"


def test_the_first_offer_counts_and_lists_are_joined():
    first = Method("a", offers=Ports(bones=1, xpbd_batches=[2]))
    second = Method("b", offers=Ports(bones=3, strands=4, xpbd_batches=[5]))
    ports = Methods([first, second]).ports
    assert (ports.bones, ports.strands, ports.xpbd_batches, ports.contacts, ports.tet_tables) == (1, 4, [2, 5], None, [])


def test_a_misspelt_port_is_an_error():
    for methods in ([Method("a")], []):
        with pytest.raises(AttributeError, match="contcts"):
            _ = Methods(methods).ports.contcts


@pytest.mark.slow
@pytest.mark.parametrize("name, wrong", [("contacts", '"Contacts" has no attribute "lam"'), ("contcts", 'attribute "contcts"')])
def test_the_type_checker_finds_a_misspelling(name, wrong, tmp_path):
    file = tmp_path / "misspelt.py"
    file.write_text(WRITTEN.format(name=name), encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml"), str(file)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert wrong in done.stdout, done.stdout
