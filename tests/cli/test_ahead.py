"""What the demo compiles beside its first step is what its later steps would compile."""

from __future__ import annotations

import numpy as np

import kinid
from kinid.cli.ahead import compile_ahead
from kinid.kernels import chain, intensity


def test_later_steps_find_compiled_what_was_compiled_ahead() -> None:
    compile_ahead()
    kernels = (chain.contacts, intensity.bank)
    before = [len(kernel.signatures) for kernel in kernels]
    assert all(before)
    t = np.arange(1000) / 250.0
    q = np.array([0.1, 0.6, 0.0, -1.4, 0.0, 1.0, 0.0]) + 0.02 * np.sin(np.outer(2.0 * t, np.arange(1, 8)))
    rig = kinid.Rig.parse(
        {"robot": {"model": "lwr4plus"}, "surface": {"point": [0.0, 0.0, 0.1], "normal": [0.0, 0.0, 1.0]}}
    )
    log = kinid.Log(t=t, q=q, wrench=np.random.default_rng(0).standard_normal((len(t), 6)))
    kinid.contact_series(log, rig, trust_wrench=True)
    assert [len(kernel.signatures) for kernel in kernels] == before
