"""Boot numbers that outlive the process."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from companion.errors import ConfigError
from companion.neighbours.boots import BootBook
from tests.datagrams import boot


def test_boot_numbers_rise_over_restarts_and_a_broken_book_is_fatal(tmp_path: Path) -> None:
    numbers = []
    for _ in range(3):
        book = BootBook(tmp_path)
        numbers.append(book.own_boot_id >> 32)
        book.note(2, boot(4), 17)
        book.close()
    assert numbers == [1, 2, 3]
    book = BootBook(tmp_path)
    reached = book.reached(2)
    book.close()
    assert reached is not None
    assert (reached.boot_id, reached.ceiling) == (boot(4), 67)
    content = msgspec.json.decode((tmp_path / "boots.json").read_bytes())
    assert content["own"] == 4
    (tmp_path / "boots.json").write_text("{")
    with pytest.raises(ConfigError, match="new keys"):
        BootBook(tmp_path)
    with pytest.raises(ConfigError, match="cannot be written"):
        BootBook(Path("/proc/nowhere"))


def test_fault_64_a_second_service_with_one_state_folder_is_refused(
    tmp_path: Path,
) -> None:
    first = BootBook(tmp_path)
    first.note(2, boot(4), 17)
    with pytest.raises(ConfigError, match=r"state_dir: .*boots\.json is in use by another companion service"):
        BootBook(tmp_path)
    first.close()
    second = BootBook(tmp_path)
    reached = second.reached(2)
    second.close()
    assert reached is not None
    assert reached.ceiling == 67
