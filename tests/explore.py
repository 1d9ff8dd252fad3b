"""New seeds for the property tests, round after round, until one fails or the time is up: `make explore SECONDS=3600`.

A seed that fails is printed with the command that repeats it; it becomes an `@example` of its test once it is mended.
"""

from __future__ import annotations

import os
import secrets
import subprocess
import sys
import time

PYTEST = [sys.executable, "-m", "pytest", "-n", "auto", "-m", "hypothesis", "-x"]
NO_TESTS_LEFT = 5


def explore(seconds: float, tests: list[str]) -> int:
    """Rounds of property tests with a new seed each: exit status 0, or that of the first round that failed."""
    end = time.monotonic() + seconds
    rounds = 0
    while time.monotonic() < end:
        seed = secrets.randbelow(2**32)
        command = [*PYTEST, f"--hypothesis-seed={seed}", *tests]
        print(f"round {rounds + 1}, seed {seed}", flush=True)
        environment = {**os.environ, "HYPOTHESIS_PROFILE": "explore"}
        status = subprocess.run(command, env=environment, check=False, stdout=subprocess.PIPE, text=True)
        if status.returncode not in {0, NO_TESTS_LEFT}:
            print(status.stdout)
            print(f"to repeat: HYPOTHESIS_PROFILE=explore {' '.join(command)}")
            return status.returncode
        rounds += 1
    print(f"{rounds} rounds, nothing found")
    return 0


if __name__ == "__main__":
    sys.exit(explore(float(sys.argv[1]), sys.argv[2:]))
