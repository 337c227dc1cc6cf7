"""The colour scale of signed efforts: blue for negative, nearly white for zero, orange for positive.

Lightness falls evenly with magnitude on both sides, in the OKLab colour space (Ottosson 2020), so that equal steps of
effort look equally large. Blue and orange stay apart under every common colour blindness, and the sign is written
beside the scale for those who see neither.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["diverging", "hexadecimal"]

_NEGATIVE_HUE, _POSITIVE_HUE = np.radians(257.0), np.radians(48.0)
_LIGHTEST, _DARKEST = 0.95, 0.47
_CHROMA = 0.14

# OKLab to the cube roots of the cone responses, and these to linear sRGB.
_TO_CONES = np.array(
    [[1.0, 0.3963377774, 0.2158037573], [1.0, -0.1055613458, -0.0638541728], [1.0, -0.0894841775, -1.2914855480]]
)
_TO_RGB = np.array(
    [
        [4.0767416621, -3.3077115913, 0.2309699292],
        [-1.2684380046, 2.6097574011, -0.3413193965],
        [-0.0041960863, -0.7034186147, 1.7076147010],
    ]
)


def diverging(values: ArrayLike) -> np.ndarray:
    """Colours of numbers between -1 and 1.

    Parameters
    ----------
    values : array_like, shape (...,)
        Numbers; those beyond ±1 get the end's colour.

    Returns
    -------
    numpy.ndarray, shape (..., 3)
        Red, green and blue, sRGB, 0..1.
    """
    share = np.clip(np.asarray(values, dtype=float), -1.0, 1.0)
    size = np.abs(share)
    lightness = _LIGHTEST - (_LIGHTEST - _DARKEST) * size
    chroma = _CHROMA * (1.0 - (1.0 - size) ** 2)
    hue = np.where(share < 0.0, _NEGATIVE_HUE, _POSITIVE_HUE)
    lab = np.stack([lightness, chroma * np.cos(hue), chroma * np.sin(hue)], axis=-1)
    linear = np.clip((lab @ _TO_CONES.T) ** 3 @ _TO_RGB.T, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


def hexadecimal(colour: ArrayLike) -> str:
    """A colour as style sheets write it, from red, green and blue in 0..1."""
    return "#" + "".join(f"{round(255 * channel):02x}" for channel in np.asarray(colour, dtype=float))
