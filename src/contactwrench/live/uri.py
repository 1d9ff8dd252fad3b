"""Devices by their URI: `sri://192.168.0.108:4008`, `udp://:9000`, `stdin:`, and what makes a source or sink of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.metadata import entry_points
from math import inf, nan
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, unquote, urlsplit

from ..errors import ContactWrenchError, InputError
from .sink import Sink
from .source import Source

SOURCES: Mapping[str, str] = {
    "sri": "sources.sri:Sri",
    "netft": "sources.netft:NetFt",
    "ur": "sources.ur:Ur",
    "rsi": "sources.rsi:Rsi",
    "ft300": "sources.ft300:Ft300",
    "robotiq": "sources.ft300:Robotiq",
    "bota": "sources.bota:Bota",
    "ros2": "sources.ros2:Ros2",
    "udp": "sources.lines:UdpLines",
    "tcp": "sources.lines:TcpLines",
    "stdin": "sources.lines:StdinLines",
}
SINKS: Mapping[str, str] = {"udp": "sinks.lines:UdpLines", "ros2": "sinks.ros2:Ros2", "file": "sinks.file:ContactFile"}
"""By scheme: where in this package the class is. Other packages add theirs as entry points of these groups."""
OWN = "contactwrench"
SOURCE_GROUP, SINK_GROUP = "contactwrench.sources", "contactwrench.sinks"

DIGITS = 15


@dataclass(frozen=True)
class Uri:
    """`scheme://host:port/path?name=value`, as a person wrote it; `text` is the whole."""

    text: str
    scheme: str
    host: str
    port: int | None
    path: str
    options: Mapping[str, str]

    def __str__(self) -> str:
        return self.text

    def only(self, *names: str) -> None:
        """Raise `InputError` for an option that is none of these."""
        for name in self.options:
            if name not in names:
                known = f"one of {', '.join(names)}" if names else "none"
                raise InputError(f"{self.text}: found the option {name}, expected {known}: correct the URI")

    def whole(self, name: str, default: int) -> int:
        """An option that is a whole number. Raises `InputError`."""
        text = self.options.get(name, str(default))
        if not (text.isascii() and text.isdigit() and len(text) <= DIGITS):
            long = f" of at most {DIGITS} digits" * (len(text) > DIGITS)
            raise InputError(f"{self.text}: found {name}={text}, expected a whole number{long}: correct the URI")
        return int(text)

    def switch(self, name: str) -> bool:
        """Whether an option is 1; 0, or not there: it is not. Raises `InputError`."""
        text = self.options.get(name, "0")
        if text not in ("0", "1"):
            raise InputError(f"{self.text}: found {name}={text}, expected 1, or no such option: correct the URI")
        return text == "1"

    def rate(self) -> float | None:
        """The option `rate`, Hz; None where there is none. Raises `InputError`."""
        if (text := self.options.get("rate")) is None:
            return None
        if not 0.0 < (rate := number_in(text)) < inf:
            raise InputError(f"{self.text}: found the rate {text}, expected Hz, as in rate=500: correct it")
        return rate


def number_in(text: str) -> float:
    """What a text says; NaN where that is no number."""
    try:
        return float(text)
    except ValueError:
        return nan


def parsed(text: str) -> Uri:
    """A URI. Raises `InputError`."""
    try:
        parts = urlsplit(text)
        port, host = parts.port, (parts.hostname or "").encode().decode()  # ValueError of what is no UTF-8
    except ValueError as error:
        raise InputError(f"{text}: found no URI ({error}), expected one like sri://192.168.0.108:4008") from None
    if not parts.scheme:
        raise InputError(f"{text}: found no scheme, expected a URI like sri://{text or '192.168.0.108'}")
    options: dict[str, str] = {}
    for name, value in parse_qsl(parts.query, keep_blank_values=True):
        if options.setdefault(name, value) != value:
            raise InputError(f"{text}: found {name}={options[name]} and {name}={value}, expected one: correct the URI")
    return Uri(text, parts.scheme, host, port, unquote(parts.path), options)


@dataclass(frozen=True)
class Known:
    """A scheme that can be opened, as its class says; `error` where that cannot be loaded."""

    scheme: str
    form: str
    about: str = ""
    rate: str = ""
    tested: str = ""
    error: str = ""


def known_sources() -> list[Known]:
    """All sources, those of other packages too: their classes state FORM, ABOUT, RATE and TESTED, texts all of them."""
    return [_known(scheme, load) for scheme, load in sorted(schemes(SOURCES, SOURCE_GROUP).items())]


def known_sinks() -> list[Known]:
    """All sinks, likewise."""
    return [_known(scheme, load) for scheme, load in sorted(schemes(SINKS, SINK_GROUP).items())]


def _known(scheme: str, load: Callable[[], Any]) -> Known:
    try:
        made = load()
    except Exception as error:  # another package's
        return Known(scheme, f"{scheme}:", error=f"cannot be loaded ({' '.join(str(error).split())})")
    told = {name: str(getattr(made, name.upper(), "")) for name in ("about", "rate", "tested")}
    return Known(scheme, str(getattr(made, "FORM", f"{scheme}:")), **told)


def source_of(text: str) -> Source:
    """The source of a URI, not yet open.

    Args:
        text: the URI, as `ur://192.168.0.2?rate=500`.

    Raises:
        InputError: a scheme that nobody knows, or an option that it does not take.
    """
    source: Source = _made(text, SOURCES, SOURCE_GROUP)
    return source


def file_of(text: str) -> Path | None:
    """The file that a sink's text names, by itself or as file:NAME; None: no file. Raises `InputError`."""
    scheme, colon, name = text.partition(":")
    if not colon:
        return Path(scheme)
    return Path(name) if parsed(text).scheme == "file" else None


def sink_of(text: str) -> Sink:
    """The sink of a URI, or of a file's name, not yet open. Raises `InputError`."""
    sink: Sink = _made(text if ":" in text else f"file:{text}", SINKS, SINK_GROUP)
    return sink


def schemes(known: Mapping[str, str], group: str) -> dict[str, Callable[[], Any]]:
    """What loads the class of each scheme: this package's own, then those of other packages, which takes a while."""
    others = {point.name: point.load for point in entry_points(group=group)}
    return {**others, **{scheme: partial(_own, place) for scheme, place in known.items()}}


def _made(text: str, known: Mapping[str, str], group: str) -> Any:
    uri = parsed(text)
    loaders = {uri.scheme: partial(_own, known[uri.scheme])} if uri.scheme in known else schemes(known, group)
    if uri.scheme not in loaders:
        raise InputError(f"{text}: found the scheme {uri.scheme}, expected one of {', '.join(sorted(loaders))}")
    try:
        return loaders[uri.scheme]()(uri)
    except ContactWrenchError:
        raise
    except Exception as error:
        points = entry_points(group=group, name=uri.scheme) if uri.scheme not in known else ()
        packages = [point.dist.name for point in points if point.dist is not None]
        if packages in ([], [OWN]):
            raise
        kind, said = group.rpartition(".")[2].removesuffix("s"), " ".join(str(error).split())
        found = f"{kind} {uri.scheme} of the package {packages[0]} that failed ({type(error).__name__}: {said})"
        raise InputError(
            f"{text}: found the {found}, expected a device: correct the URI, or report it there"
        ) from error


def _own(place: str) -> Any:
    module, _, name = place.partition(":")
    return getattr(import_module(f".{module}", __package__), name)
