"""Planning experiments: motions that respect the robot, and that excite what is to be estimated."""

from kinid.planning.expected import Law
from kinid.planning.limits import Limits
from kinid.planning.planner import Guard, Planner, Protocol
from kinid.planning.setpoint_timing import Pace
from kinid.planning.signals import Multisine, Sampled
from kinid.planning.touches import Poke, Slide, four_paths, grid, shortest_tour, within
from kinid.planning.trajectory import Trajectory, read_trajectory

__all__ = [
    "Guard",
    "Law",
    "Limits",
    "Multisine",
    "Pace",
    "Planner",
    "Poke",
    "Protocol",
    "Sampled",
    "Slide",
    "Trajectory",
    "four_paths",
    "grid",
    "read_trajectory",
    "shortest_tour",
    "within",
]
