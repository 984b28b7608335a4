"""`hairloom hair-database`: list, search, add."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent / "fourview"))
from database_scenes import camera_of, simple_hair, view_of
from hairloom.cli_database import add_database_command
from hairloom.errors import InputError
from hairloom.fourview.database_entries import entry_head, make_hairstyle
from hairloom.fourview.database_files import write_hairstyles
from hairloom.geometry.head import default_head
from hairloom.io.images import write_image
from hairloom.io.strands import read_strands, write_strands
from hairloom.progress import NO_PROGRESS


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    head = default_head()
    path = tmp_path_factory.mktemp("database") / "small.npz"
    fitted = entry_head(head)
    styles = [make_hairstyle(n, simple_hair(head, n, 500), fitted, tags=(n, "x"), family=n) for n in ("cap", "long")]
    write_hairstyles(path, styles)
    return path


def run(*arguments: object) -> dict[str, Any]:
    parser = argparse.ArgumentParser()
    commands = parser.add_subparsers(required=True)

    def command(name: str, function: Any, text: str, *parents: Any) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text)
        sub.add_argument("--json", action="store_true")
        sub.set_defaults(run=function)
        return sub

    add_database_command(command)
    options = parser.parse_args(["hair-database", *map(str, arguments)])
    report: dict[str, Any] = options.run(options, lambda stage: None, NO_PROGRESS)
    json.dumps(report)
    return report


def test_list(database: Path) -> None:
    found = run("--json", "--database", database, "list")
    assert [entry["name"] for entry in found["hairstyles"]] == ["cap", "long"]
    assert run("--database", database, "list", "--tag", "long")["hairstyles"] == 1
    assert run("--database", database, "list", "--family", "cap") == {"hairstyles": 1, "cap": "cap, x (cap)"}


def test_search_by_masks(database: Path, tmp_path: Path) -> None:
    head = default_head()
    strands = simple_hair(head, "long", 700, seed=2)
    masks = []
    for name in ("front", "left"):
        write_image(tmp_path / f"{name}.png", view_of(strands, head, camera_of(name, head, 400), name).mask)
        masks.append(f"{name}={tmp_path / name}.png")
    found = run("--database", database, "search", *masks, "--out", tmp_path / "out.hair")
    assert [match["name"] for match in found["matches"]] == ["long", "cap"]
    assert set(found["matches"][0]["per_view"]) == {"front", "left"}
    assert read_strands(tmp_path / "out.hair").n_strands > 400
    assert run("--database", database, "search", *masks, "--exclude", "long")["matches"][0]["name"] == "cap"
    assert len(run("--database", database, "search", *masks, "--exclude-family", "long", "--best", 9)["matches"]) == 1
    with pytest.raises(InputError, match="given twice"):
        run("--database", database, "search", masks[0], masks[0])
    with pytest.raises(InputError, match="is no mask"):
        run("--database", database, "search", masks[0], "left.png")


def test_add(database: Path, tmp_path: Path) -> None:
    write_strands(tmp_path / "mine.hair", simple_hair(default_head(), "ball", 400))
    folder = tmp_path / "folder"
    with pytest.raises(InputError, match="no folder"):
        run("add", folder, tmp_path / "mine.hair")
    folder.mkdir()
    report = run("add", folder, tmp_path / "mine.hair", "--name", "My ball", "--tag", "round")
    assert report["name"] == "My ball" and Path(report["out"]).is_file()
    found = run("--json", "--database", database, "--folder", folder, "list", "--tag", "round")
    assert [entry["name"] for entry in found["hairstyles"]] == ["My ball"]
