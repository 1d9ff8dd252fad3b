"""Where each number of a running Compensator stands in the flat sequences that its kernel works on."""

from __future__ import annotations

from collections.abc import MutableSequence
from typing import TypeAlias

Numbers: TypeAlias = MutableSequence[float]

# What is wrong with a sample; from `BACK` on its numbers are computed all the same.
FINE, NO_TIME, REPEATED, NO_READING, NO_ORIENTATION, NO_ROTATION, BACK, GAP = range(8)
OVERLOAD, STUCK, STILL, FROZEN, NO_PAST = range(8, 13)

# Why `advance` stopped.
REFRESH, RELEASED, BLOCK, RATE = 1, 2, 4, 8

# What starts anew with the next good sample.
WRENCH_ALONE, WHOLLY = 1.0, 2.0

# Columns of a row of `out`; the contact wrench comes first.
CONTACT, FAULT, DETAIL, CHANNEL, STATISTIC, OUT = 6, 7, 8, 9, 10, 11

# `tool`: what never changes.
GRAIN, RANGES, NOISE, WARMTH, DOWN, DELAY, LOOK_BACK, MINIMUM = 0, 18, 24, 30, 36, 39, 40, 41

# `live`: what compensator.py renews.
BIAS, WHITENING, FIRE, QUIET_BELOW, LONGEST_GAP, LIVE_SIZE = 0, 6, 27, 28, 29, 30

# `filters`: the low-pass and the sensor's own filter, each a number of sections and five coefficients of each.
LOWPASS, SENSOR, FILTERS_SIZE = 0, 11, 22

# `memory`
ASK, TIME, STARTED, FRESH, READY, STALE, SINCE, STAMPS = range(8)
TOUCHING, RUN, RUN_TIME, QUIET, QUIET_TIME, FREE_TIME, KNOWN_FREE, ONSET, ONSET_SEEN, RELEASE = range(8, 18)
BLOCK_TIME, BLOCK_ROWS, SPOILED, HEAT, FIRST_HEAT = range(18, 23)
NEW_TIME, NEW_USUAL, TURN_TIME, TURN_USUAL, SPEED, STEADY, JITTER, LONGEST_REST = range(23, 31)
RING_NEXT, RING_FILLED, RING_AT, PEAK_STATISTIC, SUM_ROWS = range(31, 36)
INTERVALS = 36
N_INTERVALS = 24
R_NEXT, R_NOW, R_STEP, R_REFRESHED = 60, 69, 78, 87
DOWN_IN_FLANGE, WRENCH, BLOCK_SUM, SUM, PEAK = 96, 99, 105, 111, 117
LAST, REPEATS, QUANTUM, LOG_SAME = 123, 129, 135, 141
LOWPASS_STATE, SENSOR_STATE, NEXT_TIME, STEP_SQUARED, POSES_FROM, MEMORY_SIZE = 147, 171, 183, 184, 185, 186
