"""Strip the example-robot-data URDFs (meshes, hand, transmissions) and add ft_sensor and tool_tip; run once, writes robots/*.urdf."""
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

HERE = Path(__file__).parent


def fixed(root: ET.Element, name: str, parent: str, xyz: str, rpy: str) -> None:
    """Append a massless link `name` fixed to `parent` at xyz [m], rpy [rad]."""
    ET.SubElement(root, "link", name=name)
    joint = ET.SubElement(root, "joint", name=name + "_joint", type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=name)
    ET.SubElement(joint, "origin", xyz=xyz, rpy=rpy)


def strip(source: Path, name: str, flange: str, drop: tuple[str, ...]) -> None:
    """Write robots/<name>.urdf from `source`, dropping links whose name begins with one of `drop`."""
    root = ET.parse(source).getroot()
    root.set("name", name)
    for child in list(root):
        label = child.get("name", "")
        target = child.find("child").get("link", "") if child.tag == "joint" and child.find("child") is not None else label
        if child.tag not in ("link", "joint") or (drop and target.startswith(drop)):
            root.remove(child)
            continue
        for tag in ("visual", "collision", "safety_controller", "calibration", "dynamics"):
            for old in child.findall(tag):
                child.remove(old)
        inertial = child.find("inertial")
        if inertial is not None and float(inertial.find("mass").get("value")) == 0:
            child.remove(inertial)
    fixed(root, "ft_sensor", flange, "0 0 0.022", "0 0 0.3")
    fixed(root, "tool_tip", "ft_sensor", "0 0 0.118", "0 0 0")
    ET.indent(root)
    ET.ElementTree(root).write(HERE / "robots" / f"{name}.urdf")


if __name__ == "__main__":
    share = next(Path(sys.prefix).glob("lib/*/site-packages/cmeel.prefix/share/example-robot-data/robots"))
    (HERE / "robots").mkdir(exist_ok=True)
    strip(share / "panda_description/urdf/panda.urdf", "panda", "panda_link8", ("panda_hand", "panda_left", "panda_right", "panda_finger"))
    for ur in ("ur5", "ur10"):
        strip(share / f"ur_description/urdf/{ur}_robot.urdf", ur, "tool0", ("ee_link", "base_never"))
