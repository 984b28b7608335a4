"""docs/papers.md: every ID of the specification is there, and what it calls done has a function and a test."""

import importlib
import os
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "papers.md"
ROW = re.compile(r"^\| ([WLBZM]-[A-Z]?\d+) \| ([^|]*) \| ([^|]*) \| ([^|]*) \|$", re.M)
SPEC = Path(os.environ.get("HAIRLOOM_DATA", ROOT.parent / "shared" / "data")).parent / "spec"


def rows():
    return {match[0]: match[1:] for match in ROW.findall(PAGE.read_text(encoding="utf-8"))}


def names(cell):
    return re.findall(r"`([^`]+)`", cell)


def test_every_id_of_the_specification_is_listed_once():
    if not SPEC.is_dir():
        pytest.skip(f"the specification is not in {SPEC}")
    wanted = set()
    for page in [*SPEC.glob("paper-*.md"), SPEC / "methods.md"]:
        wanted |= set(re.findall(r"\b([WLBZ]-[AELU]?\d+|M-\d+)\b", page.read_text(encoding="utf-8")))
    listed = [match[0] for match in ROW.findall(PAGE.read_text(encoding="utf-8"))]
    assert len(listed) == len(set(listed))
    assert wanted - set(listed) == set()


def test_a_row_is_done_with_a_function_and_a_test_or_says_that_it_is_not():
    for name, (_, functions, tests) in rows().items():
        done = bool(names(functions))
        assert done == bool(names(tests)), f"{name}: a function and a test, or neither"
        assert done or functions.strip().startswith("not done"), f"{name} must say that it is not done"


@pytest.mark.parametrize("name", [n for n, row in rows().items() if names(row[1])])
def test_the_functions_and_tests_exist(name):
    _, functions, tests = rows()[name]
    for function in names(functions):
        if function.endswith(".py"):
            assert (ROOT / function).is_file(), function
            continue
        module, _, attribute = function.rpartition(".")
        assert hasattr(importlib.import_module(f"hairloom.{module}"), attribute), function
    for test in names(tests):
        path, _, function = test.partition("::")
        text = (ROOT / "tests" / path).read_text(encoding="utf-8")
        assert re.search(rf"^def {function}\(", text, re.M), test
