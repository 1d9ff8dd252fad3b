"""contactwrench: from a raw wrist force/torque sensor to the pure contact wrench."""

from .calibration.calibration import Calibration
from .compensate.compensator import Compensator
from .compensate.contact_wrenches import ContactWrench
from .errors import ContactWrenchError
from .estimation.calibrate import calibrate
from .recording.read import read
from .samples.samples import Samples
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
