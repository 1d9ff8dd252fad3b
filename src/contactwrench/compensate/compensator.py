"""Around the step of step.py, the only class with state: settings, what the rate decides, a new zero, results."""

from __future__ import annotations

from copy import deepcopy
from math import inf, isnan, nan
from pickle import dumps, loads
from threading import get_ident
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..calibration.fields import require_calibration
from ..errors import InputError
from ..estimation.noise import with_torques
from ..geometry.arrays import Array, number, numbers, read_only, seconds
from ..geometry.orientation import OrientationLike, numbers_of
from ..geometry.ranges import CAPACITY, DURATION, PER_KELVIN, RATE, WALK
from ..samples.flange_motion import FlangeMotion
from ..samples.samples import Samples
from .acceleration import told
from .bias_tracking import HOUR, LEVEL_KNOWN, free_mean, poses_differ_by, require_let_go, start_anew, track
from .contact_detection import LEARN_FIRST, contact_so_far, covariance_of, thresholds
from .contact_wrenches import NOT_JUDGED, NOT_KNOWN, TOUCHING, Contact, ContactWrench, ContactWrenches, Zero
from .delay import past_of, use_delay
from .faults import BACK, SAME, measured_by, reason_of
from .filters import LowPass, gains_of_poses, use_low_passes
from .inertia import use_inertia
from .noise import between_poses, known_noise, of_pairs, six_numbers, stated_noise
from .runner import NOTHING_TOLD, TAKEN, by_one_thread, heat_told, require_one, results_of, samples_of, steps_of
from .shaking import known_motion
from .state import COVARIANCE, ENDED, NOISE_LEARNED, RATE_FOUND, State
from .step import ASK, WHOLLY, WRENCH_ALONE

GAP_SECONDS, GAP_SAMPLES = 0.1, 5.0  # after a longer gap than both the filters start anew


class Compensator:
    """From readings, one at a time or in batches, to contact wrenches with their std, faults and contacts.

    It serves the thread that calls it first, until a `reset`; a call from another is refused and changes nothing.
    Threads side by side need one each; a copy, or one from a pickle, goes on from the same state.

    Args:
        calibration: of the tool and the sensor.
        rate: Hz; None: from the first 25 stamps, and from more and more of those that follow, where they have another;
            nothing is filtered until then, and a cut-off may be too high for it (`InputError`).
        noise: std (6,) of one sample, N and N m; or one number, N, with N m at a lever of 5 cm; or a recording (n, 6)
            at rest or, compensated, free; None: the calibration's `still_noise`, or learned from a first second, free.
        lowpass: of the contact wrench, a `LowPass`, or a cut-off in Hz (Butterworth of order 2).
        sensor_filter: what the sensor does to a wrench, and so is done to the model: as `lowpass`, but of first order.
        delay: s, how much later than the orientation the wrench is stamped, 1 at most; None: as calibrated, if known.
        delay_std: s, of that, which counts while the arm turns; None: the calibration's, 0 of a `delay` that is stated.
        drift: std (6,) of the bias' random walk after an hour, N and N m, or one number as for `noise`; typical:
            `contactwrench.compensate.bias_tracking.TYPICAL_DRIFT`. None: not followed, nor a push that is as slow.
        temperature_coefficient: (6,) of the bias, N/K and N m/K; each reading then comes with a temperature.
        false_alarm_rate: per sample; a contact takes one that is a hundred times as rare.
        minimum_duration: s, of a contact, and of its end.
        ranges: (6,) of the sensor, N and N m.
        gravity: (3,) its direction in base axes, where that differs from the calibration's.
        fast: whether numba compiles the step, here and not at the first sample; None: where it is installed.

    Raises:
        InputError: values that cannot be meant.
        MissingExtraError: `fast` without numba.
    """

    def __init__(
        self,
        calibration: Calibration,
        *,
        rate: float | None = None,
        noise: ArrayLike | None = None,
        lowpass: LowPass | float | None = None,
        sensor_filter: LowPass | float | None = None,
        delay: float | None = None,
        delay_std: float | None = None,
        drift: ArrayLike | None = None,
        temperature_coefficient: ArrayLike | None = None,
        false_alarm_rate: float = 1e-4,
        minimum_duration: float = 0.005,
        ranges: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        fast: bool | None = None,
    ) -> None:
        require_calibration(calibration)
        self._calibration = calibration.with_gravity(gravity)
        self._stated = None if noise is None else stated_noise(noise)
        self._rate = None if rate is None else float(RATE.require(rate, "rate"))
        self._lowpass = lowpass if isinstance(lowpass, LowPass | None) else LowPass(lowpass)
        self._sensor = sensor_filter if isinstance(sensor_filter, LowPass | None) else LowPass(sensor_filter, 1)
        s = self._settings = State()
        use_delay(s, calibration, self._sensor, delay, delay_std)
        s.minimum_duration = float(DURATION.require(minimum_duration, "minimum duration")) - 1e-9
        s.ranges = six_numbers(ranges, "range", CAPACITY, inf)
        s.per_kelvin = six_numbers(temperature_coefficient, "temperature coefficient", PER_KELVIN)
        self._by_heat = any(s.per_kelvin)
        s.gravity_direction, s.B = self._calibration.gravity_direction.tolist(), calibration.B.tolist()
        use_inertia(s, calibration, self._sensor)
        s.fires, s.ends, s.begins = (table.tolist() for table in thresholds(false_alarm_rate))
        s.knows_noise = self._stated is not None or calibration.still_noise is not None
        s.learn_next = inf if s.knows_noise else LEARN_FIRST
        s.dof, s.follows_bias, s.measured = calibration.dof, drift is not None, measured_by(calibration)
        s.walk = [a * a / HOUR for a in six_numbers(None if drift is None else with_torques(drift), "drift", WALK)]
        self._steps = steps_of(fast)
        self.reset()

    def reset(self) -> None:
        """Forget everything but the settings: filters, contact, what was learned of the bias, new zero, its thread."""
        s: State = loads(dumps(self._settings))  # a tenth of deepcopy's time
        self._noise = known_noise(self._calibration, self._stated, self._rate)
        track(s, self._calibration, between_poses(self._calibration, self._noise.white * s.knows_noise))
        self._runner = self._steps(s, past_of(s, self._rate))
        self._last_contact: Contact | None = None
        self._use_noise(None)
        if self._rate is not None:
            self._use_rate(self._rate)
            self._runner.state.stamps_awaited = 0
        vars(self).pop("owner", None)

    __copy__ = deepcopy  # a shallow one would share the state

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "owner"}

    def __call__(
        self,
        wrench: ArrayLike,
        orientation: OrientationLike,
        t: float,
        temperature: float | None = None,
        *,
        position: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> ContactWrench:
        """The contact wrench of a reading; what is wrong with the sample comes back in `valid` and `reason`.

        Args:
            wrench: (6,) the reading, N and N m, sensor axes.
            orientation: `R_base_flange` (3, 3), its quaternion x, y, z, w (4,), or a scipy `Rotation`.
            t: s.
            temperature: K or degrees C; NaN: not known.
            position: (3,) m of the flange, base axes, for a calibration with inertia; None: the arm is at rest.
            acceleration: (3,) of its accelerometer, own axes and unit, for a calibration by one, in place of that.

        Raises:
            InputError: a shape, no numbers, a rate that is too low for a cut-off, or a call while another runs.
        """
        reading, turn = numbers(wrench, "wrench"), numbers_of(orientation)
        at_rest = position is None and acceleration is None
        place = NOTHING_TOLD if at_rest else told(self._calibration, position, acceleration)
        require_one(reading, turn, place)
        t = t if isinstance(t, float) else number(seconds(t), "t")
        heat = nan if temperature is None and not self._by_heat else number(heat_told(temperature), "temperature")
        if vars(self).setdefault("owner", me := get_ident()) != me:  # as `by_one_thread`, without another call
            raise InputError(TAKEN)
        said, result = self._runner.step(reading, turn, t, heat, place)
        if said != ASK:
            return ContactWrench(result, self._runner.std(), float(t), True, None, said == TOUCHING)
        events, fault, detail, channel, judged = self._runner.told()
        if events:
            self._attend(events)
        contact = None if judged == NOT_JUDGED else bool(judged)
        std = self._runner.std() if fault <= SAME or fault >= BACK else NOT_KNOWN
        return ContactWrench(result, std, float(t), fault <= SAME, reason_of(fault, detail, channel), contact)

    @by_one_thread
    def pose(self, orientation: OrientationLike, position: ArrayLike, t: float, passed: float) -> None:
        """Take a pose that comes at a time of its own; readings then come without a position. It tells the motion at
        the pose before it. At most two poses may be ahead of the next reading: more are not kept.

        Args:
            orientation: of the flange, as of a reading; what is none is passed over.
            position: (3,) m of the flange, base axes; likewise.
            t: s, by the clock of the readings.
            passed: s since the pose before, by the robot's own clock; inf, NaN: nothing is to be told from that one.

        Raises:
            InputError: a shape, no numbers, or a call while another runs.
        """
        turn, place = numbers_of(orientation), told(self._calibration, position, None)
        require_one(NOT_KNOWN, turn, place)
        self._runner.pose(turn, place, t, inf if isnan(passed) else passed)

    @by_one_thread
    def run(
        self,
        wrench: ArrayLike,
        orientation: OrientationLike,
        t: ArrayLike,
        temperature: ArrayLike | None = None,
        *,
        position: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        motion: FlangeMotion | None = None,
    ) -> ContactWrenches:
        """The contact wrenches of the next readings. The state goes on from call to call.

        Args:
            wrench: (n, 6) the readings, N and N m, sensor axes.
            orientation: `R_base_flange` (n, 3, 3), quaternions x, y, z, w (n, 4), or a scipy `Rotation`.
            t: (n,) s.
            temperature: (n,) K or degrees C; NaN: not known.
            position: (n, 3) m of the flange, base axes; None: the arm is at rest.
            acceleration: (n, 3) of its accelerometer, own axes and unit; None: it has none.
            motion: of the flange, from a whole recording, in place of what follows from position to position.

        Returns:
            The contact wrenches of the n readings in their order, and the contacts that ended in them.

        Raises:
            InputError: shapes that do not pair, else as for a single reading.
        """
        moving = () if motion is None else known_motion(self._calibration, orientation, motion)
        place = None if position is None and acceleration is None else told(self._calibration, position, acceleration)
        samples, width = samples_of(wrench, orientation, t, temperature, self._by_heat, place, *moving)
        contacts, covariances, taken = list[Contact](), [covariance_of(self._runner.state)], 0
        while taken < len(samples):
            taken = self._runner.advance(samples, width, taken)
            self._attend(events := int(samples["events"][taken - 1]))
            if events & COVARIANCE:
                covariances.append(covariance_of(self._runner.state))
            if events & ENDED and self._last_contact is not None:
                contacts.append(self._last_contact)
        return results_of(samples, contacts, covariances)

    @by_one_thread
    def zero(self, samples: Samples) -> Zero:
        """Take what free readings at rest leave, in whatever orientation, for the bias from now on.

        Args:
            samples: the free readings, 10 or more, with their orientations.

        Returns:
            By how much they had moved, (6,) N and N m, and the std of that.

        Raises:
            InputError: they move, scatter more than noise, are too few, or a contact has begun; nothing is changed.
        """
        s, before = self._runner.state, self.drift
        require_let_go(s)
        mean, variance, R = free_mean(self._calibration, samples, self._noise if s.knows_noise else None)
        start_anew(s, mean, variance, R)
        s.spoiled, s.fresh, s.touching, s.run = True, WRENCH_ALONE, False, 0
        return Zero(mean - before, np.sqrt(self._calibration.wrench_covariance(R).diagonal() + s.between + variance))

    @property
    def last_contact(self) -> Contact | None:
        """The contact that lasts (`release` None), or else the last one that ended."""
        return contact_so_far(s, self._noise, None) if (s := self._runner.state).touching else self._last_contact

    @property
    def drift(self) -> Array:
        """By how much (6,), N and N m, free readings have moved since the calibration, as far as it was learned."""
        return read_only(self._runner.state.offset)

    @property
    def delay(self) -> float:
        """The delay (s) that is applied."""
        return self._settings.delay

    def _attend(self, events: int) -> None:
        """Do what a sample leaves to be done."""
        s = self._runner.state
        if events & ENDED:
            self._last_contact = contact_so_far(s, self._noise, float(s.release))
        if events & RATE_FOUND:
            self._use_another_rate(float(s.rate_found))
        if events & NOISE_LEARNED:
            s.knows_noise, self._noise = True, of_pairs(np.array(s.means) // 2.0, np.array(s.squares))
            poses_differ_by(s, between_poses(self._calibration, self._noise.white))
            self._use_noise(1.0 / s.interval)

    def _use_another_rate(self, rate: float) -> None:
        """That of the last stamps; a loop that runs goes on where no filter takes it."""
        s, times = self._runner.state, rate * float(self._runner.state.interval)
        try:
            self._use_rate(rate)
            s.fresh = max(s.fresh, WRENCH_ALONE) if 0.5 < times < 2.0 else WHOLLY  # the motion too
        except InputError:
            if times == inf:
                raise

    def _use_rate(self, rate: float) -> None:
        s = self._runner.state
        use_low_passes(rate, (self._lowpass, s.lowpass), (self._sensor, s.sensor))
        s.longest_gap, s.interval = max(GAP_SECONDS, GAP_SAMPLES / rate), 1.0 / rate
        if self._settings.knows_noise:  # and has not learned it
            self._noise = known_noise(self._calibration, self._stated, rate)
        self._use_noise(rate)

    def _use_noise(self, rate: float | None) -> None:
        """The noise is another; None: the rate is not known, and nothing is filtered."""
        s, low_pass = self._runner.state, None if rate is None else self._lowpass
        self._noise = self._noise.over(LEVEL_KNOWN, rate)
        s.pose_gain[:] = gains_of_poses(low_pass, rate)
        s.settled = 0 if low_pass is None or rate is None else low_pass.settles_in(rate)
        self._noise.told_to(s, low_pass, rate)
