"""A zero of its own for each recording: the bias that its first seconds tell, in which the tool is free and at rest."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..calibration.calibration import Calibration
from ..compensate.bias_tracking import free_mean
from ..errors import InputError
from ..estimation.calibrate import calibrate
from ..samples.samples import Samples
from ..samples.synchronize import synchronized
from .options import Options
from .read import batches


def with_zero_of(path: str | Path, options: Options, calibration: Calibration, seconds: float) -> Calibration:
    """The calibration with the bias of a recording's first `seconds`, at which nothing may touch the tool.

    Raises `InputError` where these move, scatter or are too few, and as reading and pairing raise it.
    """
    first, begin = list[Samples](), np.nan
    for part in synchronized(batches(path, options)):
        samples = part.samples
        if samples.t is None or not len(samples):
            continue
        begin = samples.t[0] if np.isnan(begin) else begin
        first.append(samples.select(samples.t < begin + seconds))
        if len(first[-1]) < len(samples):
            break
    wrench = np.concatenate([np.empty((0, 6)), *(samples.wrench for samples in first)])
    orientation = np.concatenate([np.empty((0, 3, 3)), *(samples.R_base_flange for samples in first)])
    try:
        _, _, R = free_mean(calibration, Samples(wrench, orientation), None)
    except InputError as error:
        raise InputError(f"{path}, its first {seconds:g} s: {error}") from None
    zeroed = calibrate(Samples(wrench, np.broadcast_to(R, orientation.shape), source=str(path)), prior=calibration)
    return replace(zeroed, still_noise=calibration.still_noise)
