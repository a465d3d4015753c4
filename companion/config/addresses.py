"""Addresses of cards and hosts, as a configuration writes them."""

from __future__ import annotations

from typing import Annotated, Final

from msgspec import Meta

_END = r"$(?!\n)"
"""Of a text: before a line end, which may be there behind the last line, `$` alone is one too."""
Mac = Annotated[
    str,
    Meta(
        pattern=rf"^([0-9A-Fa-f]{{2}}:){{5}}[0-9A-Fa-f]{{2}}{_END}",
        description="six pairs of hexadecimal digits with colons between them, for example 00:21:6A:3F:17:5A",
    ),
]
_OCTET = r"(25[0-5]|2[0-4]\d|1\d\d|[1-9]?\d)"
IPV4: Final = rf"({_OCTET}\.){{3}}{_OCTET}"
"""Four numbers, as a part of a pattern."""
Ipv4 = Annotated[
    str,
    Meta(
        pattern=rf"^{IPV4}{_END}",
        description="four numbers of 0 to 255 without a leading 0, for example 192.168.1.255",
    ),
]
