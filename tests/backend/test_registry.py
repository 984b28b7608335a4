"""Jobs by name: settings from JSON, errors that help, and the worker process around them."""

from dataclasses import asdict, dataclass, field

import pytest
from hairloom.errors import InputError
from hairloom.registry import JOBS, _load, build_params, run_job


@dataclass(frozen=True, slots=True)
class Inner:
    size: int = 3
    ratio: float = 0.5


@dataclass(frozen=True, slots=True)
class Outer:
    inner: Inner = field(default_factory=Inner)
    name: str = "a"
    windows: tuple[int, ...] = (3, 2)
    flag: bool = True


def test_nested_settings_are_built_and_the_rest_keeps_its_default():
    built = build_params(Outer, {"inner": {"size": 7, "ratio": 1}, "windows": [4], "flag": False})
    assert built == Outer(Inner(7, 1.0), "a", (4,), False)
    assert isinstance(built.inner.ratio, float)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"colour": 1}, "no setting 'colour'"),
        ({"inner": 3}, "Outer.inner must be a group"),
        ({"inner": {"size": "many"}}, "Inner.size must be int"),
        ({"inner": {"size": True}}, "Inner.size must be int"),
        ({"inner": {"size": 1.5}}, "Inner.size must be int"),
        ({"flag": 1}, "Outer.flag must be bool"),
    ],
)
def test_bad_settings_are_named(values, words):
    with pytest.raises(InputError, match=words):
        build_params(Outer, values)


def test_an_unknown_job_is_named():
    with pytest.raises(InputError, match="no job 'comb_hair'"):
        run_job("comb_hair", {}, {})


@pytest.mark.parametrize("name", JOBS)
def test_every_job_and_its_defaults_exist(name):
    job = JOBS[name]
    assert callable(_load(job.run))
    if job.params:
        params = _load(job.params)
        assert build_params(params, asdict(params())) == params()
