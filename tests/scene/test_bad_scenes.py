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

RECTANGULAR, CYLINDER, WEDGE = (
    "paper/rectangular-3.03",
    "paper/cylinder-3.32",
    "paper/wedge-2.86",
)

FINE = Output(history_interval=1e-5)

# base scene, what to set, what the answer must say
BAD = [
    # unknown keys
    (RECTANGULAR, "block.widht=0.2", ["block.widht: unknown key", "did you mean block.width?"]),
    (RECTANGULAR, "velocity=3", ["velocity: unknown key", "did you mean impactor.velocity?"]),
    (
        RECTANGULAR,
        "impactor.radius=0.02",
        ["impactor.radius: unknown key; known here: mass, velocity"],
    ),
    (RECTANGULAR, "model.dampng=absolute", ["did you mean model.damping?"]),
    (RECTANGULAR, "zzz=1", ["zzz: unknown key", "known here: name, block, foam, across, impactor"]),
    (RECTANGULAR, "block.width.value=1", ["block.width.value: unknown key", "no keys of its own"]),
    # units
    (
        RECTANGULAR,
        "numerics.dt=1",
        [
            "numerics.dt = 1: must be 'auto' or above 0 and at most 1e-4 s; "
            "times are in seconds (the paper uses 1e-7)"
        ],
    ),
    (RECTANGULAR, "block.width=200", ["block.width = 200", "at most 5 m", "200 mm is 0.2"]),
    (RECTANGULAR, "block.height=100", ["block.height = 100", "metres"]),
    (RECTANGULAR, "block.depth=57", ["block.depth = 57", "57 mm is 0.057"]),
    (RECTANGULAR, "block.density=0.0256", ["block.density = 0.0256", "0.0256 g/cm3 is 25.6"]),
    (RECTANGULAR, "impactor.width=50", ["impactor.width = 50", "metres"]),
    (CYLINDER, "impactor.radius=25", ["impactor.radius = 25", "25 mm is 0.025"]),
    (RECTANGULAR, "impactor.velocity=3030", ["impactor.velocity = 3030", "3030 mm/s is 3.03"]),
    (
        RECTANGULAR,
        "foam.youngs_modulus=2.78",
        ["foam.youngs_modulus = 2.78", "at least 1,000", "Pa", "2.78 MPa is 2.78e6"],
    ),
    (RECTANGULAR, "foam.shear_modulus=0.84", ["foam.shear_modulus = 0.84", "0.84 MPa is 0.84e6"]),
    (RECTANGULAR, "foam.yield_strain=-5", ["foam.yield_strain = -5", "5 % is 0.05"]),
    (RECTANGULAR, "foam.shear_strain=10", ["foam.shear_strain = 10", "10 % is 0.10"]),
    (RECTANGULAR, "numerics.end=50", ["numerics.end = 50", "'rebound' or", "1 ms is 1e-3"]),
    (WEDGE, "impactor.angle_deg=1.5708", ["impactor.angle_deg = 1.5708", "degrees"]),
    (RECTANGULAR, "output.history_interval=1", ["output.history_interval = 1", "1 ms is 1e-3"]),
    (RECTANGULAR, "foam.fracture_energy=0", ["foam.fracture_energy = 0", "above 0", "J/m2"]),
    (
        RECTANGULAR,
        "foam.shear_fracture_energy=-21",
        ["foam.shear_fracture_energy = -21", "none, or above 0", "0.0174 N/mm is 17.4"],
    ),
    (RECTANGULAR, "foam.crush_band=5", ["foam.crush_band = 5", "at most 1 m", "200 mm is 0.2"]),
    # signs, zeros, NaN, infinity
    (RECTANGULAR, "block.columns=0", ["block.columns = 0", "at least 2"]),
    (RECTANGULAR, "block.rows=-20", ["block.rows = -20", "at least 2"]),
    (RECTANGULAR, "block.height=0", ["block.height = 0"]),
    (RECTANGULAR, "block.density=-25.6", ["block.density = -25.6"]),
    (RECTANGULAR, "impactor.mass=0", ["impactor.mass = 0", "above 0", "kilograms"]),
    (RECTANGULAR, "impactor.velocity=-3.03", ["impactor.velocity = -3.03", "positive downwards"]),
    (RECTANGULAR, "impactor.friction=-0.1", ["impactor.friction = -0.1", "at least 0"]),
    (RECTANGULAR, "block.width=nan", ["block.width = nan", "a finite number"]),
    (RECTANGULAR, "foam.tensile_strain=nan", ["foam.tensile_strain = nan"]),
    (RECTANGULAR, "impactor.velocity=inf", ["impactor.velocity = inf"]),
    (RECTANGULAR, "foam.densification_strain=-inf", ["foam.densification_strain = -inf"]),
    (RECTANGULAR, "numerics.dt=nan", ["numerics.dt = nan", "'auto'"]),
    (RECTANGULAR, "numerics.dt=0", ["numerics.dt = 0", "above 0"]),
    (RECTANGULAR, "numerics.end=inf", ["numerics.end = inf"]),
    (RECTANGULAR, "start.velocity_gradient=[[0,0],[nan,0]]", ["velocity_gradient[1][0] = nan"]),
    # strains
    (
        RECTANGULAR,
        "foam.yield_strain=0.05",
        ["foam.yield_strain = 0.05", "below 0", "negative in compression: -0.05"],
    ),
    (RECTANGULAR, "foam.tensile_strain=-0.05", ["foam.tensile_strain = -0.05", "positive in"]),
    (
        RECTANGULAR,
        "foam.locking_strain=-0.7",
        ["foam.locking_strain = -0.7", "below foam.densification_strain = -0.8", "-0.95"],
    ),
    (
        RECTANGULAR,
        "foam.densification_strain=-0.02",
        ["foam.densification_strain = -0.02", "below foam.yield_strain = -0.041"],
    ),
    (RECTANGULAR, "foam.locking_strain=-1.2", ["foam.locking_strain = -1.2", "above -1"]),
    # an impactor that cannot hit, or has hit already
    (
        RECTANGULAR,
        "impactor.x=0.3",
        ["impactor.x = 0.3", "never touches", "0.275 to 0.325 m", "-0.0975 to 0.0975 m"],
    ),
    (CYLINDER, "impactor.x=-0.2", ["impactor.x = -0.2", "never touches"]),
    (RECTANGULAR, "impactor.velocity=0", ["impactor.velocity = 0", "never touches"]),
    (RECTANGULAR, "impactor.gap=1", ["impactor.gap = 1", "0.33 s", "time_limit = 0.12 s"]),
    (RECTANGULAR, "impactor.width=0.004", ["between two columns", "0.005 m apart"]),
    (RECTANGULAR, "impactor.gap=-0.01", ["impactor.gap = -0.01", "start inside the block"]),
    (
        RECTANGULAR,
        "start.deformation_gradient=[[1,0],[0,1.2]]",
        ["impactor.gap = 0", "starts inside the block", "at least 0.02 m"],
    ),
    # wrong kinds of value
    (RECTANGULAR, "block.width=wide", ["block.width = 'wide'", "must be a number"]),
    (RECTANGULAR, "block.columns=40.5", ["block.columns = 40.5", "a whole number"]),
    (RECTANGULAR, "block.columns=true", ["block.columns = True", "a whole number"]),
    (RECTANGULAR, "block=5", ["block = 5", "a table with keys such as width, height"]),
    (RECTANGULAR, "impactor=5", ["impactor = 5", "a table with keys such as mass"]),
    (RECTANGULAR, "model.self_contact=yes", ["model.self_contact = 'yes'", "true or false"]),
    (
        RECTANGULAR,
        "model.damping=none",
        ["model.damping = none", "'stiffness' or 'absolute'"],
    ),
    (RECTANGULAR, "base.kind=glued", ["base.kind = 'glued'", "'held', 'gripped' or 'floor'"]),
    (RECTANGULAR, "impactor.shape=ball", ["impactor.shape = 'ball'", "flat, cylinder, wedge"]),
    (RECTANGULAR, "numerics.end=never", ["numerics.end = 'never'", "'rebound' or above 0"]),
    (RECTANGULAR, "numerics.dt=false", ["numerics.dt = False", "'auto' or above 0"]),
    (RECTANGULAR, "start.deformation_gradient=[[1,0]]", ["deformation_gradient[1]: missing"]),
    (RECTANGULAR, 'name=""', ["name = ''", "1 to 100 printable characters"]),
    # rate, strengths, readings, pieces
    (RECTANGULAR, "foam.rate=0", ["foam.rate = 0", "none, or at least 1 and at most 1e9 1/s"]),
    (RECTANGULAR, "foam.rate=-80", ["foam.rate = -80", "none, or at least 1", "rates are in 1/s"]),
    (RECTANGULAR, "foam.rate=1e10", ["foam.rate = 10000000000.0", "at most 1e9 1/s"]),
    (RECTANGULAR, "foam.rate=nan", ["foam.rate = nan", "none, or at least 1"]),
    (RECTANGULAR, "foam.rate=fast", ["foam.rate = 'fast'", "none, or at least 1"]),
    (RECTANGULAR, "foam.rate_exponent=0.5", ["foam.rate_exponent = 0.5", "at least 1 and at"]),
    (RECTANGULAR, "foam.rate_exponent=21", ["foam.rate_exponent = 21", "at most 20"]),
    (RECTANGULAR, "foam.rate_exponent=inf", ["foam.rate_exponent = inf", "a finite number"]),
    (RECTANGULAR, "foam.rate_exponent=none", ["foam.rate_exponent = none", "a plain number"]),
    (RECTANGULAR, "foam.strength_scatter=-0.1", ["foam.strength_scatter = -0.1", "at least 0"]),
    (RECTANGULAR, "foam.strength_scatter=20", ["foam.strength_scatter = 20", "at most 0.5"]),
    (RECTANGULAR, "foam.strength_scatter=nan", ["foam.strength_scatter = nan", "a finite number"]),
    (RECTANGULAR, "foam.strength_scatter=true", ["foam.strength_scatter = True", "a number"]),
    (
        RECTANGULAR,
        "foam.strength_seed=-1",
        ["foam.strength_seed = -1", "at least 0", "other strengths"],
    ),
    (
        RECTANGULAR,
        "foam.strength_seed=4294967296",
        ["foam.strength_seed = 4294967296", "at most 4,294,967,295"],
    ),
    (RECTANGULAR, "foam.strength_seed=1.5", ["foam.strength_seed = 1.5", "a whole number"]),
    (RECTANGULAR, "foam.strength_seed=nan", ["foam.strength_seed = nan", "a whole number"]),
    (RECTANGULAR, "model.shear=both", ["model.shear = 'both'", "'cell' or 'face'"]),
    (RECTANGULAR, "model.shear=1", ["model.shear = 1", "'cell' or 'face'"]),
    (
        RECTANGULAR,
        "model.shear_failure=angel",
        ["model.shear_failure = 'angel'", "'always', 'pressure-dependent' or 'angle'"],
    ),
    (RECTANGULAR, "model.piece_size=0", ["model.piece_size = 0", "at least 0.1 and at most 1.1"]),
    (RECTANGULAR, "model.piece_size=1.11", ["model.piece_size = 1.11", "at most 1.1"]),
    (RECTANGULAR, "model.piece_size=nan", ["model.piece_size = nan", "a finite number"]),
    (RECTANGULAR, "model.piece_size=big", ["model.piece_size = 'big'", "must be a number"]),
    (RECTANGULAR, "model.piece_friction=-0.3", ["model.piece_friction = -0.3", "at least 0"]),
    (RECTANGULAR, "model.piece_friction=6", ["model.piece_friction = 6", "at most 5"]),
    (RECTANGULAR, "model.piece_friction=inf", ["model.piece_friction = inf", "a finite number"]),
    (RECTANGULAR, "base.stops_impactor=no", ["base.stops_impactor = 'no'", "true or false"]),
    (RECTANGULAR, "base.stops_impactor=1", ["base.stops_impactor = 1", "true or false"]),
    # what the block stands on
    (
        RECTANGULAR,
        "support.kind=spikes",
        ["support.kind = 'spikes'", "'floor', 'ribs' or 'outline'"],
    ),
    (
        RECTANGULAR,
        "support.kind=ribs",
        ["support.pitch: missing", "support.kind = 'ribs' needs it"],
    ),
    (RECTANGULAR, "support.pitch=-1", ["support.pitch = -1", "above 0", "metres"]),
    (RECTANGULAR, "support.pitch=0.02", ["support.pitch = 0.02", "the kind is 'floor'"]),
    (RECTANGULAR, "support.outline=[[0,0],[0,9],[1,1]]", ["support.outline[1][1] = 9", "metres"]),
    # cuts
    (RECTANGULAR, "start.cuts=[[0,0,1]]", ["start.cuts[0][3]: missing", "lines of four numbers"]),
    (RECTANGULAR, "start.cuts=[[0,0,1,1,1]]", ["start.cuts[0]", "lines of four numbers"]),
    (RECTANGULAR, "start.cuts=[0,0,1,1]", ["start.cuts[0] = 0", "lines of four numbers"]),
    (RECTANGULAR, "start.cuts=[[0,0,0,100]]", ["start.cuts[0][3] = 100", "from -10 to 10 m"]),
    (RECTANGULAR, "start.cuts=[[0,nan,0,1]]", ["start.cuts[0][1] = nan", "metres"]),
    (RECTANGULAR, "start.cuts=none", ["start.cuts = none", "up to 1000 lines"]),
    (RECTANGULAR, "start.cuts=across", ["start.cuts = 'across'", "up to 1000 lines"]),
    # impactor shapes
    (RECTANGULAR, "impactor.shape=polygon", ["impactor.vertices: missing", "3 to 16 corners"]),
    (RECTANGULAR, "impactor.shape=outline", ["impactor.vertices: missing", "3 to 512 corners"]),
    # off the rails
    (RECTANGULAR, "impactor.spin=3", ["impactor.spin = 3: guide rails", "impactor.guided = false"]),
    (RECTANGULAR, "impactor.velocity_x=-2", ["impactor.velocity_x = -2: guide rails"]),
    (RECTANGULAR, "impactor.inertia=0.1", ["impactor.inertia = 0.1: guide rails"]),
    (RECTANGULAR, "impactor.inertia=0", ["impactor.inertia = 0", "above 0", "kg m2"]),
    (RECTANGULAR, "impactor.inertia=-1", ["impactor.inertia = -1", "above 0"]),
    (RECTANGULAR, "impactor.centre=[0,0.1]", ["impactor.centre = [0.0, 0.1]: guide rails"]),
    (RECTANGULAR, "impactor.centre=[0,9]", ["impactor.centre[1] = 9", "from -5 to 5 m"]),
    (
        RECTANGULAR,
        "impactor.spin=1e9",
        ["impactor.spin = 1000000000.0", "rad/s"],
    ),
    (RECTANGULAR, "impactor.guided=no", ["impactor.guided = 'no'", "true or false"]),
    (RECTANGULAR, "impactor.angular_velocity=3", ["impactor.angular_velocity", "impactor.spin is"]),
    (RECTANGULAR, "impactor.moment_of_inertia=3", ["impactor.moment_of_inertia", "kg m2"]),
    (WEDGE, "impactor.angle_deg=180", ["impactor.angle_deg = 180", "at most 170"]),
    (WEDGE, "impactor.height=0.02", ["impactor.height = 0.02", "above 0.025 m"]),
    # parts that disagree
    (RECTANGULAR, "impactor=none", ["numerics.end = 'rebound'", "without an impactor"]),
    (RECTANGULAR, "block.rows=10000", ["mass points", "at most 4,000,000"]),
    (
        RECTANGULAR,
        "output.snapshot_interval=1e-5",
        ["output.snapshot_interval = 1e-05", "at least output.history_interval = 0.0001"],
    ),
    (RECTANGULAR, "numerics.time_limit=5e-5", ["output.history_interval = 0.0001", "5e-05 s"]),
    (RECTANGULAR, "output.width=1281", ["output.width = 1281", "must be even"]),
    (RECTANGULAR, "output.fps=0", ["output.fps = 0"]),
    (RECTANGULAR, "start.deformation_gradient=[[1,0],[0,-1]]", ["determinant is -1"]),
    (RECTANGULAR, "start.deformation_gradient=[[0.04,0],[0,1]]", ["strain -0.96 along x"]),
    (RECTANGULAR, "foam.youngs_modulus=2780", ["ten times foam.youngs_modulus = 2780"]),
]


@pytest.mark.parametrize(("source", "setting", "says"), BAD, ids=[setting for _, setting, _ in BAD])
def test_bad_value_gets_its_message(source, setting, says):
    with pytest.raises(UserError) as caught:
        load_scene(source, overrides=[setting])
    message = str(caught.value)
    for words in says:
        assert words in message
    for inner_word in ("pydantic", "http", "Value error", "Input should"):
        assert inner_word not in message


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


@pytest.mark.parametrize(
    ("corners", "says"),
    [
        (((0, 0), (0.1, 0)), "3 to 16 corners"),
        ([(0.01 * k, 0.0001 * k * k) for k in range(17)], "3 to 16 corners"),
        (((0, 0), (0.1, 0), (0.1, 0), (0, 0.1)), r"impactor.vertices\[2\] = \[0.1, 0.0\]: repeats"),
        (((0, 0), (0.1, 0.1), (0.2, 0.2)), "all on one line"),
        (((0, 0), (0.1, 0), (0.02, 0.02), (0, 0.1)), r"vertices\[2\] = .* must be convex"),
        (((0, 0), (1e-6, 0), (0, 1e-6)), "1e-06 m across"),
        (((0, 0), (50, 0), (0, 50)), "lengths are in metres"),
        (((0, 0), (0.1, float("nan")), (0, 0.1)), r"vertices\[1\]\[1\] = nan"),
    ],
)
def test_bad_polygon_gets_its_message(corners, says):
    with pytest.raises(ValidationError) as caught:
        Polygon(vertices=corners)
    assert re.search(says, explain(caught.value, Scene))


@pytest.mark.parametrize(
    ("corners", "says"),
    [
        (((0, 0), (0.1, 0)), "3 to 512 corners"),
        ([(0.001 * k, 1e-6 * k * k) for k in range(513)], "3 to 512 corners"),
        (((0, 0), (0.1, 0), (0.1, 0), (0, 0.1)), r"impactor.vertices\[2\] = \[0.1, 0.0\]: repeats"),
        (((0, 0), (0.1, 0), (0, 0.1), (0, 0)), r"vertices\[3\] = .*closes by itself; leave it out"),
        (
            ((0, 0), (0.1, 0.1), (0.1, 0), (0, 0.1)),
            r"crosses or touches itself near \[0.05, 0.05\]",
        ),
        (((0, 0), (0.2, 0), (0.2, 0.1), (0.1, 0), (0, 0.1)), r"crosses or touches itself near"),
        (((0, 0), (0.1, 0.1), (0.2, 0.2)), "all on one line|crosses or touches itself"),
        (((0, 0), (1e-6, 0), (0, 1e-6)), "1e-06 m across"),
        (((0, 0), (50, 0), (0, 50)), "lengths are in metres"),
        (((0, 0), (0.1, float("nan")), (0, 0.1)), r"vertices\[1\]\[1\] = nan"),
    ],
)
def test_bad_outline_gets_its_message(corners, says):
    with pytest.raises(ValidationError) as caught:
        Outline(vertices=corners)
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
