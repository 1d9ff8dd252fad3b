"""ROS on this machine alone, in a domain of this process."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

os.environ.update(ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST", ROS_DOMAIN_ID=str(os.getpid() % 100 + 1))
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture(scope="session")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> str:
    from tests_ros.rig import save_calibration

    path = str(tmp_path_factory.mktemp("ros") / "tool.json")
    save_calibration(path)
    return path


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Callable[..., Any]]:
    from tests_ros.rig import Rig

    made = []

    def make(**parameters: Any) -> Rig:
        made.append(Rig(**parameters))
        return made[-1]

    yield make
    for each in made:
        each.close()
