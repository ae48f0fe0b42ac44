"""Shared by the readers of text formats: lines of a file, and the numbers in them."""

import codecs
from math import isfinite
from pathlib import Path

from pps_vision.files import read_bytes


def read_lines(file: Path, expected: str, errors: str = "replace") -> list[str]:
    """Return the lines of a file without a byte-order mark; bytes that are not UTF-8 become U+FFFD, or what `errors`
    says.  InputError where the file cannot be read; the message ends in `expected`."""
    content = read_bytes(file, expected)
    is_utf16 = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))  # as PowerShell and Excel write it
    return content.decode("utf-16" if is_utf16 else "utf-8-sig", errors).split("\n")


def first_row(file: Path) -> str:
    """Return the first line of a file without its line break, at most 10 000 characters; "" where it cannot be read."""
    try:
        if not file.is_file():
            return ""
        with file.open(encoding="utf-8-sig", errors="replace") as stream:
            return stream.readline(10_000).strip()
    except OSError:  # reported where the whole file is read
        return ""


def number(word: str) -> float:
    """Return the number that a word spells, NaN and infinity included; ValueError if it spells none.

    Stricter than `float`: digits are ASCII and not grouped, since "1_5" is a typing error.
    """
    if "_" in word or not word.isascii():
        raise ValueError(f"'{word}' is no number")
    return float(word)


def finite(word: str) -> float:
    """Return the finite number that a word spells; ValueError if it spells none."""
    value = number(word)
    if not isfinite(value):
        raise ValueError(f"'{word}' is not finite")
    return value


def whole(word: str) -> int:
    """Return the whole number that a word spells in digits; ValueError if it spells none."""
    if not word.isascii() or not word.removeprefix("-").isdecimal():
        raise ValueError(f"'{word}' is no whole number")
    return int(word)
