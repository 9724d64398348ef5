"""Where pieces of one computation are done: here, one after another, unless there are more places."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

Piece = TypeVar("Piece")
Reply = TypeVar("Reply")


class Spread:
    """Pieces of plain data that are asked the same question again and again, and the places where they are kept.

    This one keeps them here. `count` says how many pieces are worth making.
    """

    count = 1

    def hold(self, function: Callable[..., Reply], pieces: Sequence[Piece]) -> Callable[..., list[Reply]]:
        """What gives function(piece, *words) of every piece for words, in their order.

        Parameters
        ----------
        function : of a module, so that it has a name elsewhere
        pieces : picklable where there are other places
        """
        return lambda *words: [function(piece, *words) for piece in pieces]


HERE = Spread()
