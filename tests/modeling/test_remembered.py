"""What is the same for many logs is worked out once, whatever it is asked with."""

from __future__ import annotations

import numpy as np

from kinid.modeling.remembered import remembered


def test_it_is_worked_out_once_and_again_for_what_can_not_be_remembered() -> None:
    asked = []

    @remembered
    def total(x: object) -> float:
        asked.append(x)
        return float(np.sum(x))  # type: ignore[call-overload]

    assert total((1.0, 2.0)) == total((1.0, 2.0)) == 3.0
    assert len(asked) == 1
    # an effect of a user's own may hold an array, by which nothing is remembered
    assert total(np.ones(2)) == total(np.ones(2)) == 2.0
    assert len(asked) == 3
