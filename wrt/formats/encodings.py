"""Text files in the encodings that programs write them in, as UTF-8.

Editors and scripts on Windows begin UTF-8 with a byte-order mark, which is no part of the text, or write UTF-16.
"""

from __future__ import annotations

import codecs

from wrt.errors import InputError

# Longer marks first: that of UTF-32 begins with that of UTF-16.
_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}


def as_utf8(data: bytes) -> bytes:
    """Return the data of a text file without a byte-order mark, and as UTF-8 where the mark tells another encoding.

    Data without a mark are returned as they are, whatever they hold.

    Raises:
        InputError: where they are not in the encoding that the mark tells.
    """
    for mark, encoding in _MARKS.items():
        if data.startswith(mark):
            if encoding == "utf-8":
                return data[len(mark) :]
            try:
                return data.decode(encoding).encode("utf-8")
            except UnicodeDecodeError as error:
                name = encoding.upper()
                raise InputError(f"begins as {name} text and is none (byte {error.start}); save it as UTF-8") from None
    return data


def as_text(data: bytes) -> str:
    """Decode text of any encoding, so that file names in it come out as they were.

    trimesh decodes UTF-8, and needs a library that may not be installed for all else.

    Raises:
        InputError: see `as_utf8`.
    """
    return as_utf8(data).decode("utf-8", "surrogateescape")
