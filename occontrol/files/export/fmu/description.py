"""modelDescription.xml and buildDescription.xml of an FMU."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from occontrol.core.state_labels import default_names
from occontrol.files.export.flight.content import Content


@dataclass(frozen=True)
class Variable:
    """A scalar variable of an FMU.

    Parameters
    ----------
    name : as importers show it
    reference : its number
    kind : "real", "flag" or "whole"
    causality : "input", "output" or "independent"
    description : one sentence
    """

    name: str
    reference: int
    kind: str
    causality: str
    description: str


def references(content: Content) -> dict[str, int]:
    """{name in C: first reference} of the variables of a `content`."""
    n, m = content.table("mean").shape[1], content.values
    p = content.plan.filter.outputs if content.plan.filter else 0
    sizes = {"TIME": 1, "Z": m, "VALID": m, "X": n, "SD_X": n, "W": p, "SD_W": p, "NIS": 1}
    sizes |= {"NEXT": len(content.plan.names), "PLANNED": 1, "STATUS": 1, "COUNT": 1}
    found, at = {}, 0
    for name, size in sizes.items():
        found[name], at = at, at + size
    return found


def variables(content: Content) -> list[Variable]:
    """Every variable of a `content`, in the order of their references."""
    plan, first = content.plan, references(content)
    n, m = content.table("mean").shape[1], content.values
    p = plan.filter.outputs if plan.filter else 0
    found = [Variable("time", 0, "real", "independent", "Time")]

    states = plan.states or default_names(n)

    def row(name: str, key: str, size: int, kind: str, causality: str, text: str) -> None:
        found.extend(
            Variable(f"{name}[{i + 1}]", first[key] + i, kind, causality, text.replace("#", str(i + 1)))
            for i in range(size)
        )

    row("z", "Z", m, "real", "input", "Value # of the sensors in use, one sensor after the other")
    row("valid", "VALID", m, "flag", "input", "Whether value # has arrived")
    for i, state in enumerate(states):
        found.append(Variable(f"x[{i + 1}]", first["X"] + i, "real", "output", f"Estimate of {state}"))
    for i, state in enumerate(states):
        text = f"Standard deviation of the estimate of {state}"
        found.append(Variable(f"sd_x[{i + 1}]", first["SD_X"] + i, "real", "output", text))
    row("w", "W", p, "real", "output", f"Prediction of output #{plan.predicted_for}")
    row("sd_w", "SD_W", p, "real", "output", "Its standard deviation")
    found.append(Variable("nis", first["NIS"], "real", "output", "Normalised innovation squared of the last values"))
    for j, name in enumerate(plan.names):
        text = f"Whether to read {name} next"
        found.append(Variable(f"next_sensor[{j + 1}]", first["NEXT"] + j, "flag", "output", text))
    found.append(Variable("planned", first["PLANNED"], "flag", "output", "Whether the precomputed gains hold"))
    text = "0 done, 2 over, 3 infinite sample, 4 singular"
    found.append(Variable("status", first["STATUS"], "whole", "output", text))
    found.append(Variable("values", first["COUNT"], "whole", "output", "How many of z arrive next"))
    return found


def token(digest: str) -> str:
    """The identity of an FMU: a UUID that follows from the `digest` of its run."""
    return str(uuid.uuid5(uuid.NAMESPACE_URL, f"occontrol:{digest}"))


def _attributes(pairs: Mapping[str, object]) -> str:
    return " ".join(f"{name}={quoteattr(str(value))}" for name, value in pairs.items())


def model_description(
    content: Content, edition: int, prefix: str, title: str, digest: str, version: str, sources: list[str]
) -> str:
    """modelDescription.xml.

    Parameters
    ----------
    content : Content with a filter
    edition : 2 or 3
    prefix : of the names in C, also the model's identifier
    title : of the run, in words
    digest : of the run
    version : of the writer
    sources : files of the folder sources
    """
    plan = content.plan
    identity = {"modelName": title, "description": f"Filter along a schedule, run {digest[:12]}"}
    identity |= {"generationTool": f"occontrol {version}", "variableNamingConvention": "flat"}
    experiment = {"startTime": repr(float(plan.edges[0])), "stopTime": repr(float(plan.edges[-1]))}
    head = '<?xml version="1.0" encoding="UTF-8"?>\n'
    simulation = {"modelIdentifier": prefix, "canHandleVariableCommunicationStepSize": "true"}
    every = variables(content)
    outputs = [v for v in every if v.causality == "output"]
    if edition == 2:
        files = "\n".join(f"      <File name={quoteattr(name)}/>" for name in sources)
        body = "\n".join(_variable_2(v) for v in every if v.causality != "independent")
        index = {v.name: i for i, v in enumerate([v for v in every if v.causality != "independent"], start=1)}
        unknowns = "\n".join(f'      <Unknown index="{index[v.name]}"/>' for v in outputs)
        return (
            f'{head}<fmiModelDescription fmiVersion="2.0" guid="{token(digest)}" {_attributes(identity)}>\n'
            f"  <CoSimulation {_attributes(simulation)}>\n    <SourceFiles>\n{files}\n    </SourceFiles>\n"
            f"  </CoSimulation>\n  <DefaultExperiment {_attributes(experiment)}/>\n"
            f"  <ModelVariables>\n{body}\n  </ModelVariables>\n"
            f"  <ModelStructure>\n    <Outputs>\n{unknowns}\n    </Outputs>\n    <InitialUnknowns>\n{unknowns}\n"
            f"    </InitialUnknowns>\n  </ModelStructure>\n</fmiModelDescription>\n"
        )
    body = "\n".join(_variable_3(v) for v in every)
    lines = [f'    <Output valueReference="{v.reference}"/>' for v in outputs]
    lines += [f'    <InitialUnknown valueReference="{v.reference}"/>' for v in outputs]
    unknowns = "\n".join(lines)
    return (
        f'{head}<fmiModelDescription fmiVersion="3.0" instantiationToken="{token(digest)}" {_attributes(identity)}>\n'
        f"  <CoSimulation {_attributes(simulation)}/>\n  <DefaultExperiment {_attributes(experiment)}/>\n"
        f"  <ModelVariables>\n{body}\n  </ModelVariables>\n"
        f"  <ModelStructure>\n{unknowns}\n  </ModelStructure>\n</fmiModelDescription>\n"
    )


def _variable_2(v: Variable) -> str:
    kind = {"real": "Real", "flag": "Boolean", "whole": "Integer"}[v.kind]
    given = {"name": v.name, "valueReference": v.reference, "causality": v.causality, "variability": "discrete"}
    given["description"] = v.description
    start = ""
    if v.causality == "input":
        start = ' start="false"' if v.kind == "flag" else ' start="0"'
    return f"    <ScalarVariable {_attributes(given)}><{kind}{start}/></ScalarVariable>"


def _variable_3(v: Variable) -> str:
    kind = {"real": "Float64", "flag": "Boolean", "whole": "Int32"}[v.kind]
    given: dict[str, object] = {"name": v.name, "valueReference": v.reference, "causality": v.causality}
    given["variability"] = "continuous" if v.causality == "independent" else "discrete"
    given["description"] = v.description
    if v.causality == "input":
        given["start"] = "false" if v.kind == "flag" else "0"
    return f"    <{kind} {_attributes(given)}/>"


def build_description(prefix: str, sources: list[str]) -> str:
    """sources/buildDescription.xml of FMI 3.

    Parameters
    ----------
    prefix : the model's identifier
    sources : files of the folder sources
    """
    files = "\n".join(f"      <SourceFile name={quoteattr(name)}/>" for name in sources)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiBuildDescription fmiVersion="3.0">\n'
        f'  <BuildConfiguration modelIdentifier="{prefix}">\n    <SourceFileSet language="C99">\n{files}\n'
        "    </SourceFileSet>\n  </BuildConfiguration>\n</fmiBuildDescription>\n"
    )
