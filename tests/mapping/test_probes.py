"""Raw logs to a map: the virtual mould, from joints and wrench alone, beside its truth."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from mould import felt
from pyarrow import parquet

import kinid
from kinid.cli.map import map_
from kinid.data.rig import WRENCH
from kinid.errors import InputError
from kinid.inputs import digest
from kinid.lab import campaign as campaigns
from kinid.lab.campaign import MOTIONS, Campaign
from kinid.lab.protocol import Slide, five_phases
from kinid.mapping.boundaries import changes, paths
from kinid.mapping.exploration import Region, explore, pokes_after_slides
from kinid.mapping.interpolation import PlaneSites
from kinid.mapping.interpolation.triangles import Triangles
from kinid.mapping.probes import Prober, build, expected, logs_in
from kinid.mapping.property_map import PropertyMap
from kinid.writers import alone_with


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Four pokes 50 mm apart, one in each silicone; the fourth under the film."""
    folder = tmp_path_factory.mktemp("mould")
    campaigns.run(Campaign(2, 2, spacing=0.05, seed=1), folder)
    return folder


def test_four_silicones_from_raw_logs(small):
    prober = Prober.of(kinid.Rig.load(small / "rig.toml"))
    *_, grown = build(logs_in([small]), prober)
    flat = grown.flat(grown.places)
    # the tip is pushed aside a little by what it presses
    assert np.allclose(flat, [[-0.025, -0.025], [-0.025, 0.025], [0.025, -0.025], [0.025, 0.025]], atol=1e-3)
    assert np.allclose(grown.values("stiffness")[:3], [510, 732, 994], rtol=0.01)
    assert np.allclose(grown.values("damping")[:3], [7.2, 9.9, 14.5], rtol=0.05)
    # under the film one spring is not enough, and the map says so
    assert (grown.residual_over_noise[:3] < 1.5).all()
    assert grown.residual_over_noise[3] > 5
    assert grown.values("stiffness")[3] == pytest.approx(felt(*flat[3:].T)[0], rel=0.05)


def test_a_map_goes_on_where_it_was(small):
    prober = Prober.of(kinid.Rig.load(small / "rig.toml"))
    logs = logs_in([small])
    *_, half = build(logs[:2], prober)
    grown = list(build(logs, prober, half))
    assert [len(m) for m in grown] == [3, 4]
    assert expected([small]) == 4
    with pytest.raises(InputError, match="a map of"):
        list(build(logs, Prober.of(kinid.Rig.load(small / "rig.toml"), ["hooke"]), half))


@pytest.mark.parametrize(
    ("line", "other", "said"),
    [
        ("mass = 0.24", "mass = 0.9", "[tool] mass = 0.9 in the rig, 0.24 when the map was begun"),
        ("[sensor]", "[sensor]\nwrench_frame = 'base'", "[sensor] wrench_frame = base in the rig, sensor when"),
    ],
)
def test_a_map_does_not_go_on_with_another_rig(small, tmp_path, line, other, said):
    text = (small / "rig.toml").read_text(encoding="utf-8")
    assert line in text
    *_, half = build(logs_in([small])[:1], Prober.of(kinid.Rig.parse_text(text, folder=small)))
    half.write(tmp_path / "map.parquet")
    start = PropertyMap.read(tmp_path / "map.parquet")
    same = Prober.of(kinid.Rig.parse_text("# a remark\n" + text, folder=small))
    assert len(list(build(logs_in([small])[:2], same, start))) == 1
    changed = Prober.of(kinid.Rig.parse_text(text.replace(line, other), folder=small))
    with pytest.raises(InputError) as refused:
        list(build(logs_in([small]), changed, start))
    assert said in str(refused.value)
    assert "--anew" in refused.value.mend


def test_a_map_does_not_go_on_where_a_log_is_another_now(small, tmp_path):
    folder, out = tmp_path / "logs", tmp_path / "map.parquet"
    folder.mkdir()
    first, second, *_ = logs_in([small])
    for file in (first, small / "rig.toml"):
        shutil.copy(file, folder)
    map_([folder], out)
    shutil.copy(first, folder)  # the same, at another time
    os.utime(folder / first.name)
    map_([folder], out)
    shutil.copy(second, folder / first.name)
    os.utime(folder / first.name)
    with pytest.raises(InputError, match="which has changed since the map was made"):
        map_([folder], out)


def test_a_map_that_does_not_say_its_rig_goes_on_with_a_doubt(small, tmp_path, capsys):
    out, rig = tmp_path / "map.parquet", kinid.Rig.load(small / "rig.toml")
    first, second, *_ = logs_in([small])
    *_, grown = build([first], Prober.of(rig))
    dataclasses.replace(grown, origin={}).write(out)
    map_([first, second], out)
    assert "doubt: the map's 1 earlier probes don't say which rig" in capsys.readouterr().out
    map_([first, second], tmp_path / "anew.parquet")
    map_([first, second], tmp_path / "anew.parquet")
    assert "doubt" not in capsys.readouterr().out


@pytest.mark.parametrize("model", [[], ["none"]])
def test_a_model_without_effects_maps_nothing(small, model):
    with pytest.raises(InputError, match="no property of a material"):
        Prober.of(kinid.Rig.load(small / "rig.toml"), model)


def test_a_log_counts_once_under_all_its_names(small, tmp_path, monkeypatch):
    """By its path it is passed over unread, as a copy or by a link it is left out, in one go and in the next."""
    prober, (log, other, *_) = Prober.of(kinid.Rig.load(small / "rig.toml")), logs_in([small])
    (tmp_path / "link.parquet").symlink_to(log)
    shutil.copy(log, tmp_path / "copy.parquet")
    skipped = {}
    *_, grown = build([log, tmp_path / "copy.parquet", other], prober, None, skipped.__setitem__)
    assert len(grown) == 2
    assert list(skipped) == [str(tmp_path / "copy.parquet")]
    assert "the same log twice" in skipped[str(tmp_path / "copy.parquet")]
    with pytest.raises(InputError, match="the same log twice"):
        list(build([tmp_path / "copy.parquet"], prober, grown))
    monkeypatch.chdir(small)
    for same in (log.name, f"../{small.name}/{log.name}", tmp_path / "link.parquet"):
        assert not list(build([same], prober, grown))
    grown.write(tmp_path / "map.parquet")
    again = PropertyMap.read(tmp_path / "map.parquet")
    assert [probe.digest for probe in again.probes] == [digest(log), digest(other)]


def test_a_map_that_another_process_adds_to_is_left_alone(small, tmp_path):
    with alone_with(tmp_path / "map.parquet"), pytest.raises(InputError, match="another process at work on"):
        map_([small], tmp_path / "map.parquet")
    assert not list(tmp_path.iterdir())


def test_the_command(small, tmp_path):
    out, worlds = tmp_path / "map.parquet", tmp_path / "worlds"
    call = [
        sys.executable,
        "-c",
        "from kinid.cli import main; main()",
        "map",
        str(small),
        "-o",
        str(out),
        "--export",
        str(worlds),
        "--plot",
        str(tmp_path / "map.html"),
        "--method",
        "nearest",
        "--cell",
        "0.02",
        "--json",
        str(tmp_path / "map.json"),
    ]
    done = subprocess.run(call, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert "4 probes with kelvin-voigt" in done.stdout
    assert "at 1 of 4 places the model leaves more than 3 times the noise" in done.stdout
    assert len(PropertyMap.read(out)) == 4
    assert "next: kinid diagnose " in done.stdout or "next: this log can't be diagnosed" in done.stdout
    long = ("doubt", "next", "wrote", "assumed")  # a command stays on one line, to be copied
    assert all(len(line) <= 80 for line in done.stdout.splitlines() if not line.startswith(long))
    facts = json.loads((tmp_path / "map.json").read_text(encoding="utf-8"))
    assert (facts["model"], facts["probes"], facts["new"], facts["failing"]) == ("kelvin-voigt", 4, 4, 1)
    assert facts["properties"]["stiffness"]["lowest"] == pytest.approx(510, rel=0.01)
    assert set(facts["properties"]["stiffness"]["held_out"]) == {"gp", "triangles", "biharmonic", "nearest"}
    assert str(out) in facts["written"]
    about = json.loads((worlds / "map.json").read_text(encoding="utf-8"))
    assert about["properties"]["stiffness"]["unit"] == "N/m"
    assert min(about["cell"]) >= 0.02 - 1e-9
    assert about["alone"]["tip_radius"] == pytest.approx(0.5 * min(about["cell"]))
    assert "assumed friction 0.5" in done.stdout
    assert "plotly" in (tmp_path / "map.html").read_text(encoding="utf-8")
    wrong = subprocess.run(
        [*call[:4], str(tmp_path / "absent"), "-o", str(out)], capture_output=True, text=True, timeout=60, check=False
    )
    assert wrong.returncode == 2
    assert wrong.stderr.startswith("kinid: found no log at")
    assert len(wrong.stderr.strip().splitlines()) == 1


@pytest.fixture(scope="module")
def power_law():
    """A setting in which a poke and a slide of 36 mm touch one material whose force grows with a power of depth."""
    from kinid.lab.experiments import prepare
    from kinid.lab.materials import Material

    motions = MOTIONS["poke"], Slide(depth=2.5e-3, speed=0.012, length=0.018, directions=(0.0,))
    material = Material("rubber", stiffness=6900.0, exponent=1.35, loss=1.1, friction=0.5)
    base = prepare("slide", seed=1)

    def touched(*kinds):
        script = five_phases(*(motions[k] for k in kinds), height=0.008, free=0.4, hold=0.4, approach=0.8, tilt=0.1)
        return base.replace(material=material, script=script, seed=3)

    return touched


@pytest.mark.parametrize("model", [("hunt-crossley", "coulomb-friction"), ("hooke", "hertz-exponent")])
def test_pieces_of_a_slide_are_of_the_quantity_that_pokes_tell(power_law, model):
    setup = power_law(0, 1)
    properties, probes = Prober.of(setup.rig, model).of_log(setup.run().log, "both")
    made = PropertyMap(Prober.of(setup.rig).surface, properties, tuple(probes))
    stiffness, error = made.values("stiffness"), made.deviations("stiffness")
    assert len(made) > 12
    assert np.isfinite(stiffness).all()
    # the secant over 2.5 mm would be 850 N/m
    assert np.abs(stiffness / stiffness[0] - 1).max() < 0.05
    # no piece is surer than the exponent that it was told with
    n = made.deviations("exponent")[0]
    assert (error[1:] > 0.9 * stiffness[1:] * n * np.log(1 / 3e-3)).all()


def test_logs_of_a_folder_that_cannot_be_used_are_counted_and_named(small, tmp_path, capsys):
    """Beside pokes, too; maps in the folder are known for what they are, and one of them may go on there."""
    folder = tmp_path / "logs"
    folder.mkdir()
    for name in ("poke_0000.parquet", "poke_0001.parquet", "rig.toml"):
        shutil.copy(small / name, folder)
    whole = parquet.read_table(small / "poke_0002.parquet")
    parquet.write_table(whole.drop_columns(list(WRENCH)), folder / "deaf.parquet")
    parquet.write_table(whole.slice(0, 200), folder / "short.parquet")
    (folder / "notes.csv").write_text("who,when\nme,today\n")
    for _ in range(2):
        map_([folder], folder / "map.parquet", json_file=tmp_path / "map.json")
        said = capsys.readouterr().out
        assert said.startswith("2 probes with kelvin-voigt")
        assert "; 3 logs left out\n" in said
        for name, why in (("deaf.parquet", "no normal force"), ("short.parquet", "no touch"), ("notes.csv", "no time")):
            assert f"left out: {folder / name}: found {why}" in said
        assert len(json.loads((tmp_path / "map.json").read_text())["left_out_logs"]) == 3


def test_a_slide_alone_leaves_stiffness_open_and_the_map_says_so(power_law, tmp_path, capsys):
    from kinid.cli.show_map import in_map, show_map

    setup = power_law(1)
    prober = Prober.of(setup.rig, ["hunt-crossley", "coulomb-friction"])
    properties, probes = prober.of_log(setup.run().log, "slide")
    made = PropertyMap(prober.surface, properties, tuple(probes), prober.name)
    assert np.isnan(made.values("stiffness")).all()
    assert np.allclose(made.values("friction"), 0.5, rtol=0.05)
    show_map(made, in_map(made), len(made), {}, tmp_path / "rig.toml")
    assert f"stiffness: open at {len(made)} pieces of slides" in capsys.readouterr().out


@pytest.mark.slow
def test_a_hundred_pokes_map_the_mould(tmp_path):
    """Away from borders (10 mm, the grid's own spacing) the map is within 5 %: measured 2.5 % on average, 3.2 % rms."""
    campaigns.run(Campaign(10, 10), tmp_path)
    *_, grown = build(logs_in([tmp_path]), Prober.of(kinid.Rig.load(tmp_path / "rig.toml")))
    flat = grown.flat(grown.places)
    assert np.abs(grown.values("stiffness") / felt(*flat.T) - 1).max() < 0.04
    ticks = grown.grid(100)
    x, y = np.meshgrid(*ticks, indexing="ij")
    guess = grown.over_grid("stiffness", ticks)
    away = (np.abs(x - 1.5e-3 * np.sin(90 * y)) > 0.01) & (np.abs(y + 1.2e-3 * np.sin(110 * x)) > 0.01)
    away &= (
        (np.minimum(0.05 - np.abs(x), 0.05 - np.abs(y)) > 0.01)
        & (np.abs(np.minimum(x, y) - 0.012) > 0.01)
        & guess.known
    )
    error = (guess.mean / felt(x, y) - 1)[away]
    assert away.sum() > 1000
    assert np.mean(np.abs(error)) < 0.05
    assert np.sqrt(np.mean(error**2)) < 0.05
    # the rim is softer than the middle of its own silicone
    rim, middle = (
        guess.mean[np.abs(x - 0.045) + np.abs(y + 0.025) < 3e-3],
        guess.mean[np.abs(x - 0.025) + np.abs(y + 0.025) < 3e-3],
    )
    assert rim.mean() < 0.92 * middle.mean()


@pytest.mark.slow
def test_slides_and_thirty_five_pokes_from_raw_logs():
    """Joints and wrench alone, of eight slides and pokes beside the borders felt; beside a grid of a hundred pokes."""
    base, counter = Campaign(1, 1).base()[0], iter(range(1000))

    def touched(motion, place):
        script = five_phases(motion, place=tuple(place), height=0.008, free=0.4, hold=0.4, approach=0.8, tilt=0.1)
        return base.replace(script=script, seed=700 + next(counter)).run().log

    prober = Prober.of(base.rig)
    slides, places, values = [], [], []
    for axis in (0, 1):
        # at the depth that the pokes move about: beyond the film's own depth its law has a bend
        motion = Slide(depth=MOTIONS["poke"].depth, speed=16e-3, length=0.044, directions=(axis * np.pi / 2,))
        for across in (-0.03375, -0.01125, 0.01125, 0.03375):
            log = touched(motion, across * np.eye(2)[1 - axis])
            way = max(paths(kinid.contact_series(log, base.rig, robot=base.robot)), key=lambda path: len(path.x))
            slides.append((way, changes(way)))
            cuts = np.arange(10, len(way.x), 10)
            places += [way.at(part.mean()) for part in np.split(way.x, cuts)]
            values += [part.mean() for part in np.split(way.felt[0], cuts)]

    def poke(place):
        properties, (probe, *_) = prober.of_log(touched(MOTIONS["poke"], place), "poke")
        k = [item.name for item in properties].index("stiffness")
        return float(probe.values[k]), float(np.sqrt(probe.covariance[k, k]))

    region = Region((-0.045, -0.045), (0.045, 0.045))
    # the closest that 35 pokes allow
    tried = (pokes_after_slides(slides, beside=3e-3, apart=1e-3 * apart) for apart in range(4, 20))
    start = next(places for places in tried if len(places) <= 35)
    *_, poked = explore(poke, region, start, apart=4e-3, most=35)
    ticks = np.linspace(-0.045, 0.045, 10)
    grid = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2)
    q, truth = region.grid(45), felt(*region.grid(45).T)
    few = (np.vstack([poked.sample_sites.places, places]), np.append(poked.values, values))
    errors = []
    raw = np.array([poke(place)[0] for place in grid])
    for where, what in (few, (grid, raw), (grid, felt(*grid.T)), (poked.sample_sites.places, poked.values)):
        guess = Triangles(PlaneSites(where, reach=1.0), what, 0.005 * what).at(q).mean
        errors.append(float(np.mean(np.abs(guess / truth - 1))))
    print(
        "eight slides and 35 pokes {:.2%}; a grid of 100 pokes {:.2%}, were they exact {:.2%}; "
        "the 35 pokes alone {:.2%}".format(*errors)
    )
    assert errors[0] < errors[1]
