"""Terms that a project adds: worlds in one call, and declarations and values that are refused."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.errors import ArtifactError, RuleError
from dextera_build.policy import contract as contracts
from dextera_build.policy import layout
from dextera_build.policy.added import AddedTerm, AddedTerms
from dextera_build.policy.observation import Measurement, deployable, in_worlds
from dextera_build.policy.seen import Embodied, Seen
from tests import episodes

BUNDLE = episodes.bundle()
AHEAD = TermSpec(term="ahead", about="where an object is from the palm", rows="objects", parts=("x", "y"), unit="m")
RISE = TermSpec(term="rise", about="height of the task's object", parts=("height",), unit="m")


def ahead(worlds: Seen) -> np.ndarray:
    return worlds.objects[..., :2] - worlds.palms[:, :1, :2]


def added(*terms: AddedTerm) -> AddedTerms:
    """Terms of the hand-made task, whose palm is at the first two joint positions."""
    here = layout.of_bundle(BUNDLE, terms=[term.spec for term in terms])
    palms = lambda joints: np.pad(joints[:, None, :2], ((0, 0), (0, 0), (0, 5)))  # noqa: E731
    return AddedTerms(terms, here, Embodied(0, palms, BUNDLE.base_pose.matrix))


def measured(step: int) -> Measurement:
    one = episodes.episode()
    return Measurement(one.joints[step], one.objects[step], one.displacement[step])


def test_several_worlds_are_observed_as_each_of_them_alone():
    terms = added(AddedTerm(AHEAD, ahead), AddedTerm(RISE, lambda worlds: worlds.target[:, 2:3]))
    seen, sent, goal = [measured(step) for step in (2, 9, 17)], np.zeros(3), np.ones(1)
    together = in_worlds(seen, [sent] * 3, [goal] * 3, terms)
    assert {name: together[name].shape for name in ("ahead", "rise")} == {"ahead": (3, 2, 2), "rise": (3, 1)}
    for number, one in enumerate(seen):
        alone = deployable(one, sent, goal, terms)
        assert {name: each[number].tobytes() for name, each in together.items()} == {
            name: each.tobytes() for name, each in alone.values.items()
        }
    assert together["rise"][2, 0] > together["rise"][0, 0] + 0.01


def test_spaces_channels_and_components_follow_from_the_declaration():
    here = layout.of_bundle(BUNDLE, terms=[AHEAD, RISE])
    found = {term.key: term for term in here.terms()}
    assert found["deployable/ahead"].shape == (2, 2)
    assert found["deployable/ahead"].components == ("box.x", "box.y", "case.x", "case.y")
    assert (found["deployable/rise"].shape, found["deployable/rise"].components) == ((1,), ("height",))
    assert contracts.channel(here, "ahead", ("case",)).shape == (1, 2)
    assert contracts.channel(here, "rise").names == ("height",)


@pytest.mark.parametrize("terms", [[RISE, RISE], [RISE.model_copy(update={"term": "goal"})]])
def test_two_terms_of_one_name_are_refused(terms):
    with pytest.raises(RuleError, match="two terms are called") as caught:
        layout.of_bundle(BUNDLE, terms=terms)
    assert caught.value.code == "DXB-B391"


def test_a_value_of_another_shape_is_refused():
    terms = added(AddedTerm(RISE, lambda worlds: worlds.target[:, 2]))
    with pytest.raises(RuleError, match="`measure` of the term `rise` returns another shape") as caught:
        deployable(measured(0), np.zeros(3), np.ones(1), terms)
    assert caught.value.facts == {"returned": "(1,)", "declared": "(N, 1)"}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"term": "palm-to-object"}, "cannot be the name of a term"),
        ({"rows": "hands"}, "`rows` is one of joints, objects"),
        ({"parts": ()}, "names its numbers in `parts`"),
    ],
)
def test_a_declaration_that_means_nothing_is_refused(changes, said):
    with pytest.raises(ArtifactError, match=said):
        TermSpec(**(dict(RISE) | changes))


def test_an_unknown_input_may_be_an_added_term_but_no_misspelled_one():
    contracts.check_inputs(("joints", "palm_to_object"))
    with pytest.raises(ValueError, match="`objcts` is no channel"):
        contracts.check_inputs(("joints", "objcts"))
    with pytest.raises(RuleError, match="there is no channel `palm_to_object` to learn from"):
        contracts.channel(layout.of_bundle(BUNDLE), "palm_to_object")
