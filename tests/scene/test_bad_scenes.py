"""Each scene that cannot be is refused with its key, the value, what is allowed and a cure."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from taichi_foam.catalogue import load_scene
from taichi_foam.errors import UserError
from taichi_foam.scene import (
    Block,
    FlatBlock,
    Foam,
    Model,
    Numerics,
    Outline,
    Output,
    Polygon,
    Scene,
    Start,
    Wedge,
)
from taichi_foam.scene.messages import explain
from taichi_foam.scene.values import settings

RECTANGULAR = "paper/rectangular-3.03"

FINE = Output(history_interval=1e-5)

# a setting of a flat block's scene, and what its answer says after "key = value", in this order
VALUES = {
    # units
    "numerics.dt=1": "'auto' or above 0 and at most 1e-4 s; times ... (the paper uses 1e-7)",
    "block.width=200": "at most 5 m ... 200 mm is 0.2",
    "block.height=100": "metres",
    "block.depth=57": "57 mm is 0.057",
    "block.density=0.0256": "0.0256 g/cm3 is 25.6",
    "impactor.width=50": "metres",
    "impactor.velocity=3030": "3030 mm/s is 3.03",
    "foam.youngs_modulus=2.78": "at least 1,000 ... Pa ... 2.78 MPa is 2.78e6",
    "foam.shear_modulus=0.84": "0.84 MPa is 0.84e6",
    "foam.yield_strain=-5": "5 % is 0.05",
    "foam.shear_strain=10": "10 % is 0.10",
    "numerics.end=50": "'rebound' or ... 1 ms is 1e-3",
    "output.history_interval=1": "1 ms is 1e-3",
    "foam.fracture_energy=0": "above 0 ... J/m2",
    "foam.shear_fracture_energy=-21": "none, or above 0 ... 0.0174 N/mm is 17.4",
    "foam.crush_band=5": "at most 1 m ... 200 mm is 0.2",
    # signs, zeros, NaN, infinity
    "block.columns=0": "at least 2",
    "block.rows=-20": "at least 2",
    "block.height=0": "",
    "block.density=-25.6": "",
    "impactor.mass=0": "above 0 ... kilograms",
    "impactor.velocity=-3.03": "positive downwards",
    "impactor.friction=-0.1": "at least 0",
    "block.width=nan": "a finite number",
    "numerics.dt=nan": "'auto'",
    "numerics.dt=0": "above 0",
    "numerics.end=inf": "",
    # strains
    "foam.yield_strain=0.05": "below 0 ... negative in compression: -0.05",
    "foam.tensile_strain=-0.05": "positive in",
    "foam.locking_strain=-0.7": "below foam.densification_strain = -0.8 ... -0.95",
    "foam.densification_strain=-0.02": "below foam.yield_strain = -0.0425",
    "foam.locking_strain=-1.2": "above -1",
    # an impactor that cannot hit, or has hit already
    "impactor.x=0.3": "never touches ... 0.275 to 0.325 m ... -0.0975 to 0.0975 m",
    "impactor.velocity=0": "never touches",
    "impactor.gap=1": "0.33 s ... time_limit = 0.12 s",
    "impactor.gap=-0.01": "start inside the block",
    # wrong kinds of value
    "block.width=wide": "must be a number",
    "block.columns=40.5": "a whole number",
    "block.columns=true": "a whole number",
    "block=5": "a table with keys such as width, height",
    "impactor=5": "a table with keys such as mass",
    "model.self_contact=yes": "true or false",
    "model.damping=none": "'stiffness' or 'absolute'",
    "base.kind=glued": "'held', 'gripped' or 'floor'",
    "impactor.shape=ball": "flat, cylinder, wedge",
    "numerics.end=never": "'rebound' or above 0",
    "numerics.dt=false": "'auto' or above 0",
    'name=""': "1 to 100 printable characters",
    # rate, strengths, readings, pieces
    "foam.rate=0": "none, or at least 1 and at most 1e9 1/s",
    "foam.rate=-80": "none, or at least 1 ... rates are in 1/s",
    "foam.rate=1e10": "at most 1e9 1/s",
    "foam.rate=fast": "none, or at least 1",
    "foam.rate_exponent=0.5": "at least 1 and at",
    "foam.rate_exponent=21": "at most 20",
    "foam.rate_exponent=none": "a plain number",
    "foam.strength_scatter=-0.1": "at least 0",
    "foam.strength_scatter=20": "at most 0.5",
    "foam.strength_scatter=true": "a number",
    "foam.strength_seed=-1": "at least 0 ... other strengths",
    "foam.strength_seed=4294967296": "at most 4,294,967,295",
    "foam.strength_seed=1.5": "a whole number",
    "model.shear=both": "'cell' or 'face'",
    "model.shear=1": "'cell' or 'face'",
    "model.shear_failure=angel": "'always', 'pressure-dependent' or 'angle'",
    "model.piece_size=0": "at least 0.1 and at most 1.1",
    "model.piece_size=1.11": "at most 1.1",
    "model.piece_friction=-0.3": "at least 0",
    "model.piece_friction=6": "at most 5",
    "base.stops_impactor=1": "true or false",
    # what the block stands on
    "support.kind=spikes": "'floor', 'ribs' or 'outline'",
    "support.pitch=-1": "above 0 ... metres",
    "support.pitch=0.02": "the kind is 'floor'",
    # cuts
    "start.cuts=none": "up to 1000 lines",
    "start.cuts=across": "up to 1000 lines",
    # off the rails
    "impactor.spin=3": "guide rails ... impactor.guided = false",
    "impactor.velocity_x=-2": "guide rails",
    "impactor.inertia=0.1": "guide rails",
    "impactor.inertia=0": "above 0 ... kg m2",
    "impactor.inertia=-1": "above 0",
    "impactor.spin=1e9": "rad/s",
    # parts that disagree
    "block.rows=10000": "mass points ... at most 4,000,000",
    "output.snapshot_interval=1e-5": "at least output.history_interval = 0.0001",
    "output.width=1281": "must be even",
    "output.fps=0": "",
}

# the same of other shapes
OF_SHAPES = [
    ("paper/cylinder-3.32", "impactor.radius=25", "25 mm is 0.025"),
    ("paper/cylinder-3.32", "impactor.x=-0.2", "never touches"),
    ("paper/wedge-2.86", "impactor.angle_deg=1.5708", "degrees"),
    ("paper/wedge-2.86", "impactor.angle_deg=180", "at most 170"),
    ("paper/wedge-2.86", "impactor.height=0.02", "above 0.025 m"),
]

# settings whose answers name another key, or another value
OTHERS = {
    # unknown keys
    "block.widht=0.2": "block.widht: unknown key ... did you mean block.width?",
    "velocity=3": "velocity: unknown key ... did you mean impactor.velocity?",
    "impactor.radius=0.02": "impactor.radius: unknown key; known here: mass, velocity",
    "model.dampng=absolute": "did you mean model.damping?",
    "zzz=1": "zzz: unknown key ... known here: name, block, foam, across, impactor",
    "block.width.value=1": "block.width.value: unknown key ... no keys of its own",
    # signs, zeros, NaN, infinity
    "start.velocity_gradient=[[0,0],[nan,0]]": "velocity_gradient[1][0] = nan",
    # an impactor that cannot hit, or has hit already
    "impactor.width=0.004": "between two columns ... 0.005 m apart",
    "start.deformation_gradient=[[1,0],[0,1.2]]": "impactor.gap = 0: ... at least 0.02 m",
    # wrong kinds of value
    "start.deformation_gradient=[[1,0]]": "deformation_gradient[1]: missing",
    # what the block stands on
    "support.kind=ribs": "support.pitch: missing; support.kind = 'ribs' needs it",
    "support.outline=[[0,0],[0,9],[1,1]]": "support.outline[1][1] = 9 ... metres",
    # cuts
    "start.cuts=[[0,0,1]]": "start.cuts[0][3]: missing ... lines of four numbers",
    "start.cuts=[[0,0,1,1,1]]": "start.cuts[0] ... lines of four numbers",
    "start.cuts=[0,0,1,1]": "start.cuts[0] = 0 ... lines of four numbers",
    "start.cuts=[[0,0,0,100]]": "start.cuts[0][3] = 100 ... from -10 to 10 m",
    "start.cuts=[[0,nan,0,1]]": "start.cuts[0][1] = nan ... metres",
    # impactor shapes
    "impactor.shape=polygon": "impactor.vertices: missing ... 3 to 16 corners",
    "impactor.shape=outline": "impactor.vertices: missing ... 3 to 512 corners",
    # off the rails
    "impactor.centre=[0,0.1]": "impactor.centre = [0.0, 0.1]: guide rails",
    "impactor.centre=[0,9]": "impactor.centre[1] = 9 ... from -5 to 5 m",
    "impactor.angular_velocity=3": "impactor.angular_velocity ... impactor.spin is",
    "impactor.moment_of_inertia=3": "impactor.moment_of_inertia ... kg m2",
    # parts that disagree
    "impactor=none": "numerics.end = 'rebound' ... without an impactor",
    "numerics.time_limit=5e-5": "output.history_interval = 0.0001 ... 5e-05 s",
    "foam.youngs_modulus=2780": "ten times foam.youngs_modulus = 2780",
    "start.deformation_gradient=[[1,0],[0,-1]]": "determinant is -1",
    "start.deformation_gradient=[[0.04,0],[0,1]]": "strain -0.96 along x",
}


def refusal(source, setting):
    with pytest.raises(UserError) as caught:
        load_scene(source, overrides=[setting])
    message = str(caught.value)
    for inner_word in ("pydantic", "http", "Value error", "Input should"):
        assert inner_word not in message
    return message


def in_order(says):
    return re.compile(".*".join(map(re.escape, says.split(" ... "))), re.DOTALL)


@pytest.mark.parametrize(
    ("source", "setting", "says"),
    [*((RECTANGULAR, *each) for each in VALUES.items()), *OF_SHAPES],
)
def test_bad_value_gets_its_message(source, setting, says):
    ((key, value),) = settings([setting]).items()
    told = refusal(source, setting).partition(f"{key} = {'none' if value is None else repr(value)}")
    assert told[1]
    assert in_order(says).search(told[2])


@pytest.mark.parametrize("setting", OTHERS)
def test_bad_setting_gets_its_message(setting):
    assert in_order(OTHERS[setting]).search(refusal(RECTANGULAR, setting))


def test_every_problem_gets_one_line():
    with pytest.raises(UserError) as caught:
        load_scene(RECTANGULAR, overrides=["block.width=200", "numerics.dt=1", "foam.gooo=1"])
    lines = str(caught.value).splitlines()
    assert len(lines) == 4
    assert all(
        any(line.startswith(f"  {key}") for line in lines)
        for key in ("block.width", "numerics.dt", "foam.gooo")
    )


@given(
    st.sampled_from(["block.depth", "foam.yield_strain", "impactor.mass", "numerics.safety"]),
    st.floats(allow_subnormal=False),  # Taichi has its process flush them to zero
)
def test_a_number_is_taken_as_it_is_or_refused_by_name(key, value):
    problem, loaded = "", None
    try:
        scene = load_scene(RECTANGULAR, overrides=[f"{key}={value!r}"])
        part, field = key.split(".")
        loaded = getattr(getattr(scene, part), field)
    except UserError as error:
        problem = str(error)
    assert loaded == value or f"{key} = {value!r}" in problem


def test_a_plate_wider_than_the_block_is_fine():
    assert load_scene(RECTANGULAR, overrides=["impactor.width=0.5"]).impactor.width == 0.5


def test_an_impactor_at_rest_falls_when_there_is_gravity():
    """From 10 mm it arrives after sqrt(2 h / g) = 45 ms: before 50 ms, not before 40 ms."""
    fall = ["impactor.velocity=0", "impactor.gap=0.01", "numerics.gravity=9.81"]
    assert load_scene(RECTANGULAR, overrides=[*fall, "numerics.time_limit=0.05"])
    with pytest.raises(UserError, match=r"arrives after 0\.04515 s"):
        load_scene(RECTANGULAR, overrides=[*fall, "numerics.time_limit=0.04"])


OF_BOTH = [
    (((0, 0), (0.1, 0), (0.1, 0), (0, 0.1)), r"impactor.vertices\[2\] = \[0.1, 0.0\]: repeats"),
    (((0, 0), (0.1, 0.1), (0.2, 0.2)), "all on one line"),
    (((0, 0), (1e-6, 0), (0, 1e-6)), "1e-06 m across"),
    (((0, 0), (50, 0), (0, 50)), "lengths are in metres"),
    (((0, 0), (0.1, float("nan")), (0, 0.1)), r"vertices\[1\]\[1\] = nan"),
]


@pytest.mark.parametrize(
    ("shape", "corners", "says"),
    [
        *((shape, *each) for shape in (Polygon, Outline) for each in OF_BOTH),
        (Polygon, ((0, 0), (0.1, 0)), "3 to 16 corners"),
        (Polygon, [(0.01 * k, 0.0001 * k * k) for k in range(17)], "3 to 16 corners"),
        (Polygon, ((0, 0), (0.1, 0), (0.02, 0.02), (0, 0.1)), r"vertices\[2\] = .* be convex"),
        (Outline, ((0, 0), (0.1, 0)), "3 to 512 corners"),
        (Outline, [(0.001 * k, 1e-6 * k * k) for k in range(513)], "3 to 512 corners"),
        (
            Outline,
            ((0, 0), (0.1, 0), (0, 0.1), (0, 0)),
            r"vertices\[3\] = .*closes by itself; leave it out",
        ),
        (Outline, ((0, 0), (0.1, 0.1), (0.1, 0), (0, 0.1)), r"itself near \[0.05, 0.05\]"),
        (
            Outline,
            ((0, 0), (0.2, 0), (0.2, 0.1), (0.1, 0), (0, 0.1)),
            "crosses or touches itself near",
        ),
    ],
)
def test_bad_corners_get_their_message(shape, corners, says):
    with pytest.raises(ValidationError) as caught:
        shape(vertices=corners)
    assert re.search(says, explain(caught.value, Scene))


def test_an_outline_comes_from_a_file_beside_its_scene(tmp_path):
    """In millimetres, by a semicolon, its first corner once more at the end."""
    (tmp_path / "foot.csv").write_text("# a foot\nx [mm];y [mm]\n0;0\n60;0\n60;10\n0;30\n0;0\n")
    scene = tmp_path / "drop.toml"
    scene.write_text('[impactor]\nfile = "foot.csv"\nmass = 2.0\nguided = false\n')
    impactor = load_scene(scene).impactor
    assert isinstance(impactor, Outline)
    assert impactor.vertices == ((0.0, 0.0), (0.06, 0.0), (0.06, 0.01), (0.0, 0.03))
    assert impactor.mass == 2.0
    (tmp_path / "plain.csv").write_text("0,0\n0.06,0\n0,0.03\n")
    scene.write_text('[impactor]\nshape = "outline"\nfile = "plain.csv"\n')
    assert load_scene(scene).impactor.vertices[1] == (0.06, 0.0)


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        ("x,y\n0,0\n60,0\n60,ten\n", "", r"foot.csv, line 4: 'ten' in column 2: must be a number"),
        ("x [mm],y [cm]\n0,0\n6,0\n0,6\n", "", "must give x and y the same unit"),
        ("x [furlong],y [furlong]\n0,0\n6,0\n0,6\n", "", "unit 'furlong': must be one of m, mm"),
        ("0,0\n60,0\n60,40\n", "", r"vertices\[1\]\[0\] = 60.*lengths are in metres"),
        ("0,0\n0.1,nan\n0,0.1\n", "", "line 2: nan in column 2: must be finite"),
        ("0,0\n0.1,0\n0,0.1\n", 'shape = "flat"', "impactor.shape = 'flat'; must be outline"),
        ("0,0\n0.1,0\n0,0.1\n", "vertices = [[0, 0]]", "leave one of them out"),
        ("", "", "empty; must have lines of x and y"),
        (None, "", "cannot be read"),
    ],
)
def test_bad_outline_file_gets_its_message(tmp_path, text, line, says):
    if text is not None:
        (tmp_path / "foot.csv").write_text(text)
    scene = tmp_path / "drop.toml"
    scene.write_text(f'[impactor]\nfile = "foot.csv"\n{line}\n')
    with pytest.raises(UserError, match=says):
        load_scene(scene)


def test_polygon_takes_its_corners_in_any_order():
    square = Polygon(vertices=((0, 0), (1, 1), (1, 0), (0, 1)))
    assert len(square.outline()) == 4
    assert square.crushed_volume(0.5, 1.0) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("build", "line"),
    [
        (lambda: Block(width=-1), "block.width = -1: "),
        (lambda: Foam(locking_strain=-0.1), "foam.locking_strain = -0.1: "),
        (lambda: FlatBlock(gap=-1), "impactor.gap = -1: "),
        (lambda: Wedge(angle=60), "impactor.angle: unknown key; did you mean impactor.angle_deg?"),
        (lambda: Start(deformation_gradient=((1, 0), (0, 99))), "start.deformation_gradient[1][1]"),
        (lambda: Start(cuts=((0, 0, 0, 1),) * 1001), "start.cuts = "),
        (lambda: Foam(rate=0.5), "foam.rate = 0.5: must be none, or at least 1"),
        (lambda: Model(piece_size=2), "model.piece_size = 2: "),
        (lambda: Scene(impactor=FlatBlock(x=1)), "impactor.x = 1: never touches"),
        (lambda: Scene(impactor={"shape": "flat", "mas": 1}), "impactor.mas: unknown key"),
        (lambda: Scene(impactor={"mass": 1}), "impactor.shape: missing; choose one of"),
        (lambda: Scene(numerics={"dt": "fast"}), "numerics.dt = 'fast': "),
        (
            lambda: Scene(impactor=Wedge(), numerics=Numerics(dt=1e-4), output=FINE),
            "numerics.dt = 0.0001: longer than output.history_interval = 1e-05 s",
        ),
    ],
)
def test_parts_built_in_python_are_explained_with_their_place_in_the_scene(build, line):
    with pytest.raises(ValidationError) as caught:
        build()
    assert explain(caught.value, Scene).startswith(line)
    assert len(explain(caught.value, Scene).splitlines()) == 1
