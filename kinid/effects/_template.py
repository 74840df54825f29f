"""The file that `kinid effect new` writes: one law for each stage, small, commented, and keeping the contract."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

from kinid.effects._effect import Stage


@dataclass(frozen=True)
class Law:
    """What differs between the files of the stages.

    Attributes:
        about: of the file, a sentence. law: the equation with units, of the class. title, equation, signature,
            excited_by: texts of the effect. confused, apart: an effect it is mistaken for, and what tells them apart.
        attributes: more class attributes, a line each. null: name of its parameter.
        parameters, method: bodies of `parameters` and of the stage's method. does: what the method does.
        example: arguments of its example. numpy: whether the method needs NumPy.
    """

    about: str
    law: str
    title: str
    equation: str
    signature: str
    excited_by: str
    confused: str
    apart: str
    null: str
    parameters: str
    does: str
    method: str
    example: str
    attributes: str = ""
    numpy: bool = False


LAWS: dict[Stage, Law] = {
    Stage.GEOMETRY: Law(
        "A surface that sinks while it is touched.",
        "δ −= r t: r [m/s], how fast the surface sinks from the first sample on.",
        "sinking surface",
        "δ −= r t",
        "force that falls from poke to poke as if each began later",
        "pokes of the same depth, early and late",
        "surface-offset",
        "the same poke early and late: an offset stays",
        "rate",
        'return (Parameter("rate", "r", "m/s", 0.0, -1e-2, 1e-2, scale=1e-5),)',
        "Take off what the surface has sunk; a rate belongs to each depth.",
        "s.depth = s.depth - p[0] * s.t\ns.depth_rate = s.depth_rate - p[0]",
        '("kelvin-voigt",), {"rate": 3e-5}',
    ),
    Stage.ELASTIC: Law(
        "A spring that stiffens with the cube of the depth.",
        "F_e += k δ³ for δ > 0: k [N/m³].",
        "cubic spring",
        "F_e += k δ³",
        "force over depth that bends upwards ever more",
        "shallow and deep pokes",
        "hertz-exponent",
        "depths that differ by a factor of five: a power bends most near the surface",
        "stiffness",
        'return (Parameter("stiffness", "k", "N/m³", 0.0, -1e12, 1e12, scale=1e6, linear=True),)',
        "Add to the elastic force; `penetration` is the depth where it is positive.",
        "s.elastic = s.elastic + p[0] * s.penetration**3",
        '("hooke",), {"hooke.stiffness": 830.0, "stiffness": 5e6}',
        attributes="order = 1  # of the elastic stage: 0 bends the base's spring, 1 adds, 2 scales, 3 remembers",
    ),
    Stage.NORMAL: Law(
        "A dashpot whose force grows with the square of the speed.",
        "N += b |δ̇| δ̇ for δ > 0: b [N·s²/m²].",
        "damping with the square of the speed",
        "N += b |δ̇| δ̇",
        "a loop over depth whose width follows the square of the speed",
        "in and out at several speeds, some of them fast",
        "viscous-damping",
        "slow and fast pokes: one loop widens with the speed, the other with its square",
        "damping",
        'return (Parameter("damping", "b", "N·s²/m²", 0.0, -1e8, 1e8, scale=50.0, linear=True),)',
        "Add to the normal force; `inside` is where the tip is in the material.",
        "s.normal = s.normal + p[0] * abs(s.depth_rate) * s.depth_rate * s.inside",
        '("hooke",), {"damping": 260.0}',
    ),
    Stage.FRICTION: Law(
        "Drag along the surface that grows with the square of the speed.",
        "T −= c |v| v for δ > 0: c [N·s²/m²], v the slip rate.",
        "drag with the square of the speed",
        "T −= c |v| v",
        "tangential force that follows the square of the slip rate, whatever the normal force",
        "slides at several speeds, some of them fast",
        "viscous-friction",
        "slow and fast slides: one force grows with the speed, the other with its square",
        "drag",
        'return (Parameter("drag", "c", "N·s²/m²", 0.0, -1e6, 1e6, scale=20.0, linear=True),)',
        "Add to the tangential force, both tangents at once, (2, n).",
        "speed = np.hypot(*s.slip_rate)\ns.tangential = s.tangential - p[0] * speed * s.slip_rate * s.inside",
        '("hooke", "coulomb-friction"), {"drag": 250.0}',
        attributes='needs = ("normal", "slip")  # without slip in a log it isn\'t asked about',
        numpy=True,
    ),
    Stage.FRAME: Law(
        "A material with a grain: it pushes to the side as it is pressed.",
        "T₁ += k δ² for δ > 0: k [N/m²], along the first tangent.",
        "side force of a grain",
        "T₁ += k δ²",
        "force along one tangent that follows the square of the depth and never turns around",
        "shallow and deep pokes, and slides both ways",
        "coupled-stiffness",
        "shallow and deep pokes: one force grows with the depth, the other with its square",
        "stiffness",
        'return (Parameter("stiffness", "k", "N/m²", 0.0, -1e9, 1e9, scale=1e3, linear=True),)',
        "Add along the first tangent, and nothing along the second; `penetration` is the depth where it is positive.",
        "side = p[0] * s.penetration**2\ns.tangential = s.tangential + np.stack([side, np.zeros(len(s))])",
        '("kelvin-voigt", "coulomb-friction"), {"stiffness": 1.5e4}',
        attributes='needs = ("normal", "slip")\ncouples = True  # carries force from one axis into another\n'
        "order = -1  # before the frame is turned",
        numpy=True,
    ),
    Stage.TOOL: Law(
        "A hose that pulls at the tool.",
        "f += Rᵀ F: F [N], constant in the contact frame; R turns sensor axes into it.",
        "pull of a hose",
        "f += Rᵀ F",
        "a force that stays in the world while the sensor turns",
        "a tool that is turned in the air about two axes",
        "tool-mass",
        "turn the tool: a weight acts along gravity alone",
        "pull",
        'axes = ("tangent1", "tangent2", "normal")\n'
        'return tuple(Parameter(f"pull[{a}]", "F", "N", 0.0, -100.0, 100.0, scale=0.1, linear=True) for a in axes)',
        "Add to the wrench at the sensor's origin, (6, n): a force through it makes no torque.",
        'assert s.sensor is not None  # needs = ("wrench",)\n'
        'force = np.einsum("nji,j->in", s.sensor.to_contact, p)\n'
        "s.reading = s.reading + np.concatenate([force, np.zeros_like(force)])",
        '("hooke",), {"pull": (0.8, -0.5, 0.4)}, Motion.WRENCH',
        attributes='needs = ("wrench",)  # all six channels of a sensor',
        numpy=True,
    ),
    Stage.SENSOR: Law(
        "A sensor whose gain grows with the load.",
        "y = f + c |f| f: c [1/N], for the channels of force.",
        "gain that grows with the load",
        "y = f + c |f| f",
        "readings off by the square of the load, in every channel of force",
        "small and large loads in several directions",
        "sensor-gain",
        "small and large loads: a gain is off by the same share",
        "curvature",
        'return (Parameter("curvature", "c", "1/N", 0.0, -0.1, 0.1, scale=1e-4),)',
        "Change the readings sample by sample; channels of torque have another unit.",
        'force = np.array([unit == "N" for unit in s.layout.units])[:, None]\n'
        "s.reading = s.reading + p[0] * abs(s.reading) * s.reading * force",
        '("hooke",), {"curvature": 1e-3}, Motion.WRENCH',
        attributes="needs = ()  # whatever a log reads\naffine = False  # it bends what others predict\n"
        "order = 3  # after the sensor has turned, mixed and shifted what it reads",
        numpy=True,
    ),
    Stage.ACQUISITION: Law(
        "An amplifier that overshoots.",
        "y = f + τ ḟ: τ [s], how far readings run ahead.",
        "overshoot of an amplifier",
        "y = f + τ ḟ",
        "readings ahead of the load by as much as it changes",
        "fast motion, to and fro",
        "sensor-lag",
        "none is needed: a lag's time constant is positive, and readings come late",
        "lead",
        'return (Parameter("lead", "τ", "s", 0.0, -1.0, 1.0, scale=1e-3),)',
        "Change the readings over time, (channels, n); where `dt` is zero, memory begins anew.",
        "step = np.diff(s.reading, axis=1, prepend=s.reading[:, :1])\n"
        "known = s.dt > 0.0\n"
        "rate = np.where(known, step / np.where(known, s.dt, 1.0), 0.0)\n"
        "s.reading = s.reading + p[0] * rate",
        '("kelvin-voigt",), {"lead": 4e-3}, Motion.WAVES',
        attributes="needs = ()  # whatever a log reads\norder = -1  # before the filter, which is 0; 1 is the clock",
        numpy=True,
    ),
    Stage.JOINT: Law(
        "Drag in the joints that grows with the square of the speed.",
        "τ += c |q̇| q̇: c [N·m·s²/rad²] of each joint, as of grease that is churned.",
        "drag in the joints",
        "τ += c |q̇| q̇",
        "torque that follows the square of a joint's speed",
        "each joint at several speeds, both ways",
        "joint-viscous-friction",
        "slow and fast motion: one torque grows with the speed, the other with its square",
        "drag",
        'units = {"N": "N·s²/m²", "N·m": "N·m·s²/rad²"}\n'
        "return tuple(\n"
        '    Parameter(f"drag[{channel}]", "c", units[unit], 0.0, -1e4, 1e4, scale=0.01, linear=True)\n'
        "    for channel, unit in zip(layout.channels, layout.units)\n"
        ")",
        "Add to the torques, (joints, n).",
        'assert s.joints is not None  # needs = ("joints",)\n'
        "s.reading = s.reading + p[:, None] * abs(s.joints.dq) * s.joints.dq",
        '("rigid-body",), {"drag": (0.05, 0.02)}, Motion.ARM',
        attributes='needs = ("joints",)  # a log of joint torques',
    ),
}

_FILE = '''"""{about}

An example that keeps the contract of all effects: put your law in its place, then `kinid effect check {file}`.
`kinid fit … --effects FOLDER` and the other commands read the folder that it lies in.
"""

from __future__ import annotations

from typing import final
{numpy}
from kinid.effects import Array, Effect, Example, Layout, {motion}Signals
from kinid.parameter import Parameter


@final
class {kind}(Effect):
    """{law}"""

    # the name everywhere: the file's, with hyphens
    id = "{name}"
    # what users read in reports, in --explain and in the site
    title = "{title}"
    equation = "{equation}"
    source = "where the equation comes from: author, journal, year"
    # what its absence looks like in a residual
    signature = "{signature} ({name})"
    # effects of the catalogue that it can be mistaken for, and what to measure to tell them apart
    confusions = {{
        "{confused}": "{apart}",
    }}
    # what a log must hold for its parameters to be seen
    excited_by = "{excited_by}"
{attributes}    # values at which it does nothing: a diagnosis compares with that
    null = {{"{null}": 0.0}}
    # it at work: the model's other effects, true values, and a motion that shows it
    example = Example({example})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Name, symbol, SI unit, start, bounds, and the smallest change that matters; linear: readings are affine."""
{parameters}

    def {stage}(self, s: Signals, p: Array) -> None:
        """{does}"""
{method}
'''


def effect_file(name: str, stage: Stage) -> str:
    """The text of a file that holds one effect.

    Args:
        name: of the effect, kebab-case. stage: at which it acts.
    """
    law = LAWS[stage]
    attributes = textwrap.indent(law.attributes, "    ")
    return _FILE.format(
        about=law.about,
        file=f"{name.replace('-', '_')}.py",
        numpy="\nimport numpy as np\n" if law.numpy else "",
        motion="Motion, " if "Motion." in law.example else "",
        kind="".join(part.capitalize() for part in name.split("-")),
        law=law.law,
        name=name,
        title=law.title,
        equation=law.equation,
        signature=law.signature,
        confused=law.confused,
        apart=law.apart,
        excited_by=law.excited_by,
        attributes=f"{attributes}\n" if attributes else "",
        null=law.null,
        example=law.example,
        parameters=textwrap.indent(law.parameters, " " * 8),
        stage=stage.value,
        does=law.does,
        method=textwrap.indent(law.method, " " * 8),
    )
