"""README and docs/: short enough to be read, and everything they name is there."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from companion.cli import program
from tests.paths import DOCS, ROOT
from tests.printed_commands import NOT_RUN, RUN, mentioned, printed

README = ROOT / "README.md"
PAGES = [README, *sorted(DOCS.glob("*.md"))]
RESULTS = sorted((DOCS / "results").glob("*.md"))
EVERY = [*PAGES, *RESULTS]
WORDS = 1800
PICTURE_BYTES = 200_000
_LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
_MODULE = re.compile(r"(?<![\w/.])(?:companion|wsr|csi_bridge|benchmarks|tests)(?:\.[A-Za-z_]\w*)+")
_FILE = re.compile(r"(?<![\w/.])(?:companion|wsr|csi_bridge|benchmarks|tests|configs|systemd|docs)/[\w./-]*\w")
_TEST = re.compile(r"`([\w/]*test_\w+\.py)?(?:::)?(test_\w+)?`")
_STOP = re.compile(r"`([\w/]+\.py):([\w.]+)`")
_NO_MODULES = {"companion.yaml", "companion.service"}


def by_name(paths: list[Path]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("path", paths, ids=[str(path.relative_to(ROOT)) for path in paths])


@by_name(PAGES)
def test_a_page_is_short_enough_to_be_read(path: Path) -> None:
    assert len(path.read_text().split()) <= WORDS, f"{path.name}: move what nobody reads end to end to docs/results/"


@by_name(sorted(DOCS.glob("*.md")))
def test_a_page_begins_with_what_the_reader_can_do(path: Path) -> None:
    title, empty, first = path.read_text().splitlines()[:3]
    assert title.startswith("# ") and not empty
    assert first.startswith("What you can do here: ")


def test_the_readme_fits_on_two_screens() -> None:
    lines = README.read_text().splitlines()
    assert len(lines) <= 95
    assert [line for line in lines if len(line) > 100] == []


def test_the_readme_shows_a_flight_and_a_profile() -> None:
    shown = [link for link in _LINK.findall(README.read_text()) if link.endswith(".png")]
    assert shown == ["docs/pictures/flight.png", "docs/pictures/profile.png"]


@by_name(sorted((DOCS / "pictures").glob("*")))
def test_a_picture_is_small_and_shown_somewhere(path: Path) -> None:
    assert path.stat().st_size < PICTURE_BYTES
    assert any(f"pictures/{path.name})" in page.read_text() for page in PAGES)


@by_name(EVERY)
def test_every_relative_link_leads_somewhere(path: Path) -> None:
    for link in _LINK.findall(path.read_text()):
        if "://" not in link:
            name, _, anchor = link.partition("#")
            target = path.parent / name if name else path
            assert target.exists(), link
            assert not anchor or anchor in set(_anchors(target)), link


@by_name([page for page in EVERY if page != README])
def test_every_page_is_linked(path: Path) -> None:
    links = {
        (page.parent / link.partition("#")[0]).resolve() for page in PAGES for link in _LINK.findall(page.read_text())
    }
    assert path in links


@by_name(EVERY)
def test_every_module_that_is_named_is_there(path: Path) -> None:
    for name in sorted(set(_MODULE.findall(path.read_text())) - _NO_MODULES):
        assert _is_there(name), f"{path.name} names {name}"


@by_name(EVERY)
def test_every_file_that_is_named_is_there(path: Path) -> None:
    for name in sorted(set(_FILE.findall(path.read_text()))):
        assert (ROOT / name).exists(), f"{path.name} names {name}"


def test_every_test_that_is_named_is_there() -> None:
    """A test named without a file is in the file named before it."""
    known = {path: set(re.findall(r"def (test_\w+)", path.read_text())) for path in (ROOT / "tests").rglob("test_*.py")}
    for page in EVERY:
        files: list[Path] = []
        for file, test in _TEST.findall(page.read_text()):
            if file:
                files = [path for path in known if path.as_posix().endswith(f"/{file}")]
                assert len(files) == 1, f"{page.name}: {file} is {len(files)} files"
            if test and page.name != "faults.md":
                assert len(files) == 1 and test in known[files[0]], f"{page.name}: {test} is not in {files}"


def test_every_stop_of_a_way_is_there() -> None:
    """A way is a table with a function at each stop."""
    wiring, *ways = (DOCS / "architecture.md").read_text().split("<!-- way: ")
    assert [way.partition(" ")[0] for way in ways] == ["csi", "datagram", "pose", "tag", "wish", "replay"]
    for way in (wiring, *ways):
        stops = _STOP.findall(way)
        assert len(stops) >= 2
        for file, function in stops:
            assert function in set(_functions(ROOT / file)), f"{file}: no {function}"


def test_a_csi_record_goes_one_way_through_at_most_eight_rooms() -> None:
    way = (DOCS / "architecture.md").read_text().split("<!-- way: csi -->")[1].split("###")[0]
    rooms = [file.removeprefix("companion/").partition("/")[0] for file, _ in _STOP.findall(way)]
    visits = [room for n, room in enumerate(rooms) if n == 0 or room != rooms[n - 1]]
    assert len(visits) == len(set(visits)) <= 8, visits


@by_name(EVERY)
def test_every_command_that_is_printed_is_one(path: Path) -> None:
    for text in (*printed(path), *mentioned(path)):
        words = re.sub(r"[\[\]]", "", text).split()
        command: click.Command = program
        while isinstance(command, click.Group) and words and re.fullmatch(r"[a-z][a-z-]*", words[0]):
            found = command.get_command(click.Context(command), words.pop(0))
            assert found is not None, f"{path.name}: {text}"
            command = found
        options = {name for parameter in command.params for name in parameter.opts}
        wanted = {word for word in words if re.fullmatch(r"--?[a-z][a-z0-9-]*", word)}
        assert wanted <= options, f"{path.name}: {command.name} has no {wanted - options}"


def test_every_command_that_is_printed_is_run_or_says_why_not() -> None:
    """Those that are run: tests/sitl/test_printed_commands.py."""
    commands = {text for path in PAGES for text in printed(path)}
    run = {one.words for one in RUN}
    assert not run & NOT_RUN.keys()
    assert commands - run - NOT_RUN.keys() == set(), "not in tests/printed_commands.py"
    ours = {text for path in EVERY for text in mentioned(path)} | commands
    assert (run | NOT_RUN.keys()) - ours == set(), "no longer printed"


def test_what_runs_a_command_instead_is_there() -> None:
    files = {path.name for path in (ROOT / "tests").rglob("test_*.py")}
    for reason in NOT_RUN.values():
        assert set(re.findall(r"test_\w+\.py", reason)) <= files, reason


@by_name(PAGES)
def test_every_make_target_that_is_printed_is_one(path: Path) -> None:
    targets = set(re.findall(r"^([\w.-]+):(?!=)", (ROOT / "Makefile").read_text(), re.MULTILINE))
    printed = set(re.findall(r"(?:^    |`)make ([a-z][\w-]*)", path.read_text(), re.MULTILINE))
    assert printed <= targets


def test_every_dependency_has_its_line() -> None:
    """Those that were asked for; below them stand those that these pull in."""
    cells = re.findall(r"^\| ([^|]+) \|", (DOCS / "dependencies.md").read_text(), re.MULTILINE)
    listed = {name.strip().lower() for cell in cells for name in cell.split(",")} - {"package", "---"}
    asked = set()
    for name in ("requirements.txt", "requirements-dev.txt"):
        chosen = (ROOT / name).read_text().split("# pulled in by the above")[0]
        asked |= {package.lower() for package in re.findall(r"^([\w-]+)==", chosen, re.MULTILINE)}
    assert listed == asked


def _anchors(path: Path) -> Iterator[str]:
    for line in path.read_text().splitlines():
        if line.startswith("#"):
            yield re.sub(r"[^\w\s-]", "", line.lstrip("#").strip().lower()).replace(" ", "-")


def _is_there(name: str) -> bool:
    """A module, or something in one."""
    if _is_module(name):
        return True
    module, _, attribute = name.rpartition(".")
    return _is_module(module) and hasattr(importlib.import_module(module), attribute)


def _is_module(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:  # its parent is none, or no package
        return False


def _functions(path: Path) -> Iterator[str]:
    """Functions and methods of a file, `Class.method`."""
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name
        elif isinstance(node, ast.ClassDef):
            for each in node.body:
                if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef):
                    yield f"{node.name}.{each.name}"


_SYMPTOMS = 30
_SHELL = [ROOT / "Makefile", *sorted((ROOT / "systemd").glob("*-*"))]


def test_every_symptom_is_in_the_programs_own_words() -> None:
    """What stands between two … of a row's first cell is in one text of ours, as it is printed."""
    rows = re.findall(r"^\| (`[^|]+`)[^`|]* \|", (DOCS / "troubleshooting.md").read_text(), re.MULTILINE)
    seen = [cell for cell in rows if "you see" not in cell]
    assert len(seen) >= _SYMPTOMS
    ours = [*_texts(), *(" ".join(path.read_text().split()) for path in _SHELL if path.is_file())]
    foreign = {"Device or resource busy (-16)"}  # the kernel's
    for words in (cell.strip("`") for cell in seen):
        parts = [part.strip(" :;,.()") for part in words.split("…") if len(part.strip(" :;,.()")) > 3]
        assert parts and (words in foreign or any(all(part in text for part in parts) for text in ours)), words


def _texts() -> Iterator[str]:
    """Every text of the program, what is put into it left out."""
    for package in ("companion", "csi_bridge", "wsr"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.JoinedStr):
                    yield "…".join(str(part.value) for part in node.values if isinstance(part, ast.Constant))
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield node.value
