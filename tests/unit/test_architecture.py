"""The house: no files stand on each other in a circle, the root stays small, the camera's reader needs nothing, `wsr`
is maths, and tests stand where the module's name leads.

Which room may stand on which is a contract of import-linter in pyproject.toml.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import grimp
import pytest

import companion
import csi_bridge
import wsr
from tests.paths import ROOT

_ROOT_MODULES = {"__init__", "__main__", "app", "cli", "errors"}
_OF_NO_MODULE = {"wsr/test_errata.py"}
"""The paper's equations as printed, which stand in no module because they do not hold."""
_COVERED_BY = {
    "companion/__main__.py": "unit/companion/test_cli.py",
    "companion/app.py": "faults/test_endings.py",
    "companion/autopilot/port.py": "unit/companion/autopilot/test_delegating.py",
    "companion/autopilot/rates.py": "unit/companion/autopilot/test_mavsdk_edge.py",
    "companion/commands/feed.py": "sitl/test_feed_and_doctor.py",
    "companion/commands/log.py": "unit/companion/log/test_export.py",
    "companion/commands/report.py": "unit/companion/analysis/test_imported.py",
    "companion/commands/run.py": "sitl/flight/test_service_ends.py",
    "companion/config/tag_camera.py": "unit/companion/config/test_rules.py",
    "companion/core/recorder.py": "unit/companion/log/test_recorder.py",
    "companion/flight/records.py": "unit/companion/flight/test_knowledge.py",
    "companion/live/server.py": "unit/companion/roles/test_live.py",
    "companion/roles/fed.py": "unit/companion/roles/test_page.py",
    "companion/roles/health.py": "unit/test_foxglove_layout.py",
    "companion/roles/node.py": "faults/test_long_mission.py",
    "companion/roles/team.py": "sitl/flight/test_team.py",
    "companion/roles/uav.py": "faults/test_vehicle_faults.py",
    "companion/roles/uav_service.py": "sitl/flight/test_engaging.py",
    "companion/signing/relay.py": "sitl/test_signing_relay.py",
    "companion/signing/told.py": "sitl/test_signing_relay.py",
    "companion/sim/px4/report.py": "sitl/test_px4_process.py",
    "companion/sim/world.py": "sitl/test_world.py",
    "companion/study/study.py": "unit/companion/study/test_catalogue.py",
    "companion/study/virtual_mission.py": "unit/companion/study/test_rendezvous.py",
    "companion/tak/sender.py": "unit/companion/roles/test_tak.py",
    "companion/team/records.py": "unit/companion/team/test_process.py",
    "csi_bridge/feitcsi/netlink.py": "faults/test_feitcsi_netlink.py",
    "csi_bridge/netlink.py": "faults/test_csi_netlink.py",
    "csi_bridge/source.py": "unit/csi_bridge/test_unix_socket.py",
    "wsr/aoa.py": "unit/wsr/estimators/test_robust.py",
    "wsr/errors.py": "unit/wsr/test_aperture.py",
    "wsr/estimators/options.py": "unit/wsr/estimators/test_robust.py",
}
"""Modules that no test file is named after, and where below tests/ theirs are: protocols, shapes of data, and wiring
that is a flow or nothing."""
_MATHS = {"__future__", "collections", "dataclasses", "functools", "math", "numba", "numpy", "typing", "wsr"}
_OF_SOURCES = {"hashlib", "inspect"}
"""What `wsr.machine_code` may import beside: it reads the package's own files to tell what cached code is made of."""
_NO_MATHS = {"open", "print", "input", "exec", "eval", "__import__"}
_PACKAGES = [Path(package.__path__[0]) for package in (companion, wsr, csi_bridge)]
_WSR = sorted(Path(wsr.__path__[0]).rglob("*.py"))


def test_no_circle_of_files() -> None:
    """Imports for type checking alone count too: a reader follows them just the same."""
    graph = grimp.build_graph("companion", "wsr", "csi_bridge", "benchmarks", "tests", cache_dir=None)
    assert {"wsr.estimators.robust", "benchmarks.recorded", __name__} <= graph.modules
    stands_on = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    TopologicalSorter(stands_on).prepare()  # raises CycleError, which names the circle


def test_the_root_holds_what_starts_the_program_and_nothing_else() -> None:
    modules = {path.stem for path in Path(companion.__path__[0]).glob("*.py")}
    assert modules <= _ROOT_MODULES, f"{', '.join(sorted(modules - _ROOT_MODULES))}: belongs in a room"


def test_no_two_classes_have_one_name() -> None:
    where: dict[str, list[str]] = {}
    for path in (path for package in _PACKAGES for path in package.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                where.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    assert {name: paths for name, paths in where.items() if len(paths) > 1} == {}


def test_commands_that_estimate_nothing_load_no_compiler() -> None:
    """It takes half a second of processor."""
    rooms = [
        "check_axes", "config", "control", "csi", "demo", "doctor", "feed", "keygen", "log", "radio", "replay",
        "report", "run", "status", "study",
    ]  # fmt: skip
    code = f"import sys, {', '.join(f'companion.commands.{room}' for room in rooms)}; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("package", ["companion", "companion/pose"])
def test_packages_on_the_way_to_the_camera_reader_import_nothing_of_ours(package: str) -> None:
    docstring, *more = ast.parse((ROOT / package / "__init__.py").read_text()).body
    assert isinstance(docstring, ast.Expr)
    names = {name.name for one in more if isinstance(one, ast.Import) for name in one.names}
    assert names <= {"os"} and not any(isinstance(one, ast.ImportFrom) for one in more)


def test_the_camera_reader_imports_where_nothing_is_installed() -> None:
    """-I and -S: neither this environment's packages nor its paths."""
    program = f"import sys; sys.path.insert(0, {str(ROOT)!r}); import companion.pose.t265_reader"
    done = subprocess.run([sys.executable, "-I", "-S", "-c", program], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr


def test_tests_stand_where_the_name_of_their_module_leads() -> None:
    """tests/unit/<room>/test_<name>.py holds the tests of <room>/<name>.py, or of the package <room>/<name>; where
    there are too many, test_<name>_<of what>.py some of them."""
    unit = ROOT / "tests" / "unit"
    files = {path.relative_to(unit).as_posix(): path for path in unit.rglob("test_*.py") if path.parent != unit}
    assert files.keys() >= _OF_NO_MODULE
    strays = []
    for name in files.keys() - _OF_NO_MODULE:
        words = (ROOT / name).stem.split("_")[1:]
        modules = [(ROOT / name).parent / "_".join(words[:many]) for many in range(1, len(words) + 1)]
        if not any(one.with_suffix(".py").is_file() or (one / "__init__.py").is_file() for one in modules):
            strays.append(name)
    assert not strays, f"{', '.join(sorted(strays))}: there is no such module; its tests belong to those they test"


def test_every_module_has_its_tests_where_its_name_leads() -> None:
    """Or in one file or more that begin with its name; else the table says where they are."""
    modules = [path.relative_to(ROOT) for package in _PACKAGES for path in package.rglob("*.py")]
    own = {module.as_posix(): _has_tests(module) for module in modules if _defines(module)}
    lost = {name for name, has_tests in own.items() if not has_tests} - _COVERED_BY.keys()
    assert not lost, f"{', '.join(sorted(lost))}: no tests where the name leads; write them, or say where they are"
    found = {name for name in _COVERED_BY if own.get(name, True)}
    assert not found, f"{', '.join(sorted(found))}: there is no such module, or it has tests of its own: no row"
    gone = {name for name, where in _COVERED_BY.items() if not (ROOT / "tests" / where).is_file()}
    assert not gone, f"{', '.join(sorted(gone))}: the file with its tests is not there"


def _has_tests(module: Path) -> bool:
    path = module.parent if module.name == "__init__.py" else module.with_suffix("")
    folder = ROOT / "tests" / "unit" / path.parent
    return any([(folder / f"test_{path.name}.py").is_file(), *folder.glob(f"test_{path.name}_*.py")])


def _defines(module: Path) -> bool:
    """A package's face that only speaks of the room needs no test."""
    body = ast.parse((ROOT / module).read_text()).body
    return module.name != "__init__.py" or any(isinstance(one, ast.FunctionDef | ast.ClassDef) for one in body)


@pytest.mark.parametrize("module", _WSR, ids=lambda module: module.name)
def test_a_module_of_wsr_imports_and_calls_nothing_outside_maths(module: Path) -> None:
    """No file, socket, clock, log, plot or event loop may come in, directly or by import."""
    known = _MATHS | _OF_SOURCES if module.name == "machine_code.py" else _MATHS
    for node in ast.walk(ast.parse(module.read_text())):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module or ""]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in _NO_MATHS, f"{module.name} calls {node.func.id}"
        for name in names:
            assert name.split(".")[0] in known, f"{module.name} imports {name}"


def test_modules_of_wsr_are_found() -> None:
    assert {"aoa.py", "kernel.py"} <= {module.name for module in _WSR}


def test_what_compiled_functions_call_is_part_of_their_machine_code() -> None:
    """`inner` or `shared`: linked, it would round one way in a process that compiles and another in one that reads the
    cache (`wsr.machine_code.shared`)."""
    kinds: dict[str, str] = {}
    calls: set[tuple[str, str]] = set()
    for module in _WSR:
        for node in ast.walk(ast.parse(module.read_text())):
            if not isinstance(node, ast.FunctionDef):
                continue
            marks = {mark.id for mark in node.decorator_list if isinstance(mark, ast.Name)}
            if found := marks & {"compiled", "inner", "shared"}:
                kinds[node.name] = found.pop()
                called = {one.func for one in ast.walk(node) if isinstance(one, ast.Call)}
                calls |= {(node.name, name.id) for name in called if isinstance(name, ast.Name)}
    linked = [f"{by} calls {name}" for by, name in sorted(calls) if kinds.get(name) == "compiled"]
    assert len(kinds) > 20
    assert not linked, "; ".join(linked)
