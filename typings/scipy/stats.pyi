from typing import Any

chi2: Any
