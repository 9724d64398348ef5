from typing import Any

from numba import types as types

config: Any

def njit(*arguments: Any, **options: Any) -> Any: ...
