"""The cache of compiled code is a cache: where it cannot be read or written, numba compiles, and one remark says so.

Numba keeps machine code beside the package or below HOME and raises when neither can be written, when the disk is full
while it saves, and when a file of the cache is cut off. `guard` changes that once numba is imported, and imports
nothing itself: a folder for this user below the temporary one takes their place, or nothing does. It also stops the
clock (core/stopwatch.py) while numba loads, compiles and saves.
"""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Callable
from importlib.machinery import ModuleSpec
from types import ModuleType

from occontrol.core import stopwatch

_WATCHED = "numba.core.dispatcher"
_remarks: list[str] = []


def guard() -> None:
    """Make numba's cache forgiving as soon as numba is imported, or now if it is."""
    if _WATCHED in sys.modules:
        _soften(sys.modules[_WATCHED])
    elif not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())  # type: ignore[arg-type]


def remark() -> str:
    """One line about a cache that could not be used; empty where all went well."""
    return _remarks[0] if _remarks else ""


def _note(text: str) -> None:
    if not _remarks:
        _remarks.append(text)


class _Finder:
    """Waits for numba's dispatcher and hands it to `_soften` once it is loaded."""

    def find_spec(self, name: str, path: object, target: ModuleType | None = None) -> ModuleSpec | None:
        if name != _WATCHED:
            return None
        import importlib.util

        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        loader = None if spec is None else spec.loader
        if loader is not None:
            execute = loader.exec_module

            def exec_module(module: ModuleType) -> None:
                execute(module)
                _soften(module)

            loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


def _soften(dispatcher: ModuleType) -> None:
    """Replace the methods through which numba meets the file system, and the one that compiles."""
    from numba.core import caching, event

    kind, cache = dispatcher.Dispatcher, caching.Cache
    if getattr(kind.enable_caching, "softened", False):
        return
    enable, load, save = kind.enable_caching, cache.load_overload, cache.save_overload
    compile_one = kind.compile

    def enable_caching(self: object) -> None:
        if not _attempt(lambda: enable(self)) and _use_temporary_folder():
            _attempt(lambda: enable(self))

    def load_overload(self: caching.Cache, sig: object, target_context: object) -> object:
        try:
            return load(self, sig, target_context)
        except Exception as error:  # pickle raises a dozen kinds for a file that is cut off; then it is compiled anew
            _note(f"compiled code could not be read and is compiled anew ({type(error).__name__})")
            return None

    def save_overload(self: caching.Cache, sig: object, data: object) -> None:
        try:
            try:
                save(self, sig, data)
            except OSError:
                raise
            except Exception:  # the index is damaged: begin a new one
                self.flush()
                save(self, sig, data)
        except Exception as error:
            reason = getattr(error, "strerror", None) or type(error).__name__
            _note(f"compiled code could not be kept ({reason}): it is compiled anew each time")

    def compile(self: object, sig: object) -> object:
        with stopwatch.stopped():
            return compile_one(self, sig)

    class Watch(event.Listener):
        def on_start(self, event: object) -> None:
            stopwatch.begin()

        def on_end(self, event: object) -> None:
            stopwatch.end()

    event.register("numba:compile", Watch())
    enable_caching.softened = True  # type: ignore[attr-defined]
    kind.enable_caching, cache.load_overload, cache.save_overload = enable_caching, load_overload, save_overload
    kind.compile = compile


def _attempt(work: Callable[[], None]) -> bool:
    try:
        work()
        return True
    except (RuntimeError, OSError, KeyError):
        return False


def _use_temporary_folder() -> bool:
    """Let numba use a folder that only this user can write; False, with a remark, where there is none."""
    import tempfile
    from pathlib import Path

    from numba import config

    folder = Path(tempfile.gettempdir()) / f"occontrol-compiled-{os.getuid() if hasattr(os, 'getuid') else 0}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        private = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o077
        if hasattr(os, "getuid"):
            private = private and found.st_uid == os.getuid()  # code that is run must not be somebody else's
        if private and os.access(folder, os.W_OK):
            config.CACHE_DIR = str(folder)
            _note(f"neither the package nor HOME can be written: compiled code is kept in {folder}")
            return True
    except OSError:
        pass
    _note("no folder for compiled code can be written: it is compiled anew each time")
    return False
