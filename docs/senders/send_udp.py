"""Joints and wrench to `kinid live udp://127.0.0.1:5005`: one JSON object a line. Copy `send` into the robot's loop."""

import itertools
import json
import math
import socket
import sys
import time

out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
numbers = itertools.count()  # of lines: by it each that is lost is known


def send(port, t_ns, q, wrench, dq=()):
    """One cycle: when it was measured [ns], positions [rad], fx fy fz tx ty tz [N, N·m], velocities [rad/s]."""
    line = {"n": next(numbers), "t_ns": t_ns, "q": list(q), "wrench": list(wrench)}
    if len(dq):
        line["dq"] = list(dq)
    out.sendto(json.dumps(line).encode(), ("127.0.0.1", port))


if __name__ == "__main__":  # python send_udp.py PORT CYCLES: a robot that nods
    port, cycles = int(sys.argv[1]), int(sys.argv[2])
    for k in range(cycles):
        q = [0.1 * math.sin(1e-3 * k)] * 7
        send(port, time.time_ns(), q, [0.0, 0.0, -2.4, 0.0, 0.0, 0.0])
        time.sleep(1e-3)
