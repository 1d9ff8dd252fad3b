"""What happens while the arm runs: samples and commands in, contact wrenches, events and snapshots out.

No thread, no socket, no clock: all times come with the samples and the calls, so a program of one's own can feed it,
and a test can. pump.py feeds it from devices.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import inf, isnan
from typing import Any

from msgspec.structs import replace

from ..calibration.calibration import Calibration
from ..calibration.fields import require_calibration
from ..compensate.contact_wrenches import ContactWrench
from ..errors import ContactWrenchError, InputError
from ..geometry.arrays import number
from ..samples.samples import Streams
from .fitting import SIGNS, shown
from .history import History, Motion, Stillness
from .intake import Intake
from .pose_track import PoseTrack
from .running import OF_ROBOT, OF_SENSOR, Options, Runner, shown_contact_wrench, traced
from .sink import Pose, Reading, Turn
from .snapshot import Command, Event, Output, Phase, Snapshot
from .source import NO_PLACE, NO_WRENCH, About, Batch, Four, Sample
from .wizard import Wish, Wizard

EVENTS_KEPT, NEW_EVENTS_KEPT, TRACE_EVERY, TRACE_KEPT = 50, 1_000, 1.0 / 125.0, 250
NOT_TURNED: Four = (0.0, 0.0, 0.0, 1.0)
WARNINGS = dict.fromkeys(("refusal", "pose_refused", "finding", *OF_SENSOR, *OF_ROBOT), "warning")


class Session:
    """A sensor and a robot, or one device that is both, on the way to a calibration and then with one.

    Args:
        calibration: to run with at once; None: the wizard first.
        sensor: what the sensor is called in events: its URI.
        robot: as `sensor`; None: the sensor's samples have orientations too.
        wish: how many poses, and what is known, on the way to a calibration.
        options: of the compensation.
        save: writes a calibration, and says where; None: it cannot be saved. May raise a `ContactWrenchError`.
        save_accepted: write it as soon as a person goes on from its fit, and not only when asked.

    Raises:
        InputError: an option that cannot be meant, or no calibration.
    """

    def __init__(
        self,
        calibration: Calibration | None = None,
        *,
        sensor: str = "sensor",
        robot: str | None = "robot",
        wish: Wish | None = None,
        options: Options | None = None,
        save: Callable[[Calibration], str] | None = None,
        save_accepted: bool = False,
    ) -> None:
        self._sensor = Intake(sensor, "sensor" if robot is not None else "sensor and robot")
        self._robot = self._sensor if robot is None else Intake(robot, "robot")
        self._intakes = tuple(dict.fromkeys((self._sensor, self._robot)))
        self._track, self._history, self._stillness = PoseTrack(), History(), Stillness()
        self._options, self._save, self._save_accepted = options or Options(), save, save_accepted
        self._saved: tuple[Calibration, str] | None = None
        self._motion, self._traced = Motion(), -inf
        self._wizard = Wizard(wish or Wish(), self._streams)
        self._runner: Runner | None = None
        self._events: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self._new: deque[Event] = deque(maxlen=NEW_EVENTS_KEPT)
        self._trace: deque[tuple[float | None, ...]] = deque(maxlen=TRACE_KEPT)
        self._last: Turn | None = None
        self.recording: bool | None = None
        """Whether it is recorded; None: there is nothing to record to."""
        if calibration is not None:
            require_calibration(calibration)
            self._wizard.phase = Phase.RUN
            self._run(calibration, SIGNS.get(str(calibration.provenance.get("sign", "pull")), 1.0))

    @property
    def phase(self) -> Phase:
        """Where the session is."""
        return self._wizard.phase

    @property
    def calibration(self) -> Calibration | None:
        """The one that runs, or the last that was fitted."""
        return self._wizard.calibration if self._runner is None else self._runner.calibration

    @property
    def saved(self) -> str:
        """Where the calibration was written; empty: it has not been, or has changed since."""
        return self._saved[1] if self._saved is not None and self._saved[0] is self.calibration else ""

    def _streams(self) -> Streams | None:
        return self._motion.streams(self._wizard.sign)

    def opened(self, role: str, about: About, t: float) -> None:
        """A device is there, or there again.

        Args:
            role: `sensor` or `robot`.
            about: what it says of itself.
            t: s since 1970.

        Raises:
            InputError: another role.
        """
        unknown = self._sensor.about is None
        self._say(self._intake(role).opened(about, t))
        if unknown and self._sensor.about is not None and self._runner is not None:  # now its rate and ranges are known
            self._run(self._runner.calibration, self._runner.sign)

    def down(self, role: str, text: str, t: float) -> None:
        """A device cannot be reached, or went away: `role` and `t` as of `opened`, `text` says why."""
        if event := self._intake(role).down(text, t):
            self._say(event)

    def outlet_ended(self, text: str, t: float) -> None:
        """A sink has ended by itself."""
        self._say(Event(t, "sink", "error", text))

    def _intake(self, role: str) -> Intake:
        if role not in ("sensor", "robot"):
            raise InputError(f"role is {role!r}, expected sensor or robot: name one of them")
        return self._robot if role == "robot" else self._sensor

    def feed(self, sensor: Batch | None = None, robot: Batch | None = None, *, t: float) -> Turn:
        """Take what came until `t` s since 1970, and make of it what there is to be made.

        Args:
            sensor: from the sensor, in the order in which it came.
            robot: from the robot.
            t: now. Call it twenty times a second or more, also where nothing came: silence is found so.

        Raises:
            InputError: something else than batches of samples, or no time.
        """
        t = number(t, "t")
        for batch, intake in ((sensor, self._sensor), (robot, self._robot)):
            if batch is not None:
                intake.require(batch)
        poses = [] if robot is None else self._robot.take(robot)
        readings = [] if sensor is None else self._sensor.take(sensor)
        poses = readings if self._robot is self._sensor else poses
        turns = [each for each in poses if each[1].orientation is not None and not each[1].flaw]
        if turns:
            add = self._track.add
            known = [(at, pose) for at, pose in turns if add(at, pose.orientation or NOT_TURNED, pose.position)]
            if self._runner is not None:
                self._runner.came(known)
        turn = self._turn([each for each in readings if each[1].wrench is not None or each[1].flaw], turns)
        if turn.readings:
            self._history.add(turn)
            self._last = turn
        for k, reading in enumerate(turn.readings):
            if reading.t - self._traced >= TRACE_EVERY:
                self._traced = reading.t
                self._trace.append(traced(reading, turn.judged[k] if turn.judged else None))
        if self._runner is None and self.phase is not Phase.CONNECT and turn.rows:
            self._motion.add(turn, t)
        for intake in self._intakes:
            for event in intake.look(t):
                self._say(event)
        if self._stillness.look(self._history, t) and self.phase is not Phase.RUN:
            self._happened(said := self._wizard.look(self._history, self._stillness, t), t)
            if any(kind == "verified" for kind, _ in said):
                self._keep(t)
        return turn

    def _turn(self, samples: list[tuple[float, Sample]], poses: list[tuple[float, Sample]]) -> Turn:
        readings: list[Reading] = []
        judged: list[ContactWrench] = []
        runner, delay = self._runner, 0.0 if self._runner is None else self._runner.delay
        for when, sample in samples:
            orientation, age = self._track.at(when, when)
            wrench = NO_WRENCH if sample.wrench is None else sample.wrench
            readings.append(reading := Reading(when, sample.arrival, wrench, orientation, sample.flaw))
            if runner is None:
                continue
            if delay:
                orientation, age = self._track.at(when - delay, when)
            why = sample.flaw
            if not why and orientation[0] != orientation[0]:
                word = "frozen" if self._track.frozen(when) else "stale"
                why = f"{word}: the orientation is {age:.2f} s old" if age < inf else f"{word}: no orientation has come"
            judged.append(runner.step(reading, orientation, why, self._track.stale_after))
        said, ended = ([], ()) if runner is None or not readings else runner.happened()
        if said:
            self._happened(said, readings[-1].t)
        came = [Pose(when, pose.orientation or NOT_TURNED, pose.position or NO_PLACE) for when, pose in poses]
        return Turn(readings, came, judged, ended)

    def do(self, command: Command, t: float, number: int | None = None) -> None:
        """Do what a person asks for; what cannot be done now is an event.

        Args:
            command: one of `commands()`.
            t: s since 1970.
            number: of a pose, from 1.
        """
        try:
            if command not in self.commands():
                raise ContactWrenchError(f"{command.value} is not possible now")
            if command is Command.SAVE and self._save is not None and self.calibration is not None:
                self._saved = self.calibration, self._save(self.calibration)
                self._happened([("saved", f"calibration written to {self.saved}")], t)
            elif command is Command.ZERO and self._runner is not None:
                self._happened([("zero", self._runner.zero(self._history, t))], t)
            elif command is Command.RECORD:
                self.recording = not self.recording
                self._happened([("record", f"recording is {'on' if self.recording else 'off'}")], t)
            else:
                self._happened(self._wizard.do(command, number, self._history, t), t)
                if self.phase is not Phase.RUN:
                    self._runner = None
                elif self._runner is None and self._wizard.calibration is not None:
                    self._run(self._wizard.calibration, self._wizard.sign)
                self._keep(t)
        except ContactWrenchError as error:
            self._happened([("refusal", str(error))], t)

    def commands(self) -> tuple[Command, ...]:
        """What can be asked for now."""
        running = (Command.ZERO,) if self._runner is not None else ()
        done = self.phase in (Phase.FIT, Phase.VERIFY, Phase.RUN) and self.calibration is not None
        save = (Command.SAVE,) if self._save is not None and done and not self.saved else ()
        record = () if self.recording is None else (Command.RECORD,)
        return (*self._wizard.commands(self._stillness), *running, *save, *record)

    def _run(self, calibration: Calibration, sign: float) -> None:
        self._motion = Motion()
        self._trace.clear()
        self._runner = Runner(calibration, sign, self._options, self._sensor.about)

    def _keep(self, t: float) -> None:
        """Write what a person has accepted, and what a check has made of it, where that is wanted."""
        if self._save_accepted and self.phase in (Phase.VERIFY, Phase.RUN) and Command.SAVE in self.commands():
            self.do(Command.SAVE, t)

    def _happened(self, what: list[tuple[str, str]], t: float) -> None:
        for kind, text in what:
            intake = self._sensor if kind in OF_SENSOR else self._robot if kind in OF_ROBOT else None
            self._say(Event(t, kind, WARNINGS.get(kind, "note"), text, "" if intake is None else intake.uri))

    def _say(self, event: Event) -> None:
        if self._events and event.t < self._events[-1].t:  # a recording's samples begin before its device is known
            event = replace(event, t=self._events[-1].t)
        self._events.append(event)
        self._new.append(event)

    def events(self) -> list[Event]:
        """What happened since they were last asked for."""
        new = list(self._new)
        self._new.clear()
        return new

    def snapshot(self, t: float, outputs: tuple[Output, ...] = (), recording: str = "") -> Snapshot:
        """What a person sees at `t` s since 1970; the trace begins anew. `outputs` and `recording`: of the sinks."""
        last, wizard, stand = self._last, self._wizard, self._stillness
        _, here, place = self._track.newest or (t, None, NO_PLACE)
        reading = None if last is None or last.readings[-1].flaw else last.readings[-1].wrench
        noise: Any = None if stand.noise is None else tuple(stand.noise.tolist())
        trace, self._trace = tuple(self._trace), deque(maxlen=TRACE_KEPT)
        return Snapshot(
            t=t,
            phase=self.phase,
            devices=tuple(each.shown(t) for each in self._intakes),
            reading=reading,
            noise=noise,
            orientation=here,
            position=None if isnan(place[0]) else place,
            still=stand.now.still,
            moving=stand.now.moves,
            trace=trace,
            commands=self.commands(),
            events=tuple(self._events),
            contact=None if last is None else shown_contact_wrench(last, self._sensor),
            push=wizard.push.steps() if self.phase is Phase.PUSH else (),
            poses=wizard.shown(here),
            fit=None if wizard.fit is None or self.phase not in (Phase.FIT, Phase.VERIFY) else shown(wizard.fit),
            checks=wizard.checks,
            verified=wizard.verified,
            saved=self.saved,
            running=None if self._runner is None else self._runner.shown(self.saved),
            outputs=outputs,
            recording=recording if self.recording else "",
        )
