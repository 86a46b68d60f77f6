"""What tests/cli/test_cli.py shares with other tests: ROOT, run, samples, wsim."""

from pathlib import Path

import numpy as np

from wsim import cli

ROOT = str(Path(__file__).resolve().parents[3])


def wsim(*arguments) -> int:
    """Exit code of a command in this process."""
    try:
        return cli.main([str(a) for a in arguments])
    except SystemExit as exit:
        return exit.code


def run(stage, out, *more) -> int:
    return wsim("run", stage, "-o", out, "--device", "cpu", *more)


def samples(path, prim="/cloth"):
    """{time code: points} of a result."""
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    attribute = UsdGeom.Mesh(stage.GetPrimAtPath(prim)).GetPointsAttr()
    return {code: np.array(attribute.Get(code)) for code in attribute.GetTimeSamples()}
