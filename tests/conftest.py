"""Property tests draw the same examples at every run, so a red run can be repeated; `make explore` draws new ones."""

from __future__ import annotations

import os

from hypothesis import settings

settings.register_profile("same_every_time", derandomize=True, database=None, deadline=None)
settings.register_profile("explore", database=None, deadline=None, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same_every_time"))
