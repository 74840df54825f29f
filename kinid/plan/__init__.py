"""Planning experiments: motions that respect the robot, and that excite what is to be estimated."""

from kinid.plan.expected import Law
from kinid.plan.limits import Limits
from kinid.plan.planner import Guard, Planner, Protocol
from kinid.plan.setpoint import Pace
from kinid.plan.signals import Multisine, Sampled
from kinid.plan.touches import Poke, Slide, four_paths, grid, shortest_tour, within
from kinid.plan.trajectory import Trajectory, read_trajectory

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
