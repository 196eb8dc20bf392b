"""Read colours: numbers, RGB and spectra as linear Rec. 709.

Spectra are converted with the CIE 1931 observer. An emission spectrum becomes ∫ L r dλ / ∫ y dλ, where r is the Rec.
709 combination of the matching functions; radiance is in W·sr⁻¹·m⁻²·nm⁻¹ as in Mitsuba, and a constant spectrum is a
little red. A reflectance spectrum is lit by D65, ∫ s D65 r dλ / ∫ D65 r dλ, so a constant spectrum is grey.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrt.io.measured.observer import D65, OBSERVER, RESPONSE, WAVELENGTHS
from wrt.io.mitsuba.document import Document, Element
from wrt.io.mitsuba.plugin import Plugin, plugin_of
from wrt.io.mitsuba.transforms import numbers_of, vector_of
from wrt.io.safe_read import as_utf8, read_file
from wrt.linalg import product
from wrt.scene.srgb import linear_from_srgb
from wrt.values import Vec3, vec3

COLOR_TAGS = ("rgb", "spectrum", "float", "integer", "srgb", "color", "blackbody")  # elements that give a colour
LUMINOUS = float(OBSERVER[:, 1].sum())  # ∫ y dλ, nm, which normalises radiance summed over wavelengths

# Planck's constant, J s; the speed of light, m/s; Boltzmann's constant, J/K (SI, exact since 2019).
_PLANCK, _LIGHT, _BOLTZMANN = 6.62607015e-34, 299792458.0, 1.380649e-23

Spectrum = NDArray[np.float64]  # (N,) values at WAVELENGTHS


def emitted(spectrum: Spectrum) -> Vec3:
    """Return the colour of an emission spectrum, clipped at 0 outside Rec. 709."""
    return _color(product(spectrum, RESPONSE) / LUMINOUS)


def reflected(spectrum: Spectrum) -> Vec3:
    """Return the colour of a reflectance spectrum, or of a spectrum of refractive indices, under D65."""
    return _color(product(spectrum * D65, RESPONSE) / product(D65, RESPONSE))


def _color(rgb: NDArray[np.float64]) -> Vec3:
    return vec3(np.maximum(rgb, 0.0))


def blackbody(kelvin: float) -> Spectrum:
    """Return the spectral radiance of a black body, W·sr⁻¹·m⁻²·nm⁻¹ (Planck 1901)."""
    metres = WAVELENGTHS * 1e-9
    exponent = _PLANCK * _LIGHT / (metres * _BOLTZMANN * kelvin)
    return np.asarray(2e-9 * _PLANCK * _LIGHT**2 / (metres**5 * np.expm1(np.minimum(exponent, 700.0))))


def color_of(element: Element, document: Document, *, emits: bool) -> Vec3:
    """Return the linear Rec. 709 colour of an element with one of COLOR_TAGS, as emission or as reflectance."""
    if element.tag in ("rgb", "color", "srgb"):
        return _rgb(element)
    if element.tag == "blackbody":
        kelvin = numbers_of(element, element.get("temperature").rstrip("kK"), 1)[0]
        scale = numbers_of(element, element.attributes.get("scale", "1"), 1)[0]
        return emitted(scale * _blackbody(element, kelvin))
    color_from = emitted if emits else reflected
    if element.attributes.get("type"):
        return _by_plugin(plugin_of(element, document), color_from)
    if "filename" in element.attributes:
        return color_from(_from_file(element, document.file(element, element.get("filename"))))
    words = element.get("value").replace(",", " ").split()
    pairs = [word.split(":") for word in words]
    if all(len(pair) == 1 for pair in pairs):
        if document.old and len(words) == 3:  # the usual build of version 0.6 took them for a colour
            return vec3(numbers_of(element, " ".join(words), 3))
        value = numbers_of(element, " ".join(words), 1)[0]
        return (value,) * 3 if element.tag != "spectrum" else color_from(np.full(len(WAVELENGTHS), value))
    if any(len(pair) != 2 for pair in pairs):
        raise element.error(f"{element.label} must be one number or a list of wavelength:value")
    wavelengths, values = zip(*(numbers_of(element, " ".join(pair), 2) for pair in pairs), strict=True)
    return color_from(_interpolated(element, wavelengths, values))


def _rgb(element: Element) -> Vec3:
    text = element.get("value").strip()
    if text.startswith("#"):
        if re.fullmatch("#[0-9a-fA-F]{6}", text) is None:
            raise element.error(f"{element.label} must be three numbers or #rrggbb, not {text!r}")
        return vec3(linear_from_srgb(np.array([*bytes.fromhex(text[1:])]) / 255.0))
    numbers = vector_of(element)
    return vec3(linear_from_srgb(np.array(numbers))) if element.tag == "srgb" else numbers


def _interpolated(element: Element, wavelengths: Sequence[float], values: Sequence[float]) -> Spectrum:
    """Interpolate a spectrum from wavelengths, nm, and values; outside them it is 0."""
    if len(wavelengths) < 2 or (np.diff(wavelengths) <= 0.0).any():
        raise element.error(f"{element.label}: a spectrum needs at least two wavelengths in ascending order")
    return np.asarray(np.interp(WAVELENGTHS, wavelengths, values, left=0.0, right=0.0))


def _from_file(element: Element, path: Path) -> Spectrum:
    """Return the spectrum in a text file of wavelengths, nm, and values."""
    try:
        lines = [line.split("#")[0].split() for line in as_utf8(read_file(path)).decode("utf-8").splitlines()]
        rows = [(float(line[0]), float(line[1])) for line in lines if line]
    except (OSError, ValueError, IndexError):
        raise element.error(f"{path}: not a spectrum: each line must have a wavelength and a value") from None
    return _interpolated(element, [row[0] for row in rows], [row[1] for row in rows])


def _blackbody(element: Element, kelvin: float) -> Spectrum:
    if not 0.0 < kelvin < 1e9:
        raise element.error(f"a temperature must be above 0 and below 1e9 K, not {kelvin:g}")
    return blackbody(kelvin)


def _by_plugin(plugin: Plugin, color_from: Callable[[Spectrum], Vec3]) -> Vec3:
    """Return the colour of a spectrum plugin."""
    element = plugin.element
    result: Vec3
    if plugin.type == "blackbody":
        plugin.ignore("wavelength_min", "wavelength_max")
        spectrum = _blackbody(element, plugin.number("temperature", 5000.0))
        result = emitted(plugin.number("scale", 1.0) * spectrum)
    elif plugin.type in ("uniform", "d65"):
        plugin.ignore("wavelength_min", "wavelength_max")
        result = (plugin.number("scale", 1.0) * plugin.number("value", 1.0),) * 3
    elif plugin.type in ("rgb", "srgb"):
        inner = plugin.value("color", "rgb", "color") or plugin.value("value", "rgb", "color")
        result = (0.5, 0.5, 0.5) if inner is None else _rgb(inner)
    elif plugin.type in ("irregular", "regular"):
        values = numbers_of(element, plugin.text("values", ""))
        if plugin.type == "irregular":
            wavelengths = numbers_of(element, plugin.text("wavelengths", ""))
        else:
            low, high = plugin.number("wavelength_min", 360.0), plugin.number("wavelength_max", 830.0)
            wavelengths = tuple(np.linspace(low, high, len(values)).tolist())
        if len(values) != len(wavelengths):
            raise element.error(f"{plugin.label} has {len(wavelengths)} wavelengths and {len(values)} values")
        result = color_from(_interpolated(element, wavelengths, values))
    else:
        plugin.warn("this kind of spectrum is not known; 0.5 stands in for it")
        result = (0.5, 0.5, 0.5)
    return result
