"""Joints and wrench to `kinid live shm:/dev/shm/kinid`. Copy `Ring` into the robot's loop."""

import mmap
import struct
import sys
import time

SLOTS, WIDTH = 4096, 21  # samples that wait; numbers of the largest: q, dq, tau of seven joints


class Ring:
    """A file in shared memory; kinid.live.sources.shared_memory tells what stands where."""

    def __init__(self, path):
        with open(path, "w+b") as file:
            file.truncate(64 + SLOTS * (24 + 8 * WIDTH))
            self.map, self.count = mmap.mmap(file.fileno(), 0), 0
        struct.pack_into("<8sIIIIQQ", self.map, 0, b"KINIDSHM", 1, SLOTS, WIDTH, 0, 0, time.time_ns())

    def put(self, kind, t_ns, numbers):
        """One sample: 1 joints (q, then dq, then tau) or 2 wrench; when it was measured [ns]."""
        at = 64 + (self.count % SLOTS) * (24 + 8 * WIDTH)
        struct.pack_into("<Q", self.map, at, 0)
        struct.pack_into(f"<IIq{len(numbers)}d", self.map, at + 8, kind, len(numbers), t_ns, *numbers)
        self.count += 1
        struct.pack_into("<Q", self.map, at, self.count)
        struct.pack_into("<Q", self.map, 24, self.count)


if __name__ == "__main__":  # python send_ring.py PATH CYCLES: a robot at rest
    ring = Ring(sys.argv[1])
    time.sleep(1.0)  # for a reader that begins now
    for _ in range(int(sys.argv[2])):
        now = time.time_ns()
        ring.put(1, now, [0.1] * 7)
        ring.put(2, now, [0.0, 0.0, -2.4, 0.0, 0.0, 0.0])
        time.sleep(1e-3)
