"""The contract's laws, by role: plain functions of a method that raise `AssertionError` when they are broken.

Which laws apply follows from the role, and from whether the method learns. A pipeline, the stages of an expression,
keeps those of a point matcher, but for what is the business of its stages: their settings, and where each is good.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from treereg_core.evaluator import Evaluator
from treereg_core.learning import Learner
from treereg_core.method import CoarseAligner, FeatureFilter, Method, PointMatcher, RowDetector, RowMatcher
from treereg_core.pipeline import Pipeline
from treereg_core.testing.law import Law
from treereg_core.testing.laws import aligners, conduct, evaluators, filters, learners, matchers, rows, settings, wholes

SETTINGS: tuple[Law, ...] = (
    settings.settings_are_described,
    settings.settings_survive_json,
    settings.settings_are_frozen,
    settings.an_unknown_setting_is_refused,
    settings.it_pickles,
    settings.the_docstring_names_its_source,
    settings.models_are_named,
)
CONDUCT: tuple[Law, ...] = (
    conduct.repeatable_under_one_seed,
    conduct.threads_change_nothing,
    conduct.another_process_changes_nothing,
    conduct.inputs_are_untouched,
)
INVARIANCE: tuple[Law, ...] = (
    conduct.order_of_trees_is_irrelevant,
    conduct.a_far_origin_changes_nothing,
    conduct.too_few_trees_are_no_crash_and_no_number,
    conduct.trees_on_a_line_are_no_crash_and_no_nonsense,
)
FILTER: tuple[Law, ...] = (
    filters.it_keeps_a_subset,
    filters.it_leaves_trees_to_work_with,
    filters.what_it_adds_to_both_surveys_ignores_the_placement,
    filters.it_moves_nothing,
    filters.rows_keep_their_order,
    filters.a_filter_of_one_survey_ignores_the_other,
    filters.it_describes_each_tree_by_a_number,
    filters.describing_changes_nothing,
    filters.describing_ignores_the_order_of_trees,
)
ALIGNER: tuple[Law, ...] = (
    aligners.the_truth_is_among_the_proposals,
    aligners.noise_does_not_hide_the_truth,
    aligners.it_finds_a_copy_anywhere,
    aligners.it_proposes_a_few_distinct_placements,
    aligners.the_sources_frame_is_irrelevant,
    aligners.swapped_surveys_give_the_inverse,
)
DETECTOR: tuple[Law, ...] = (
    rows.a_tree_stands_in_one_row,
    rows.rows_are_the_planted_ones,
    rows.trees_of_a_row_follow_each_other,
    rows.rows_turn_with_the_orchard,
)
ROW_MATCHER: tuple[Law, ...] = (
    rows.a_row_is_matched_once,
    rows.rows_and_trees_stay,
    rows.true_rows_are_matched_right,
    rows.rows_are_found_from_two_trees_along,
    rows.copied_rows_come_back,
    rows.the_order_and_sense_of_rows_are_irrelevant,
    rows.swapped_rows_are_matched_the_same,
)
MATCHER: tuple[Law, ...] = (
    matchers.a_survey_on_itself_is_the_identity,
    matchers.a_known_transform_comes_back,
    matchers.it_is_as_good_as_a_fit_to_the_true_pairs,
    matchers.a_moved_source_moves_the_result,
    matchers.a_moved_reference_moves_the_result,
    matchers.swapped_surveys_give_the_inverse,
    matchers.what_is_returned_was_fitted,
    matchers.trees_of_no_weight_count_for_nothing,
    matchers.nothing_within_reach_is_refused,
)
WHOLE: tuple[Law, ...] = (
    wholes.an_ordinary_orchard_is_accepted_and_right,
    wholes.itself_is_the_identity,
    wholes.a_copy_is_found_anywhere,
    wholes.the_sources_frame_does_not_matter,
    wholes.swapped_surveys_are_placed_inversely,
    wholes.every_model_is_fitted_all_the_way,
    wholes.threads_change_no_word_of_the_judge,
    wholes.order_of_trees_changes_no_verdict,
    wholes.hard_scenes_are_right_or_not_accepted,
    wholes.a_wrong_start_is_found_out,
    wholes.a_lattice_is_ambiguous,
    wholes.too_few_trees_are_never_accepted,
)
EVALUATOR: tuple[Law, ...] = (evaluators.figures_are_numbers_or_none,)

LEARNER: tuple[Law, ...] = (
    learners.what_it_learned_is_json,
    learners.learning_changes_nothing_it_is_given,
    learners.learning_is_repeatable,
    learners.a_place_that_is_not_known_is_no_obstacle,
    learners.what_it_learned_is_of_use,
    learners.its_exports_are_texts,
)

BY_ROLE: Mapping[type, tuple[Law, ...]] = MappingProxyType(
    {
        FeatureFilter: (*SETTINGS, *CONDUCT, *INVARIANCE, *FILTER),
        CoarseAligner: (*SETTINGS, *CONDUCT, *INVARIANCE, *ALIGNER),
        RowDetector: (*SETTINGS, *CONDUCT, *INVARIANCE, *DETECTOR),
        RowMatcher: (*SETTINGS, *CONDUCT, *INVARIANCE, *ROW_MATCHER),
        PointMatcher: (*SETTINGS, *CONDUCT, *INVARIANCE, *MATCHER, *WHOLE),
        Evaluator: (*SETTINGS, *CONDUCT, *EVALUATOR),
        Learner: LEARNER,
    }
)
PIPELINE: tuple[Law, ...] = (*CONDUCT, *INVARIANCE, *WHOLE)


def laws_for(method: Method) -> tuple[Law, ...]:
    """The laws that apply to a method, in a good order to try them. `TypeError` for one that plays no known role."""
    if isinstance(method, Pipeline):
        return PIPELINE
    laws = tuple(law for role, of_role in BY_ROLE.items() if isinstance(method, role) for law in of_role)
    if not laws:
        raise TypeError(f"{method.name} plays none of the known roles")
    return laws
