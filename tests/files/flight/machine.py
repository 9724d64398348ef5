"""Flight code compiled and called: what the tests of its text share."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from occontrol.core.target import TargetPlan
from occontrol.files.export.flight import texts_of, write_flight
from occontrol.files.export.flight.content import Content, Options, make_content

STRICT = (
    "-std=c99 -pedantic -Wall -Wextra -Wconversion -Wshadow -Wdouble-promotion -Wfloat-equal -Wcast-qual -Wvla -Werror"
).split()
COMPILERS = [name for name in ("gcc", "clang", "cc") if shutil.which(name)]
CC = COMPILERS[0] if COMPILERS else ""
needs_compiler = pytest.mark.skipif(not CC, reason="no C compiler on this computer")


def written(folder: Path, plan: TargetPlan, options: Options | None = None) -> Content:
    """The content of a plan whose flight code stands in `folder` with the prefix oc."""
    content = make_content(plan, options or Options())
    write_flight(folder, texts_of(content, "oc", "a plan", "sha256:0"))
    return content


def built(compiler: str, sources: list[Path], program: Path, *flags: str) -> Path:
    """A program, or a failed test with what the compiler said."""
    done = subprocess.run([compiler, *flags, "-o", program, *sources], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return program


def selftest(folder: Path, compiler: str, *flags: str) -> subprocess.CompletedProcess[str]:
    """The self-test of a folder, compiled and run."""
    sources = [folder / "oc_filter.c", folder / "oc_tables.c", folder / "host" / "selftest.c"]
    program = built(compiler, sources, folder / "selftest", *(flags or [*STRICT, "-O2"]))
    return subprocess.run([program], capture_output=True, text=True)


class Machine:
    """The compiled filter, called function by function."""

    def __init__(self, folder: Path, content: Content):
        sources = [folder / "oc_filter.c", folder / "oc_tables.c"]
        self.code = ctypes.CDLL(str(built(CC, sources, folder / "oc.so", "-std=c99", "-O2", "-shared", "-fPIC")))
        self.real = ctypes.c_double if content.options.precision == "double" else ctypes.c_float
        self.n, self.m = content.table("mean").shape[1], content.values
        self.outputs = content.plan.model.outputs if content.plan.model else 0
        lower = max(1, self.n * (self.n - 1) // 2)
        full = [("pivot", self.real * self.n), ("lower", self.real * lower)] if "full" in content.flags else []
        fields = [("x", self.real * self.n), *full, ("nis", self.real), ("dimension", ctypes.c_uint32)]

        fields += [("round", ctypes.c_uint64)] if "endless" in content.flags else []

        class Filter(ctypes.Structure):
            _fields_ = [*fields, ("k", ctypes.c_uint32), ("planned", ctypes.c_uint8)]

        self.kind = Filter

    def new(self) -> ctypes.Structure:
        """A filter at the start of the horizon."""
        f = self.kind()
        assert self.code.oc_init(ctypes.byref(f)) == 0
        return f

    def array(self, values: np.ndarray) -> ctypes.Array:
        """Numbers as C wants them."""
        return (self.real * len(values))(*[float(x) for x in values])

    def step(self, f: ctypes.Structure, z: np.ndarray, valid: np.ndarray | None = None) -> int:
        """One step; the status."""
        flags = None if valid is None else (ctypes.c_uint8 * len(valid))(*[int(x) for x in valid])
        return self.code.oc_step(ctypes.byref(f), self.array(z), flags)

    def said(self, f: ctypes.Structure) -> np.ndarray:
        """Everything that a filter says, in a row."""
        parts = [np.array(f.x), [f.nis, f.k, f.dimension, f.planned]]
        for name, sizes in (("variance", [self.n]), ("covariance", [self.n**2]), ("predict", [self.outputs] * 2)):
            if hasattr(self.code, f"oc_{name}"):
                places = [(self.real * size)() for size in sizes]
                assert getattr(self.code, f"oc_{name}")(ctypes.byref(f), *places) == 0
                parts += [np.array(each) for each in places]
        return np.concatenate(parts)
