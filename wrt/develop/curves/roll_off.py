"""The highlight compression of Khronos PBR Neutral, shared by two curves."""

from __future__ import annotations

from wrt.develop.curves.curve import Colors

DESATURATION = 0.15
"""How fast compressed colours go to white."""


def roll_off(colors: Colors, start: float) -> Colors:
    """Compress colours whose largest channel exceeds `start`, so that it stays below 1, and blend them with white.

    Below `start` colours do not change. Value and slope of the largest channel p are continuous there:
    p' = 1 − d² / (p + d − start), with d = 1 − start. Ratios of channels, and so the hue, are kept; then the colour
    goes to white as the compression takes more away (Khronos Group, "PBR Neutral Tone Mapper", 2024).

    Args:
        colors: (..., 3) linear values.
        start: the largest channel from which on colours are compressed, 0 to 1.
    """
    is_bright = colors.max(axis=-1) > start
    result = colors.copy()
    bright = colors[is_bright]
    peak = bright.max(axis=-1, keepdims=True)
    room = 1.0 - start
    compressed = 1.0 - room * room / (peak + room - start)
    white = 1.0 - 1.0 / (DESATURATION * (peak - compressed) + 1.0)
    bright = bright * (compressed / peak)
    result[is_bright] = bright + (compressed - bright) * white
    return result
