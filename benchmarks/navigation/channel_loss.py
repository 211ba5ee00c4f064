"""The computed share of lone packets that the channel loses at a range, as the reference for simulated packets."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from auv_lse_common.mission_file.sections.world import ChannelConfig
from auv_lse_common.support.arrays import Array
from auv_lse_sim.water.channel import frame_error_rate, snr_db


def loss_at_range(range_m: ArrayLike, config: ChannelConfig) -> Array:
    """Chance that a lone packet of one frame is not read at each range, fading and random loss included."""
    config = config.in_force
    ratio = snr_db(range_m, config)
    if not config.frame_errors:
        error = np.zeros_like(ratio)
    elif config.fading_db == 0.0:
        error = frame_error_rate(ratio, config.rate)
    else:
        # mean over the fading by the midpoints of 1000 equally likely parts of the normal distribution
        parts = ndtri((np.arange(1000) + 0.5) / 1000.0)
        error = frame_error_rate(ratio[..., None] + config.fading_db * parts, config.rate).mean(axis=-1)
    return np.asarray(1.0 - (1.0 - error) * (1.0 - config.packet_loss))
