"""Integers that TOML does not allow are refused before anything shows them: Python does not print 5,000 digits."""

from __future__ import annotations

from pathlib import Path

import pytest

import wrt


@pytest.mark.parametrize("number", [f"0x{'f' * 5000}", f"0o{'7' * 5000}", "9" * 5000, str(2**63), "-" + "9" * 20])
def test_integers_of_more_than_64_bits_are_refused(number: str, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(f"[settings]\nwidth = {number}\n")
    with pytest.raises(wrt.InputError, match=r"not TOML: .*an integer of more than 64 bits"):
        wrt.load(tmp_path / "scene.toml")
