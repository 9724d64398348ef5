"""Text of others inside C: in strings and in comments."""

from __future__ import annotations

import re


def c_string(name: str) -> str:
    """A C string of `name`; what is not plain ASCII as octal bytes of UTF-8."""
    plain = (chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f"\\{b:03o}" for b in name.encode())
    return f'"{"".join(plain)}"'


def comment(text: str) -> str:
    """A `text` that neither ends a comment nor begins another."""
    return re.sub(r"[^ -~]|\*/|/\*|\\|\?\?", "?", text)
