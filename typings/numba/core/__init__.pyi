from typing import Any

from numba.core import caching as caching

event: Any
