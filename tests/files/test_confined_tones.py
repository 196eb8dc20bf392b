"""A confined scene names no configuration of OpenColorIO: it would open files anywhere when a picture is developed."""

from __future__ import annotations

from pathlib import Path

import pytest

import wrt

SCENE = """
settings = {{ tone = "{tone}" }}
camera = {{ origin = [0, 0, 5], target = [0, 0, 0] }}
environment = {{ type = "constant", radiance = 1.0 }}
shapes = [{{ type = "sphere" }}]
"""


@pytest.mark.parametrize("tone", ["ocio:config.ocio", "ocio:/etc/passwd,sRGB", "ocio:missing.ocio"])
def test_files_of_tone_curves_are_refused(tone: str, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE.format(tone=tone))
    (tmp_path / "config.ocio").write_text("ocio_profile_version: 2\n")
    with pytest.raises(wrt.InputError, match="names a file, which is not read in confinement"):
        wrt.load(tmp_path / "scene.toml", confined=True)
    assert wrt.load(tmp_path / "scene.toml").settings.tone == tone


@pytest.mark.parametrize("tone", ["soft", "ocio", "ocio:,sRGB - Display", "ocio:ocio://default,sRGB - Display"])
def test_tone_curves_without_files_are_not(tone: str, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE.format(tone=tone))
    assert wrt.load(tmp_path / "scene.toml", confined=True).settings.tone == tone
