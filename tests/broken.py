"""Methods that break the contract, one for each law: what shows that the laws can fail."""

from __future__ import annotations

from dataclasses import replace
from itertools import count
from typing import Any, ClassVar

import numpy as np
from pydantic import ConfigDict, Field, field_serializer
from treereg_outside import LargeCrowns, Mutual, StraightRows

from treereg_core.errors import NoRegistration
from treereg_core.evaluator import Problem
from treereg_core.evaluators import Truth
from treereg_core.features import FeatureSet
from treereg_core.judgement import Judgement
from treereg_core.learning import Learner, Outcome, State
from treereg_core.method import CoarseAligner, Context, Described, Method, PointMatcher, Registration
from treereg_core.pair import Pair, Rows
from treereg_core.registry import installed
from treereg_core.rows import NearestRows
from treereg_core.transform import Affine, FloatArray, Model, Rigid

CALLS = count()


class Undescribed(LargeCrowns):
    extra: int = 3


class Boundless(LargeCrowns):
    extra: int = Field(3, description="a number of any size")


class Forgetful(LargeCrowns):
    @field_serializer("share")
    def rounded(self, share: float) -> float:
        return round(share, 1)


class Thawed(LargeCrowns):
    model_config = ConfigDict(frozen=False)


class Tolerant(LargeCrowns):
    model_config = ConfigDict(extra="ignore")


class Glued(LargeCrowns):
    def __reduce__(self) -> Any:
        raise TypeError("cannot pickle this")


class Anonymous(LargeCrowns):
    pass


class Sourceless(LargeCrowns):
    """Keeps the largest crowns, as everybody knows."""


class Useless(LargeCrowns):
    models = frozenset()


class Unseeded(LargeCrowns):
    def select(self, pair: Pair, context: Context) -> Pair:
        return pair.narrow(pair.reference.take(np.random.default_rng().permutation(len(pair.reference))), pair.source)


class Remembering(LargeCrowns):
    def select(self, pair: Pair, context: Context) -> Pair:
        return pair.narrow(pair.reference.take(np.arange(next(CALLS) % 10 + 3)), pair.source)


class ThreadBound(Mutual):
    def register(self, pair: Pair, context: Context) -> Registration:
        found = super().register(pair, context)
        return replace(found, transform=Rigid.turn(1e-9 * context.threads) @ found.transform)


class LostOnTheWay(LargeCrowns):
    def __reduce__(self) -> Any:
        return LargeCrowns, (), None


class Vandal(LargeCrowns):
    def select(self, pair: Pair, context: Context) -> Pair:
        pair.source.weight.setflags(write=True)
        pair.source.weight[0] = 2.0
        return pair


class FirstHalf(LargeCrowns):
    def select(self, pair: Pair, context: Context) -> Pair:
        return pair.narrow(*(f.take(np.arange(len(f) // 2)) for f in (pair.reference, pair.source)))


class EastOfOrigin(LargeCrowns):
    def select(self, pair: Pair, context: Context) -> Pair:
        return pair.narrow(*(f.take(f.xy[:, 0] > 0) for f in (pair.reference, pair.source)))


class NeverRefusing(Mutual):
    def register(self, pair: Pair, context: Context) -> Registration:
        try:
            return super().register(pair, context)
        except NoRegistration:
            linear = context.model.kind.identity()
            return Registration(linear, np.empty((0, 2), dtype=np.int64), np.empty(0))


class CrashingOnNothing(LargeCrowns):
    def select(self, pair: Pair, context: Context) -> Pair:
        return pair.narrow(*(f.take(f.area >= np.quantile(f.area, 0.3)) for f in (pair.reference, pair.source)))


class Moving(LargeCrowns):
    def select(self, pair: Pair, context: Context) -> Pair:
        return pair.narrow(pair.reference.replace(xy=pair.reference.xy + 0.001), pair.source)


class Inventing(LargeCrowns):
    def select(self, pair: Pair, context: Context) -> Pair:
        return pair.narrow(pair.reference.replace(ids=pair.reference.ids + 1), pair.source)


class Emptying(LargeCrowns):
    def select(self, pair: Pair, context: Context) -> Pair:
        return pair.narrow(pair.reference.take([0, 1]), pair.source)


class Placing(LargeCrowns):
    def select(self, pair: Pair, context: Context) -> Pair:
        return pair.at(Rigid.turn(1e-6) @ pair.reference_from_source)


class Biased(LargeCrowns):
    def select(self, pair: Pair, context: Context) -> Pair:
        distance, index = pair.reference.tree.query(pair.source_in_reference)
        back = np.zeros(len(pair.reference))
        back[index] = distance
        return pair.narrow(
            pair.reference.replace(attributes={"near": back}), pair.source.replace(attributes={"near": distance})
        )


class RowLosing(LargeCrowns):
    def select(self, pair: Pair, context: Context) -> Pair:
        return replace(pair, reference=pair.reference.take(np.arange(100)))


class Peeping(LargeCrowns):
    def select(self, pair: Pair, context: Context) -> Pair:
        least = np.quantile(pair.source.area, 0.3)
        return pair.narrow(*(f.take(f.area >= least) for f in (pair.reference, pair.source)))


class Describing(LargeCrowns):
    """A filter that says of each tree what `number` makes of its survey."""

    def describe(self, pair: Pair, context: Context) -> Described:
        one, two = self.number(pair.reference, context), self.number(pair.source, context)
        return {"number": one}, {"number": two}

    def number(self, features: FeatureSet, context: Context) -> FloatArray:
        raise NotImplementedError


class OfSome(Describing):
    def number(self, features: FeatureSet, context: Context) -> FloatArray:
        return features.area[:100]


class OfThreads(Describing):
    def number(self, features: FeatureSet, context: Context) -> FloatArray:
        return features.area * context.threads


class Marking(Describing):
    def number(self, features: FeatureSet, context: Context) -> FloatArray:
        features.weight.setflags(write=True)
        features.weight[:1] = 2.0
        return features.area


class Numbering(Describing):
    def number(self, features: FeatureSet, context: Context) -> FloatArray:
        return np.arange(float(len(features)))


class Lazy(CoarseAligner):
    """Proposes the files' own georeference."""

    name = "lazy"

    def propose(self, pair: Pair, context: Context) -> tuple[Pair, ...]:
        return (pair.at(Rigid.identity()),)


Good: type[CoarseAligner] = next(
    installed().method(name)
    for name in installed().names(CoarseAligner)  # type: ignore[misc]
)


class Drifting(Good):  # type: ignore[valid-type, misc]
    def propose(self, pair: Pair, context: Context) -> tuple[Pair, ...]:
        drift = Rigid(np.eye(2), (pair.reference.spacing, 0.0))
        return tuple(p.at(drift @ p.reference_from_source) for p in super().propose(pair, context))


class Stuttering(Good):  # type: ignore[valid-type, misc]
    def propose(self, pair: Pair, context: Context) -> tuple[Pair, ...]:
        return super().propose(pair, context)[:1] * 2


class Chunks(StraightRows):
    def detect(self, features: FeatureSet, context: Context) -> Rows:
        order = features.ids[np.argsort(features.xy[:, 0])]
        return Rows(tuple(order[k : k + 10] for k in range(0, len(order) - 1, 10)))


class Overlapping(StraightRows):
    def detect(self, features: FeatureSet, context: Context) -> Rows:
        rows = super().detect(features, context).trees
        return Rows((*rows, rows[0]))


class Zigzag(StraightRows):
    def detect(self, features: FeatureSet, context: Context) -> Rows:
        return Rows(tuple(np.concatenate([row[::2], row[1::2]]) for row in super().detect(features, context).trees))


class Matched(NearestRows):
    """Changes what the good row matcher gives."""

    def match(self, pair: Pair, context: Context) -> tuple[Pair, ...]:
        return tuple(self.change(matched, pair) for matched in super().match(pair, context))

    def change(self, matched: Pair, pair: Pair) -> Pair:
        raise NotImplementedError

    @staticmethod
    def with_matches(matched: Pair, matches: Any) -> Pair:
        assert matched.rows is not None
        return replace(matched, rows=replace(matched.rows, matches=matches))


class TwiceMatched(Matched):
    def change(self, matched: Pair, pair: Pair) -> Pair:
        assert matched.rows is not None
        return self.with_matches(matched, np.vstack([matched.rows.matches, matched.rows.matches[:1]]))


class TreeLosing(Matched):
    def change(self, matched: Pair, pair: Pair) -> Pair:
        return matched.narrow(matched.reference.take(np.arange(300)), matched.source)


class NextRow(Matched):
    def change(self, matched: Pair, pair: Pair) -> Pair:
        assert matched.rows is not None
        reference, source = matched.rows.matches.T
        return self.with_matches(matched, np.column_stack([reference[1:], source[:-1]]))


class NotPlacing(Matched):
    def change(self, matched: Pair, pair: Pair) -> Pair:
        return matched.at(pair.reference_from_source)


class ByNumber(Matched):
    def change(self, matched: Pair, pair: Pair) -> Pair:
        assert matched.rows is not None
        rows = np.arange(min(len(matched.rows.reference), len(matched.rows.source)))
        return self.with_matches(matched, np.column_stack([rows, rows]))


class Placed(Mutual):
    """Changes the transform that the good matcher gives."""

    def register(self, pair: Pair, context: Context) -> Registration:
        found = super().register(pair, context)
        return replace(found, transform=self.change(found.transform, pair))

    def change(self, transform: Affine, pair: Pair) -> Affine:
        raise NotImplementedError


class Slipping(Placed):
    slip_m: ClassVar[float] = 0.005

    def change(self, transform: Affine, pair: Pair) -> Affine:
        return Rigid(np.eye(2), (self.slip_m, 0.0)) @ transform


class SlippingFar(Slipping):
    slip_m = 0.06


class Staying(Placed):
    def change(self, transform: Affine, pair: Pair) -> Affine:
        return pair.reference_from_source


class Rounding(Placed):
    def change(self, transform: Affine, pair: Pair) -> Affine:
        return type(transform)(transform.linear, np.round(transform.shift, 1))


class Sampling(Mutual):
    def register(self, pair: Pair, context: Context) -> Registration:
        return super().register(pair.narrow(pair.reference, pair.source.take(pair.source.ids % 12 == 0)), context)


class FirstTrees(Mutual):
    def register(self, pair: Pair, context: Context) -> Registration:
        return super().register(pair.narrow(pair.reference, pair.source.take(np.arange(400))), context)


class AlwaysRigid(Mutual):
    def register(self, pair: Pair, context: Context) -> Registration:
        return super().register(pair, replace(context, model=Model.RIGID))


class Misreporting(Mutual):
    def register(self, pair: Pair, context: Context) -> Registration:
        found = super().register(pair, context)
        return Registration(found.transform, found.pairs[::2], found.weights[::2])


class Weightless(Mutual):
    def register(self, pair: Pair, context: Context) -> Registration:
        return super().register(
            pair.narrow(pair.reference, pair.source.replace(weight=np.ones(len(pair.source)))), context
        )


class Refusing(PointMatcher):
    """Never finds anything."""

    name = "refusing"

    def register(self, pair: Pair, context: Context) -> Registration:
        raise NoRegistration("nothing is good enough")


class Infinite(Truth):
    def score(self, judgement: Judgement, problem: Problem) -> Any:
        return {"error_m": float("inf")}


class Fickle(Truth):
    def score(self, judgement: Judgement, problem: Problem) -> Any:
        return {"error_m": 0.0} if judgement.transform else {}


class Studious(LargeCrowns, Learner):
    def learn(self, outcome: Outcome, state: State) -> State:
        return {"lessons": state.get("lessons", 0) + 1}


class OutOfRange(Studious):
    def learn(self, outcome: Outcome, state: State) -> State:
        return {"share": float("nan")}


class LearningTuples(Studious):
    def learn(self, outcome: Outcome, state: State) -> State:
        return {"counts": (1, 2)}


class Overwriting(Studious):
    def learn(self, outcome: Outcome, state: Any) -> State:
        state["lessons"] = state.get("lessons", 0) + 1
        return dict(state)


class Recounting(Studious):
    def learn(self, outcome: Outcome, state: State) -> State:
        return {"lessons": next(CALLS)}


class Homesick(Studious):
    def learn(self, outcome: Outcome, state: State) -> State:
        return {"trees": outcome.home_from_reference(outcome.pair.reference.xy).tolist()}  # type: ignore[misc]


class Overtaught(Studious):
    def select(self, pair: Pair, context: Context) -> Pair:
        if context.memory.get(self.name):
            raise NoRegistration("it knows better")
        return super().select(pair, context)


class Straying(Studious):
    def export(self, state: State) -> dict[str, str]:
        return {"../network.xml": "<network/>"}


HONEST_JUDGE: tuple[tuple[str, str, Method, str], ...] = (
    ("settings", "settings_are_described", Undescribed(), "extra has no description"),
    ("settings", "settings_are_described", Boundless(), "extra is a number without a range"),
    ("settings", "settings_survive_json", Forgetful(), "became"),
    ("settings", "settings_are_frozen", Thawed(), "share could be set"),
    ("settings", "an_unknown_setting_is_refused", Tolerant(), "taken without a word"),
    ("settings", "it_pickles", Glued(), "cannot pickle this"),
    ("settings", "the_docstring_names_its_source", Anonymous(), "no docstring of its own"),
    ("settings", "the_docstring_names_its_source", Sourceless(), "neither a DOI"),
    ("settings", "models_are_named", Useless(), "no model"),
    ("conduct", "repeatable_under_one_seed", Unseeded(), "differ"),
    ("conduct", "repeatable_under_one_seed", Remembering(), "differ"),
    ("conduct", "threads_change_nothing", ThreadBound(), "1 and 2 threads"),
    ("conduct", "another_process_changes_nothing", LostOnTheWay(share=0.3), "another result"),
    ("conduct", "inputs_are_untouched", Vandal(), "the pair was changed"),
    ("conduct", "order_of_trees_is_irrelevant", FirstHalf(), "trees are kept in one and not in the other"),
    ("conduct", "a_far_origin_changes_nothing", EastOfOrigin(), "trees are kept in one and not in the other"),
    ("conduct", "too_few_trees_are_no_crash_and_no_number", NeverRefusing(), "a placement was given"),
    ("conduct", "too_few_trees_are_no_crash_and_no_number", CrashingOnNothing(), "IndexError"),
    ("conduct", "trees_on_a_line_are_no_crash_and_no_nonsense", NeverRefusing(), "fitted to trees on a line"),
    ("filters", "it_keeps_a_subset", Moving(), "a tree was changed"),
    ("filters", "it_keeps_a_subset", Inventing(), "a tree was invented"),
    ("filters", "it_leaves_trees_to_work_with", Emptying(), "only 2 trees"),
    ("filters", "what_it_adds_to_both_surveys_ignores_the_placement", Biased(), "near depends on the placement"),
    ("filters", "it_moves_nothing", Placing(), "placement was changed"),
    ("filters", "rows_keep_their_order", RowLosing(), "other rows"),
    ("filters", "a_filter_of_one_survey_ignores_the_other", Peeping(), "keeps other trees"),
    ("filters", "it_describes_each_tree_by_a_number", OfSome(), "number has shape (100,)"),
    ("filters", "describing_changes_nothing", OfThreads(), "it says something else"),
    ("filters", "describing_changes_nothing", Marking(), "the pair was changed"),
    ("filters", "describing_ignores_the_order_of_trees", Numbering(), "number is another one"),
    ("aligners", "the_truth_is_among_the_proposals", Lazy(), "m off"),
    ("aligners", "noise_does_not_hide_the_truth", Lazy(), "m off"),
    ("aligners", "it_finds_a_copy_anywhere", Lazy(), "turned by 13 degrees"),
    ("aligners", "it_proposes_a_few_distinct_placements", Stuttering(), "two proposals are 0 m apart"),
    ("aligners", "the_sources_frame_is_irrelevant", Lazy(), "m off"),
    ("aligners", "swapped_surveys_give_the_inverse", Drifting(), "m off"),
    ("rows", "a_tree_stands_in_one_row", Overlapping(), "a tree stands twice"),
    ("rows", "rows_are_the_planted_ones", Chunks(), "of consecutive trees"),
    ("rows", "trees_of_a_row_follow_each_other", Zigzag(), "times their length"),
    ("rows", "rows_turn_with_the_orchard", Chunks(), "turned by 30 degrees"),
    ("rows", "a_row_is_matched_once", TwiceMatched(), "matched twice"),
    ("rows", "rows_and_trees_stay", TreeLosing(), "were changed"),
    ("rows", "true_rows_are_matched_right", NextRow(), "matches are wrong"),
    ("rows", "rows_are_found_from_two_trees_along", NotPlacing(), "beside their own"),
    ("rows", "copied_rows_come_back", NotPlacing(), "m off"),
    ("rows", "the_order_and_sense_of_rows_are_irrelevant", ByNumber(), "other rows"),
    ("rows", "swapped_rows_are_matched_the_same", NextRow(), "other rows"),
    ("matchers", "a_survey_on_itself_is_the_identity", Slipping(), "0.005 m off"),
    ("matchers", "a_known_transform_comes_back", Staying(), "a known rigid transform"),
    ("matchers", "it_is_as_good_as_a_fit_to_the_true_pairs", Sampling(), "true pairs"),
    ("matchers", "a_moved_source_moves_the_result", Rounding(), "m off"),
    ("matchers", "a_moved_reference_moves_the_result", Rounding(), "m off"),
    ("matchers", "swapped_surveys_give_the_inverse", SlippingFar(), "swapped"),
    ("matchers", "what_is_returned_was_fitted", Misreporting(), "the fit of its own pairs"),
    ("matchers", "trees_of_no_weight_count_for_nothing", Weightless(), "m off"),
    ("matchers", "nothing_within_reach_is_refused", NeverRefusing(), "it gave"),
    ("wholes", "an_ordinary_orchard_is_accepted_and_right", Refusing(), "it is failed"),
    ("wholes", "itself_is_the_identity", Slipping(), "the identity"),
    ("wholes", "a_copy_is_found_anywhere", Slipping(), "a copy turned by"),
    ("wholes", "the_sources_frame_does_not_matter", Rounding(), "from a moved source"),
    ("wholes", "swapped_surveys_are_placed_inversely", SlippingFar(), "swapped"),
    ("wholes", "every_model_is_fitted_all_the_way", AlwaysRigid(), "similarity was asked for and Rigid"),
    ("wholes", "threads_change_no_word_of_the_judge", ThreadBound(), "1 and 2 threads"),
    ("wholes", "order_of_trees_changes_no_verdict", FirstTrees(), "in another order"),
    ("evaluators", "figures_are_numbers_or_none", Infinite(), "error_m is inf"),
    ("evaluators", "figures_are_numbers_or_none", Fickle(), "names of the figures"),
    ("learners", "what_it_learned_is_json", OutOfRange(), "Out of range float values"),
    ("learners", "what_it_learned_is_json", LearningTuples(), "another one after JSON"),
    ("learners", "learning_changes_nothing_it_is_given", Overwriting(), "the state so far was changed"),
    ("learners", "learning_is_repeatable", Recounting(), "another state"),
    ("learners", "a_place_that_is_not_known_is_no_obstacle", Homesick(), "NoneType"),
    ("learners", "what_it_learned_is_of_use", Overtaught(), "with what it learned it refuses"),
    ("learners", "its_exports_are_texts", Straying(), "not the name of a file"),
)
"""Module, law, a method that breaks it, and part of what the law says."""

CREDULOUS_JUDGE: tuple[tuple[str, str, Method, str], ...] = (
    ("wholes", "hard_scenes_are_right_or_not_accepted", Mutual(), "different orchards"),
    ("wholes", "a_wrong_start_is_found_out", Mutual(), "started a tree over: accepted"),
    ("wholes", "a_lattice_is_ambiguous", Mutual(), "is accepted"),
    ("wholes", "too_few_trees_are_never_accepted", NeverRefusing(), "accepted, where failed is right"),
)
"""Laws that only a judge who accepts everything breaks."""
