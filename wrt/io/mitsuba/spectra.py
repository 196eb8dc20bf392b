"""Read colours: numbers, RGB and spectra as linear Rec. 709.

Spectra are converted with the CIE 1931 observer. An emission spectrum becomes ∫ L r dλ / ∫ y dλ, where r is the Rec.
709 combination of the matching functions; radiance is in W·sr⁻¹·m⁻²·nm⁻¹ as in Mitsuba, and a constant spectrum is a
little red. A reflectance spectrum is lit by D65, ∫ s D65 r dλ / ∫ D65 r dλ, so a constant spectrum is grey.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.io.encodings import as_utf8
from wrt.io.measured.observer import D65, OBSERVER, RESPONSE, WAVELENGTHS
from wrt.io.mitsuba.document import Document, Element
from wrt.io.mitsuba.plugin import Plugin
from wrt.io.mitsuba.transforms import numbers_of
from wrt.io.safe_read import read_file
from wrt.linalg import product
from wrt.scene.srgb import linear_from_srgb
from wrt.values import Vec3, vec3

COLOR_TAGS = ("rgb", "spectrum", "float", "integer", "srgb", "color", "blackbody")
"""Elements that give a colour."""

LUMINOUS = float(OBSERVER[:, 1].sum())
"""∫ y dλ, nm, which normalises radiance summed over wavelengths."""

# Planck's constant, J s; the speed of light, m/s; Boltzmann's constant, J/K (SI, exact since 2019).
_PLANCK, _LIGHT, _BOLTZMANN = 6.62607015e-34, 299792458.0, 1.380649e-23

Spectrum = NDArray[np.float64]
"""(N,) values at WAVELENGTHS."""


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


def color_of(element: Element, document: Document, *, shines: bool) -> Vec3:
    """Return the linear Rec. 709 colour of an element.

    Args:
        element: one of COLOR_TAGS.
        document: the document, to find files.
        shines: whether it is emission rather than reflectance.

    Raises:
        InputError: when its numbers cannot be read.
    """
    if element.tag in ("float", "integer"):
        grey = numbers_of(element, element.get("value"), 1)[0]
        return grey, grey, grey
    if element.tag in ("rgb", "color", "srgb"):
        return _rgb(element)
    if element.tag == "blackbody":
        kelvin = numbers_of(element, element.get("temperature").rstrip("kK"), 1)[0]
        scale = numbers_of(element, element.attributes.get("scale", "1"), 1)[0]
        return emitted(scale * blackbody(_temperature(element, kelvin)))
    if element.attributes.get("type"):
        return _typed(Plugin(element, document), shines)
    if "filename" in element.attributes:
        return _seen(_from_file(element, document), shines)
    text = element.get("value")
    if document.old and len(text.replace(",", " ").split()) == 3 and ":" not in text:
        return vec3(np.array(numbers_of(element, text, 3)))  # what the usual build of version 0.6 took for a colour
    return _listed(element, text, shines)


def _rgb(element: Element) -> Vec3:
    text = element.get("value").strip()
    if text.startswith("#"):
        try:
            code = int(text[1:], 16) if len(text) == 7 else -1
        except ValueError:
            code = -1
        if code < 0:
            raise element.error(f"{element.label} must be three numbers or #rrggbb, not {text!r}")
        return vec3(linear_from_srgb(np.array([code >> 16, code >> 8 & 255, code & 255]) / 255.0))
    numbers = numbers_of(element, text, 1, 3)
    if element.tag == "srgb":
        numbers = tuple(float(x) for x in linear_from_srgb(np.array(numbers)))
    return (numbers[0],) * 3 if len(numbers) == 1 else (numbers[0], numbers[1], numbers[2])


def _seen(spectrum: Spectrum, shines: bool) -> Vec3:
    return emitted(spectrum) if shines else reflected(spectrum)


def _listed(element: Element, text: str, shines: bool) -> Vec3:
    """Return the colour of a constant spectrum, or of a list of wavelength:value."""
    if ":" not in text:
        value = numbers_of(element, text, 1)[0]
        return _seen(np.full(len(WAVELENGTHS), value), shines)
    pairs = [word.split(":") for word in text.replace(",", " ").split()]
    if any(len(pair) != 2 for pair in pairs):
        raise element.error(f"{element.label} must be one number or a list of wavelength:value, not {text[:60]!r}")
    numbers = [numbers_of(element, " ".join(pair), 2) for pair in pairs]
    return _seen(_interpolated(element, numbers), shines)


def _interpolated(element: Element, pairs: list[tuple[float, ...]]) -> Spectrum:
    """Interpolate a spectrum from pairs of wavelength, nm, and value; outside them it is 0."""
    wavelengths, values = np.array(pairs).T if pairs else (np.zeros(0), np.zeros(0))
    if len(wavelengths) < 2 or (np.diff(wavelengths) <= 0.0).any():
        raise element.error(f"{element.label}: a spectrum needs at least two wavelengths in ascending order")
    return np.asarray(np.interp(WAVELENGTHS, wavelengths, values, left=0.0, right=0.0))


def _from_file(element: Element, document: Document) -> Spectrum:
    """Return the spectrum in a text file of wavelengths, nm, and values."""
    path = document.file(element, element.get("filename"))
    try:
        lines = [line.split("#")[0].split() for line in as_utf8(read_file(path)).decode("utf-8").splitlines()]
        pairs = [(float(line[0]), float(line[1])) for line in lines if line]
    except (OSError, ValueError, IndexError):
        raise element.error(f"{path}: not a spectrum: each line must have a wavelength and a value") from None
    return _interpolated(element, [tuple(pair) for pair in pairs])


def _temperature(element: Element, kelvin: float) -> float:
    if not 0.0 < kelvin < 1e9:
        raise element.error(f"a temperature must be above 0 and below 1e9 K, not {kelvin:g}")
    return kelvin


def _typed(plugin: Plugin, shines: bool) -> Vec3:
    """Return the colour of a spectrum plugin."""
    element = plugin.element
    if plugin.type == "blackbody":
        kelvin = _temperature(element, plugin.number("temperature", 5000.0))
        plugin.ignore("wavelength_min", "wavelength_max")
        result = emitted(plugin.number("scale", 1.0) * blackbody(kelvin))
    elif plugin.type == "uniform":
        result = (plugin.number("value", 1.0),) * 3
        plugin.ignore("wavelength_min", "wavelength_max")
    elif plugin.type == "d65":
        result = (plugin.number("scale", 1.0) * plugin.number("value", 1.0),) * 3
    elif plugin.type in ("rgb", "srgb"):
        inner = plugin.value("color", "rgb", "color") or plugin.value("value", "rgb", "color")
        result = (0.5, 0.5, 0.5) if inner is None else _rgb(inner)
    elif plugin.type in ("irregular", "regular"):
        result = _seen(_tabulated(plugin), shines)
    else:
        plugin.warn("this kind of spectrum is not known; 0.5 stands in for it")
        return 0.5, 0.5, 0.5
    plugin.finish()
    return result


def _tabulated(plugin: Plugin) -> Spectrum:
    element = plugin.element
    values = numbers_of(element, plugin.text("values", ""))
    if plugin.type == "irregular":
        wavelengths = numbers_of(element, plugin.text("wavelengths", ""))
    else:
        low, high = plugin.number("wavelength_min", 360.0), plugin.number("wavelength_max", 830.0)
        wavelengths = tuple(float(x) for x in np.linspace(low, high, len(values)))
    if len(values) != len(wavelengths):
        raise element.error(f"{plugin.label} has {len(wavelengths)} wavelengths and {len(values)} values")
    return _interpolated(element, list(zip(wavelengths, values, strict=True)))
