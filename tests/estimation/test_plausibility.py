"""What free air cannot tell: a tool that no robot has, and a base that leans as nobody said, is said, an honest one
never, and dead channels are named.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.findings import Finding, Kind, Severity
from contactwrench.errors import InputError
from contactwrench.estimation.plausibility import BEHIND, TOO_FAR, TOO_HEAVY, TOO_LIGHT, TOO_NEAR, oddity
from tests.support.world import DOWN, Array, Rig, noisy_readings, random_rotations

G, LBF, INCH = 9.80665, 4.4482216152605, 0.0254
R = random_rotations(14, np.random.default_rng(3))
BIAS = np.array([1.0, -2.0, 3.0, 0.1, -0.2, 0.3])


def wrench_of(mass: float = 1.0, z: float = 0.06, R_flange_sensor: Array | None = None) -> Array:
    mounting = np.eye(3) if R_flange_sensor is None else R_flange_sensor
    rig = Rig(mass * G, mounting.T @ np.array([0.004, -0.003, z]), BIAS, mounting, DOWN)
    noise = 0.002 * mass * G * np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
    return noisy_readings(rig, R, noise, np.random.default_rng(0))


def found(wrench: Array, model: str = "auto", **stated: object) -> list[Finding]:
    return of_tool(cw.calibrate(cw.Samples(wrench, R), model, **stated))  # type: ignore[arg-type]


def of_tool(calibration: cw.Calibration) -> list[Finding]:
    return [finding for finding in calibration.findings if finding.kind in {Kind.IMPLAUSIBLE_TOOL, Kind.DEAD_CHANNEL}]


def scaled(force: float, torque: float) -> Array:
    return np.repeat([force, torque], 3)


MASS, PLACE = (
    f"? Weigh the tool; contactwrench diagnose lists other units and signs; if it is so: --known {what}+-STD"
    for what in ("mass=KG", "com_mm=X,Y,Z")
)
MISTAKES = {
    "kgf, N m": (
        scaled(1 / G, 1.0),
        "doubtful: the centre of mass comes out 0.59 m from the sensor: are the torques in N mm? So far no "
        f"tool of 0.1 kg reaches: or are the forces in kgf or lbf{PLACE}",
    ),
    "lbf, lbf in": (
        scaled(1 / LBF, 1 / LBF / INCH),
        "weak: the centre of mass comes out 2.4 m from the sensor: are the torques in N mm? So far no tool "
        f"of 0.22 kg reaches: or are the forces in kgf or lbf{PLACE}",
    ),
    "mN, mN m": (
        scaled(1e3, 1e3) * 3.0,
        "doubtful: the mass comes out as 3e+03 kg, more than any robot carries: are the forces in mN or gf" + MASS,
    ),
    "kN, kN m": (
        scaled(1e-3, 1e-3),
        "doubtful: the mass comes out as 0.001 kg, less than any tool's: are the forces in kN" + MASS,
    ),
    "mN, N m": (
        scaled(1e3, 1.0),
        "doubtful: the centre of mass comes out 6e-05 m from the sensor's origin, where no tool of 1e+03 kg has it: "
        f"are the forces in mN, or the torques in another unit{PLACE}",
    ),
    "torques negated": (
        scaled(1.0, -1.0),
        "doubtful: the centre of mass comes out 60 mm behind the sensor, on the robot's side: are tx, ty and tz "
        f"reversed or about the tool's tip, or does the flange's z point to the robot{PLACE}",
    ),
}


@pytest.mark.parametrize("model", ["auto", "affine"])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_that_fits_perfectly_is_said(mistake: str, model: str) -> None:
    """Of every model: `affine` has no tool, but its torques are those of one."""
    factors, text = MISTAKES[mistake]
    calibration = cw.calibrate(cw.Samples(wrench_of() * factors, R), model)
    (finding,) = of_tool(calibration)
    assert finding.text == text
    assert len(finding.text) < 300
    assert calibration.verdict == finding.severity


FLIPPED = np.diag([1.0, -1.0, -1.0])


@pytest.mark.parametrize("mounting", [np.eye(3), FLIPPED], ids=["along", "against"])
@pytest.mark.parametrize("mass", [0.1, 1.0, 500.0])
def test_an_honest_tool_is_not_doubted(mass: float, mounting: Array) -> None:
    calibration = cw.calibrate(cw.Samples(wrench_of(mass, 0.06 * np.cbrt(mass), mounting), R))
    assert (calibration.verdict, calibration.findings) == ("good", ())


def test_a_sensor_at_any_angle_has_no_side_behind_it() -> None:
    """Where sensor and flange are not parallel, nobody knows which axis of the flange points to the tool."""
    aside = Rotation.from_euler("Y", 40.0, degrees=True).as_matrix()
    assert found(wrench_of(z=-0.06, R_flange_sensor=aside), "mount") == []
    (finding,) = found(wrench_of(z=-0.06), "mount")
    assert "behind the sensor" in finding.text


def test_what_is_known_is_not_doubted() -> None:
    """What was weighed, or seen, is no mistake."""
    behind, light = wrench_of() * scaled(1.0, -1.0), wrench_of(0.003)
    assert found(behind, known={"com": (np.array([-0.004, 0.003, -0.06]), 0.005)}) == []
    assert len(found(behind, known={"weight": (G, 0.1)})) == 1
    assert found(light, known={"weight": (0.003 * G, 1e-3)}) == []


def test_a_mass_that_was_weighed_contradicts_forces_in_another_unit() -> None:
    calibration = cw.calibrate(cw.Samples(wrench_of() * scaled(1 / G, 1.0), R), known={"weight": (G, 0.05)})
    assert calibration.verdict == "weak"
    assert Kind.POOR_FIT in [finding.kind for finding in calibration.findings]


def leaning(degrees: float, towards: float = 0.0, pull: Array | None = None) -> cw.Samples:
    """Readings with gravity so far off -z of the base, and a steady `pull` (3,) N on the tool, in base axes."""
    down = Rotation.from_euler("yz", [-degrees, towards], degrees=True).apply(DOWN)
    mounting = Rotation.from_euler("zxy", [25.0, 1.0, -2.0], degrees=True).as_matrix()
    total = G * down + (np.zeros(3) if pull is None else pull)
    weight = float(np.linalg.norm(total))
    rig = Rig(weight, np.array([0.004, -0.003, 0.06]), BIAS, mounting, total / weight)
    noise = np.repeat([0.02, 0.001], 3)
    return cw.Samples(noisy_readings(rig, R, noise, np.random.default_rng(0)), R)


def of_the_base(samples: cw.Samples, model: str = "auto", **stated: object) -> list[str]:
    calibration = cw.calibrate(samples, model, **stated)  # type: ignore[arg-type]
    texts = [finding.text for finding in calibration.findings if finding.kind is Kind.LEANING_BASE]
    assert not texts or calibration.verdict == "doubtful"
    return texts


@pytest.mark.parametrize("model", ["auto", "mount+base"])
def test_a_base_that_leans_as_nobody_said_is_said(model: str) -> None:
    (text,) = of_the_base(leaning(20.0), model)
    assert text == (
        "doubtful: gravity comes out 20.0 deg off the direction that was stated or is usual: if the base does not lean "
        "so, something pulls steadily, a hose or a balancer, and the weight is wrong; if it does, state gravity as "
        "0.342,0,-0.94"
    )
    assert of_the_base(leaning(20.0), model, gravity=(0.342, 0.0, -0.94)) == []
    assert len(of_the_base(leaning(0.0), model, gravity=(0.342, 0.0, -0.94))) == 1
    assert of_the_base(leaning(4.5, 70.0), model) == []


def test_a_base_may_lean_as_far_as_was_stated() -> None:
    samples = leaning(8.0)
    assert len(of_the_base(samples)) == 1
    assert of_the_base(samples, base_tilt_sd=np.deg2rad(10.0)) == []
    assert of_the_base(samples, known={"gravity": (DOWN, np.deg2rad(10.0))}) == []
    within = np.deg2rad(2.4)  # of less the readings contradict what is known, which says more
    assert len(of_the_base(samples, known={"gravity": (DOWN, within)})) == 1


def test_a_calibration_with_an_odd_prior_is_as_odd() -> None:
    """What the earlier one doubted is taken as known, and is no better for that."""
    samples = leaning(20.0)
    earlier = cw.calibrate(samples)
    assert len(of_the_base(samples, prior=earlier)) == 1
    plain = leaning(0.0)
    assert of_the_base(plain, prior=cw.calibrate(plain)) == []


def test_a_steady_pull_is_no_base_that_leans() -> None:
    """It weighs the tool wrongly, and nothing is left in the poses; a model that holds gravity finds no such pull."""
    pull = Rotation.from_euler("z", 110.0, degrees=True).apply([2.5, 0.0, 4.0])
    samples = leaning(0.0, pull=pull)
    assert cw.calibrate(samples).weight == pytest.approx(G - 4.0, abs=1.0)
    assert len(of_the_base(samples)) == 1


def test_a_direction_that_is_hardly_known_is_not_doubted() -> None:
    """A tool of 30 g, whose weight is little more than the noise of a pose."""
    heavy = leaning(0.0)
    noise = np.random.default_rng(4).normal(size=(len(R), 6)) * np.repeat([0.1, 0.003], 3)
    light = (heavy.wrench - BIAS) * 0.03 + BIAS + noise
    assert of_the_base(cw.Samples(light, R), "mount+base") == []


def tools(n: int = 400) -> Iterator[tuple[float, Array]]:
    """Boxes of half to five times the density of water, upright on the sensor, 0.1 to 500 kg: weight, com."""
    rng = np.random.default_rng(1)
    for mass in np.geomspace(0.1, 500.0, n):
        side = np.cbrt(mass / np.exp(rng.uniform(np.log(500.0), np.log(5000.0))))
        across, up = rng.normal(size=2) * 0.1 * side, 0.5 * side * rng.uniform(0.7, 1.6) + rng.uniform(0.0, 0.03)
        yield mass * G, np.array([*across, up])


HONEST = {
    "camera on a tube of carbon": (0.45, 0.55),
    "paint lance": (3.0, 0.6),
    "spot-welding gun": (110.0, 0.45),
    "stylus": (0.015, 0.03),
    "flange of aluminium": (0.15, 0.005),
    "flange of steel": (4.0, 0.006),
    "palletizer's gripper": (300.0, 0.8),
    "gripper of Franka": (0.73, 0.03),
    "gripper of UR's shop": (0.925, 0.058),
}


def test_honest_tools_of_all_sizes_are_not_odd() -> None:
    assert [(weight, com) for weight, com in tools() if oddity(weight, com, float(com[2]))] == []
    assert [name for name, (mass, z) in HONEST.items() if oddity(mass * G, np.array([0.0, 0.0, z]), z)] == []


@pytest.mark.parametrize(
    ("force", "torque", "least"),
    [
        pytest.param(1 / G, 1.0, 0.9, id="kgf, N m"),
        pytest.param(1 / G, 100.0 / G, 1.0, id="kgf, kgf cm"),
        pytest.param(1e3, 1.0, 1.0, id="mN, N m"),
        pytest.param(1e-3, 1.0, 1.0, id="kN, N m"),
        pytest.param(1.0, 1e3, 1.0, id="N, N mm"),
        pytest.param(1.0, 1e2, 0.98, id="N, N cm"),
        pytest.param(1.0, 1e-3, 1.0, id="N m as N mm"),
        pytest.param(1.0, -1.0, 0.95, id="torques reversed"),
        pytest.param(1 / LBF, 1 / LBF / INCH, 1.0, id="lbf, lbf in"),
        pytest.param(1 / LBF, 1.0, 0.0, id="lbf, N m: a long tool"),
        pytest.param(1 / G, 1 / G, 0.0, id="kgf, kgf m: a smaller tool"),
    ],
)
def test_mistakes_that_make_an_absurd_tool_are_said_of_nearly_all(force: float, torque: float, least: float) -> None:
    """The share that is said; the last two make a tool that could be, and docs/warnings.md says so."""
    said = [oddity(force * w, torque / force * com, torque / force * float(com[2])) != "" for w, com in tools()]
    assert np.mean(said) >= least


@pytest.mark.parametrize(
    ("mass", "z", "odd"),
    [
        (2299.0, 1.0, ""),
        (2301.0, 1.0, TOO_HEAVY),
        (0.0051, 0.01, ""),
        (0.0049, 0.01, TOO_LIGHT),
        (1.0, 0.759, ""),
        (1.0, 0.761, TOO_FAR),
        (1000.0, 1.99, ""),
        (1000.0, 2.01, TOO_FAR),
        (1.0, 0.00051, ""),
        (1.0, 0.00049, TOO_NEAR),
        (1.0, -0.0099, ""),
        (1.0, -0.0101, BEHIND),
    ],
)
def test_limits(mass: float, z: float, odd: str) -> None:
    assert oddity(mass * G, np.array([0.0, 0.0, z]), z) == odd


def test_an_uncertain_centre_of_mass_is_not_doubted() -> None:
    """Three standard deviations are given to it."""
    far = np.array([0.0, 0.0, 0.8])
    assert oddity(G, far, 0.8, np.full(3, 0.02)) == ""
    assert oddity(G, far, 0.8, np.full(3, 0.01)) == TOO_FAR


def test_negated_readings_of_a_long_light_tool_are_no_rival() -> None:
    """They fit by a negative weight: the same fit, which says nothing of the sign."""
    findings = cw.calibrate(cw.Samples(wrench_of() * scaled(1 / G, 1.0), R)).findings
    assert Kind.SIGN_NOT_CONFIRMED not in [finding.kind for finding in findings]


@pytest.mark.parametrize("model", ["auto", "paper", "affine"])
@pytest.mark.parametrize(
    ("wrench", "message"),
    [
        (
            np.zeros((14, 6)),
            "arrays: found 0 in all six channels of every row, expected what a six-axis sensor reads: check its "
            "columns, cable and driver",
        ),
        (
            np.repeat(wrench_of()[:, :1], 6, axis=1),
            "arrays: found six equal channels, expected what a six-axis sensor reads: check its columns, cable and "
            "driver",
        ),
        (
            np.tile([1.5, 0.0, -2.0, 0.0, 0.0, 0.25], (14, 1)),
            "arrays: found fx = 1.5, fy = 0, fz = -2, tx = 0, ty = 0, tz = 0.25 in all 14 rows, though these tilt the "
            "tool, expected readings that change: check the sensor's cable and driver",
        ),
    ],
    ids=["zero", "equal", "frozen"],
)
def test_dead_sensors_are_refused(wrench: Array, message: str, model: str) -> None:
    with pytest.raises(InputError) as refusal:
        cw.calibrate(cw.Samples(wrench, R), model)
    assert str(refusal.value) == message


@pytest.mark.parametrize("model", ["auto", "affine"])
def test_a_dead_channel_is_named(model: str) -> None:
    wrench = wrench_of()
    wrench[:, 5] = 0.25
    (finding,) = found(wrench, model)
    text = (
        "doubtful: tz = 0.25 in all 14 rows, though these tilt the tool: a dead channel, or one that was not recorded?"
    )
    assert (finding.kind, finding.severity, finding.text) == (Kind.DEAD_CHANNEL, Severity.DOUBTFUL, text)
    wrench[0, 5] = 0.2501
    assert found(wrench, model) == []


@pytest.mark.parametrize("per_n", [1.0, 100.0, 3000.0])
def test_a_converters_counts_are_doubtful_and_whole_newtons_are_not(per_n: float) -> None:
    rng = np.random.default_rng(3)
    R = Rotation.random(14, random_state=rng).as_matrix()
    force = -20.0 * R[:, 2]
    wrench = per_n * np.hstack([force, 20.0 * np.cross([0.0, 0.01, 0.06], force)])
    said = cw.calibrate(cw.Samples(np.rint(wrench + rng.normal(size=(14, 6))), R)).warnings
    assert any("a converter's counts, not N and N m?" in text for text in said) == (per_n > 1.0)
    said = cw.calibrate(cw.Samples(wrench + rng.normal(size=(14, 6)), R)).warnings
    assert not any("counts" in text for text in said)
