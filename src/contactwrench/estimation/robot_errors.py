"""Errors of the robot's orientation: each turns the weight, across gravity and never along it.

A pose whose flange is off by a small rotation phi (rad, flange axes) reads B [r]_x phi more, r gravity in the flange
and B the tool's wrench matrix: two directions of six, in which the torque goes with the force. Robots err beside
whatever else there is: so each likely drift is looked at with such turns, too (method, "One inference").
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..calibration.findings import Kind
from ..geometry.arrays import Array
from ..geometry.wrench import cross_matrix
from ..model import RigidTool, gravity_in_flange, wrench_matrix
from .bias_drift import MOST_STOPS, Kernels
from .error_covariance import AlikeOnAxes, Turned, Turns, of_larger
from .least_squares import Members
from .noise import LEAST_DOF
from .variance_components import SHOWING, USUAL, Linear, Optimum, along_axes, at_optimum, look_at, shows

ODDS = 1.0
"""Before the readings, that robots err so that it may show."""

CORRELATION = 0.85
"""Of the error from one pose to the next, where they have one in common."""

FURTHEST = 5.0 * USUAL
"""rad, standard deviation: what leaves more is no robot's error."""

AT_FIRST = 2.5
"""Of the noise's variance, by turns about one axis, and as much about the other: five sixths of what is left, to begin
with: from below, turns of a few poses would not be reached."""

MOST_BESIDE, CLOSE_BESIDE = 3, 4.0
"""Drifts that are looked at with turns beside them, and the natural logarithm of the odds of one, against the likeliest
or none, from which on."""

Begun: TypeAlias = Callable[[], Turned | None]


def turns_of_robot(n: int) -> tuple[Array | None, ...]:
    """How errors of the robot's orientation may be alike at n poses: not at all, None, or from one to the next, (n, n),
    where these are stops.
    """
    if n > MOST_STOPS:
        return (None,)
    return (None, CORRELATION ** np.abs(np.subtract.outer(np.arange(n), np.arange(n))))


def turns_across_gravity(tool: RigidTool, R_base_flange: Array, alike: Array | None, kept: NDArray[np.bool_]) -> Turns:
    """Of poses (n,) whose turns about the flange's axes are `alike` (n, n) from pose to pose, None: not at all."""
    r = gravity_in_flange(R_base_flange, tool.gravity_direction)
    across = cross_matrix(r)
    one = across[range(len(r)), :, np.argmin(np.abs(r), axis=1), None]
    one = one / np.linalg.norm(one, axis=1, keepdims=True)
    about = np.concatenate([one, across @ one], axis=2)
    if alike is not None:
        flat = about.transpose(1, 0, 2).reshape(3, -1)
        alike = np.repeat(np.repeat(alike, 2, axis=0), 2, axis=1) * (flat.T @ flat)
    return Turns(wrench_matrix(tool)[:, :3] @ across @ about, alike, kept)


def variance_of_turns(tool: RigidTool, R_base_flange: Array) -> Array:
    """Of readings (6,) at these orientations, turned by 1 rad about each axis, on average."""
    turned = wrench_matrix(tool)[:, :3] @ cross_matrix(gravity_in_flange(R_base_flange, tool.gravity_direction))
    return np.asarray(np.mean(np.sum(turned**2, axis=2), axis=0))


def likely_with(
    linear: Linear,
    base: AlikeOnAxes,
    turns: Turns,
    kernels: Kernels,
    others: Members,
    among: NDArray[np.intp],
    before: Members | None,
) -> list[tuple[int, Optimum]]:
    """The kernels that are likely with `turns` beside them, each with its optimum; none where no turns show.

    Args:
        linear: the poses.
        base: the noise of the likeliest of `others`, and nothing else.
        turns: of the poses.
        kernels: of the table.
        others: its members without turns.
        among: the kernels to look at, a steady bias among them where there is one.
        before: members with such turns of a table nearby: from there it is not far.
    """
    nearby = {} if before is None else _optima(before, base, turns, kernels)

    def reached(drift: int, begun: Begun) -> Optimum | None:
        """From where it was nearby, or, where no turns are left from there, from where it is `begun`."""
        for start in (partial(nearby.get, drift), begun):
            if (V := start()) and shows((optimum := at_optimum(linear, V, kernels.drifts[drift])).V):
                return optimum
        return None

    found: dict[int, tuple[int, Optimum]] = {}
    beside: dict[int, Begun] = {}
    steady = kernels.drift[among] == 0
    if alone := reached(0, partial(_begun, linear, base, turns)):
        found = {int(kernels.drift[k]): (int(k), alone) for k in among[steady]}
        for k in _likely_beside(linear, alone, kernels, among[~steady]):
            beside[k] = partial(replace, alone.V, base=_with_drift(alone.V.base, kernels, k))
    without: dict[int, Begun] = {
        k: partial(_begun, linear, _with_drift(replace(base, variance=variance), kernels, k), turns)
        for k, variance in _likely_alone(kernels, others).items()
    }
    for starts in (beside, without):
        optima: dict[tuple[Kind | None, bytes], Optimum | None] = {}
        for k, begun in starts.items():
            drift = int(kernels.drift[k])
            own = kernels.drifts[drift]
            same = own.kind, own.columns[base.kept].tobytes()  # as of steps either side of a pose that is left out
            if drift not in found and same not in optima:
                optima[same] = reached(drift, begun)
            if optimum := optima.get(same):
                found[drift] = (k, optimum)
    return list(found.values())


def _optima(members: Members, base: AlikeOnAxes, turns: Turns, kernels: Kernels) -> dict[int, Turned]:
    """Of each drift where its members are, whatever their hypothesis; with `turns` of other poses, or another tool."""
    found = {}
    for k, variance, strength, sd in zip(members.kernel, members.variance, members.strength, members.turn, strict=True):
        drift = int(kernels.drift[k])
        own = replace(base, variance=variance, columns=kernels.drifts[drift].columns, strength=float(strength))
        found[drift] = Turned(own, turns, float(sd))
    return found


def _with_drift(base: AlikeOnAxes, kernels: Kernels, k: int) -> AlikeOnAxes:
    return replace(base, columns=kernels.drifts[kernels.drift[k]].columns, strength=float(kernels.strength[k]))


def _begun(linear: Linear, base: AlikeOnAxes, turns: Turns) -> Turned | None:
    """Where to begin: most of what is left is turns; None where half of what counts is too much, or no robot is so far
    off.
    """
    found = look_at(linear, _with_share(linear, base, turns, 0.5 * SHOWING))
    # a rival's noise is no measure of what is left without it
    left = max(float(found.chi2[:7].sum() / max(found.dof[:7].sum(), LEAST_DOF)), 1e-12)
    if 0.5 * (found.dof[7] - found.chi2[7] / left) + found.prior_slope[7] >= 0.0:
        return None
    V = _with_share(linear, replace(base, variance=base.variance * max(left, 1.0)), turns, AT_FIRST)
    return None if V.sd > FURTHEST else V


def _with_share(linear: Linear, base: AlikeOnAxes, turns: Turns, share: float) -> Turned:
    """Turns that have the `share` (`Turned.shares`) of the noise of forces or torques, where it is the larger, the
    variances of the base being about that of noise and turns; a drift is as large as it was.
    """
    load = turns.mean_square + 1e-300
    of_axis = share * load / base.variance / of_larger(load / base.variance)
    noise = base.variance / (1.0 + 2.0 * of_axis)
    V = Turned(base, turns, float(np.sqrt(share / of_larger(load / noise))))
    noise = np.maximum(noise, np.maximum(linear.noise.least, V.beyond_first_order))
    as_large = float(np.sqrt(np.mean(base.variance[:3]) / np.mean(noise[:3])))
    return replace(V, base=replace(base, variance=noise, strength=base.strength * as_large))


def _likely_alone(kernels: Kernels, others: Members) -> dict[int, Array]:
    """Where a steady bias is not the likeliest, of each cause that may well be there its likeliest kernel, with the
    variances (6,) of the noise.
    """
    order = np.argsort(-others.log_evidence)
    near = order[others.log_evidence[order] > others.log_evidence[order[0]] - CLOSE_BESIDE]
    causes = kernels.causes[others.kernel[near]]
    if causes[0] == 0:
        return {}
    first = [int(near[np.argmax(causes == cause)]) for cause in dict.fromkeys(causes[causes > 0].tolist())]
    return {int(others.kernel[k]): others.variance[k] for k in first[:MOST_BESIDE]}


def _likely_beside(linear: Linear, alone: Optimum, kernels: Kernels, among: NDArray[np.intp]) -> list[int]:
    """Of each cause that may well be there beside the turns, its likeliest kernel; all variances being those of turns
    `alone`.
    """
    base = alone.V.base
    odds = kernels.log_plausible(among, kernels.strength[among], base.of_forces, linear.weight)
    odds = odds + kernels.log_prior[among]
    score, looked_at = odds, kernels.select(among)
    for here, of_kernel, columns in looked_at.by_columns(base.kept):
        L = columns.transpose(0, 2, 1)  # (d, q, m)
        weighted = along_axes(alone, L.reshape(-1, L.shape[2]).T).reshape(6, -1, *L.shape[:2]).transpose(2, 0, 1, 3)
        value, vectors = np.linalg.eigh(L[:, None] @ weighted * base.variance[:, None, None])
        pulls = (L @ alone.left).transpose(0, 2, 1)
        pulled = (pulls[:, :, None] @ vectors)[:, :, 0] ** 2
        squared = looked_at.strength[here, None, None] ** 2
        grown = squared * np.maximum(value, 0.0)[of_kernel]
        score[here] += 0.5 * np.sum(squared * pulled[of_kernel] / (1.0 + grown) - np.log1p(grown), axis=(1, 2))
    order = np.argsort(-score)
    first = np.sort(np.unique(kernels.causes[among[order]], return_index=True)[1])[:MOST_BESIDE]
    return [int(among[k]) for k in order[first] if score[k] > max(float(score.max()), 0.0) - CLOSE_BESIDE]
