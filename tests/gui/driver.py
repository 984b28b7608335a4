"""A user made of generators: each `yield seconds` lets Blender take in its events and draw."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Generator, Sequence
from pathlib import Path

import bpy

OUT = Path(os.environ.get("HAIRLOOM_GUI_OUT", "."))
Steps = Generator["float | Steps", None, None]


def save_screen(name: str) -> None:
    path = OUT / f"{name}.png"
    subprocess.run(["import", "-window", "root", path], check=True)
    print(f"picture {path}", flush=True)


class User:
    """Mouse, keyboard and eyes on Blender's first window. Pixels count from the window's lower left corner."""

    def __init__(self) -> None:
        self.place = (0, 0)
        self.found = (0, 0)

    @property
    def window(self) -> bpy.types.Window:
        """Looked up each time: another file brings other windows."""
        return bpy.context.window_manager.windows[0]

    def area(self, kind: str = "VIEW_3D") -> bpy.types.Area:
        return max((a for a in self.window.screen.areas if a.type == kind), key=lambda a: a.width * a.height)

    def region(self, kind: str = "WINDOW", area: str = "VIEW_3D") -> bpy.types.Region:
        return next(r for r in self.area(area).regions if r.type == kind)

    def override(self, region: str = "WINDOW") -> object:
        """Context for operators that a test calls itself."""
        return bpy.context.temp_override(window=self.window, area=self.area(), region=self.region(region))

    def event(self, kind: str, value: str, **modifiers: bool) -> None:
        self.window.event_simulate(type=kind, value=value, x=self.place[0], y=self.place[1], **modifiers)

    def move(self, x: float, y: float) -> None:
        self.place = (int(x), int(y))
        self.event("MOUSEMOVE", "NOTHING")

    def click(self, x: float, y: float) -> Steps:
        self.move(x, y)
        yield 0.1
        self.event("LEFTMOUSE", "PRESS")
        yield 0.1
        self.event("LEFTMOUSE", "RELEASE")
        yield 0.2

    def key(self, kind: str, **modifiers: bool) -> Steps:
        self.event(kind, "PRESS", **modifiers)
        yield 0.05
        self.event(kind, "RELEASE", **modifiers)
        yield 0.3

    def drag(self, places: Sequence[tuple[float, float]], release: bool = True, **modifiers: bool) -> Steps:
        """Press at the first place, move through all of them, and release at the last."""
        self.move(*places[0])
        yield 0.1
        self.event("LEFTMOUSE", "PRESS", **modifiers)
        yield 0.1
        for place in places[1:]:
            self.move(*place)
            yield 0.02
        yield 0.2
        if release:
            self.event("LEFTMOUSE", "RELEASE", **modifiers)
            yield 0.3
            # on a busy machine Blender works the moves off for a while
            yield from self.wait(lambda: not len(self.window.modal_operators), 60, "the drag ends")

    def into_view(self) -> Steps:
        """Put the mouse in the middle of the 3D view, where shortcuts act."""
        region = self.region()
        self.move(region.x + region.width * 0.4, region.y + region.height * 0.5)
        yield 0.2

    def hovered(self) -> str:
        """The operator call under the mouse, as Blender's own 'Copy Python Command' gives it; '' when none is there."""
        manager = bpy.context.window_manager
        with self.override("UI"):
            if not bpy.ops.ui.copy_python_command_button.poll():
                return ""
            manager.clipboard = ""
            bpy.ops.ui.copy_python_command_button()
            return manager.clipboard

    def find_button(self, command: str) -> Steps:
        """Look down the sidebar for the button of an operator; its place is `found`, with no pixel known beforehand."""
        seen: list[str] = []
        # where the sidebar stands now, then from its top down, half a page at a time
        for turns in (0, -60, 6, 6, 6, 6):
            yield self._turn_wheel(turns)
            yield self._look_for(command, seen)
            if command in self.hovered():
                return
        raise AssertionError(f"no button {command} in the sidebar; there are {sorted(set(seen))}")

    def _turn_wheel(self, turns: int) -> Steps:
        """Scroll the sidebar, down for positive numbers."""
        region = self.region("UI")
        self.move(region.x + region.width * 0.5, region.y + region.height * 0.5)
        yield 0.1
        for _ in range(abs(turns)):
            self.event("WHEELDOWNMOUSE" if turns > 0 else "WHEELUPMOUSE", "PRESS")
            yield 0.02
        yield 0.3 if turns else 0.0

    def _look_for(self, command: str, seen: list[str]) -> Steps:
        yield self.into_view()
        region = self.region("UI")
        rows = range(region.y + region.height - 4, region.y, -7)
        # the middle finds what is as wide as the panel, the second column the small buttons at its right end
        for across, y in itertools.product((0.5, 0.82), rows):
            self.move(region.x + region.width * across, y)
            yield 0.06
            text = self.hovered()
            seen.append(text)
            if command not in text:
                continue
            yield 0.5
            if command in self.hovered():  # still so once Blender has taken in every move
                self.found = (self.place[0], y - 3)
                return

    def press(self, command: str) -> Steps:
        """Find the button and click on it."""
        yield self.find_button(command)
        yield self.click(*self.found)

    def wait(self, condition: Callable[[], bool], seconds: float, what: str) -> Steps:
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, f"{what}: not within {seconds} s"
            yield 0.1

    def picture(self, name: str) -> Steps:
        """Save the screen; software drawing needs a while."""
        for area in self.window.screen.areas:
            area.tag_redraw()
        yield 2.0
        save_screen(name)
        yield 0.1


def run(test: Callable[[User], Steps], limit_seconds: float) -> None:
    """Run a test step by step from Blender's timer, then end Blender with an exit status."""
    start = time.monotonic()
    stack: list[Steps] = []

    def leave(status: int) -> None:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)

    def tick() -> float | None:
        try:
            if not stack:
                stack.append(test(User()))
            while stack:
                assert time.monotonic() - start < limit_seconds, f"not done within {limit_seconds} s"
                step = next(stack[-1], None)
                if step is None:
                    stack.pop()
                elif isinstance(step, float | int):
                    return float(step)
                else:
                    stack.append(step)
        except BaseException:  # noqa: BLE001  whatever it is, it must become an exit status: Blender would just go on
            traceback.print_exc()
            save_screen("failed")
            leave(1)
        print(f"done in {time.monotonic() - start:.0f} s", flush=True)
        leave(0)
        return None

    bpy.app.timers.register(tick, first_interval=2.0, persistent=True)
