"""Scenes to TOML and back, scripts, built-in names, choice sets and overrides."""

import re
import subprocess
import sys
from functools import partial
from typing import Literal, get_args, get_origin

import annotated_types
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taichi_foam import catalogue
from taichi_foam.catalogue import list_scenes, load_scene
from taichi_foam.errors import UserError
from taichi_foam.scene import (
    CHOICE_SETS,
    Base,
    Block,
    Cylinder,
    FlatBlock,
    Foam,
    Layer,
    Model,
    Numerics,
    Output,
    Polygon,
    Pulse,
    Scene,
    Start,
    Support,
    Wedge,
)
from taichi_foam.scene.files import scene_to_toml
from taichi_foam.scene.options import PulseShape
from taichi_foam.shim2000 import impacts

# Taichi, once started, has its process flush subnormal numbers to zero.
floats = partial(st.floats, allow_subnormal=False)


def values(field):
    """Any value that a number, switch or option field takes by its own range."""
    kind = field.annotation
    if get_origin(kind) is Literal:
        return st.sampled_from(get_args(kind))
    if kind is bool:
        return st.booleans()
    if str in (getattr(each, "__origin__", each) for each in get_args(kind)):
        return st.none() | st.just("a test of 2026")
    bounds = {type(m): m for m in field.metadata}
    gt, ge = bounds.get(annotated_types.Gt), bounds.get(annotated_types.Ge)
    lt, le = bounds.get(annotated_types.Lt), bounds.get(annotated_types.Le)
    low = gt.gt if gt else ge.ge
    high = lt.lt if lt else le.le
    if kind is int:
        step = getattr(bounds.get(annotated_types.MultipleOf), "multiple_of", 1)
        return st.integers(-(-low // step), high // step).map(lambda k: k * step)
    return floats(low, high, exclude_min=gt is not None, exclude_max=lt is not None)


def parts(kind, **fixed):
    """Instances of a part with every field drawn, apart from the given ones."""
    drawn = {
        name: values(field)
        for name, field in kind.model_fields.items()
        if name not in fixed and name != "shape"
    }
    return st.builds(kind, **drawn, **fixed)


@st.composite
def foams(draw):
    locking, densification, at_yield = draw(
        st.tuples(floats(-0.99, -0.7), floats(-0.69, -0.51), floats(-0.5, -1e-9))
    )
    return draw(
        parts(
            Foam,
            locking_strain=st.just(locking),
            densification_strain=st.just(densification),
            yield_strain=st.just(at_yield),
            youngs_modulus=floats(1e6, 1e11),
            shear_modulus=floats(1e3, 1e7),
            crushed_tensile_stress=st.none() | floats(0, 1e9),
            rate=st.none() | floats(1, 1e9),
            overshoot_strain=st.none() | floats(5e-3, 1),
            crush_band=st.none() | floats(1e-5, 1),
            fracture_energy=st.none() | floats(1e-6, 1e6),
            shear_fracture_energy=st.none() | floats(1e-6, 1e6),
            softening=st.booleans(),
        )
    )


@st.composite
def blocks(draw):
    """Of two densities; outlines are in test_outlines, layers of other foams in test_layers."""
    block = draw(
        parts(
            Block,
            width=floats(0.09, 0.2),
            cell=st.none(),  # in test_lattice_numbers
            columns=st.integers(4, 60),  # every scene is checked three times, node by node
            rows=st.integers(2, 60),
            outline=st.just(()),
            holes=st.just(()),
            layers=st.just(()),
            lattice_angle_deg=st.just(0.0),
        )
    )
    layer = Layer(
        bottom=block.height * draw(floats(0, 0.4)),
        top=block.height,
        density=draw(st.none() | floats(1, 5000)),
        interface=draw(st.sampled_from(["bonded", "loose"])),
    )
    return Block(**{**dict(block), "layers": draw(st.sampled_from([(), (layer,)]))})


# An offset that keeps every shape over the block, and a width that no gap between columns has.
hits = {
    "x": floats(-0.02, 0.02),
    "gap": st.just(0.0),
    "velocity": floats(1e-3, 500),
    "drop_height": st.none(),  # it would say another velocity
    "motion": st.just("free"),  # a crosshead has rails
    "travel": st.none(),
    "guided": st.just(False),
    "velocity_x": floats(-500, 500),
    "inertia": st.none(),  # its range goes by mass and outline
    "centre": st.none() | st.tuples(floats(-5, 5), floats(-5, 5)),
}
impactors = st.one_of(
    parts(FlatBlock, width=floats(0.1, 5), **hits, rotation_deg=floats(-80, 80)),
    parts(Cylinder, radius=floats(0.05, 2), **hits),
    parts(
        Wedge,
        angle_deg=floats(90, 170),
        shank_width=floats(0.1, 1),
        height=st.just(2),
        **hits,
    ),
    parts(
        Polygon,
        vertices=st.permutations([(0, 0), (0.1, 0), (0.13, 0.1), (0.05, 0.2), (-0.05, 0.1)]),
        **hits,
    ),
)

still = {"pulse": st.none(), "pulse_peak_g": st.none(), "pulse_duration_ms": st.none()}
shaken = {
    "pulse": st.sampled_from(get_args(PulseShape)),
    "pulse_peak_g": floats(1e-3, 1e5),
    "pulse_duration_ms": floats(1e-2, 1e4),
}
bases = st.one_of(parts(Base, acceleration=st.none(), **one) for one in (still, shaken))

scenes = st.builds(
    Scene,
    name=st.text(st.characters(exclude_categories=["C"]), min_size=1, max_size=100),
    block=blocks(),
    foam=foams(),
    impactor=impactors,
    base=bases,
    model=parts(Model),
    numerics=parts(
        Numerics,
        dt=st.just("auto") | floats(0, 1e-7, exclude_min=True),
        end=floats(0.1, 10),  # of a base that is shaken a time
        time_limit=floats(0.1, 10),
    ),
    start=st.builds(
        Start,
        velocity_gradient=st.lists(
            st.tuples(floats(-1e6, 1e6), floats(-1e6, 1e6)), min_size=2, max_size=2
        ),
        cuts=st.lists(st.tuples(*[floats(-10, 10)] * 4), max_size=3),
    ),
    output=parts(Output, history_interval=floats(1e-7, 0.1), snapshot_interval=floats(0.1, 1)),
)


@settings(max_examples=200)
@given(scenes)
def test_toml_gives_an_equal_scene_back(tmp_path_factory, scene):
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(scene_to_toml(scene), encoding="utf-8")
    assert load_scene(path) == scene


def test_toml_of_other_scenes_gives_equal_ones_back(tmp_path):
    pulse = Pulse(time=[0.0, 0.1 + 0.2, 1.0], acceleration=[0.0, -1e3 / 3, 7.0])
    shaken = Scene(base=Base(acceleration=pulse), numerics=Numerics(end=1e-3))
    plate = FlatBlock(motion="crosshead", velocity=0.7, travel=0.03)
    held = {"base": Base(kind="floor"), "impactor": FlatBlock()}
    ribs = Scene(support=Support(kind="ribs", pitch=0.1 / 3, width=0.02, depth=0.01), **held)
    drawn = ((-0.1, -0.1), (0.1 / 3, -0.1), (0, 0))
    ridge = Scene(support=Support(kind="outline", outline=drawn), **held)
    scenes = {"shaken": shaken, "pressed": Scene(impactor=plate), "ribs": ribs, "ridge": ridge}
    for name, scene in scenes.items():
        path = write(tmp_path, f"{name}.toml", scene_to_toml(scene))
        assert load_scene(path) == scene


def test_toml_of_a_scene_without_impactor_leaves_it_out():
    scene = Scene(numerics=Numerics(end=1e-3))
    text = scene_to_toml(scene)
    assert "[impactor]" not in text
    assert "crushed_tensile_stress" not in text
    assert "rate =" not in text


def test_cuts_are_written_and_read_as_lists(tmp_path):
    cuts = ((0.0, 0.02, 0.0, 0.06), (-0.01, 0.04, 0.01, 0.05))
    scene = Scene(start=Start(cuts=cuts), numerics=Numerics(end=1e-3))
    path = write(tmp_path, "cut.toml", scene_to_toml(scene))
    assert load_scene(path).start.cuts == cuts
    by_hand = "[start]\ncuts = [[0, 0.02, 0, 0.06], [-0.01, 0.04, 0.01, 0.05]]\n"
    path = write(tmp_path, "by_hand.toml", by_hand + "[numerics]\nend = 1e-3\n")
    assert load_scene(path, overrides=["name=scene"]) == scene
    override = "start.cuts=[[0, 0.02, 0, 0.06], [-0.01, 0.04, 0.01, 0.05]]"
    assert load_scene("paper/wedge-2.86", overrides=[override]).start.cuts == cuts


def test_a_cut_block_is_at_rest():
    assert Start(cuts=((0, 0, 0, 1),)).is_at_rest
    assert not Start(velocity_gradient=((0, 1), (0, 0))).is_at_rest


def write(folder, name, text):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


SCRIPT = """
from taichi_foam.scene import Cylinder, Scene
scene = Scene(name="from a script", impactor=Cylinder(velocity=2))
if __name__ == "__main__":
    raise SystemExit("the main part ran")
"""


def test_script_and_toml_give_the_same_scene(tmp_path):
    script = load_scene(write(tmp_path, "drop.py", SCRIPT))
    table = 'name = "from a script"\n[impactor]\nshape = "cylinder"\nvelocity = 2\n'
    assert script == load_scene(write(tmp_path, "drop.toml", table))
    assert script.impactor.velocity == 2.0


def test_loading_writes_nothing(tmp_path):
    load_scene(write(tmp_path, "drop.py", SCRIPT))
    assert [p.name for p in tmp_path.iterdir()] == ["drop.py"]


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.toml", "name = 'a'\n[block\nrows = 3\n", ["a.toml: not valid TOML", "line 2, column"]),
        ("a.toml", "[block]\nrows = 3\nrows = 4\n", ["a.toml: not valid TOML", "line 3"]),
        ("a.toml", "[blok]\nrows = 3\n", ["blok: unknown key; did you mean block?"]),
        ("a.toml", "[block]\nrows = '3'\n", ["block.rows = '3': must be a whole number"]),
        ("a.toml", "", ["numerics.end = 'rebound'", "without an impactor"]),
        ("a.py", "x = 1\n", ["a.py: defines no `scene`", "scene = Scene(...)"]),
        ("a.py", "scene = {'block': 1}\n", ["a.py: `scene` is dict, not"]),
        ("a.py", "x = 1\n\nscene = 1 / 0\n", ["a.py:3: the script failed: ZeroDivisionError"]),
        ("a.py", "def f(:\n", ["a.py:1: the script failed: SyntaxError"]),
        ("a.py", "x = 1\nimport nowhere_to_be_found\n", ["a.py:2", "ModuleNotFoundError"]),
        ("a.py", "raise SystemExit('enough')\n", ["a.py:1", "SystemExit: enough"]),
        (
            "a.py",
            "from taichi_foam.scene import *\n\nscene = Scene(impactor=Wedge(mass=-6))\n",
            ["a.py:3: not a valid scene", "  impactor.mass = -6: must be above 0"],
        ),
        ("a.json", "{}", ["a.json: a scene is a .toml or a .py file", "taichi-foam scenes"]),
    ],
)
def test_bad_file_gets_its_message(tmp_path, name, text, says):
    path = write(tmp_path, name, text)
    with pytest.raises(UserError) as caught:
        load_scene(path)
    for words in says:
        assert words in str(caught.value)


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("nowhere/scene.toml", "nowhere/scene.toml: no such file"),
        ("paper/cylinder-3.23", "did you mean paper/cylinder-3.32?"),
        ("gallery/wavebar", "did you mean gallery/wave-bar?"),
        (".", "is a folder"),
    ],
)
def test_missing_source_gets_its_message(source, says):
    with pytest.raises(UserError, match=re.escape(says)):
        load_scene(source)


def test_later_settings_win_over_earlier_ones_over_choices_over_the_scene():
    scene = load_scene(
        "paper/wedge-2.86",
        "paper-literal",
        ["impactor.friction=0.2", "block.rows=10", "block.rows=40", "name=a plain phrase"],
    )
    assert scene.impactor.friction == 0.2
    assert scene.block.rows == 40
    assert scene.name == "a plain phrase"
    assert scene.base.kind == "held"


@pytest.mark.parametrize("text", ["block.rows", "=3", "block.rows=", "block..rows=3", ".=1"])
def test_malformed_setting(text):
    with pytest.raises(UserError, match="must read KEY=VALUE"):
        load_scene("paper/wedge-2.86", overrides=[text])


def test_a_setting_cannot_smuggle_in_a_second_one():
    with pytest.raises(UserError, match=r"block\.rows = '4"):
        load_scene("paper/wedge-2.86", overrides=["block.rows=4\nvalue2=5"])


@pytest.mark.parametrize("choices", CHOICE_SETS)
def test_choices_apply_to_any_scene(tmp_path, choices):
    path = write(tmp_path, "a.toml", "[impactor]\nshape = 'wedge'\nfriction = 0.77\n")
    scene = load_scene(path, choices)
    for key, value in CHOICE_SETS[choices].items():
        part, field = key.split(".")
        assert getattr(getattr(scene, part), field) == value


def test_choices_apply_to_a_scene_without_impactor(tmp_path):
    path = write(tmp_path, "a.toml", "[numerics]\nend = 1e-3\n")
    assert load_scene(path, "paper-literal").base.kind == "held"


PAPER = {
    "yield_strain": -0.05,
    "rate": "none",
    "overshoot_strain": "none",
    "crush_band": "none",
    "fracture_energy": "none",
    "shear_fracture_energy": "none",
}


def test_calibrated_is_the_default_but_for_the_specimen_and_the_rig():
    scene = Scene(impactor=FlatBlock())
    plain = ["base.stops_impactor=true", "impactor.friction=0.13"]
    plain += [f"foam.{key}={value}" for key, value in PAPER.items()]
    assert scene == load_scene(
        "paper/rectangular-3.03", "calibrated", ["name=scene", "reference=none", *plain]
    )


def test_every_built_in_scene_loads_and_has_a_description():
    names = list_scenes()
    assert list(names)[:9] == list(impacts.NAMES)
    for name, description in names.items():
        assert isinstance(load_scene(name), Scene)
        assert 20 < len(description) < 100
        assert "\n" not in description


def test_gallery_is_found_inside_an_installed_package(tmp_path, monkeypatch):
    gallery = tmp_path / "taichi_foam" / "gallery"
    gallery.mkdir(parents=True)
    write(gallery, "one_drop.py", '"""A drop."""\n' + SCRIPT)
    monkeypatch.setattr(catalogue, "__file__", str(tmp_path / "taichi_foam" / "catalogue.py"))
    monkeypatch.setattr(catalogue, "references", dict)  # the next tests know the package's own
    assert list_scenes()["gallery/one-drop"] == "A drop."
    assert load_scene("gallery/one-drop").name == "from a script"


def test_import_is_light():
    """The foam's law is Taichi's functions, so that scenes load Taichi; nothing starts it."""
    code = (
        "import sys, taichi_foam.catalogue\n"
        "heavy = ('taichi_foam.engine', 'scipy', 'matplotlib', 'imageio')\n"
        "print([m for m in heavy if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
