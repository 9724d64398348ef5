"""The functions that an FMU must export beside those of its template: access to variables, and refusals."""

from __future__ import annotations

from collections.abc import Sequence

SIZE, REFERENCES = "size_t", "const fmi{0}ValueReference *"
# name: the types of the parameters after the instance; an FMU that only simulates refuses them all
REFUSED_2 = {
    "GetFMUstate": ["void **"],
    "SetFMUstate": ["void *"],
    "FreeFMUstate": ["void **"],
    "SerializedFMUstateSize": ["void *", "size_t *"],
    "SerializeFMUstate": ["void *", "char *", SIZE],
    "DeSerializeFMUstate": ["const char *", SIZE, "void **"],
    "GetDirectionalDerivative": [REFERENCES, SIZE, REFERENCES, SIZE, "const double *", "double *"],
    "SetRealInputDerivatives": [REFERENCES, SIZE, "const int *", "const double *"],
    "GetRealOutputDerivatives": [REFERENCES, SIZE, "const int *", "double *"],
    "GetStatus": ["int", "void *"],
    "GetRealStatus": ["int", "double *"],
    "GetIntegerStatus": ["int", "int *"],
    "GetBooleanStatus": ["int", "int *"],
    "GetStringStatus": ["int", "const char **"],
    "SetInteger": [REFERENCES, SIZE, "const int *"],
    "GetString": [REFERENCES, SIZE, "const char **"],
    "SetString": [REFERENCES, SIZE, "const char *const *"],
}
_KINDS_3 = {
    "Float32": "float", "Int8": "int8_t", "UInt8": "uint8_t", "Int16": "int16_t", "UInt16": "uint16_t",
    "UInt32": "uint32_t", "Int64": "int64_t", "UInt64": "uint64_t", "String": "const char *",
}  # fmt: skip
_DERIVATIVE = [REFERENCES, SIZE, REFERENCES, SIZE, "const double *", SIZE, "double *", SIZE]
REFUSED_3 = {
    **{f"Get{kind}": [REFERENCES, SIZE, f"{c} *", SIZE] for kind, c in _KINDS_3.items()},
    **{f"Set{kind}": [REFERENCES, SIZE, f"const {c} *".replace("const const", "const"), SIZE]
       for kind, c in _KINDS_3.items() if kind != "String"},
    "SetString": [REFERENCES, SIZE, "const char *const *", SIZE],
    "SetInt32": [REFERENCES, SIZE, "const int32_t *", SIZE],
    "GetBinary": [REFERENCES, SIZE, "size_t *", "const uint8_t **", SIZE],
    "SetBinary": [REFERENCES, SIZE, "const size_t *", "const uint8_t *const *", SIZE],
    "GetClock": [REFERENCES, SIZE, "bool *"],
    "SetClock": [REFERENCES, SIZE, "const bool *"],
    "GetNumberOfVariableDependencies": ["fmi3ValueReference", "size_t *"],
    "GetVariableDependencies": ["fmi3ValueReference", "size_t *", "fmi3ValueReference *", "size_t *", "int *", SIZE],
    "GetFMUState": ["void **"],
    "SetFMUState": ["void *"],
    "FreeFMUState": ["void **"],
    "SerializedFMUStateSize": ["void *", "size_t *"],
    "SerializeFMUState": ["void *", "uint8_t *", SIZE],
    "DeserializeFMUState": ["const uint8_t *", SIZE, "void **"],
    "GetDirectionalDerivative": _DERIVATIVE,
    "GetAdjointDerivative": _DERIVATIVE,
    "EnterConfigurationMode": [],
    "ExitConfigurationMode": [],
    "GetIntervalDecimal": [REFERENCES, SIZE, "double *", "int *"],
    "GetIntervalFraction": [REFERENCES, SIZE, "uint64_t *", "uint64_t *", "int *"],
    "GetShiftDecimal": [REFERENCES, SIZE, "double *"],
    "GetShiftFraction": [REFERENCES, SIZE, "uint64_t *", "uint64_t *"],
    "SetIntervalDecimal": [REFERENCES, SIZE, "const double *"],
    "SetIntervalFraction": [REFERENCES, SIZE, "const uint64_t *", "const uint64_t *"],
    "SetShiftDecimal": [REFERENCES, SIZE, "const double *"],
    "SetShiftFraction": [REFERENCES, SIZE, "const uint64_t *", "const uint64_t *"],
    "EvaluateDiscreteStates": [],
    "UpdateDiscreteStates": ["bool *"] * 5 + ["double *"],
    "EnterEventMode": [],
    "EnterContinuousTimeMode": [],
    "CompletedIntegratorStep": ["bool", "bool *", "bool *"],
    "SetTime": ["double"],
    "SetContinuousStates": ["const double *", SIZE],
    "GetContinuousStateDerivatives": ["double *", SIZE],
    "GetEventIndicators": ["double *", SIZE],
    "GetContinuousStates": ["double *", SIZE],
    "GetNominalsOfContinuousStates": ["double *", SIZE],
    "GetNumberOfEventIndicators": ["size_t *"],
    "GetNumberOfContinuousStates": ["size_t *"],
    "GetOutputDerivatives": [REFERENCES, SIZE, "const int32_t *", "double *", SIZE],
    "ActivateModelPartition": ["fmi3ValueReference", "double"],
}
_STRING = "const char *"
OTHER_KINDS_3 = {
    "InstantiateModelExchange": [_STRING] * 3 + ["bool"] * 2 + ["void *", "const void *"],
    "InstantiateScheduledExecution": [_STRING] * 3 + ["bool"] * 2 + ["void *"] + ["const void *"] * 4,
}
# function: (type of a value, the accessor of the instance, whether it writes)
ACCESS = {
    2: {
        "GetReal": ("double", "get_real", False),
        "SetReal": ("double", "set_real", True),
        "GetInteger": ("int", "get_whole", False),
        "GetBoolean": ("int", "get_flag", False),
        "SetBoolean": ("int", "set_flag", True),
    },
    3: {
        "GetFloat64": ("double", "get_real", False),
        "SetFloat64": ("double", "set_real", True),
        "GetInt32": ("int32_t", "get_whole", False),
        "GetBoolean": ("bool", "get_flag", False),
        "SetBoolean": ("bool", "set_flag", True),
    },
}


def access(edition: int) -> str:
    """The getters and setters of FMI `edition` 2 or 3, in C."""
    return "\n".join(_access(edition, name, *entry) for name, entry in ACCESS[edition].items())


def _access(edition: int, name: str, kind: str, accessor: str, writes: bool) -> str:
    end, extra = (", size_t m", "    (void)m;\n") if edition == 3 else ("", "")
    types = f"const fmi{edition}ValueReference r[], size_t n, {'const ' if writes else ''}{kind} v[]{end}"
    instance = f"fmi{edition}{'Component' if edition == 2 else 'Instance'}"
    head = f"OCC_EXPORT fmi{edition}Status fmi{edition}{name}({instance} c,"
    indent = " " * 4
    head = f"{head}\n{indent}{types})"
    call = {
        "set_real": "occ_set_real(one, r[i], v[i]) == 0",
        "set_flag": "occ_set_flag(one, r[i], (int)v[i]) == 0",
        "get_real": "occ_get_real(one, r[i], &v[i]) == 0",
        "get_whole": "occ_get_whole(one, r[i], &whole) == 0",
        "get_flag": "occ_get_flag(one, r[i], &flag) == 0",
    }[accessor]
    local = {"get_whole": "        int32_t whole = 0;\n", "get_flag": "        int flag = 0;\n"}.get(accessor, "")
    store = {"get_whole": "        v[i] = whole;\n", "get_flag": "        v[i] = (flag != 0);\n"}.get(accessor, "")
    one = f"    {'' if writes else 'const '}occ_instance *one = c;\n"
    return (
        f"{head};\n{head}\n{{\n{one}    size_t i;\n\n{extra}"
        f"    if ((one == NULL) || ((n > 0U) && ((r == NULL) || (v == NULL)))) {{\n"
        f"        return fmi{edition}Error;\n    }}\n"
        f"    for (i = 0U; i < n; i++) {{\n{local}        if ({call}) {{\n"
        f"            return fmi{edition}Error;\n        }}\n"
        f"{store}    }}\n    return fmi{edition}OK;\n}}\n"
    )


def refused(edition: int) -> str:
    """The functions of FMI `edition` 2 or 3 that always return an error, in C."""
    table = REFUSED_2 if edition == 2 else REFUSED_3
    result = f"fmi{edition}Status", f"fmi{edition}Error"
    text = [_refusal(*result, edition, name, types) for name, types in table.items()]
    if edition == 3:
        text += [_refusal("fmi3Instance", "NULL", 3, name, types, ()) for name, types in OTHER_KINDS_3.items()]
    else:
        text.append(_refusal("fmi2Status", "fmi2OK", 2, "SetDebugLogging", ["int", SIZE, "const char *const *"]))
    return "\n".join(text)


def _refusal(
    result: str, value: str, edition: int, name: str, types: Sequence[str], first: Sequence[str] = ("void *",)
) -> str:
    every = [kind.format(edition) for kind in (*first, *types)]
    named = [f"{kind}{'' if kind.endswith('*') else ' '}a{i}" for i, kind in enumerate(every)]
    head, line = f"OCC_EXPORT {result} fmi{edition}{name}(", ""
    lines = []
    for piece in named:
        if len(line) + len(piece) > 100:
            lines.append(line)
            line = ""
        line += (", " if line or lines else "") + piece
    head += ("\n    ".join([*lines, line])) + ")"
    unused = "".join(f"    (void)a{i};\n" for i in range(len(every)))
    return f"{head};\n{head}\n{{\n{unused}    return {value};\n}}\n"
