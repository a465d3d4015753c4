"""What YAML would read otherwise than it was meant is refused, with its line."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from companion.config.document import read_document
from companion.config.file import load_config
from companion.errors import ConfigError
from tests.paths import CONFIGS, FIELD_CASES

CASES = sorted(FIELD_CASES.glob("yaml-*/*.yaml"))


def refusal(text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        read_document(text, "F")
    return str(caught.value)


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.name)
def test_the_shipped_files_mean_what_yaml_says(path: Path) -> None:
    assert read_document(path.read_text(), "F") == yaml.safe_load(path.read_text())


@pytest.mark.skipif(not CASES, reason="no field cases beside this clone")
@pytest.mark.parametrize("path", CASES, ids=lambda path: path.name)
def test_field_cases_are_refused_with_file_and_key(path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "line " in str(caught.value) or "neighbours.broadcast: expected four numbers" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a: 1\nb: 2\na: 3\n", "F: line 3: a is there twice, first in line 1; keep one of them"),
        ("g:\n  a: 1\nh: 1\ng:\n  b: 1\n", "F: line 4: g is there twice, first in line 1; keep one of them"),
        ("g: {a: 1, a: 2}\n", "F: line 1: g: a is there twice"),
        ("p:\n- {id: 010}\n", "F: line 2: p.id: 010: a number with a leading 0 is octal in YAML; write 10,"),
        ("p: -017650\n", "write -17650,"),
        ("p: 00.5\n", "write 0.5,"),
        ("p: 1:30\n", "F: line 1: p: 1:30: with colons a number to the base of 60 in YAML; write the plain one"),
        ("p: 1_000\n", "underscores in a number; write 1000,"),
        ("p: 0x1F\n", "not a decimal number"),
        ("p: 2024-02-30\n", "F: line 1: p: 2024-02-30: a date in YAML; quote it"),
        ("p: !!int abc\n", "F: line 1: p: !!int: tags are not read here"),
        ("p: !!python/object:os.system {}\n", "tags are not read here"),
        ("p: &a [*a]\n", "2 errors\n  line 1: p: &a: anchors are not read here"),
        (f"p: {'9' * 5000}\n", "a number of 5000 digits; expected 15 at most"),
        (f"p: {'[' * 6000}\n", "F: line 1: nested more than 20 deep"),
        ("- " * 6000, "F: line 1: nested more than 20 deep"),
        ("p: [1\n", "F: line 2: not valid YAML"),
        ("? [1, 2]\n: 3\n", "F: line 1: expected a word as the key"),
        ("a: 1\n---\nb: 2\n", "F: line 2: a second document begins"),
        ("a: \0\n", "F: line 1: character U+0000, which no text holds (is this UTF-16?)"),
        (
            "a: 1\n# b\u2028c: 2\n",
            "F: line 2: character U+2028, at which YAML begins a new line and an editor does not",
        ),
        ("a: 1\r\n# b\x85c: 2\n", "F: line 2: character U+0085, at which YAML begins a new line"),
        ("a: 1\n\ufeffb: 2\n", "F: line 2: character U+FEFF, which looks like a space or nothing"),
        ("a:\n  b: x\u00a0y\n", "F: line 2: a.b: character U+00A0"),
        ('a: "x\u200b"\n', "F: line 1: a: character U+200B"),
        ("\n".join(f"a: {i}" for i in range(1000)), "F: 999 errors"),
    ],
)
def test_what_yaml_reads_otherwise_is_refused(text: str, expected: str) -> None:
    assert expected in refusal(text)
    assert len(refusal(text).splitlines()) < 25


def test_what_is_plain_is_read() -> None:
    text = (
        'a: 1 # 5\u00a0m\nb: -0.5\nc: 1e-3\nd: yes\ne: off\nf: ~\ng:\nh: "010"\ni: 00:21:06:03:17:05\nj: 0\nk: .5\n'
        "l: [x, 1.5]\nm: 127.0.0.1\nn: .inf\no: serial:///dev/ttyS1:921600\np: '1:30'\nq:\n- ~\n"
    )
    assert read_document(text, "F") == {
        "a": 1, "b": -0.5, "c": 0.001, "d": True, "e": False, "f": None, "g": None, "h": "010",
        "i": "00:21:06:03:17:05", "j": 0, "k": 0.5, "l": ["x", 1.5], "m": "127.0.0.1", "n": float("inf"),
        "o": "serial:///dev/ttyS1:921600", "p": "1:30", "q": [None],
    }  # fmt: skip


@given(st.text(max_size=200) | st.text(alphabet='ab:-[]{}&*!"\n 01?|>#%', max_size=200))
def test_any_text_is_read_or_refused(text: str) -> None:
    """Invariant: values or ConfigError, nothing else, whatever the text."""
    try:
        read_document(text, "F")
    except ConfigError as error:
        assert str(error).startswith("F: ")


def test_a_file_that_is_no_text_or_has_no_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    for data, expected in (
        (b"name: a\nrole: \xe9\n", "line 2: not UTF-8 (byte 0xe9)"),
        (b"# " + b"x" * (300 << 10), "larger than 256 KB"),
    ):
        path.write_bytes(data)
        with pytest.raises(ConfigError, match=str(path)) as caught:
            load_config(path)
        assert expected in str(caught.value)
    for wrong in (Path("/dev/zero"), tmp_path, tmp_path / ("n" * 300), Path("a\0b")):
        with pytest.raises(ConfigError):
            load_config(wrong)
