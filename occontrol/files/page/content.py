"""What stands on a page, as data: panels over one axis of time, tables, texts and pictures. No library draws here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from occontrol.core.kinds import Plain


@dataclass(frozen=True, eq=False, kw_only=True)
class Bars:
    """Who is used when: one row for every name.

    Parameters
    ----------
    title : of the panel
    edges : (K+1,) increasing times
    weights : (K, M) share of the time between two edges; at instants, how often
    names : of the M rows, the first on top
    allowed : (K, M) of bool, where a name may be used; None is always
    rates : (K, M) what the use costs, None where nothing is known
    rate : what `rates` are, in words
    instants : whether the use is at the instants edges[:-1] and not between them
    """

    title: str
    edges: np.ndarray
    weights: np.ndarray
    names: Sequence[str]
    allowed: np.ndarray | None = None
    rates: np.ndarray | None = None
    rate: str = "cost rate"
    instants: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Curves:
    """A few curves over time.

    Parameters
    ----------
    title, label : of the panel and of its vertical axis
    times : (K,), or (K+1,) edges where the values stand between them
    values : (K, C)
    names : of the C curves
    used : (K, C) of bool, drawn thick; None for none
    low, high : (K, C) ends of a band round each curve, None for none
    level : a value that is marked by a line, None for none
    sensors : whether the names are sensors, whose colours and boxes they share
    dots : whether the values are points that nothing joins
    """

    title: str
    label: str
    times: np.ndarray
    values: np.ndarray
    names: Sequence[str]
    used: np.ndarray | None = None
    low: np.ndarray | None = None
    high: np.ndarray | None = None
    level: float | None = None
    sensors: bool = False
    dots: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Shades:
    """Many curves over time as a map, one row for every name.

    Parameters
    ----------
    title, label : of the panel and of its colours
    edges : (K+1,) ends of the columns
    values : (K, M); not-a-number stays empty
    names : of the M rows, the first on top
    smallest : whether the smallest value stands for what is too narrow to be seen, otherwise the largest
    """

    title: str
    label: str
    edges: np.ndarray
    values: np.ndarray
    names: Sequence[str]
    smallest: bool = False


Panel = Bars | Curves | Shades


@dataclass(frozen=True, eq=False, kw_only=True)
class Group:
    """Panels below each other over one horizontal axis, which zoom together.

    Parameters
    ----------
    axis : name of the horizontal axis
    panels : from the top
    title : above them
    log : whether the axis is logarithmic
    whole : whether it counts, so that only whole numbers stand at it
    """

    axis: str
    panels: Sequence[Panel]
    title: str = ""
    log: bool = False
    whole: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Table:
    """A table that can be sorted and copied.

    Parameters
    ----------
    title : above it
    columns : {heading: values}, all of one length, numbers or texts
    """

    title: str
    columns: Mapping[str, Sequence[Plain]]

    @property
    def length(self) -> int:
        """The number of rows."""
        return len(next(iter(self.columns.values()), ()))


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture for those who look without scripts.

    Parameters
    ----------
    name : of the file
    png : its content
    words : what it shows, for those who cannot see it
    """

    name: str
    png: bytes
    words: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Page:
    """One page.

    Parameters
    ----------
    title, kind : what it is about, and what kind of page it is
    sentences : what was found, in words
    numbers : (label, text) the few that matter, with all their digits
    facts : (label, text) lines
    groups : panels
    tables : to sort and to copy
    texts : (title, text) shown as they stand
    pictures : shown where there are no scripts
    """

    title: str
    kind: str
    sentences: Sequence[str] = ()
    numbers: Sequence[tuple[str, str]] = ()
    facts: Sequence[tuple[str, str]] = ()
    groups: Sequence[Group] = ()
    tables: Sequence[Table] = ()
    texts: Sequence[tuple[str, str]] = ()
    pictures: Sequence[Picture] = field(default=())
