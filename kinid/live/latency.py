"""Times in a histogram of fixed size: a session of days takes no more room than one of a second."""

from __future__ import annotations


class Latencies:
    """Durations [ns], to 1/16 of their size."""

    def __init__(self) -> None:
        self._bins = [0] * (64 * 16)
        self.count, self.longest = 0, 0

    def add(self, duration: int) -> None:
        """One more."""
        duration = max(duration, 16)
        octave = duration.bit_length() - 5
        self._bins[(octave << 4) + (duration >> octave) - 16] += 1
        self.count += 1
        self.longest = max(self.longest, duration)

    def percentile(self, percent: float) -> float:
        """Below which so many of them lie [ns]; 0 without any."""
        wanted, seen = percent / 100.0 * self.count, 0
        for place, many in enumerate(self._bins):
            seen += many
            if many and seen >= wanted:
                octave, rest = divmod(place, 16)
                return float((rest + 16.5) * (1 << octave))
        return 0.0

    def summary(self) -> dict[str, float]:
        """Median, 99 and 99.9 % and the longest [µs]."""
        out = {name: 1e-3 * self.percentile(p) for name, p in (("median", 50.0), ("p99", 99.0), ("p99.9", 99.9))}
        return out | {"longest": 1e-3 * self.longest}
