"""contactwrench: from a raw wrist force/torque sensor to the pure contact wrench."""

from .calibrate import calibrate
from .calibration import Calibration
from .compensator.compensator import Compensator
from .compensator.contact_wrench import ContactWrench
from .errors import ContactWrenchError
from .recording import read
from .samples import Samples
from .version import __version__

__all__ = [
    "Calibration",
    "Compensator",
    "ContactWrench",
    "ContactWrenchError",
    "Samples",
    "__version__",
    "calibrate",
    "read",
]
