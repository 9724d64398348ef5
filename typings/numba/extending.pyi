from collections.abc import Callable
from typing import Any

models: Any

# the typing context that an intrinsic takes first is Numba's own: callers leave it out
def intrinsic(function: Callable[..., Any]) -> Callable[..., Any]: ...
def register_model(kind: type) -> Callable[[type], type]: ...
