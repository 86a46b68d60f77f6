"""What the tests of sweeps share: the file of a hanging cloth."""

import pytest

from tests.make.sweep.sweep import hung


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> str:
    return hung(tmp_path_factory.mktemp("scene") / "hung.usda")
