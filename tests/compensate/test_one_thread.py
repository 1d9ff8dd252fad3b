"""A Compensator serves one thread: others are refused, and none is given what another's readings made."""

from __future__ import annotations

import copy
import pickle
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import count
from threading import Barrier, Thread
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.errors import InputError
from tests.support.rigs import NOISE, example, noisy

TAKEN = "found a call from a second thread, expected one: give each a Compensator of its own, or begin anew, reset()"
STEPS = [False, pytest.param(True, marks=pytest.mark.skipif(find_spec("numba") is None, reason="no numba"))]
CALIBRATION = cw.calibrate(noisy(*example(4)), "mount")
AT_REST = np.eye(3)


def compensator(fast: bool = False) -> cw.Compensator:
    return cw.Compensator(CALIBRATION, rate=1000.0, noise=NOISE, fast=fast)


@contextmanager
def switching_often() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def together(*jobs: Callable[[], None]) -> None:
    """Run jobs in threads that begin at the same time."""
    barrier = Barrier(len(jobs))

    def begin(job: Callable[[], None]) -> None:
        barrier.wait()
        job()

    threads = [Thread(target=begin, args=(job,)) for job in jobs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


@pytest.mark.parametrize("fast", STEPS)
def test_two_threads_are_given_their_own_readings_or_refused(fast: bool) -> None:
    shared = compensator(fast)
    wrong: list[object] = []
    free, stamps = CALIBRATION.predict(AT_REST), count()

    def hammer(force: float) -> None:
        reading = free + np.array([0.0, 0.0, force, 0.0, 0.0, 0.0])
        for _ in range(1500):
            try:
                found = shared(reading, AT_REST, 0.001 * next(stamps))
            except InputError as error:
                if str(error) != TAKEN:
                    wrong.append(error)
                continue
            if abs(found.wrench[2] - force) > 1e-6:
                wrong.append((force, found))

    with switching_often():
        together(lambda: hammer(5.0), lambda: hammer(-5.0))
    assert wrong == []
    with pytest.raises(InputError):
        shared(free, AT_REST, 100.0)
    shared.reset()
    assert shared(free, AT_REST, 100.0).wrench == pytest.approx(np.zeros(6), abs=1e-9)


def in_another(job: Callable[[], Any]) -> Any:
    """What a job gives, or raises, in a thread of its own."""
    results: list[Any] = []

    def run() -> None:
        try:
            results.append(job())
        except InputError as error:
            results.append(str(error))

    together(run)
    return results[0]


@pytest.mark.parametrize("fast", STEPS)
def test_every_call_from_another_thread_is_refused_and_changes_nothing(fast: bool) -> None:
    """Also where no two calls overlap: a filter would mix them."""
    shared, alone = (cw.Compensator(CALIBRATION, rate=1000.0, noise=NOISE, lowpass=5.0, fast=fast) for _ in range(2))
    readings, R, t = 50.0 * np.ones((20, 6)), np.tile(AT_REST, (20, 1, 1)), 0.001 * np.arange(20)
    calls: list[Callable[[], Any]] = [
        lambda: shared(readings[0], AT_REST, 0.5),
        lambda: shared.run(readings, R, 1.0 + t),
        lambda: shared.zero(cw.Samples(readings, R)),
    ]
    for k in range(5):
        if k:
            assert {in_another(call) for call in calls} == {TAKEN}
        now = [each(readings[k] / 50.0, AT_REST, 0.001 * k) for each in (shared, alone)]
        assert np.array_equal(now[0].wrench, now[1].wrench)
        assert np.array_equal(now[0].std, now[1].std)


@pytest.mark.parametrize(
    "way", [lambda c: c.reset(), copy.copy, copy.deepcopy, lambda c: pickle.loads(pickle.dumps(c))]
)
@pytest.mark.parametrize("fast", STEPS)
def test_a_new_beginning_and_a_copy_are_for_any_thread(fast: bool, way: Callable[[Any], Any]) -> None:
    shared, alone = compensator(fast), compensator(fast)
    shared(np.ones(6), AT_REST, 0.0)
    free = way(shared) or shared
    found = in_another(lambda: free(np.ones(6), AT_REST, 0.001))
    assert np.array_equal(found.wrench, alone(np.ones(6), AT_REST, 0.001).wrench)


def test_a_refused_call_leaves_it_free() -> None:
    shared = compensator()
    with pytest.raises(InputError, match="wrench and orientation have shapes"):
        shared(np.ones(5), AT_REST, 0.0)
    with pytest.raises(InputError, match="orientation, t and temperature have shapes"):
        shared.run(np.ones((5, 6)), np.ones((4, 4)), np.arange(5.0))
    with pytest.raises(InputError, match="no new zero: found 1 samples"):
        shared.zero(cw.Samples(np.ones((1, 6)), AT_REST[None]))
    assert shared(np.ones(6), AT_REST, 0.0).valid


@pytest.mark.parametrize("way", [copy.copy, copy.deepcopy, lambda c: pickle.loads(pickle.dumps(c))])
@pytest.mark.parametrize("fast", STEPS)
def test_a_copy_goes_on_from_the_same_state_on_its_own(fast: bool, way: Callable[[Any], Any]) -> None:
    rng = np.random.default_rng(1)
    readings = CALIBRATION.predict(AT_REST) + NOISE * rng.normal(size=(300, 6))
    first = compensator(fast)
    first.run(readings[:200], np.tile(AT_REST, (200, 1, 1)), 0.001 * np.arange(200))
    second = way(first)
    for k in range(200, 300):
        a, b = (each(readings[k], AT_REST, 0.001 * k) for each in (first, second))
        assert np.array_equal(a.wrench, b.wrench)
        assert np.array_equal(a.std, b.std)
        assert (a.valid, a.contact, a.t) == (b.valid, b.contact, b.t)
    first(readings[0] + 50.0, AT_REST, 1.0)
    assert second(readings[0], AT_REST, 1.0).wrench == pytest.approx(readings[0] - CALIBRATION.predict(AT_REST))


def test_an_interrupted_call_leaves_it_free(monkeypatch: pytest.MonkeyPatch) -> None:
    shared = compensator()
    with monkeypatch.context() as patch:
        patch.setattr("contactwrench.compensate.compensator.ContactWrench", Mock(side_effect=KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            shared(np.ones(6), AT_REST, 0.0)
    assert shared(np.ones(6), AT_REST, 0.001).valid
