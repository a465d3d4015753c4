"""Everybody connected gets each item, in order, one after the other."""

from __future__ import annotations

from companion.core.output import Output


def test_sinks_get_each_item_in_the_order_of_connection() -> None:
    output, got = Output[int](), list[tuple[str, int]]()
    output.give(1)  # nobody need listen
    output.connect(lambda item: got.append(("a", item)), lambda item: got.append(("b", item)))
    output.connect(lambda item: got.append(("c", item)))
    output.give(2)
    output.give(3)
    assert got == [("a", 2), ("b", 2), ("c", 2), ("a", 3), ("b", 3), ("c", 3)]
