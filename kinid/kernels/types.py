"""Types of compiled functions' arguments."""

from typing import Any

#: an argument of a compiled function: numba knows its layout (arrays, tuples, records), type checkers don't
Compiled = Any
