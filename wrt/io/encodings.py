"""Conversion of text files to UTF-8 by their byte-order marks.

Programs on Windows often write UTF-16, or UTF-8 with a byte-order mark, which is not part of the text.
"""

from __future__ import annotations

import codecs

from wrt.errors import InputError

# Longer marks first: the UTF-32 mark starts with the UTF-16 mark.
_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}


def as_utf8(data: bytes) -> bytes:
    """Return the data of a text file as UTF-8 without a byte-order mark; the mark tells the encoding.

    Data without a mark are returned unchanged.

    Raises:
        InputError: where the data are not valid in the encoding of the mark.
    """
    for mark, encoding in _MARKS.items():
        if data.startswith(mark):
            if encoding == "utf-8":
                return data[len(mark) :]
            try:
                return data.decode(encoding).encode("utf-8")
            except UnicodeDecodeError as error:
                name = encoding.upper()
                raise InputError(f"begins as {name} text but is invalid (byte {error.start}); save as UTF-8") from None
    return data


def as_text(data: bytes) -> str:
    """Decode the data of a text file; bytes that are not UTF-8 survive as surrogates, so that file names keep working.

    trimesh itself decodes only UTF-8 without an optional library.

    Raises:
        InputError: see `as_utf8`.
    """
    return as_utf8(data).decode("utf-8", "surrogateescape")
