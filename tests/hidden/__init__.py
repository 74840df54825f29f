"""A second world: logs whose hidden effects do not come from the catalogue's own code.

    from hidden.cases import cases
    for case in cases("single", 200, seed=1, world="wrench"):
        found = kinid.diagnose(kinid.Model(*case.model).fit(case.log, case.rig))

`world/` is a simulator of its own. It shares the format of logs and rigs with kinid, and the text of the arm's URDF;
laws, kinematics, dynamics, sensors and noise are written anew and on other equations:

| physics | here | in the catalogue |
|---|---|---|
| elastic force | springs side by side under the profile of the punch, numerically | a power of the depth |
| damping, relaxation | a plate on springs and dashpots that lifts off, implicit Euler at 5 kHz | recursions on the log
|
| hysteresis, presliding | bundles of sliders (Jenkins, Iwan) and of bristles, each of its own length | one bristle
(Dahl) |
| stress softening | a bundle of fibres that break, each at its own stretch | a function of the deepest depth |
| adhesion | a bundle of threads of unequal length and strength | a closed form |
| layers, compliance | a second spring behind a gap; a spring in series, solved at each step | a ramp; measured force
times C |
| friction | rational in the speed; area of asperities under load; flanks of grooves | exponential; power; factor |
| tool, payload, arm | bodies in MuJoCo's inverse dynamics, on an own inverse kinematics | Newton-Euler on measured
motion |
| sensor | filters, delays, converters and matrices on a 5 kHz stream before it is logged | operations on the prediction
|

A case says what is hidden (`truth`) and which model a user starts with (`model`), which holds all the rest. The size of
each effect is drawn from weak to strong: what the starting model can't absorb of it is 0.2 to 12 times the noise. Dry
friction turns within 0.1 mm (a joint's within 1e-4 rad) unless presliding is hidden (2 µm to 2.6 mm): the catalogue
fixes that length.

Worlds: "force-depth" (a material tester: t, depth, normal force; with slip and tangential forces, or without), "wrench"
(an LWR4+ presses, slides, tilts and turns a tool: joint positions and six channels), "joints" (the arm in free motion:
joint positions and torques). Kinds: "single" and "pair" (one or two effects hidden), "none", "outside" (something that
no catalogue holds, and that its effects can't follow), "not-excited" (a limited protocol; `truth` names what it can't
show). `measured.py` plants effects in logs of real machines. Every case follows from its kind, number, seed and world
alone.
"""
