"""contactwrench: from a raw wrist force/torque sensor to the pure contact wrench."""

from importlib import import_module

from .version import __version__

TYPE_CHECKING = False  # that of `typing`, which takes as long as all that comes before a signal is heard (__main__.py)
if TYPE_CHECKING:
    from typing import Any

    from . import live
    from .calibration.calibration import Calibration
    from .compensate.compensator import Compensator
    from .compensate.contact_wrenches import ContactWrench
    from .errors import ContactWrenchError
    from .estimation.calibrate import calibrate
    from .recording.read import read
    from .samples.samples import Samples

__all__ = [
    "Calibration",
    "Compensator",
    "ContactWrench",
    "ContactWrenchError",
    "Samples",
    "__version__",
    "calibrate",
    "live",
    "read",
]

_HOMES = {
    "Calibration": "calibration.calibration",
    "Compensator": "compensate.compensator",
    "ContactWrench": "compensate.contact_wrenches",
    "ContactWrenchError": "errors",
    "Samples": "samples.samples",
    "calibrate": "estimation.calibrate",
    "read": "recording.read",
}


def __getattr__(name: str) -> "Any":
    """A public name, imported when it is first asked for: the program's `--help` needs none of them."""
    if name == "live":
        return import_module(".live", __name__)
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    return value


def __dir__() -> list[str]:
    return __all__
