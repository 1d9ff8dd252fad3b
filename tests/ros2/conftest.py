"""A calibration that says only in which base it is."""

from __future__ import annotations

import pytest

from tests.ros2.free_tool import save_calibration


@pytest.fixture(scope="session")
def saved(tmp_path_factory: pytest.TempPathFactory) -> str:
    return save_calibration(tmp_path_factory.mktemp("ros") / "tool.json")
