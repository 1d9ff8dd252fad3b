"""While the arm runs: sensors and robots over the network, a session that guides and compensates, sinks and a page.

    with contactwrench.live.open("netft://192.168.1.1") as sensor:
        for batch in sensor:
            print(batch.t, batch.wrench)

`Session` is what happens, without threads, sockets or a clock; `pump.py` runs it on devices; `sources/` and `sinks/`
have one file a device, and other packages add theirs by entry points (`contactwrench.sources`, `contactwrench.sinks`).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .session import Session
    from .stream import open_stream as open

__all__ = ["Session", "open"]

_HOMES = {"Session": ("session", "Session"), "open": ("stream", "open_stream")}


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, inner = _HOMES[name]
    value = globals()[name] = getattr(import_module(f".{module}", __name__), inner)
    return value
