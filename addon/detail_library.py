"""Saved details: files NAME.npz, NAME.png and NAME.blend in the user's folder and in that which ships with the add-on.

The .npz is what is applied, the .png its picture, and the .blend makes it show in Blender's asset browser: a small
Curves object whose custom property names the .npz.
"""

from __future__ import annotations

import itertools
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bpy
import bpy.utils.previews

from . import assets
from .backend.errors import FileError, InputError, require

LIBRARY = "Hairloom Details"
FILE_PROPERTY = "hairloom_detail"  # custom property of an asset: the file name of its .npz
_SUFFIXES = (".npz", ".png", ".blend")
_MAX_NAME_BYTES = 60  # Blender 4.5 keeps 63 bytes of an object's name
_RESERVED = {"con", "prn", "aux", "nul", *(f"{port}{i}" for port in ("com", "lpt") for i in range(10))}
# pictures loaded for the panel, made on first use; a list, so that register and unregister need no `global`
_previews: list[bpy.utils.previews.ImagePreviewCollection] = []


@dataclass(frozen=True, slots=True)
class SavedDetail:
    """A saved detail: its name, the .npz, and whether it came with the add-on."""

    name: str
    path: Path
    is_bundled: bool

    @property
    def picture(self) -> Path:
        return self.path.with_suffix(".png")


def bundled_folder() -> Path:
    """Where the details lie that ship with the add-on."""
    return Path(assets.folder(), "details")


def user_folder() -> Path | None:
    """Where the user's details are kept; None where the user folder cannot be written."""
    try:
        return Path(bpy.utils.extension_path_user(__package__, path="details", create=True))
    except OSError:
        return None


def saved_details() -> list[SavedDetail]:
    """What can be applied: the user's own first, then what ships, each by name."""
    found: list[SavedDetail] = []
    for folder, is_bundled in ((user_folder(), False), (bundled_folder(), True)):
        if folder is not None and folder.is_dir():
            paths = [path for path in folder.iterdir() if path.suffix == ".npz" and path.is_file()]
            own = [SavedDetail(path.stem, path, is_bundled) for path in paths if not path.name.startswith(".")]
            found += sorted(own, key=lambda detail: detail.name.casefold())
    return found


def find_detail(name: str) -> SavedDetail:
    """The saved detail of that name; the name is only compared, no path is made of it.

    Raises
    ------
    InputError : there is none.
    """
    known = saved_details()
    found = next((detail for detail in known if detail.name == name), None)
    if found is None:
        names = ", ".join(detail.name for detail in known) or "none yet"
        raise InputError(f"there is no saved detail '{name[:80]}'; there are: {names}")
    return found


def detail_of(obj: bpy.types.Object) -> SavedDetail | None:
    """The saved detail that an asset's object stands for; None for any other object.

    Raises
    ------
    InputError : its .npz is in neither folder.
    """
    named = obj.get(FILE_PROPERTY)
    if not isinstance(named, str):
        return None
    found = next((detail for detail in saved_details() if detail.path.name == named), None)
    require(
        found is not None,
        f"'{obj.name}' stands for the saved detail '{named[:80]}', which is not here; save it again, or delete the "
        f"custom property '{FILE_PROPERTY}' to use the strands themselves",
    )
    return found


def proposed_name(groom_name: str) -> str:
    """A name for the details of a groom that is not taken yet."""
    plain = "".join(sign if _may_stand_in_name(sign) else " " for sign in groom_name).strip(" .")[:40] or "Detail"
    taken = {detail.name.casefold() for detail in saved_details()}
    numbered = (plain if i == 1 else f"{plain} {i}" for i in itertools.count(1))
    return next(name for name in numbered if name.casefold() not in taken)


def _may_stand_in_name(sign: str) -> bool:
    return sign.isalnum() or sign in " -_()+,."


def checked_name(name: str) -> str:
    """`name` without spaces around it, if it can be a file's name on every system.

    Raises
    ------
    InputError : empty, too long, reserved, or with signs that file names must not have.
    """
    name = name.strip()
    require(name, "the detail needs a name; give one")
    require(len(name.encode()) <= _MAX_NAME_BYTES, f"the name '{name[:20]}...' is too long; 60 letters are allowed")
    wrong = sorted({sign for sign in name if not _may_stand_in_name(sign)})
    require(not wrong, f"the name '{name}' has {' '.join(map(repr, wrong))}; use letters, digits, spaces, - and _")
    require(not name.startswith(".") and not name.endswith("."), f"the name '{name}' begins or ends with a dot")
    require(name.split(".")[0].lower() not in _RESERVED, f"'{name}' is a name that Windows keeps for itself")
    return name


def free_place(name: str, *, overwrite: bool) -> Path:
    """The .npz to write for `name` (checked already).

    Raises
    ------
    InputError : the name is taken. FileError : the user folder cannot be written.
    """
    folder = user_folder()
    if folder is None:
        raise FileError("the user folder of Blender cannot be written, so no detail can be saved; check its rights")
    taken = next((detail for detail in saved_details() if detail.name.casefold() == name.casefold()), None)
    if taken is not None:
        require(not taken.is_bundled, f"'{taken.name}' is a detail that came with Hairloom; choose another name")
        require(overwrite, f"there is a detail '{taken.name}' already; choose another name, or Overwrite")
        return taken.path
    return folder / f"{name}.npz"


@contextmanager
def written_together(place: Path) -> Iterator[Path]:
    """A .npz path in a temporary folder; what is written there and beside it is moved to `place` at the end.

    The .npz comes last, so that a detail without its picture and asset is never listed.

    Raises
    ------
    FileError : a file could not be written or moved.
    """
    place.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=".saving-", dir=place.parent))
    try:
        yield scratch / place.name
        for suffix in reversed(_SUFFIXES):
            os.replace((scratch / place.name).with_suffix(suffix), place.with_suffix(suffix))
    except (OSError, RuntimeError) as error:
        raise FileError(f"cannot save the detail '{place.stem}' in {place.parent}: {error}") from error
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def write_asset(obj: bpy.types.Object, path: Path) -> None:
    """Write `obj`, marked as asset, and what it uses into a .blend of their own; the open file is not changed."""
    # not linked to a scene, it has no user, and only a fake one keeps it in the file that is written
    bpy.data.libraries.write(str(path), {obj}, fake_user=True, compress=True)


def icon(detail: SavedDetail) -> int:
    """The icon of a detail's picture for menus, 0 where it has none; loaded anew when the file changes."""
    try:
        changed = detail.picture.stat().st_mtime_ns
    except OSError:
        return 0
    if not _previews:
        _previews.append(bpy.utils.previews.new())
    key = f"{detail.picture}|{changed}"
    loaded = _previews[0]
    picture = loaded[key] if key in loaded else loaded.load(key, str(detail.picture), "IMAGE")
    return picture.icon_id


def _library() -> bpy.types.UserAssetLibrary | None:
    folder = user_folder()
    libraries = bpy.context.preferences.filepaths.asset_libraries
    return next((library for library in libraries if folder is not None and assets.same(library.path, folder)), None)


def register() -> None:
    folder = user_folder()
    if folder is not None and _library() is None:
        bpy.context.preferences.filepaths.asset_libraries.new(name=LIBRARY, directory=str(folder))


def unregister() -> None:
    library = _library()
    if library is not None:
        bpy.context.preferences.filepaths.asset_libraries.remove(library)
    while _previews:
        bpy.utils.previews.remove(_previews.pop())
