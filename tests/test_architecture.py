"""The rules of the code's structure: who imports whom, what nobody calls, how long things are.

Each rule is a function from syntax trees to a list of offences, so that the last tests can show that it finds some.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
OWN_FOLDERS = ("addon", "backend", "blend_templates", "tests", "benchmarks", "docs")
MAX_FILE_LINES = 500
MAX_FUNCTION_LINES = 60

# A module imports from its own level or a lower one; feature packages stay apart from each other.
BACKEND_LEVELS = (
    {"types", "errors", "progress", "kernels"},
    {"io"},
    {"geometry"},
    {"fields"},
    {"synthesis", "editing", "rods", "fourview", "imagebased", "capture"},
    {"registry", "jobs", "warm_up"},
    {"cli", "cli_rods", "cli_fourview", "cli_database", "worker", "bench", "__main__"},
)
FEATURES = BACKEND_LEVELS[4]
# ui -> ops -> everything else of the add-on (props, jobs, bridge, ...) -> backend
ADDON_LEVELS = {"backend": 0, "ops": 2, "tools": 2, "gizmos": 2, "ui": 3, "": 4}
ADDON_OTHER_LEVEL = 1

BLENDER_MODULES = {"bpy", "bpy_extras", "bl_ui", "bl_ext", "mathutils", "gpu", "gpu_extras", "blf", "bmesh", "idprop"}
HEAVY_MODULES = {"numpy", "scipy", "numba", "igl", "embreex", "xatlas", "cv2", "psutil", "sklearn"}
PICKLING_MODULES = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib"}
NETWORK_MODULES = {"urllib", "http", "socket", "requests", "ftplib", "ensurepip", "pip"}
CLOCK_AND_CHANCE_MODULES = {"time", "datetime", "uuid", "random", "secrets"}
CLOCK_ALLOWED = {("cli",), ("bench",), ("worker",)}
SEEDED_RANDOM = {"default_rng", "Generator", "SeedSequence", "PCG64", "BitGenerator"}


@dataclass(frozen=True)
class Import:
    """`absolute` names a module of somewhere else; else `inside` is the path within the package, () its top."""

    absolute: str
    inside: tuple[str, ...]
    line: int
    at_module_level: bool


@dataclass(frozen=True)
class Module:
    """A source file; `name` is its dotted path within its package, as a tuple, () for the package's __init__."""

    name: tuple[str, ...]
    is_package: bool
    source: str
    path: str

    @cached_property
    def tree(self) -> ast.Module:
        return ast.parse(self.source)

    def __hash__(self) -> int:
        return hash(self.path)

    def at(self, node_or_line: ast.AST | int, text: str) -> str:
        line = node_or_line if isinstance(node_or_line, int) else node_or_line.lineno
        return f"{self.path}:{line}: {text}"


def source_module(name: str, source: str, package: str = "backend") -> Module:
    """A module made of text, for the tests of the rules."""
    parts = tuple(name.split(".")) if name else ()
    return Module(parts, not parts, source, f"{package}/{name}")


def read_package(folder: str) -> dict[tuple[str, ...], Module]:
    modules = {}
    for path in sorted((ROOT / folder).rglob("*.py")):
        parts = path.relative_to(ROOT / folder).with_suffix("").parts
        is_package = parts[-1] == "__init__"
        name = parts[:-1] if is_package else parts
        modules[name] = Module(name, is_package, path.read_text(encoding="utf-8"), str(path.relative_to(ROOT)))
    return modules


@pytest.fixture(scope="module")
def backend() -> dict[tuple[str, ...], Module]:
    return read_package("backend")


@pytest.fixture(scope="module")
def addon() -> dict[tuple[str, ...], Module]:
    return read_package("addon")


# --- what a module imports ---------------------------------------------------------------------------------------


def at_module_level(tree: ast.Module) -> set[int]:
    """The ids of the nodes that run when the module is imported; `if TYPE_CHECKING:` does not."""
    running, waiting = set(), list(tree.body)
    while waiting:
        node = waiting.pop()
        running.add(id(node))
        checks_types = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) and not checks_types:
            waiting.extend(ast.iter_child_nodes(node))
    return running


def imports(module: Module) -> Iterator[Import]:
    """Every import, also those by `lazy.backend("io.strands")` and `lazy.bridge("curves")`, the add-on's late ones."""
    early = at_module_level(module.tree)
    for node in ast.walk(module.tree):
        now = id(node) in early
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(alias.name, (), node.lineno, now)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield Import(node.module or "", (), node.lineno, now)
        elif isinstance(node, ast.ImportFrom):
            keep = len(module.name) + module.is_package - node.level
            base = module.name[: max(keep, 0)] if keep >= 0 else ("..",)
            base += tuple((node.module or "").split(".")) if node.module else ()
            for alias in node.names:
                yield Import("", (*base, alias.name), node.lineno, now)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args:
            late = ast.unparse(node.func)
            if late in {"lazy.backend", "lazy.bridge"} and isinstance(node.args[0], ast.Constant):
                inside = (late.removeprefix("lazy."), *str(node.args[0].value).split("."))
                yield Import("", inside, node.lineno, False)


def backend_level(part: str) -> int:
    for level, parts in enumerate(BACKEND_LEVELS):
        if part in parts:
            return level
    raise LookupError(f"backend/{part} has no place in BACKEND_LEVELS: give it one")


def wrong_direction_in_backend(module: Module) -> list[str]:
    offences = []
    for found in imports(module):
        if found.absolute or not module.name or not found.inside:
            continue
        if found.inside[0] == "..":
            offences.append(module.at(found.line, "imports from outside the backend"))
            continue
        mine, theirs = module.name[0], found.inside[0]
        if theirs.startswith("__"):
            continue
        upward = backend_level(theirs) > backend_level(mine)
        across = mine != theirs and {mine, theirs} <= FEATURES
        if upward or across:
            offences.append(module.at(found.line, f"{mine} must not import {theirs}"))
    return offences


def addon_level(part: str) -> int:
    return ADDON_LEVELS.get(part, ADDON_OTHER_LEVEL)


def wrong_direction_in_addon(module: Module) -> list[str]:
    mine = module.name[0] if module.name else ""
    return [
        module.at(found.line, f"{mine} must not import {'.'.join(found.inside)}")
        for found in imports(module)
        if not found.absolute and found.inside and addon_level(found.inside[0]) > addon_level(mine)
    ]


def forbidden_imports(module: Module, forbidden: set[str]) -> list[str]:
    return [
        module.at(found.line, f"imports {found.absolute}")
        for found in imports(module)
        if found.absolute.split(".")[0] in forbidden
    ]


def imported_at_registration(addon: dict[tuple[str, ...], Module], backend: dict[tuple[str, ...], Module]) -> list[str]:
    """Heavy packages that are imported when Blender enables the add-on, followed through all modules."""
    modules = addon | {("backend", *name): module for name, module in backend.items()}
    waiting: list[tuple[str, ...]] = [()]
    seen: set[tuple[str, ...]] = set()
    offences = []
    while waiting:
        name = waiting.pop()
        if name in seen or name not in modules:
            continue
        seen.add(name)
        module = modules[name]
        for found in imports(module):
            if not found.at_module_level:
                continue
            if found.absolute.split(".")[0] in HEAVY_MODULES:
                offences.append(module.at(found.line, f"imports {found.absolute} when the add-on is enabled"))
            inside = name[:1] + found.inside if module.path.startswith("backend") else found.inside
            # `from .a.b import c` runs a, a.b and, if it is a module, a.b.c
            waiting.extend(inside[:length] for length in range(1, len(inside) + 1) if not found.absolute)
    return offences


def numba_outside_kernels(module: Module) -> list[str]:
    last = module.name[-1] if module.name else ""
    if module.name == ("kernels",) or (last.startswith("_") and last.endswith("kernels")):
        return []
    return forbidden_imports(module, {"numba"})


# --- what nobody calls -------------------------------------------------------------------------------------------


def banned_calls(module: Module) -> list[str]:
    """print, eval and exec, numpy's global random state, unpickling, global variables, the shell."""
    may_print = module.name in {("cli",), ("bench",)} and module.path.startswith("backend")
    offences = []
    for node in ast.walk(module.tree):
        text = ast.unparse(node.func) if isinstance(node, ast.Call) else ""
        if text in {"eval", "exec", "compile", "__import__", "os.system", "os.popen"}:
            offences.append(module.at(node, f"calls {text}"))
        if text == "print" and not may_print:
            offences.append(module.at(node, "prints: raise an error, report progress or return a report"))
        of_random = isinstance(node, ast.Attribute) and ast.unparse(node.value) in {"np.random", "numpy.random"}
        if of_random and node.attr not in SEEDED_RANDOM:
            offences.append(module.at(node, f"uses the global state of np.random.{node.attr}"))
        if isinstance(node, ast.keyword) and node.arg == "allow_pickle" and ast.unparse(node.value) != "False":
            offences.append(module.at(node.value, "allows pickle"))
        if isinstance(node, ast.keyword) and node.arg == "shell" and ast.unparse(node.value) != "False":
            offences.append(module.at(node.value, "starts a shell"))
        if isinstance(node, ast.Global):
            offences.append(module.at(node, "has global state"))
    return offences


def unseeded_generators(module: Module) -> list[str]:
    return [
        module.at(node, "default_rng without a seed")
        for node in ast.walk(module.tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("default_rng")
        if not node.args or ast.unparse(node.args[0]) == "None"
    ]


def search_path_edits(module: Module) -> list[str]:
    edits = {"sys.path.append", "sys.path.insert", "sys.path.extend", "site.addsitedir"}
    return [
        module.at(node, "edits sys.path, which extensions must not")
        for node in ast.walk(module.tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) in edits
    ]


# --- how long things are -----------------------------------------------------------------------------------------


def too_long(module: Module) -> list[str]:
    offences = []
    n_lines = len(module.source.splitlines())
    if n_lines > MAX_FILE_LINES:
        offences.append(module.at(n_lines, f"{n_lines} lines; {MAX_FILE_LINES} are allowed"))
    for node in ast.walk(module.tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            if ast.get_docstring(node) is not None:
                length -= (node.body[0].end_lineno or 0) - node.body[0].lineno + 1
            if length >= MAX_FUNCTION_LINES:
                offences.append(
                    module.at(node, f"{node.name} has {length} lines; under {MAX_FUNCTION_LINES} are allowed")
                )
    return offences


# --- the tests ---------------------------------------------------------------------------------------------------


def check(modules: dict[tuple[str, ...], Module], rule: Callable[..., list[str]], *arguments: object) -> None:
    offences = [offence for module in modules.values() for offence in rule(module, *arguments)]
    assert not offences, "\n" + "\n".join(offences)


def test_backend_imports_downward_only(backend) -> None:
    check(backend, wrong_direction_in_backend)


def test_backend_knows_nothing_of_blender(backend) -> None:
    check(backend, forbidden_imports, BLENDER_MODULES)


def test_packages_import_themselves_relatively(backend, addon) -> None:
    """The backend is `hairloom` for some and `bl_ext.user_default.hairloom.backend` for others."""
    for modules in (backend, addon):
        check(modules, forbidden_imports, {"hairloom", "backend", "addon"})


def test_addon_imports_downward_only(addon) -> None:
    check(addon, wrong_direction_in_addon)


def test_panels_and_operators_do_not_compute(addon) -> None:
    outer = {name: module for name, module in addon.items() if name[:1] in {("ui",), ("ops",)}}
    check(outer, forbidden_imports, HEAVY_MODULES)


def test_nothing_heavy_is_imported_when_the_addon_is_enabled(addon, backend) -> None:
    offences = imported_at_registration(addon, backend)
    assert not offences, "\n" + "\n".join(offences)


def test_numba_stays_in_kernel_files(backend, addon) -> None:
    for modules in (backend, addon):
        check(modules, numba_outside_kernels)


def test_nobody_makes_banned_calls(backend, addon) -> None:
    for modules in (backend, addon):
        check(modules, banned_calls)
        check(modules, forbidden_imports, PICKLING_MODULES | NETWORK_MODULES)
    check(addon, search_path_edits)


def test_backend_has_no_clock_and_no_unseeded_chance(backend) -> None:
    timed = {name: module for name, module in backend.items() if name not in CLOCK_ALLOWED}
    check(timed, forbidden_imports, CLOCK_AND_CHANCE_MODULES)
    check(backend, unseeded_generators)


@pytest.mark.parametrize("folder", OWN_FOLDERS)
def test_files_and_functions_are_short(folder: str) -> None:
    check(read_package(folder), too_long)


def test_the_build_script_is_short_and_needs_the_standard_library_only() -> None:
    module = Module(("build_addon",), False, (ROOT / "build_addon.py").read_text(encoding="utf-8"), "build_addon.py")
    assert too_long(module) == []
    assert {found.absolute.split(".")[0] for found in imports(module)} <= sys.stdlib_module_names


# --- the rules can fail ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("types", "from .io import strands"),
        ("io.hair", "from ..geometry.head import HeadSurface"),
        ("fields.grid", "from ..synthesis import wisps"),
        ("synthesis.wisps", "from ..rods.energy import bend"),
        ("synthesis.wisps", "def late():\n    from .. import registry"),
        ("synthesis.wisps", "from ...addon import jobs"),
    ],
)
def test_rule_of_backend_direction(name: str, source: str) -> None:
    assert len(wrong_direction_in_backend(source_module(name, source))) == 1


@pytest.mark.parametrize("source", ["from ..types import Head", "from .features import fit", "import numpy"])
def test_rule_of_backend_direction_lets_the_right_ones_pass(source: str) -> None:
    assert wrong_direction_in_backend(source_module("synthesis.wisps", source)) == []


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("ops.synthesize", "from ..ui import panels"),
        ("bridge.curves", "from .. import ops"),
        ("jobs", "from . import ui"),
    ],
)
def test_rule_of_addon_direction(name: str, source: str) -> None:
    assert len(wrong_direction_in_addon(source_module(name, source, "addon"))) == 1
    assert wrong_direction_in_addon(source_module("ui.panels", "from .. import jobs, ops", "addon")) == []


def test_rule_of_registration_follows_imports() -> None:
    top = source_module("", "from . import props", "addon")
    props = source_module("props", "from .backend.synthesis.wisps import WispParams", "addon")
    wisps = source_module("synthesis.wisps", "from ..types import Head\ndef f():\n    import scipy")
    types = source_module("types", "import numpy as np")
    backend_modules = {("synthesis", "wisps"): wisps, ("types",): types}
    assert len(imported_at_registration({(): top, ("props",): props}, backend_modules)) == 1
    late = source_module("props", "def f():\n    from .backend.synthesis.wisps import WispParams", "addon")
    assert imported_at_registration({(): top, ("props",): late}, backend_modules) == []


@pytest.mark.parametrize(
    "source",
    ["print(1)", "eval('1')", "np.random.rand(3)", "np.load(f, allow_pickle=True)", "def f():\n    global x"],
)
def test_rule_of_banned_calls(source: str) -> None:
    assert len(banned_calls(source_module("synthesis.wisps", source))) == 1


def test_rules_of_numba_seeds_and_paths() -> None:
    assert len(numba_outside_kernels(source_module("synthesis.wisps", "from numba import njit"))) == 1
    assert numba_outside_kernels(source_module("synthesis._wisp_kernels", "from numba import njit")) == []
    assert len(unseeded_generators(source_module("types", "np.random.default_rng()"))) == 1
    assert unseeded_generators(source_module("types", "np.random.default_rng(seed)")) == []
    assert len(search_path_edits(source_module("jobs", "sys.path.insert(0, 'x')"))) == 1


def test_rule_of_length() -> None:
    body = "    x = 1\n" * 59
    assert len(too_long(source_module("types", f"def f():\n{body}"))) == 1
    assert too_long(source_module("types", f'def f():\n    """a\n    b"""\n{body[:-10]}')) == []
    assert len(too_long(source_module("types", "x = 1\n" * 501))) == 1
