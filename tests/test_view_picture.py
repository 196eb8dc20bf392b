"""What the live view shows is what PNG files hold."""

from __future__ import annotations

import numpy as np
import pytest

import wrt
from wrt.develop.tones import CURVES
from wrt.view.picture import Look, develop


@pytest.mark.parametrize("tone", CURVES)
def test_a_frame_has_the_codes_of_the_file_but_for_dither(tone: str) -> None:
    radiance = np.random.default_rng(1).exponential(0.6, (48, 64, 3)).astype(np.float32)
    radiance[:4] *= 1e3
    radiance[0, :4] = np.array([np.nan, np.inf, 3e38, 1e9])[:, None]
    for exposure in (-1.5, 0.0):
        file = wrt.develop_image(radiance, tone=tone, exposure=exposure).astype(int)
        assert np.abs(develop(radiance, Look(exposure, tone)).astype(int) - file).max() <= 1
