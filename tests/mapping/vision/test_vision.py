"""Materials from a picture: recognised, held out honestly, and strangers called strangers."""

from __future__ import annotations

import os
import struct
import tracemalloc
import zlib

import numpy as np
import pytest

from kinid.errors import InputError
from kinid.mapping.picture import Picture
from kinid.mapping.picture_classes import UNKNOWN, MaterialClassifier, held_out, value_classes
from kinid.mapping.png import to_png

pytest.importorskip("sklearn")


def mould_picture(seed=0, n=160, mould=None):
    """The virtual mould under uneven light, with glitter and the camera's noise, 0.1 m wide."""
    from scipy.ndimage import gaussian_filter

    from kinid.lab.materials import MOULD

    mould = mould or MOULD
    rng = np.random.default_rng(seed)
    ticks = (np.arange(n) + 0.5) / n * 0.1 - 0.05
    x, y = np.meshgrid(ticks, ticks, indexing="ij")
    colour = mould.colors(x.ravel(), y.ravel()).reshape(n, n, 3)
    light = gaussian_filter(rng.standard_normal((n, n)), 25)
    glitter = (rng.random((n, n, 1)) < 0.06) * rng.uniform(-0.35, 0.35, (n, n, 1))
    pixels = colour * (1 + 0.12 * light / light.std())[..., None] + glitter + 0.05 * rng.standard_normal((n, n, 3))
    return Picture(np.clip(pixels, 0, 1), (-0.05, -0.05), (0.05, 0.05))


def material(places):
    x, y = places.T
    quarter = 2 * (x > 1.5e-3 * np.sin(90 * y)) + (y > -1.2e-3 * np.sin(110 * x))
    return np.where(np.minimum(x, y) > 0.012, "film", np.array(["a", "b", "c", "d"])[quarter])


@pytest.fixture(scope="module")
def seen():
    places = np.random.default_rng(1).uniform(-0.048, 0.048, (300, 2))
    return mould_picture().features(places), material(places), places


@pytest.mark.parametrize("calibrated", [False, True])
def test_the_mould_is_recognised(seen, calibrated):
    """The study's 80.3 % in random folds; blocks stand beside it, and are no better."""
    features, labels, places = seen
    figures = held_out(features, labels, places, calibrated=calibrated, folds=6)
    assert figures.random_folds >= 0.803
    assert 0.5 < figures.spatial_blocks <= figures.random_folds + 0.02
    if calibrated:
        assert figures.calibration_error < 0.1


def test_random_folds_flatter_where_samples_are_neighbours():
    """Colours at random by place tell nothing of another place; neighbours a pixel apart share them all the same."""
    rng = np.random.default_rng(2)
    spots = rng.uniform(0, 0.1, (40, 2))
    names = np.repeat(rng.choice(["a", "b"], 40), 8)
    features = np.repeat(rng.normal(size=(40, 4)), 8, axis=0) + 0.01 * rng.normal(size=(320, 4))
    places = np.repeat(spots, 8, axis=0) + 1e-4 * rng.normal(size=(320, 2))
    figures = held_out(features, names, places, calibrated=False, folds=10)
    assert figures.random_folds > 0.95
    assert figures.spatial_blocks < 0.75


def test_strangers_are_unknown(seen):
    features, labels, _ = seen
    classifier = MaterialClassifier.learn(features, labels)
    rng = np.random.default_rng(3)
    white = Picture(np.clip(0.95 + 0.03 * rng.standard_normal((40, 40, 3)), 0, 1), (0.0, 0.0), (1.0, 1.0))
    assert np.mean(classifier.at(white.features(rng.random((50, 2)))).label == UNKNOWN) > 0.95
    fresh = np.random.default_rng(4).uniform(-0.048, 0.048, (200, 2))
    sight = classifier.at(mould_picture().features(fresh))
    assert np.mean(sight.label == UNKNOWN) < 0.05
    assert np.allclose(sight.probabilities.sum(axis=1), 1.0)


def test_pictures_come_from_files(tmp_path):
    image = pytest.importorskip("PIL.Image")
    pixels = np.zeros((20, 30, 3), np.uint8)
    pixels[:10, :, 0] = 255
    image.fromarray(pixels).save(tmp_path / "a.png")
    picture = Picture.read(tmp_path / "a.png", (0.0, 0.0), (0.02, 0.03))
    assert picture.features(np.array([[0.002, 0.015], [0.018, 0.015]]))[:, 0] == pytest.approx([1.0, 0.0])
    # what exports write: 16 bits of grey, the same as 8 to a share of a step
    grey = np.add.outer(np.linspace(0.0, 0.7, 20), np.linspace(0.0, 0.3, 30))
    (tmp_path / "deep.png").write_bytes(to_png(grey, 0.0, 1.0))
    image.fromarray(np.round(255 * grey).astype(np.uint8)).save(tmp_path / "shallow.png")
    deep, shallow = (Picture.read(tmp_path / f"{name}.png", (0.0, 0.0), (0.02, 0.03)) for name in ("deep", "shallow"))
    assert np.allclose(deep.pixels, grey[..., None], atol=1e-4)
    assert np.allclose(deep.pixels, shallow.pixels, atol=0.6 / 255)


def test_large_pictures_are_worked_on_in_tiles_that_change_nothing():
    rng = np.random.default_rng(4)
    pixels = rng.random((1100, 1300, 3)).astype(np.float32)
    large = Picture(pixels, (0.0, 0.0), (1.1, 1.3))
    small = Picture(pixels[300:900, 400:1200], (0.3, 0.4), (0.9, 1.2))
    places = rng.uniform((0.35, 0.45), (0.85, 1.15), (400, 2))  # a border of tiles runs through the middle
    found = large.features(places)
    assert np.allclose(found, small.features(places), rtol=0.0, atol=1e-12)
    corners = large.features(np.array([[0.0, 0.0], [1.1, 1.3]]))
    assert np.isfinite(corners).all()


def test_the_largest_picture_fits_into_a_part_of_the_memory():
    pixels = np.zeros((4000, 4000, 3), np.float32)
    picture = Picture(pixels, (0.0, 0.0), (1.0, 1.0))
    places = np.random.default_rng(0).random((900, 2))
    tracemalloc.start()
    picture.features(places)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 400 * 2**20  # all features of all pixels at once are 1 GiB, and twice that on the way


def test_what_is_no_picture_is_refused(tmp_path):
    """A text, a picture with a remark that unpacks to more than one has, and a pipe, which nobody writes to."""
    image = pytest.importorskip("PIL.Image")
    path = tmp_path / "a.png"
    path.write_bytes(b"nothing")
    with pytest.raises(InputError, match="no picture"):
        Picture.read(path, (0.0, 0.0), (1.0, 1.0))
    image.new("RGB", (20, 20)).save(path)
    remark = b"zTXtComment\0\0" + zlib.compress(bytes(5_000_000))
    chunk = struct.pack(">I", len(remark) - 4) + remark + struct.pack(">I", zlib.crc32(remark))
    png, end = path.read_bytes(), len(b"\x89PNG\r\n\x1a\n") + 25  # behind the header
    path.write_bytes(png[:end] + chunk + png[end:])
    with pytest.raises(InputError, match=r"no picture.*too large"):
        Picture.read(path, (0.0, 0.0), (1.0, 1.0))
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(InputError, match="a pipe"):
        Picture.read(path, (0.0, 0.0), (1.0, 1.0))


def test_classes_follow_from_the_values():
    rng = np.random.default_rng(5)
    truth = rng.integers(0, 3, 90)
    values = np.array([500.0, 1000.0, 2400.0])[truth] * (1 + 0.01 * rng.standard_normal(90))
    assert np.array_equal(value_classes(values), truth)


def test_one_class_is_no_classes(seen):
    with pytest.raises(InputError, match="two at least"):
        MaterialClassifier.learn(seen[0], ["a"] * 300)


def mould_map(n=10):
    """A map of the mould from a grid of exact pokes on the stiffness alone."""
    from kinid.lab.materials import MOULD
    from kinid.mapping.property_map import Probe, Property, PropertyMap
    from kinid.robotics.surface import Plane

    ticks = np.linspace(-0.045, 0.045, n)
    places = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2)
    values = MOULD.at(*places.T)["stiffness"] + MOULD.at(*places.T)["layer"]
    probes = [
        Probe(np.array([*p, 0.0]), np.array([v]), np.array([[25.0]]), source=str(i))
        for i, (p, v) in enumerate(zip(places, values))
    ]
    return PropertyMap(Plane(np.zeros(3), np.eye(3)), (Property("stiffness", "N/m"),), tuple(probes), "truth")


def save(picture, path):
    image = pytest.importorskip("PIL.Image")
    image.fromarray(np.round(255 * picture.pixels).astype(np.uint8)).save(path)


def test_values_follow_from_another_picture():
    """What is stated holds: nine of ten places lie within two standard deviations."""
    from kinid.lab.materials import MOULD
    from kinid.mapping.picture_map import Sighted

    sighted = Sighted.learn(mould_map(), "stiffness", mould_picture())
    q = np.random.default_rng(6).uniform(-0.04, 0.04, (400, 2))
    mean, sd = sighted.prior(mould_picture(seed=9))(q)
    truth = MOULD.at(*q.T)["stiffness"] + MOULD.at(*q.T)["layer"]
    finite = np.isfinite(mean)
    assert finite.mean() > 0.75
    assert np.median(np.abs(mean / truth - 1)[finite]) < 0.1
    assert np.mean((np.abs(mean - truth) < 2 * sd)[finite]) > 0.85
    assert sighted.errors[1] > 0.8 * sighted.errors[0]


def grey_picture(seed=0, n=160):
    """Paint over the mould: the camera's noise on one grey."""
    pixels = 0.5 + 0.03 * np.random.default_rng(seed).standard_normal((n, n, 1))
    return Picture(np.clip(np.repeat(pixels, 3, axis=2), 0, 1), (-0.05, -0.05), (0.05, 0.05))


def coloured_anyhow(seed, n=160):
    """Blots of colours that have nothing to do with what is below them."""
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(seed)
    blots = np.stack([gaussian_filter(rng.standard_normal((n, n)), 12) for _ in range(3)], axis=2)
    return Picture(np.clip(0.5 + 0.15 * blots / blots.std(), 0, 1), (-0.05, -0.05), (0.05, 0.05))


def test_a_picture_that_tells_nothing_is_said_to():
    """Grey, uniform, or coloured by chance: no better than the commonest class, and so no prediction; the mould's own
    tells.
    """
    from kinid.mapping.picture_map import Sighted

    q = np.random.default_rng(6).uniform(-0.04, 0.04, (50, 2))
    uniform = Picture(np.full((160, 160, 3), 0.5), (-0.05, -0.05), (0.05, 0.05))
    for picture in (grey_picture(), uniform, coloured_anyhow(0)):
        sighted = Sighted.learn(mould_map(6), "stiffness", picture)
        assert not sighted.tells
        assert not np.isfinite(sighted.prior(picture)(q)[0]).any()
    sighted = Sighted.learn(mould_map(6), "stiffness", mould_picture())
    assert sighted.tells
    assert sighted.explained[0] > 0.3
    assert np.isfinite(sighted.prior(mould_picture())(q)[0]).any()


def test_the_command_refuses_to_predict_from_grey(tmp_path):
    import json
    import subprocess
    import sys

    mould_map().write(tmp_path / "m.parquet")
    save(grey_picture(), tmp_path / "grey.png")
    call = [
        sys.executable,
        "-c",
        "from kinid.cli import main; main()",
        "picture",
        str(tmp_path / "m.parquet"),
        str(tmp_path / "grey.png"),
        "--corners=-0.05,-0.05,0.05,0.05",
        "--json",
        str(tmp_path / "f.json"),
    ]
    done = subprocess.run(call, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert "doubt: the picture tells nothing of stiffness" in done.stdout
    assert "predicted:" not in done.stdout
    assert json.loads((tmp_path / "f.json").read_text(encoding="utf-8"))["tells"] is False
    done = subprocess.run(
        [*call, "-o", str(tmp_path / "p.parquet")], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 2
    assert done.stderr.startswith("kinid: found a picture that tells nothing of stiffness")
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "p.parquet").exists()


@pytest.mark.parametrize(
    "words",
    [("--corners=-inf,-inf,inf,inf",), ("--corners=0,0,1,1", "--onto", "b.png", "--onto-corners=0,0,inf,1")],
)
def test_corners_are_finite(tmp_path, monkeypatch, capsys, words):
    from kinid.cli import main

    monkeypatch.chdir(tmp_path)
    mould_map().write(tmp_path / "m.parquet")
    for name in ("a.png", "b.png"):
        save(grey_picture(), tmp_path / name)
    monkeypatch.setattr("sys.argv", ["kinid", "picture", "m.parquet", "a.png", *words])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert "inf; expected four numbers [m], each below 1000" in capsys.readouterr().err.replace(",1;", ";")


def test_the_command_says_both_figures_and_what_is_unknown(tmp_path):
    import json
    import subprocess
    import sys

    from kinid.mapping.property_map import PropertyMap

    mould_map().write(tmp_path / "m.parquet")
    save(mould_picture(), tmp_path / "a.png")
    other = mould_picture(seed=9).pixels.copy()
    strange = [0.9, 0.1, 0.9]
    other[80:, :60] = np.clip(strange + 0.05 * np.random.default_rng(0).standard_normal((80, 60, 3)), 0, 1)
    save(Picture(other, (-0.05, -0.05), (0.05, 0.05)), tmp_path / "b.png")
    call = [
        sys.executable,
        "-c",
        "from kinid.cli import main; main()",
        "picture",
        str(tmp_path / "m.parquet"),
        str(tmp_path / "a.png"),
        "--corners=-0.05,-0.05,0.05,0.05",
    ]
    more = ["--onto", str(tmp_path / "b.png"), "-o", str(tmp_path / "p.parquet"), "--json", str(tmp_path / "f.json")]
    more += ["--plot", str(tmp_path / "p.html")]
    done = subprocess.run([*call, *more], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert "random folds, as in the study" in done.stdout
    assert "spatial blocks" in done.stdout
    facts = json.loads((tmp_path / "f.json").read_text(encoding="utf-8"))
    assert facts["held_out"]["spatial_blocks"]["recognised"] <= facts["held_out"]["random_folds"]["recognised"] + 0.05
    predicted = PropertyMap.read(tmp_path / "p.parquet")
    assert len(predicted) + facts["unknown_cells"] == 900
    # what was predicted is no measurement: nothing on its page is tested against itself
    page = (tmp_path / "p.html").read_text(encoding="utf-8")
    assert f"{len(predicted)} cells predicted from a picture" in page
    assert "How well probes are predicted" not in page
    assert predicted.uniform("stiffness") is None
    # the strange corner has no cells
    flat = predicted.flat(predicted.places)
    assert not ((flat[:, 0] > 0.004) & (flat[:, 1] < -0.018)).any()
    wrong = subprocess.run([*call[:-1], "--corners=0,0,1"], capture_output=True, text=True, timeout=60, check=False)
    assert wrong.returncode == 2
    assert "four numbers" in wrong.stderr
    assert len(wrong.stderr.strip().splitlines()) == 1


#: between the mould's four silicones; its film changes the last one's stiffness little [N/m]
LIMITS = (600.0, 920.0, 1500.0)


def test_the_studys_recipe_from_the_command_line(tmp_path):
    """Asked for: 85 % in random folds, 80 % in blocks. With the number of classes that it picks itself it has 55 %."""
    import json
    import subprocess
    import sys

    mould_map().write(tmp_path / "m.parquet")
    save(mould_picture(n=800), tmp_path / "a.png")
    words = f"picture {tmp_path / 'm.parquet'} {tmp_path / 'a.png'} --corners=-0.05,-0.05,0.05,0.05 --study --rgb"
    words += f" --patch 50 --limits 600,920,1500 --json {tmp_path / 'f.json'} --confusion {tmp_path / 'c.html'}"
    call = [sys.executable, "-c", "from kinid.cli import main; main()"]
    done = subprocess.run([*call, *words.split()], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    facts = json.loads((tmp_path / "f.json").read_text(encoding="utf-8"))["held_out"]
    assert facts["random_folds"]["recognised"] >= 0.85
    assert facts["spatial_blocks"]["recognised"] >= 0.80
    for kind in ("random_folds", "spatial_blocks"):
        counts = np.array(facts[kind]["confusion"])
        assert counts.sum() == 100
        assert np.trace(counts) / 100 == pytest.approx(facts[kind]["recognised"])
    page = (tmp_path / "c.html").read_text(encoding="utf-8")
    assert "Spatial blocks, which is honest" in page
    wrong = [*call, *words.replace("600,920,1500", "900,600").split()]
    done = subprocess.run(wrong, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "limits 900, 600" in done.stderr


def photograph(seed, n=400):
    """The mould as a photograph: a lamp from a side, a soft shadow, texture, a camera's white balance, exposure, curve,
    blur, noise and compression, all of which differ from picture to picture.
    """
    import io

    from PIL import Image
    from scipy.ndimage import gaussian_filter

    from kinid.lab.materials import MOULD

    rng = np.random.default_rng(seed)
    ticks = (np.arange(n) + 0.5) / n * 0.1 - 0.05
    x, y = np.meshgrid(ticks, ticks, indexing="ij")
    angle, texture = rng.uniform(0.0, 2.0 * np.pi), gaussian_filter(rng.standard_normal((n, n)), rng.uniform(1.0, 3.0))
    light = 1.0 + rng.uniform(0.1, 0.35) * (np.cos(angle) * x + np.sin(angle) * y) / 0.05
    lit = 1.0 / (1.0 + np.exp(-(np.cos(angle + 2.0) * x + np.sin(angle + 2.0) * y + 0.02) / 0.004))
    light *= (1.0 - rng.uniform(0.15, 0.4) * (1.0 - lit)) * (1.0 + rng.uniform(0.01, 0.05) * texture / texture.std())
    seen = MOULD.colors(x.ravel(), y.ravel()).reshape(n, n, 3) * light[..., None]
    seen = np.clip(seen * (1.0 + rng.uniform(-0.12, 0.12, 3)) * (1.0 + rng.uniform(-0.2, 0.2)), 0.0, 1.0)
    blur = rng.uniform(0.0, 1.5)
    seen = gaussian_filter(seen ** (1.0 + rng.uniform(-0.2, 0.2)), (blur, blur, 0.0))
    seen = seen + rng.uniform(0.005, 0.03) * rng.standard_normal(seen.shape)
    held = io.BytesIO()
    image = Image.fromarray((255 * np.clip(seen, 0.0, 1.0)).astype(np.uint8))
    image.save(held, "JPEG", quality=int(rng.integers(50, 95)))
    pixels = np.asarray(Image.open(held).convert("RGB"), dtype=float) / 255.0
    return Picture(pixels, (-0.05, -0.05), (0.05, 0.05), patch=25, texture=False)


def test_photographs_that_training_has_not_seen_are_recognised():
    """Asked for: 75 % where light, shadow, texture and camera differ. Without grey-world it is 85 % on average, and 65
    % at worst; with texture as a feature 58 %.
    """
    from kinid.lab.materials import MOULD
    from kinid.mapping.picture_map import Sighted

    places = np.random.default_rng(3).uniform(-0.046, 0.046, (600, 2))
    stiffness = MOULD.at(*places.T)["stiffness"] + MOULD.at(*places.T)["layer"]
    true = np.searchsorted(LIMITS, stiffness)
    shares = []
    for seed in (21, 22):
        sighted = Sighted.learn(mould_map(), "stiffness", photograph(seed).grey_world(), limits=LIMITS)
        for other in range(210, 214):
            seen = sighted.classifier.at(photograph(other).grey_world().features(places))
            shares.append(float(np.mean(seen.probabilities.argmax(axis=1) == true)))
    print(f"recognised: {np.round(shares, 2)}")
    assert min(shares) >= 0.75


@pytest.mark.slow
def test_a_picture_saves_pokes_from_raw_logs(tmp_path):
    """Learnt on one mould from 36 raw pokes and its picture; another one, a quarter turned, is poked with and without
    it.
    """
    import dataclasses

    import kinid
    from kinid.lab import campaign as campaigns
    from kinid.lab.campaign import MOTIONS, Campaign
    from kinid.lab.materials import MOULD
    from kinid.lab.protocol import five_phases
    from kinid.mapping.exploration import Region, explore
    from kinid.mapping.interpolation import PlaneSites
    from kinid.mapping.interpolation.triangles import Triangles
    from kinid.mapping.picture_map import Sighted
    from kinid.mapping.probes import Prober, build, logs_in

    campaigns.run(Campaign(6, 6, spacing=0.016), tmp_path)
    prober = Prober.of(kinid.Rig.load(tmp_path / "rig.toml"))
    *_, grown = build(logs_in([tmp_path]), prober)
    sighted = Sighted.learn(grown, "stiffness", mould_picture())
    turned = dataclasses.replace(
        MOULD,
        fields={name: lambda x, y, f=f: f(-y, x) for name, f in MOULD.fields.items()},
        colors=lambda x, y: MOULD.colors(-y, x),
    )
    base, region = Campaign(1, 1).base()[0].replace(material=turned), Region((-0.045, -0.045), (0.045, 0.045))
    # what a poke of some millimetres feels, by more pokes than any exploration makes: beyond the film's depth both
    # springs push
    q = region.grid(30)
    p = turned.at(*q.T)
    depth = 3e-3 + 1.5e-3 * np.sin(np.linspace(0, 2 * np.pi, 60, endpoint=False))
    k = p["stiffness"] + p["layer"]
    for _ in range(40):
        d = depth * (5200.0 / (5200.0 + k))[..., None]  # under the arm's impedance
        force = p["stiffness"][..., None] * d + p["layer"][..., None] * np.maximum(d - p["layer_depth"][..., None], 0)
        k = np.sum(force * d, axis=-1) / np.sum(d**2, axis=-1)
    felt: dict[tuple[float, float], tuple[float, float]] = {}

    def poke(place):
        key = tuple(np.round(place, 6))
        if key not in felt:
            script = five_phases(
                MOTIONS["poke"], place=tuple(place), height=0.008, free=0.4, hold=0.4, approach=0.8, tilt=0.1
            )
            properties, (probe, *_) = prober.of_log(base.replace(script=script, seed=900 + len(felt)).run().log, "poke")
            i = [item.name for item in properties].index("stiffness")
            felt[key] = float(probe.values[i]), float(np.sqrt(probe.covariance[i, i]))
        return felt[key]

    runs = {}
    for name, prior in (("without", None), ("with", sighted.prior(mould_picture(seed=9, mould=turned)))):
        runs[name] = []
        for some in explore(poke, region, region.grid(3), apart=4e-3, most=36, prior=prior):
            wide = Triangles(PlaneSites(some.sample_sites.places, reach=1.0), some.values, some.noise, prior)
            runs[name].append(float(np.mean(np.abs(wide.at(q).mean / k - 1))))
    least = min(runs["without"])
    needed = {
        name: 9 + int(np.flatnonzero(np.array(errors) <= least)[0]) if min(errors) <= least else None
        for name, errors in runs.items()
    }
    print(
        f"error after 9, 18, 27, 36 pokes: { ({name: np.round(e[::9], 3).tolist() for name, e in runs.items()}) }; "
        f"pokes for {least:.1%}: {needed}"
    )
    assert needed["with"] is not None
    assert needed["with"] < needed["without"]


@pytest.mark.parametrize(
    ("low", "high"), [((-np.inf, -np.inf), (np.inf, np.inf)), ((0.0, 0.0), (np.inf, 1.0)), ((0.0, np.nan), (1.0, 1.0))]
)
def test_a_picture_without_end_is_refused(low, high):
    with pytest.raises(InputError, match="two corners, the lower one first"):
        Picture(np.zeros((64, 64, 3)), low, high)
