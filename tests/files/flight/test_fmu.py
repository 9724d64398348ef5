"""FMUs: what their descriptions say, and the compiled code driven as an importer drives it."""

from __future__ import annotations

import ctypes
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import numpy as np
import pytest

from occontrol.core.errors import SolveFailed, UsageError
from occontrol.core.target import TargetPlan
from occontrol.files.export.flight.content import Options, make_content
from occontrol.files.export.flight.reference import ReferenceFilter
from occontrol.files.export.fmu import fmu_texts, write_fmu
from tests.files.flight.machine import CC, STRICT, built, needs_compiler
from tests.files.flight.plans import random_plan


def texts(edition: int, plan: TargetPlan | None = None) -> dict[str, str]:
    return fmu_texts(plan or random_plan(), Options(), "oc", 'a "plan" <1>', "sha256:0", edition)


class Importer:
    """The few calls that a simulation makes, for either edition."""

    def __init__(self, folder: Path, edition: int, plan: TargetPlan):
        self.edition, content = edition, texts(edition, plan)
        for name, text in content.items():
            (folder / Path(name).name).write_text(text)
        sources = sorted(folder.glob("*.c"))
        self.code = ctypes.CDLL(str(built(CC, sources, folder / "oc.so", *STRICT, "-O2", "-shared", "-fPIC", "-lm")))
        self.xml = ElementTree.fromstring(content["modelDescription.xml"])
        self.reference = {v.get("name"): int(v.get("valueReference")) for v in self.xml.iter() if v.get("valueReference") and v.get("name")}  # type: ignore[arg-type] # noqa: E501

    def call(self, name: str, *arguments: object) -> int:
        return getattr(self.code, f"fmi{self.edition}{name}")(*arguments)

    def instance(self, token: str | None = None) -> ctypes.c_void_p | None:
        token = token or self.xml.get("guid") or self.xml.get("instantiationToken")
        two = self.edition == 2
        head = [b"one", *([ctypes.c_int(1)] * two), token.encode(), b"", *([None] * two)]
        rest = [0, 0] if self.edition == 2 else [False] * 4 + [None, ctypes.c_size_t(0), None, None, None]
        make = self.code.fmi2Instantiate if self.edition == 2 else self.code.fmi3InstantiateCoSimulation
        make.restype = ctypes.c_void_p
        found = make(*head, *rest)
        return ctypes.c_void_p(found) if found else None

    def start(self) -> ctypes.c_void_p:
        c = self.instance()
        assert c is not None
        if self.edition == 2:
            zero = ctypes.c_double(0)
            assert self.call("SetupExperiment", c, 0, zero, zero, 0, zero) == 0
            assert self.call("EnterInitializationMode", c) == 0
        else:
            zero = ctypes.c_double(0)
            assert self.call("EnterInitializationMode", c, False, zero, zero, False, zero) == 0
        return c

    def put(self, c: ctypes.c_void_p, z: np.ndarray) -> None:
        arrived, values = (~np.isnan(z)).tolist(), np.where(np.isnan(z), 0, z).tolist()
        self._access("SetReal" if self.edition == 2 else "SetFloat64", c, "z", ctypes.c_double, values)
        self._access("SetBoolean", c, "valid", ctypes.c_int if self.edition == 2 else ctypes.c_bool, arrived)

    def get(self, c: ctypes.c_void_p, *names: str) -> list[float]:
        values = (ctypes.c_double * len(names))()
        references = (ctypes.c_uint32 * len(names))(*[self.reference[name] for name in names])
        size = ctypes.c_size_t(len(names))
        more = [] if self.edition == 2 else [size]
        assert self.call("GetReal" if self.edition == 2 else "GetFloat64", c, references, size, values, *more) == 0
        return list(values)

    def _access(self, name: str, c: ctypes.c_void_p, what: str, kind: type, values: list) -> None:
        size = ctypes.c_size_t(len(values))
        references = (ctypes.c_uint32 * len(values))(*[self.reference[f"{what}[{i + 1}]"] for i in range(len(values))])
        more = [] if self.edition == 2 else [size]
        assert self.call(name, c, references, size, (kind * len(values))(*values), *more) == 0

    def step(self, c: ctypes.c_void_p, t: float, until: float) -> int:
        if self.edition == 2:
            return self.call("DoStep", c, ctypes.c_double(t), ctypes.c_double(until - t), 1)
        flags, last = [ctypes.byref(ctypes.c_bool()) for _ in range(3)], ctypes.byref(ctypes.c_double())
        return self.call("DoStep", c, ctypes.c_double(t), ctypes.c_double(until - t), True, *flags, last)


@needs_compiler
@pytest.mark.parametrize("edition", [2, 3])
def test_steps_of_any_size_advance_over_the_intervals_inside(edition: int, tmp_path: Path) -> None:
    """Steps that skip, halve and repeat intervals: bit-equal to the filter with the skipped values missing."""
    plan = random_plan(active=[(0, 1)] * 12)
    importer, reference = Importer(tmp_path, edition, plan), ReferenceFilter(make_content(plan, Options()))
    c = importer.start()
    assert importer.call("ExitInitializationMode", c) == 0
    rng, t, done = np.random.default_rng(3), float(plan.edges[0]), 0
    stops = plan.edges[[1, 2, 4, 5, 9]].tolist()
    for until in (*stops[:3], float(np.mean(plan.edges[4:6])), *stops[3:], plan.edges[12] + 5):
        z = rng.standard_normal(3)
        z[0] = np.nan if done == 2 else z[0]
        importer.put(c, z)
        assert importer.step(c, t, float(until)) == 0
        ends = int(np.sum(plan.edges[1:] <= until))
        for k in range(done, ends):
            assert reference.step(z if k == ends - 1 else np.full(3, np.nan)) == 0
        done, t = ends, float(until)
        assert importer.get(c, "x[1]", "x[2]", "x[3]") == reference.x.tolist()
        w, v = reference.predict()
        assert importer.get(c, "w[1]", "w[2]", "nis") == [*w.tolist(), float(reference.nis)]
        assert importer.get(c, "sd_x[2]", "sd_w[1]") == [float(np.sqrt(reference.variance()[1])), float(np.sqrt(v[0]))]
    importer.put(c, np.array([np.inf, 0.0, 0.0]))
    assert importer.step(c, t, t + 1) == 0  # the horizon is over: nothing moves
    assert importer.call("Reset", c) == 0 and importer.get(c, "x[1]") == [float(plan.model.mean[0])]
    importer.put(c, np.array([np.inf, 0.0, 0.0]))
    assert importer.step(c, float(plan.edges[0]), float(plan.edges[1])) == 1  # fmiWarning
    importer.call("FreeInstance", c)


@needs_compiler
@pytest.mark.parametrize("edition", [2, 3])
def test_a_reading_at_the_start_is_an_input_of_the_initialisation(edition: int, tmp_path: Path) -> None:
    plan = random_plan(active=[(0,)] * 3, intervals=3, rows=(1,))
    object.__setattr__(plan, "edges", np.array([0.0, 0.0, 1.0, 2.0]))
    object.__setattr__(plan, "instants", True)
    importer, reference = Importer(tmp_path, edition, plan), ReferenceFilter(make_content(plan, Options()))
    c = importer.start()
    importer.put(c, np.array([0.5]))
    assert importer.call("ExitInitializationMode", c) == 0
    assert reference.step(np.array([0.5])) == 0
    assert importer.get(c, "x[1]", "x[2]", "x[3]") == reference.x.tolist()


@needs_compiler
@pytest.mark.parametrize("edition", [2, 3])
def test_instances_are_eight_at_a_time_and_only_of_this_run(edition: int, tmp_path: Path) -> None:
    importer = Importer(tmp_path, edition, random_plan())
    assert importer.instance("somebody else") is None
    taken = [importer.instance() for _ in range(8)]
    assert all(taken) and importer.instance() is None
    importer.call("FreeInstance", taken[3])
    assert importer.instance() is not None


@pytest.mark.parametrize("edition", [2, 3])
def test_the_description_names_sources_variables_and_run(edition: int, tmp_path: Path) -> None:
    plan = random_plan(names=('a "b" <c>', "größe"))
    found = texts(edition, plan)
    xml = ElementTree.fromstring(found["modelDescription.xml"])
    names = [v.get("name") for v in xml.find("ModelVariables") if v.get("name")]  # type: ignore[union-attr]
    for name in ("z[3]", "valid[3]", "x[3]", "sd_x[3]", "w[2]", "sd_w[2]", "nis", "next_sensor[2]", "status"):
        assert name in names
    assert xml.find("DefaultExperiment").get("stopTime") == repr(float(plan.edges[-1]))  # type: ignore[union-attr]
    listed = xml if edition == 2 else ElementTree.fromstring(found["sources/buildDescription.xml"])
    files = {each.get("name") for each in listed.iter("File" if edition == 2 else "SourceFile")}
    assert files == {"oc_fmu.c", "oc_filter.c", "oc_tables.c"}
    other = random_plan(seed=1)
    key = "guid" if edition == 2 else "instantiationToken"
    assert xml.get(key) != ElementTree.fromstring(texts(edition, other)["modelDescription.xml"]).get(key)
    one, two = (write_fmu(tmp_path / name, texts(edition, plan))[0].read_bytes() for name in ("one.fmu", "two.fmu"))
    assert one == two


@needs_compiler
def test_a_binary_is_added_on_demand(tmp_path: Path) -> None:
    for edition in (2, 3):
        (path,) = write_fmu(tmp_path / f"{edition}.fmu", texts(edition), build="oc")
        binaries = [name for name in zipfile.ZipFile(path).namelist() if name.startswith("binaries/")]
        assert len(binaries) == 1 and binaries[0].split("/")[-1].startswith("oc.")


def test_refusals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match="there is no FMI 1 for --fmi\n  hint: there are: 2, 3"):
        texts(1)
    plan = random_plan()
    object.__setattr__(plan, "model", None)
    object.__setattr__(plan, "why", "it is a set")
    with pytest.raises(UsageError, match="an FMU needs a filter: it is a set"):
        texts(3, plan)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(SolveFailed, match="no C compiler was found"):
        write_fmu(tmp_path / "x.fmu", texts(3), build="oc")
