"""Headers of C++ are whole, and have the constants of Python; `tests/cuda/test_cuda_compile.py` compiles them."""

import re
from pathlib import Path

from conftest import ROOT

from wrt.kernels import native

FOLDER = Path(native.__file__).parent
HEADERS = sorted(str(path.relative_to(FOLDER)) for path in FOLDER.rglob("*.h"))


def test_modules_depend_on_no_file_and_constants_are_those_of_python():
    """Warp hashes the text that a module gets, so it must be whole."""
    for name in HEADERS:
        text = native.text_of(name)
        assert "#include" not in text
        assert str(ROOT) not in text
        assert len(re.findall(r"^#ifndef WRT_\w+_H$", text, re.MULTILINE)) == len(set(native.headers_of(name)))
    text = native.constants_header()
    assert f"constexpr int NODE_FLOATS = {native.constants.NODE_FLOATS};" in text
    assert f"constexpr double BOX_PAD = {native.constants.BOX_PAD};" in text
