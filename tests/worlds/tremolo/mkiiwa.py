"""Once: models/iiwa.urdf from pybullet_data's kuka_iiwa/model.urdf: shapes and <dynamics> taken out, flange, sensor and tip frames added."""
import os, re
import pybullet_data

src = open(os.path.join(pybullet_data.getDataPath(), "kuka_iiwa", "model.urdf")).read()
s = re.sub(r"<!--.*?-->\s*", "", src, flags=re.S)
for tag in ("visual", "collision", "material"):
    s = re.sub(rf"<{tag}[^>]*>.*?</{tag}>\s*", "", s, flags=re.S)
s = re.sub(r"<dynamics[^>]*/>\s*", "", s)
s = re.sub(r"<link name=\"lbr_iiwa_link_0\">.*?</link>", '<link name="lbr_iiwa_link_0"/>', s, flags=re.S)
extra = ""
for parent, child, z in (("lbr_iiwa_link_7", "flange", 0.045), ("flange", "ft_sensor", 0.0375), ("ft_sensor", "tool_tip", 0.12)):
    extra += f'  <link name="{child}"/>\n  <joint name="{child}_joint" type="fixed">\n    <parent link="{parent}"/><child link="{child}"/>\n    <origin rpy="0 0 0" xyz="0 0 {z}"/>\n  </joint>\n'
s = s.replace("</robot>", extra + "</robot>")
head = "<!-- From pybullet_data kuka_iiwa/model.urdf (c) 2015 R. Krug, T. Stoyanov, BSD licence; shapes and <dynamics> removed, fixed frames flange, ft_sensor, tool_tip added. -->\n"
s = s.replace('<?xml version="1.0" ?>\n', '<?xml version="1.0" ?>\n' + head)
open("models/iiwa.urdf", "w").write(s)
