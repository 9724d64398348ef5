"""Choosers that do not look at the covariance to decide: fixed, held, recorded, round-robin and random choices.

They stand beside the rules of sensor_choice.py as a comparison, and they repeat what a run has decided. Their scores
are the paper's rho_j all the same, and movable sensors stand where the paper's rule puts them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from occontrol.families.vlambda.sensor_choice import Choice, EigenspaceChooser, Epoch, choice_of


@dataclass(frozen=True)
class FixedChooser:
    """The same sensors in every epoch."""

    sensors: tuple[int, ...]

    def choose(self, epoch: Epoch) -> Choice:
        """Choose `sensors`.

        Parameters
        ----------
        epoch : Epoch
        """
        return choice_of(tuple(sorted(self.sensors)), *EigenspaceChooser().scores(epoch))


@dataclass(frozen=True)
class HoldChooser:
    """The same answer for every epoch: what a stopped run goes on with."""

    answer: Choice

    def choose(self, epoch: Epoch) -> Choice:
        """Repeat the answer.

        Parameters
        ----------
        epoch : Epoch
        """
        return self.answer


@dataclass(frozen=True)
class SequenceChooser:
    """A given group of sensors in each epoch, at given locations if any."""

    groups: tuple[tuple[int, ...], ...]
    locations: tuple[Mapping[int, np.ndarray], ...] = ()

    @classmethod
    def repeating(cls, choices: Iterable[Choice]) -> SequenceChooser:
        """The chooser that makes these choices again, one for each epoch, at the same locations."""
        made = list(choices)
        return cls(tuple(c.sensors for c in made), tuple(dict(c.locations) for c in made))

    def choose(self, epoch: Epoch) -> Choice:
        """Choose `groups[epoch.index]`.

        Parameters
        ----------
        epoch : Epoch
        """
        scores, locations = EigenspaceChooser().scores(epoch)
        given = {**locations, **(self.locations[epoch.index] if self.locations else {})}
        return choice_of(tuple(sorted(self.groups[epoch.index])), scores, given)


@dataclass(frozen=True)
class RoundRobinChooser:
    """Every sensor in turn."""

    def choose(self, epoch: Epoch) -> Choice:
        """Choose the next `epoch.select` sensors.

        Parameters
        ----------
        epoch : Epoch
        """
        count = len(epoch.plant.sensors)
        group = tuple(sorted((epoch.index * epoch.select + i) % count for i in range(epoch.select)))
        return choice_of(group, *EigenspaceChooser().scores(epoch))


@dataclass(frozen=True)
class RandomChooser:
    """Any sensors with equal probability, reproducible for each seed."""

    seed: int = 0

    def choose(self, epoch: Epoch) -> Choice:
        """Draw `epoch.select` different sensors.

        Parameters
        ----------
        epoch : Epoch
        """
        generator = np.random.default_rng([self.seed, epoch.index])
        drawn = generator.choice(len(epoch.plant.sensors), epoch.select, replace=False)
        return choice_of(tuple(sorted(int(j) for j in drawn)), *EigenspaceChooser().scores(epoch))
