"""Mass properties of bodies: density times volume, intervals, what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Body, Certainty, Estimate, Link, Physics, Placement, Rival, Support
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.geometry import massprops, solids
from dextera_build.statistics import Z90
from dextera_build.testing import RuleRunner
from rules.factorize import household
from rules.factorize.elements import naming
from tests import factories, object_views


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def weigh(runner, body, proposed="plastic", category="object", world=(None, None), phrase="", **options) -> Physics:
    """`world` are the placement of the body and the support."""
    traits = object_views.view(body.links["base"].mesh, np.eye(4), material=proposed).traits
    traits = traits.model_copy(update={"category": category, "phrase": phrase})
    told = {name: value for name, value in zip(("placement", "support"), world, strict=True) if value is not None}
    return runner.run("factorize.physics", body=body, traits=traits, options=options, **told)


BOX = object_views.mesh(solids.box((0.1, 0.2, 0.3), (0.0, 0.0, 0.15)))


def test_a_box_of_wood_weighs_density_times_volume(runner):
    found = weigh(runner, object_views.body(BOX), "wood").links["base"]
    assert found.mass_kg == pytest.approx(600.0 * 0.006, rel=1e-6)
    assert found.centre == pytest.approx((0.0, 0.0, 0.15), abs=1e-6)
    x, y, z = 0.1, 0.2, 0.3
    expected = found.mass_kg / 12 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])
    assert found.inertia == pytest.approx((*expected, 0.0, 0.0, 0.0), rel=1e-5, abs=1e-9)
    assert found.source == "material table: wood, whole at 600 kg/m3"


def test_a_vessel_is_made_of_walls_and_a_product_of_what_is_in_it(runner):
    cup = object_views.mesh(object_views.cup())
    volume = massprops.of_mesh(cup.vertices, cup.faces).volume
    hollow = weigh(runner, object_views.body(cup, hollow=True), "ceramic").links["base"]
    filled = weigh(runner, object_views.body(cup), "ceramic", category="mug").links["base"]
    assert hollow.mass_kg == pytest.approx(2300.0 * volume, rel=1e-6)
    assert "like stacking cup large and paper cup" in filled.source
    assert filled.mass_low_kg < 0.23 < filled.mass_high_kg


def test_the_interval_holds_the_estimate_and_is_wide_where_little_is_known(runner):
    box = weigh(runner, object_views.body(BOX), "cardboard").links["base"]
    metal = weigh(runner, object_views.body(BOX), "wood").links["base"]
    assert box.mass_low_kg < box.mass_kg < box.mass_high_kg
    assert box.mass_high_kg / box.mass_low_kg > metal.mass_high_kg / metal.mass_low_kg > 1.5


@pytest.mark.parametrize(("grams", "size"), [(411, (0.060, 0.158, 0.210)), (514, (0.038, 0.089, 0.175))])
def test_published_boxes_lie_inside_their_interval(runner, grams, size):
    found = weigh(runner, object_views.body(object_views.mesh(solids.box(size))), "cardboard").links["base"]
    assert found.mass_low_kg < grams / 1000 < found.mass_high_kg


def test_a_weighed_mass_is_shared_out_by_volume(runner):
    lid = object_views.mesh(solids.box((0.1, 0.2, 0.1), (0.0, 0.0, 0.35)))
    body = Body(links={"base": Link(mesh=BOX), "lid": Link(mesh=lid)}, pose=factories.placed(np.eye(4)))
    found = weigh(runner, body, mass_kg=2.0)
    assert found.links["base"].mass_kg == pytest.approx(1.5, rel=1e-6)
    assert found.links["lid"].mass_kg == pytest.approx(0.5, rel=1e-6)
    assert found.links["lid"].source == "weighed"
    assert found.weighed
    assert runner.outcome.line.startswith("2.00 kg (1.94 kg to 2.07 kg), weighed")
    assert not weigh(runner, body).weighed


def test_contact_comes_from_the_table_and_an_option_overrides_the_proposal(runner):
    found = weigh(runner, object_views.body(BOX), "plastic", material="rubber")
    assert (found.material, found.friction, found.restitution) == ("rubber", 0.8, 0.6)


def test_an_unknown_material_names_those_that_exist(runner):
    with pytest.raises(RuleError, match="no material is called `ceramics`") as caught:
        weigh(runner, object_views.body(BOX), "ceramics")
    assert caught.value.hint == "did you mean `ceramic`?"
    assert "wood" in caught.value.facts["exist"]
    with pytest.raises(RuleError) as caught:
        weigh(runner, object_views.body(BOX), "xyz")
    assert caught.value.hint == "set `material` of the element in `scene.yaml` to one that exists"


def test_an_open_and_an_inside_out_link_are_refused(runner):
    opened = Mesh(vertices=BOX.vertices, faces=BOX.faces[1:])
    with pytest.raises(RuleError, match="link `base` is open, it has no volume"):
        weigh(runner, object_views.body(opened))
    with pytest.raises(RuleError, match=r"link `base` has no mass: the volume is -0.006 m3"):
        weigh(runner, object_views.body(Mesh(vertices=BOX.vertices, faces=np.ascontiguousarray(BOX.faces[:, ::-1]))))


def test_a_weighed_mass_must_be_positive(runner):
    with pytest.raises(ValueError, match="greater than 0"):
        weigh(runner, object_views.body(BOX), mass_kg=-1.0)


def log_width(physics: Physics) -> float:
    """Standard deviation of the log mass."""
    link = physics.links["base"]
    return math.log(link.mass_high_kg / link.mass_low_kg) / (2.0 * Z90)


def known(body, **fields) -> Body:
    """The body with what the photograph is said to determine."""
    certain = {"unseen_fraction": 0.0, "volume_sigma": 0.0} | fields
    return body.model_copy(update={"certainty": Certainty(**certain)})


def test_a_shape_without_doubt_leaves_the_density_of_its_material(runner):
    body = known(object_views.body(BOX))
    assert log_width(weigh(runner, body, material="wood")) == pytest.approx(0.30)
    assert log_width(weigh(runner, known(body, volume_sigma=0.4), material="wood")) == pytest.approx(0.5)
    assert log_width(weigh(runner, known(body, unseen_fraction=0.5), material="wood", volume_sigma=0.4)) == (
        pytest.approx(0.5)
    )
    walls = known(object_views.body(BOX, hollow=True))
    assert log_width(weigh(runner, walls, material="wood")) == pytest.approx(math.hypot(0.25, 0.35))


def test_a_shape_that_tells_nothing_has_a_wide_interval(runner):
    told, untold = known(object_views.body(BOX), unseen_fraction=0.5), object_views.body(BOX)
    assert log_width(weigh(runner, untold)) > log_width(weigh(runner, told))
    assert log_width(weigh(runner, untold)) == log_width(
        weigh(runner, known(untold, unseen_fraction=0.5, volume_sigma=None))
    )


def test_a_near_rival_of_another_volume_widens_the_mass(runner):
    def width(ratio: float, gap: float, *, hollow: bool = False) -> float:
        rival = Rival(hypothesis="other", volume_ratio=ratio, hollow=hollow, gap=gap)
        return log_width(weigh(runner, known(object_views.body(BOX), rival=rival), material="wood"))

    # Two equally good hypotheses, one of which is twice as heavy: half a log 2 to either side.
    assert width(2.0, 0.0) == pytest.approx(math.hypot(0.30, math.log(2.0) / 2))
    assert width(1.0, 0.0) == pytest.approx(0.30)
    assert width(2.0, 0.0) > width(2.0, 0.05) > width(2.0, 1.0) == pytest.approx(0.30, rel=1e-6)
    # The rival's walls are denser than a whole product.
    assert width(1.0, 0.0, hollow=True) == pytest.approx(math.hypot(0.30, math.log(650 / 600) / 2))


def test_a_less_certain_material_widens_mass_and_friction(runner):
    body = known(object_views.body(BOX))
    seen = object_views.view(BOX, np.eye(4), material="ceramic").traits
    found = [
        runner.run("factorize.physics", body=body, traits=seen.model_copy(update={"material_confidence": sure}))
        for sure in (1.0, 0.9, None, 0.4)
    ]
    assert found[1] == found[2], "0.9 is assumed of a proposer that tells nothing"
    assert log_width(found[0]) < log_width(found[1]) < log_width(found[3])
    assert found[0].friction_sigma == 0.12 < found[1].friction_sigma < found[3].friction_sigma
    assert found[0].friction == 0.45
    assert found[1].friction < 0.45, "that of things of this size, most of which are no ceramics"


def test_a_material_is_as_certain_as_whether_the_body_is_a_vessel(runner):
    def friction(*, hollow: bool, sure: float) -> float:
        rival = Rival(hypothesis="other", volume_ratio=1.0, hollow=hollow, gap=0.05)
        seen = object_views.view(BOX, np.eye(4), material="ceramic").traits
        traits = seen.model_copy(update={"material_confidence": sure})
        body = known(object_views.body(BOX), rival=rival)
        return float(runner.run("factorize.physics", body=body, traits=traits).friction_sigma)

    assert friction(hollow=True, sure=0.9) > friction(hollow=False, sure=0.9)
    assert friction(hollow=True, sure=1.0) == 0.12, "somebody stated it"


def test_a_carton_weighs_what_cartons_of_its_size_do_and_a_block_is_wood(runner):
    """A box of crackers of 411 g; a wooden block is wood all through."""
    carton = object_views.mesh(solids.box((0.060, 0.158, 0.210), (0.0, 0.0, 0.105)))
    box = weigh(runner, object_views.body(carton), "cardboard", category="box").links["base"]
    assert box.mass_low_kg < 0.411 < box.mass_high_kg < 20 * box.mass_low_kg
    assert box.mass_kg == pytest.approx(0.411, rel=0.5)
    block = weigh(runner, object_views.body(carton), "wood").links["base"]
    assert block.mass_low_kg > 0.4
    weighed = weigh(runner, object_views.body(carton), "cardboard", mass_kg=0.4).links["base"]
    assert weighed.mass_low_kg > 0.38


def test_the_surer_it_is_that_a_box_is_a_carton_the_narrower_its_mass(runner):
    """Books, telephones and sponges are boxes, too. Of mugs, the proposed material says little."""
    carton = object_views.body(object_views.mesh(solids.box((0.20, 0.14, 0.05), (0.0, 0.0, 0.025))))
    sure, unsure = (
        weigh(runner, carton, "cardboard", category="box", material_confidence=p).links["base"] for p in (0.9, 0.5)
    )
    assert sure.mass_high_kg / sure.mass_low_kg < 0.8 * unsure.mass_high_kg / unsure.mass_low_kg
    told = [household.Told("mug", "ceramic", p) for p in (0.9, 0.5, 1.0)]
    sides, unknown = np.array([0.12, 0.09, 0.08]), (0.1, 0.4, 1.0)
    likely, less, certain = (household.mass_of(sides, one, unknown) for one in told)
    assert likely == less != certain


def test_a_thing_with_a_word_weighs_what_such_things_do(runner):
    """A can of soup of 349 g, 101 x 66 mm."""
    rings = np.stack([solids.ring(0.033, 0.033, 2.0, z, 48) for z in (0.0, 0.101)])
    body = object_views.body(object_views.mesh(solids.loft(rings)))
    unnamed, named, shape = (
        weigh(runner, body, category="cylinder", phrase=w).links["base"] for w in ("", "can", "cylinder")
    )
    assert named.mass_low_kg < 0.349 < named.mass_high_kg
    assert named.mass_kg == pytest.approx(0.349, rel=0.25)
    assert named.mass_high_kg / named.mass_low_kg < 0.5 * unnamed.mass_high_kg / unnamed.mass_low_kg
    assert shape == unnamed, "its shape class is no word for it"
    assert "can" in named.source


def ball(radius: float) -> Mesh:
    """A ball on the support."""
    angle = np.linspace(-1.5, 1.5, 13)
    heights = radius * (1.0 + np.sin(angle))
    rings = [solids.ring(r, r, 2.0, z, 24) for r, z in zip(radius * np.cos(angle), heights, strict=True)]
    return object_views.mesh(solids.loft(np.stack(rings)))


def test_the_words_of_colours_are_those_of_parsing():
    plain = {"brown", "white", "gray", "black"}
    assert {word for _, word in naming.HUES} | plain == set(household.COLOURS)


def test_the_colour_tells_things_of_one_size_apart(runner):
    """A lemon is about as large as a golf ball, but never white."""
    body = object_views.body(ball(0.03))
    named = {word: weigh(runner, body, phrase=f"{word} object") for word in ("blue", "white", "yellow")}
    likely = {word: found.links["base"].source for word, found in named.items()}
    assert "lemon" in likely["yellow"]
    assert "lemon" not in likely["white"]
    assert "golf ball" in likely["white"]
    assert len(set(likely.values())) == 3


def test_friction_is_that_of_the_things_it_may_be(runner):
    """Of boxes like this one some are plastic or electronics; who states a material gets its own friction."""
    carton = object_views.mesh(solids.box((0.060, 0.158, 0.210), (0.0, 0.0, 0.105)))
    tennis = object_views.body(ball(0.0325))
    box = weigh(runner, object_views.body(carton), "cardboard", category="box")
    round_one = weigh(runner, tennis, "plastic")
    stated = weigh(runner, tennis, material="plastic")
    assert abs(box.friction - 0.40) < 0.02, "nearly all things like it are cardboard"
    assert round_one.friction > 0.42 > stated.friction == 0.35, "balls are rubber and food"
    assert round_one.friction_sigma > stated.friction_sigma == 0.10


def test_the_interval_of_a_vessel_is_that_of_its_walls(runner):
    """Twice as thick walls weigh about twice as much; what would fill the cavity does not count."""
    thin, thick = (
        weigh(runner, object_views.body(object_views.mesh(object_views.cup(wall=wall)), hollow=True), "ceramic")
        for wall in (0.002, 0.004)
    )
    ratios = [
        getattr(thick.links["base"], end) / getattr(thin.links["base"], end) for end in ("mass_low_kg", "mass_high_kg")
    ]
    assert ratios == pytest.approx([1.93, 1.93], abs=0.1)
    outer = math.pi * 0.04**2 * 0.09
    assert thick.links["base"].mass_kg < 0.7 * 800.0 * outer, "less than a product of that outline"


def test_things_of_a_household_are_compared_in_metres(runner):
    """A carton in a world whose unit is 0.5 m weighs the same after scaling; while the unit is unknown, no thing is."""
    carton = object_views.body(object_views.mesh(solids.box((0.060, 0.158, 0.210), (0.0, 0.0, 0.105))))
    double = object_views.body(object_views.mesh(solids.box((0.120, 0.316, 0.420), (0.0, 0.0, 0.210))))
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    pose = Pose(parent="world", child="camera", matrix=np.eye(4))
    placement = Placement(pose=Pose(parent="world", child="object", matrix=np.eye(4)), scale=1.0, method="guess")
    sized = Support(camera_pose=pose, polygon=square, scale="size", factor=0.5)
    own = weigh(runner, carton, "cardboard", category="box").links["base"]
    scaled = weigh(runner, double, "cardboard", category="box", world=(placement, sized)).links["base"]
    assert scaled.mass_kg / 8 == pytest.approx(own.mass_kg, rel=1e-4)
    assert scaled.mass_low_kg / 8 == pytest.approx(own.mass_low_kg, rel=1e-4)
    unknown = sized.model_copy(update={"scale": "unknown", "factor": 1.0})
    alone = weigh(runner, double, "cardboard", category="box", world=(placement, unknown)).links["base"]
    assert alone.source.startswith("material table")


CARTON = object_views.mesh(solids.box((0.060, 0.158, 0.210), (0.0, 0.0, 0.105)))


@pytest.mark.parametrize("proposed", ["wood", "cardboard"])
def test_the_less_certain_the_volume_the_wider_the_mass(runner, proposed):
    """Of a body without depth, the fit's own interval is the wide one; by material and by things of a household."""

    def width(fit: float, unseen: float = 0.0, **options: float) -> float:
        body = known(object_views.body(CARTON), volume_sigma=fit, unseen_fraction=unseen)
        return log_width(weigh(runner, body, proposed, category="box", **options))

    widths = [width(fit) for fit in (0.0, 0.3, 0.6)]
    assert widths[1] > 1.05 * widths[0]
    assert widths[2] > 1.1 * widths[1]
    assert width(0.0, 0.5, volume_sigma=0.6) == pytest.approx(widths[2])
    assert width(0.6, 0.5, volume_sigma=0.1) == pytest.approx(widths[2], rel=0.03)


@pytest.mark.parametrize("weighed", [{}, {"mass_kg": 0.5}])
def test_what_is_told_is_the_body_as_it_ends_in_the_twin(runner, weighed):
    """A block placed at half its size in a world whose unit is 0.4 m: what is said is said of the asset, too."""
    body, square = object_views.body(BOX), np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    placement = Placement(
        pose=Pose(parent="world", child="object", matrix=np.eye(4)), scale=0.5, scale_sigma=0.2, method="guess"
    )
    camera = Pose(parent="world", child="camera", matrix=np.eye(4))
    world = Support(camera_pose=camera, polygon=square, scale="size", factor=0.4)
    found = weigh(runner, body, "wood", world=(placement, world), **weighed)
    told, line = runner.outcome.metrics, runner.outcome.line
    traits = object_views.view(BOX, np.eye(4)).traits
    collision = runner.run("factorize.collision", body=body)
    given = {"placement": placement, "traits": traits, "support": world}
    asset = runner.run("simulate.asset", body=body, physics=found, collision=collision, **given).physics.links["base"]
    assert told["mass"] == (pytest.approx(asset.mass_kg), "kg")
    assert told["volume"] == (pytest.approx(6000.0 * 0.2**3, rel=1e-5), "cm3")
    ends = [1000 * value for value in (asset.mass_kg, asset.mass_low_kg, asset.mass_high_kg)]
    assert line.startswith("{:.0f} g ({:.0f} g to {:.0f} g), ".format(*ends))
    unknown = world.model_copy(update={"scale": "unknown", "factor": 1.0})
    weigh(runner, body, "wood", world=(placement, unknown), **weighed)
    assert ("mass" in runner.outcome.metrics) == bool(weighed)
    assert "volume" not in runner.outcome.metrics
    assert runner.outcome.line.startswith("500 g" if weighed else "mass and volume not known, since the scale is not")


def told(runner, body, estimate, proposed="cardboard", category="box", **options) -> Physics:
    """The physics of a body of which a model states an estimate."""
    traits = object_views.view(body.links["base"].mesh, np.eye(4), material=proposed).traits
    traits = traits.model_copy(update={"category": category, "estimate": estimate})
    return runner.run("factorize.physics", body=body, traits=traits, options=options)


def guess(mass_kg, friction=(0.35, 0.45), restitution=(0.1, 0.3), phrase="box of crackers") -> Estimate:
    return Estimate(phrase=phrase, mass_kg=mass_kg, friction=friction, restitution=restitution)


@pytest.mark.parametrize(("hollow", "mass_kg"), [(False, (0.3, 0.5)), (True, (0.9, 1.5))])
def test_an_estimate_that_agrees_narrows_the_mass(runner, hollow, mass_kg):
    """A carton of 411 g by the things of a household, and a body of walls by its material alone."""
    body = object_views.body(CARTON, hollow=hollow)
    alone = weigh(runner, body, "cardboard", category="box").links["base"]
    both = told(runner, body, guess(mass_kg)).links["base"]
    assert both.mass_high_kg / both.mass_low_kg < 0.7 * alone.mass_high_kg / alone.mass_low_kg
    assert both.source == f"{alone.source}, and a model's estimate" or "like cracker box" in both.source
    assert both.inertia == pytest.approx([both.mass_kg / alone.mass_kg * part for part in alone.inertia])
    if not hollow:
        assert both.mass_low_kg < 0.411 < both.mass_high_kg < 4 * both.mass_low_kg


def test_an_estimate_that_cannot_be_changes_little(runner):
    body = object_views.body(CARTON)
    alone = told(runner, body, None).links["base"]
    wrong = told(runner, body, guess((40.0, 60.0), phrase="")).links["base"]
    assert wrong.mass_kg == pytest.approx(alone.mass_kg, rel=0.1)
    assert wrong.mass_high_kg / wrong.mass_low_kg > 0.8 * alone.mass_high_kg / alone.mass_low_kg


def test_an_estimate_of_contact_moves_it_and_never_widens_it(runner):
    body = object_views.body(CARTON)
    alone = told(runner, body, None)
    both = told(runner, body, guess((0.3, 0.5), friction=(0.5, 0.6), restitution=(0.2, 0.3)))
    assert alone.friction < both.friction < 0.55
    assert both.friction_sigma < alone.friction_sigma
    assert both.restitution_sigma < alone.restitution_sigma


def test_a_weighed_mass_and_a_stated_material_come_before_an_estimate(runner):
    body = object_views.body(CARTON)
    assert told(runner, body, guess((0.3, 0.5)), mass_kg=0.7).links["base"].mass_kg == pytest.approx(0.7)
    stated = told(runner, body, guess((0.3, 0.5)), material="rubber")
    assert stated == told(runner, body, None, material="rubber")


def test_an_estimate_is_compared_in_metres(runner):
    """A carton in a world whose unit is 0.5 m; the mass of a body of two links is shared as their volumes are."""
    double = object_views.body(object_views.mesh(solids.box((0.120, 0.316, 0.420), (0.0, 0.0, 0.210))))
    pose = Pose(parent="world", child="object", matrix=np.eye(4))
    placement = Placement(pose=pose, scale=0.5, method="guess")
    traits = object_views.view(CARTON, np.eye(4), material="cardboard").traits
    traits = traits.model_copy(update={"category": "box", "estimate": guess((0.3, 0.5))})
    own = told(runner, object_views.body(CARTON), guess((0.3, 0.5))).links["base"]
    scaled = runner.run("factorize.physics", body=double, traits=traits, placement=placement).links["base"]
    assert scaled.mass_kg / 8 == pytest.approx(own.mass_kg, rel=1e-4)
