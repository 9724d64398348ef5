"""The public names: one table, and one rule for names that several families have."""

from __future__ import annotations

import pytest

import occontrol as oc
from occontrol.families import find_family, names


@pytest.mark.parametrize("family", names())
def test_every_method_and_the_problem_of_a_family_are_public_below_its_name(family: str) -> None:
    space, found = getattr(oc, family), find_family(family)
    for kind in (*found.methods.values(), found.problem_type):
        assert getattr(space, kind.__name__) is kind


def test_every_problem_has_a_name_of_its_own_at_the_top() -> None:
    for family in oc._FAMILIES:
        space, kind = getattr(oc, family), find_family(family).problem_type
        own = [name for name in dir(space) if getattr(space, name) is kind]
        assert len(own) == 1 and getattr(oc, own[0]) is kind
        assert set(find_family(family).methods.values()) <= {getattr(space, name) for name in dir(space)}


def test_a_name_of_one_family_alone_is_public_at_the_top() -> None:
    for family in oc._FAMILIES:
        for name in dir(getattr(oc, family)):
            owners = [other for other in names() if name in dir(getattr(oc, other))]
            if owners == [family]:
                assert getattr(oc, name) is getattr(getattr(oc, family), name)


def test_of_a_shared_name_that_of_athans_is_at_the_top_or_none() -> None:
    assert oc.Random is oc.athans.Random and oc.Random is not oc.robust.Random
    assert oc.RoundRobin is oc.athans.RoundRobin and oc.BestSingle is oc.athans.BestSingle
    for name in ("Fixed", "Optimal"):
        with pytest.raises(AttributeError, match=f"module 'occontrol' has no attribute '{name}'"):
            getattr(oc, name)
    assert oc.robust.Optimal(relative_gap=0.1).name == oc.vlambda.Optimal().name == "optimal"


def test_a_name_that_a_family_does_not_have_is_refused_with_those_that_it_has() -> None:
    with pytest.raises(AttributeError, match=r"occontrol\.precision has no 'Random'; there are: Barrier, Cla"):
        oc.precision.Random  # noqa: B018


def test_what_is_listed_is_there() -> None:
    assert set(names()) < set(dir(oc)) and set(oc.__all__) < set(dir(oc))
    assert all(getattr(oc, name) is not None for name in oc.__all__)
    assert repr(oc.robust) == "<the problems and methods of family robust>"
