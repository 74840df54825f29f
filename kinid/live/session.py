"""The loop: a source's items to samples, events, recording and views; what went through, how fast, how late."""

from __future__ import annotations

import gc
import math
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np

from kinid.data.rig import CONTACT as QUANTITIES
from kinid.errors import InputError, KinidError
from kinid.estimators.estimate import Estimate
from kinid.live import encoding
from kinid.live.alignment import Aligner
from kinid.live.events import Event
from kinid.live.latency import Latencies
from kinid.live.messages import NO_SAMPLE, Notice, Source, Start
from kinid.live.pipeline import Pipeline
from kinid.live.rates import Rates
from kinid.live.readings import Readings
from kinid.live.sink import Sink
from kinid.live.trust import Trust
from kinid.writers import Json, finite

#: a stream is lost after so long, or so many of its samples, without one [ns]; looked at so often [ns]
SILENCE_NS, SILENCE_SAMPLES, LOOK_NS = 100_000_000, 20, 20_000_000
#: after so many samples their rate is known
RATE_KNOWN = 100
#: streams have so long to begin [ns]
BEGIN_NS = 2_000_000_000
#: contact quantities and estimates are recorded so often [ns]
RECORD_NS = 20_000_000
#: events that are remembered; all are counted, told and recorded
REMEMBERED = 1000


class Known(Protocol):
    """What is known of places: a map."""

    def nearest(self) -> Mapping[str, float] | None:
        """Values nearest to where the tool is, by the names of the parameters; None where nothing is known."""


class Session:
    """One run of a source through a pipeline.

    Args:
        source: of samples. pipeline: that works on them. joints: names of the robot's joints, in order.
        wrench_offset, max_gap: as in `Aligner`.
        sinks: take all of it, as a recorder or a server do. tell: is told each event.
        known: gives what the estimators start from as something is touched, and behind a border or a jump; None: a
            recorded session's starts, where its recording is replayed.
        full: range of the sensor [N, N·m], where it is known.
        bandwidth: of the pipeline [Hz], where somebody asked for it: beyond half the streams' rate it is refused.

    Attributes:
        samples: that went through the pipeline. counts: of events by kind. events: the last ones.
        processing: time of a sample from its streams' messages to its estimate [ns]; latency: from the reception of the
            last message that a sample needed to its estimate [ns], where a source is live. trust: in the estimates.
    """

    def __init__(
        self,
        source: Source,
        pipeline: Pipeline,
        joints: Sequence[str],
        *,
        wrench_offset: float = 0.0,
        max_gap: float | None = None,
        sinks: Sequence[Sink] = (),
        tell: Callable[[Event], None] | None = None,
        known: Known | None = None,
        full: Sequence[float] | None = None,
        bandwidth: float | None = None,
    ) -> None:
        self.source, self.pipeline, self._tell = source, pipeline, tell
        self._sinks, self._working = tuple(sinks), list(sinks)
        self._known, self._starts = known, dict[int, Mapping[str, float]]()
        self.aligner = Aligner(joints, self._report, wrench_offset=wrench_offset, max_gap=max_gap)
        self.samples, self.counts, self.events = 0, Counter[str](), deque[Event](maxlen=REMEMBERED)
        self.processing, self.latency = Latencies(), Latencies()
        self.trust = Trust(pipeline.model, full)
        self._readings = Readings(pipeline.rig, pipeline.contact.robot)
        self._rates: Rates | None = Rates(len(joints))
        self._no_rates = np.full(len(joints), np.nan)
        self._joints = tuple(joints)
        self._doubts: list[str] = []
        self._received = self._looked = self._begun = self._recorded = 0
        self._lost: set[str] = set()
        self._bandwidth = bandwidth
        self._stop, self._patience = False, math.inf

    def stop(self) -> None:
        """End at the next item."""
        self._stop = True

    def run(self, duration: float = math.inf) -> None:
        """Take everything that the source has, or so much of its time [s]; Ctrl-C ends it as the source's end does."""
        gc.collect()
        gc.freeze()  # what is here stays: it needn't be searched for garbage while samples come
        try:
            self._run(duration)
        except KeyboardInterrupt:
            pass
        finally:
            gc.unfreeze()
            self.source.close()
            for sink in self._sinks:
                sink.close()
            self._leave_failed()
            try:
                self._doubts = self._readings.doubts()  # it takes its time, which no sample waits for
            except KinidError as error:  # readings that no log may hold: the session's result stands
                self._doubts = [f"the readings of free motion can't be judged: {error}"]

    def summary(self) -> Json:
        """What went through, as plain types."""
        clocks = self.aligner.clocks.items()
        return {
            "source": self.source.name,
            "samples": self.samples,
            "duration_s": self.aligner.t,
            "rates_hz": {name: 1e9 / clock.period if clock.period else None for name, clock in clocks},
            "processing_us": self.processing.summary(),
            "latency_us": self.latency.summary() if self.source.live else None,
            "events": dict(self.counts),
            "doubts": [*self._doubts, *self.trust.doubts(self.pipeline.estimates)],
            "estimates": {
                part: {
                    "units": {name: self.trust.units[name] for name in estimate.names},
                    "values": dict(zip(estimate.names, estimate.values.tolist())),
                    "std": [finite(v) for v in estimate.std.tolist()],
                    "valid": estimate.valid,
                    "status": estimate.status.remedy,
                }
                for part, estimate in self.pipeline.estimates.items()
            },
        }

    def _run(self, duration: float) -> None:
        aligner, sinks, live = self.aligner, self._working, self.source.live
        clock, spent = time.perf_counter_ns, 0
        begun = heard = time.monotonic_ns()
        self._patience = begun + 1.25 * BEGIN_NS + 1e9 * duration if live else math.inf
        self._received = begun if live else 0
        for item in self.source.items():
            if item is None:
                if live:
                    now = time.monotonic_ns()
                    self._look(now)
                    if (
                        now - heard > 1.25 * BEGIN_NS and now - begun > 1e9 * duration
                    ):  # a stream that is silent ends, too
                        return
            elif isinstance(item, NO_SAMPLE):
                self._heed(item)
            else:
                if item.received - self._looked > LOOK_NS:
                    self._look(item.received)
                begin, heard = clock(), item.received
                stamp = aligner.put(item)
                self._received = item.received
                if stamp is not None:
                    for sink in sinks:
                        sink.sample(item, stamp)
                while aligner.pair():
                    self._sample()
                    end = clock()
                    self.processing.add(spent + end - begin)
                    if live:
                        self.latency.add(time.monotonic_ns() - item.received)
                    begin, spent = end, 0
                spent += clock() - begin
            if self._stop or aligner.t > duration:
                return

    def _heed(self, item: Notice | Start) -> None:
        """What a source says of itself, or of what is to come."""
        if isinstance(item, Start):
            self._starts[item.stamp] = item.values
        else:
            self._received = item.received
            self._report(item.kind, item.says)
            if item.missing:
                self.aligner.lost(item.missing)

    def _sample(self) -> None:
        """The pair that is ready, through the pipeline."""
        aligner = self.aligner
        rates = aligner.dq if self._rates is not None else self._no_rates
        event_bits = self.pipeline.step(aligner.t, aligner.q, aligner.wrench, rates)
        self.samples += 1
        if event_bits:
            if event_bits < 0:
                self._report("not-finite", "a pair that can't be used")
                return
            for event in self.pipeline.explain(event_bits, aligner.t):
                self._note(event)
                if event.kind == "reopened":
                    self.trust.parted()
        if aligner.stamp - self._recorded >= RECORD_NS:
            self._recorded = aligner.stamp
            if self._bandwidth is not None and self.samples > RATE_KNOWN:
                self._check_bandwidth(self._bandwidth)
            if self._rates is not None:
                self._check_rates(self._rates)
            estimates = self.pipeline.estimates
            self.trust.take(estimates)
            self.trust.felt(aligner.wrench)
            if self.pipeline.free:
                self._readings.take(aligner.t, aligner.q, aligner.wrench)
            if self._working:
                self._record(estimates)

    def _check_rates(self, rates: Rates) -> None:
        """Leave velocities out, once and for all, that contradict the positions."""
        slopes = rates.take(self.aligner.t, self.aligner.q, self.aligner.dq)
        if slopes is not None:
            self._rates = None
            of = ", ".join(f"{name} {x:.3g}" for name, x in zip(self._joints, slopes.tolist()) if math.isfinite(x))
            self._report("wrong-velocities", f"velocity over the position's rate: {of}; all are left out")

    def _check_bandwidth(self, asked: float) -> None:
        """Refuse, once, what no samples of this rate can hold (C. E. Shannon, Proc. IRE 37, 1949)."""
        self._bandwidth = None
        rate = 1e9 / max(clock.period for clock in self.aligner.clocks.values())
        if asked > 0.5 * rate:
            raise InputError(
                f"--bandwidth {asked:g} of streams of {rate:.4g} Hz",
                f"half of that at most, {0.5 * rate:.4g} Hz",
                "give less, or leave it out",
            )

    def _record(self, now: Mapping[str, Estimate]) -> None:
        """Contact quantities and estimates as they are now."""
        aligner, pipeline = self.aligner, self.pipeline
        known = dict(zip(QUANTITIES, map(finite, pipeline.quantities.tolist())))
        known["predicted_normal_force"] = finite(pipeline.predicted)
        contact = {"t": aligner.t, **known, "in_contact": pipeline.touching}
        values, status = {}, {}
        for estimate in now.values():
            for name, value, std in zip(estimate.names, estimate.values.tolist(), estimate.std.tolist()):
                values[name] = {"value": finite(value), "std": finite(std)}
                status[name] = estimate.status.name.lower().replace("_", "-")
        estimates = {"t": aligner.t, "values": values, "status": status}
        for sink in self._working:
            sink.state(encoding.CONTACT, self._received, aligner.stamp, contact)
            sink.state(encoding.ESTIMATES, self._received, aligner.stamp, estimates)

    def _report(self, kind: str, says: str) -> None:
        """What a stream has to be told of."""
        self._note(Event(kind, self.aligner.t, says))

    def _note(self, event: Event) -> None:
        # asked before a map takes in what was touched till now
        start = self._start() if event.kind in ("touch", "reopened") else None
        self.counts[event.kind] += 1
        self.events.append(event)
        for sink in self._working:
            sink.event(event, self._received, self.aligner.stamp)
        if self._tell is not None:
            self._tell(event)
        if start:
            self.pipeline.start(start)
            says = ", ".join(f"{name} {value:.4g}" for name, value in start.items())
            self._note(Event("warm-start", event.t, says, event.place, event.force, start))

    def _start(self) -> Mapping[str, float] | None:
        """What the estimators start from here."""
        return self._starts.get(self.aligner.stamp) if self._known is None else self._known.nearest()

    def _look(self, now: int) -> None:
        """Whether a stream is silent, or back."""
        self._looked = now
        self._begun = self._begun or now
        for name, clock in self.aligner.clocks.items():
            if clock.started:
                silent = now - clock.received
                is_lost = silent > max(SILENCE_NS, SILENCE_SAMPLES * clock.period)
            else:
                silent = now - self._begun
                is_lost = silent > BEGIN_NS
            if is_lost and name not in self._lost:
                self._lost.add(name)
                self._report("stream-lost", f"no {name} for {1e-9 * silent:.2f} s")
            elif not is_lost and name in self._lost:
                self._lost.remove(name)
                self._report("stream-returned", name)
        if not self.samples and now > self._patience:  # of one stream alone no time comes
            self._stop = True
        self._leave_failed()

    def _leave_failed(self) -> None:
        """Say of sinks that have given up why they did, and send them nothing more."""
        for sink in [sink for sink in self._working if sink.error]:
            self._working.remove(sink)
            self._report("recording-failed", sink.error)
