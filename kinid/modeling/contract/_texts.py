"""Rules about what users read of an effect, and about the names it gives."""

from __future__ import annotations

import re

from kinid.effects import Stage, catalogue
from kinid.modeling.contract._case import Case, Rule, demand

#: shorter texts say nothing
SHORTEST = 4
#: what an effect may ask of the signals
NEEDS = {"normal", "slip", "wrench", "joints"}


def identity(case: Case) -> str:
    """A name in kebab-case, and a final class with a docstring of its own."""
    kind = case.kind
    demand(re.fullmatch(r"[a-z]+(-[a-z]+)*", case.name), f'id = "{case.name}"')
    demand(getattr(kind, "__final__", False), f"class {kind.__name__} without @final")
    doc = kind.__doc__ or ""
    demand(len(doc) >= SHORTEST and not doc.startswith(f"{kind.__name__}("), f"no docstring in {kind.__name__}")
    return f"{case.name}, a final class with a docstring"


def texts(case: Case) -> str:
    """Title, equation, source, signature and what excites it are there."""
    wanted = ("title", "equation", "source", "signature", "excited_by")
    for attribute in wanted:
        text = getattr(case.kind, attribute, "")
        demand(len(text) >= SHORTEST and text == text.strip(), f'{attribute} = "{text}"')
    demand(not case.kind.title.endswith("."), f'title = "{case.kind.title}", with a full stop')
    return ", ".join(wanted)


def signature(case: Case) -> str:
    """Its signature says something that no other effect's says, and its name isn't taken by another one."""
    others = {name: kind for name, kind in catalogue().items() if name != case.name}
    same = [name for name, kind in others.items() if kind.signature == case.kind.signature]
    demand(not same, f"the signature of '{' and '.join(same)}'")
    return f"“{case.kind.signature}”"


def confusions(case: Case) -> str:
    """What it is mistaken for and what it needs are effects of the catalogue."""
    kind, known = case.kind, {*catalogue()} - {case.name}
    for attribute, named in (("confusions", kind.confusions), ("requires", kind.requires)):
        unknown = set(named) - known
        demand(not unknown, f"{attribute} of {', '.join(sorted(unknown))}, not in the catalogue")
    for other, apart in kind.confusions.items():
        demand(len(apart) >= SHORTEST, f'"{other}": "{apart}", which says nothing')
    demand(kind.confusions or kind.base or kind.detector, "none")
    return ", ".join(kind.confusions) or "none: " + ("a base" if kind.base else "told by its mark")


def stages(case: Case) -> str:
    """It acts somewhere, and where its kind of log has a stage."""
    acting, kind = set(case.effect.stages()), case.kind
    unknown = set(kind.needs) - NEEDS
    demand(not unknown, f"needs of {', '.join(sorted(unknown))}; known are {', '.join(sorted(NEEDS))}")
    said = ", ".join(stage.value for stage in case.effect.stages())
    demand(acting, "no method of a stage")
    if "joints" in kind.needs:
        demand(acting <= {Stage.JOINT, Stage.SENSOR, Stage.ACQUISITION}, f"{said}, with needs of joints")
    elif kind.base:
        demand(Stage.ELASTIC in acting, f"a base that acts on {said}")
    else:
        demand(Stage.JOINT not in acting, f"{said}, without needs of joints")
    return said


TEXTS = (
    Rule("identity", identity, "a name in kebab-case, @final, a docstring", "name it as its file, and describe it"),
    Rule("texts", texts, "what users read, without spaces around", "write it; it ends up in reports"),
    Rule("signature", signature, "what its absence alone looks like", "say what tells it from that one"),
    Rule("confusions", confusions, "effects of the catalogue", "name them, and say what tells them apart"),
    Rule("stages", stages, "a stage that its log has", "implement the method of its stage; needs = ('joints',)?"),
)
