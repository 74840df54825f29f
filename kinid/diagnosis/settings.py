"""The numbers that a diagnosis decides by: all of them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DiagnosisSettings:
    """What a diagnosis decides by. `docs/benchmarks.md` has the curve that chose each.

    Attributes:
        min_significance: held-out gain over its standard error [1]; an effect is accepted above it.
        beyond_doubt: inside the tolerance, times the share that an addition leaves (of what is beyond noise; beside
            other additions, of the squared error), the significance that it must have: no form is exact [1].
        min_share: of the squared error that is left, what an effect must take off; one that couples channels, for each
            parameter that it has a channel [1].
        min_reading_share: root mean square of an effect's change of the readings over that of the readings [1]; less
            than this no sensor's linearity bears out.
        alternative_significance: alternatives within so many standard errors of each other are not told apart [1].
        alternative_share: nor are those of which neither takes off more than this share of what the other leaves [1].
        parameter_price: of the best gain, what each parameter must bring that a simpler effect does without [1].
        refits: effects that are refitted in a round [1].
        promising_share: of the best predicted gain of a round, what another effect must promise to be refitted [1].
        max_effects: effects that are added at most [1].
        tolerance: share of the readings' root mean square that may be left [1].
        stand_in_ratio: of what is left beyond noise to what an effect takes off, as root mean squares, above which the
            effect is a stand-in where the diagnosis ends unexplained [1].
    """

    min_significance: float = 4.0
    beyond_doubt: float = 30.0
    min_share: float = 0.03
    min_reading_share: float = 0.003
    alternative_significance: float = 2.0
    alternative_share: float = 0.02
    parameter_price: float = 0.01
    refits: int = 6
    promising_share: float = 0.15
    max_effects: int = 8
    tolerance: float = 0.02
    stand_in_ratio: float = 0.5

    @property
    def explains(self) -> float:
        """Share of the squared error beyond noise from which on an effect explains it: no stand-in, no usual form."""
        return 1.0 / (1.0 + self.stand_in_ratio**2)
