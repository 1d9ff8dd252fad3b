"""Threads: one reader a device, one worker that feeds the session with what came and hands on what it made.

No device waits for the worker, and the worker for no sink, page or disk: in between are bounded queues, and what does
not fit is counted. While the worker waits for the sensor it reads it itself, as waking it for each sample takes as long
as the sample; whenever it is busy for longer, as with a fit, the reader goes on.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from queue import Queue
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, TypeAlias

import msgspec

from ..errors import ContactWrenchError
from .devices import require_same
from .session import Session
from .sink import OpenSink
from .snapshot import Event as Said
from .snapshot import Output
from .source import About, Batch, EndOfStreamError, Note, NoteKind, Source, now
from .stream import WAIT, batches

if TYPE_CHECKING:
    from .page.app import Ask

WAITING = 20_000
"""Samples between a reader and the worker: 20 s at 1 kHz, which is more than any fit takes."""
TURN = WAIT
"""s that the worker waits before it looks whether it is to end; and that a reader stands by for one which is busy: the
shortest buffer of a system fills in twice that (transport.py).
"""
SILENT, AGAIN = "nothing for {:g} s, connecting again", 0.4
"""What is said of a device that says nothing; and s from one attempt to the next."""
AHEAD = 1
"""Batches by which a recording may be ahead of the worker; a turn with more would have more poses than are kept."""
SNAPSHOTS = 1.0 / 30.0
ENDS_IN, ASKED_EVERY = 4.0, 0.1
"""s that a thread is given to end, and after which it is asked again: it may just have connected."""

News: TypeAlias = Batch | About | str
"""What a reader says: what came, that the device is there, or why it is not."""


class Reader:
    """A device that is read in a thread of its own, from now on, and connected to again for as long as it takes. The
    source is open already; `about` is what it said, and `early` what has come.
    """

    def __init__(self, source: Source, about: About, early: Batch) -> None:
        self._source, self.about = source, about
        self._any_thread = getattr(source, "any_thread", False)
        self._news: deque[News] = deque()
        self._stop = Event()
        self.wake = Event()
        """Set whenever something came."""
        self._given = self._taken = self._full = 0
        self._ended = False
        self._reads, self._stands_by_until = Lock(), 0.0
        self._stream: Iterator[Batch] = iter(())
        self._failure: Exception | None = None
        self._reads.acquire()  # by its own thread
        self.put(about)
        self.put(early)
        self._thread = Thread(target=self._run, name=f"reads {source.uri}", daemon=True)
        self._thread.start()

    @property
    def ended(self) -> bool:
        """Whether nothing more will come, and all that came was taken."""
        return self._ended and not self._news

    def news(self) -> list[News]:
        """What came since the last call, at most until the device went, or came back: its clock begins anew then."""
        news: list[News] = []
        while self._news and (isinstance(self._news[0], Batch) or not news or not isinstance(news[-1], Batch)):
            news.append(each := self._news.popleft())
            self._taken += len(each.samples) if isinstance(each, Batch) else 0
        if self._full:
            news.append(Batch(notes=[Note(NoteKind.LOST, "more came than could be taken", self._full)]))
            self._full = 0
        return news

    def forget(self) -> None:
        """Let go what came while something else was waited for, where that was more than can be taken: all of it is
        old, and the last of it is missing. What fits, as of a pipe, or a recording that waits itself, is kept.
        """
        for _ in range(len(self._news) if self._full else 0):  # turned once round: the thread goes on to put
            if not isinstance(news := self._news.popleft(), Batch):
                self._news.append(news)
        self._taken, self._full = self._given if self._full else self._taken, 0

    def lead(self) -> bool:
        """Wait for what comes next, and put it, in the calling thread; False: its own thread is at it. That one stands
        by from now on, and goes on where this is not called for `TURN` s.
        """
        if not self._any_thread or self._failure is not None or self._stop.is_set():
            return False
        self._stands_by_until = now() + 2.0 * TURN
        if not self._reads.acquire(blocking=False):
            return False
        try:
            self.put(next(self._stream, None) or Batch())
            self._stands_by_until = now() + TURN
        except Exception as error:  # its own thread's to say, and to connect again
            self._failure, self._stands_by_until = error, 0.0
        finally:
            self._reads.release()
        return True

    def stop(self) -> None:
        """Ask the thread to end."""
        self._stop.set()
        self._source.close()

    def join(self) -> None:
        """Wait until it has."""
        end = now() + ENDS_IN
        while self._thread.is_alive() and now() < end:
            self._source.close()
            self._thread.join(ASKED_EVERY)

    def _run(self) -> None:
        about: About | None = self.about
        while not self._stop.is_set():
            try:
                if about is None:
                    about = self._source.open()
                    require_same(self._source.uri, self.about, about)
                    self.put(about)
                self._stream = batches(self._source, about, self._stop.is_set, SILENT)
                for batch in self._stream:
                    self.put(batch)
                    while about.replay and len(self._news) > AHEAD and not self._stop.is_set():
                        self._stop.wait(0.001)
                    self._stand_by()
            except EndOfStreamError as error:
                self.put(str(error))
                self._ended = True
                return
            except ContactWrenchError as error:
                self.put(str(error))
            except Exception as error:  # a source may be anybody's
                said = " ".join(str(error).split())
                self.put(f"{self._source.uri}: the source failed ({type(error).__name__}: {said})")
            finally:
                about = None
                self._source.close()
            self._stop.wait(AGAIN)

    def _stand_by(self) -> None:
        """While another thread leads; raises what that met with."""
        if self._stands_by_until > now():
            self._reads.release()
            self.wake.set()  # whoever leads may be waiting for this one's last batch
            while (left := self._stands_by_until - now()) > 0.0 and not self._stop.wait(left):
                pass
            self._reads.acquire()
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def put(self, news: News) -> None:
        """Keep what came until it is taken; of samples no more than can wait."""
        if isinstance(news, Batch):
            if not (news.samples or news.notes):
                return
            if self._given - self._taken >= WAITING or len(self._news) >= WAITING:
                self._full += len(news.samples)
                return
            self._given += len(news.samples)
        self._news.append(news)
        if not self.wake.is_set():
            self.wake.set()


class Pump:
    """Runs a session on devices until it is closed, or a recording has ended. The readers are by role, `sensor` and,
    where that is another device, `robot`. Snapshots go as JSON to `publish`, events to `say`, turns to `outlets`, and
    while the session records to `recorder` too; commands come from `asked`.
    """

    def __init__(
        self,
        session: Session,
        readers: Mapping[str, Reader],
        *,
        publish: Callable[[bytes], None] | None = None,
        say: Callable[[Said], None] | None = None,
        asked: Queue[Ask] | None = None,
        outlets: tuple[OpenSink, ...] = (),
        recorder: OpenSink | None = None,
    ) -> None:
        self.session, self._readers = session, dict(readers)
        self._publish, self._say, self._asked = publish, say, asked
        self._outlets, self._recorder = outlets, recorder
        self._sinks = outlets if recorder is None else (*outlets, recorder)
        self._ended = set[str]()
        self._wake = self._readers["sensor"].wake
        self._stop = Event()
        self._shown, self._recorded, self._replay = 0.0, 0.0, False
        self.failure: BaseException | None = None
        self._worker = Thread(target=self._run, name="worker", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._worker.start()

    def wait(self, seconds: float | None = None) -> bool:
        """Wait until it has ended by itself, at most some s; whether it has."""
        self._worker.join(seconds)
        return not self._worker.is_alive()

    def close(self) -> None:
        """End all threads: readers, then the worker, then the sinks; what came until then is written."""
        for reader in self._readers.values():
            reader.stop()
        for reader in self._readers.values():
            reader.join()
        self._stop.set()
        self._wake.set()
        if self._worker.ident is not None:
            self._worker.join(ENDS_IN)
        for sink in self._sinks:
            sink.close()

    def _run(self) -> None:
        try:
            ended = False
            while not ended:
                if not self._readers["sensor"].lead():  # its own thread is at it: until that has something, or a moment
                    self._wake.wait(TURN)
                    self._wake.clear()
                ended = self._stop.is_set() or self._readers["sensor"].ended
                self._turn(now())
        except BaseException as error:  # a thread's error is said by whoever waits for it
            self.failure = error

    def _turn(self, t: float) -> None:
        batches = {role: self._taken(role, reader, t) for role, reader in self._readers.items()}
        if self._replay:  # its clock is the recording's
            stamps = [batch.samples[-1].arrival for batch in batches.values() if batch is not None and batch.samples]
            t = self._recorded = max([self._recorded, *stamps]) or t
        turn = self.session.feed(batches.get("sensor"), batches.get("robot"), t=t)
        if turn.rows:
            for sink in self._sinks if self.session.recording else self._outlets:
                sink.write(turn)
        for sink in self._sinks:
            if sink.error and sink.uri not in self._ended:  # of each that has ended, once
                self._ended.add(sink.uri)
                self.session.outlet_ended(sink.error, t)
        while self._asked is not None and not self._asked.empty():
            ask = self._asked.get()
            self.session.do(ask.do, t, None if ask.pose is None else ask.pose + 1)
        for said in self.session.events():
            if self._say is not None:
                self._say(said)
        if self._publish is not None and t - self._shown >= SNAPSHOTS:
            self._shown = t
            self._publish(self.encoded_snapshot(t))

    def _taken(self, role: str, reader: Reader, t: float) -> Batch | None:
        """What came from a device, joined; that it is there, or gone, is told to the session in its turn."""
        whole: Batch | None = None
        for news in reader.news():
            if isinstance(news, About):
                self._replay = news.replay
                self.session.opened(role, news, t)
            elif isinstance(news, str):
                self.session.down(role, news, t)
            elif whole is None:
                whole = news
            else:
                whole.add(news)
        return whole

    def encoded_snapshot(self, t: float) -> bytes:
        """What a person sees at `t` s, as JSON; for the worker alone."""
        outlets = tuple(Output(each.uri, each.written, each.dropped, each.error) for each in self._outlets)
        recording = "" if self._recorder is None else self._recorder.uri
        return msgspec.json.encode(self.session.snapshot(t, outlets, recording))
