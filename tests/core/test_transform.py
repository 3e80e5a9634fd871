"""The algebra of transforms, and the fits that give them."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from treereg_core.testing import strategies as some
from treereg_core.transform import Affine, FloatArray, Model, Rigid, Similarity, Transform

MICROMETRE = 1e-6
KINDS = (Rigid, Similarity, Affine)
models = st.sampled_from(Model)


def close(a: FloatArray, b: FloatArray) -> None:
    np.testing.assert_allclose(a, b, rtol=0, atol=MICROMETRE)


@given(some.transforms(), some.points())
def test_the_inverse_undoes_and_keeps_its_kind(t: Affine, p: FloatArray) -> None:
    assert type(t.inverse()) is type(t)
    close(t.inverse()(t(p)), p)
    close(t(t.inverse()(p)), p)


@given(some.transforms(), some.transforms(), some.points())
def test_a_composition_applies_the_right_one_first_and_is_of_the_wider_kind(
    a: Affine, b: Affine, p: FloatArray
) -> None:
    both = a @ b
    close(both(p), a(b(p)))
    assert type(both) is KINDS[max(KINDS.index(type(a)), KINDS.index(type(b)))]
    close(both.inverse()(both(p)), (b.inverse() @ a.inverse())(both(p)))


@given(some.transforms(), some.transforms(), some.transforms(), some.points())
def test_composition_is_associative_and_has_the_identity(a: Affine, b: Affine, c: Affine, p: FloatArray) -> None:
    close(((a @ b) @ c)(p), (a @ (b @ c))(p))
    close((a @ Rigid.identity())(p), a(p))
    close((Rigid.identity() @ a)(p), a(p))


@given(some.transforms())
def test_the_matrix_goes_there_and_back(t: Affine) -> None:
    assert type(t).from_matrix(t.matrix) == t
    assert Affine.from_matrix(t.matrix).matrix.tolist() == t.matrix.tolist()
    homogeneous = t.matrix @ [3.0, -4.0, 1.0]
    close(homogeneous[:2], t([[3.0, -4.0]])[0])


@given(some.transforms(), some.points(), some.shifts())
def test_about_is_the_same_motion_seen_from_another_origin(
    t: Affine, p: FloatArray, origin: tuple[float, float]
) -> None:
    o = np.array(origin)
    close(t.about(o)(p - o) + o, t(p))
    close(t.about(o).about(-o)(p), t(p))
    assert type(t.about(o)) is type(t)


@given(some.transforms())
def test_transforms_are_values(t: Affine) -> None:
    again = pickle.loads(pickle.dumps(t))
    assert again == t
    assert hash(again) == hash(t)
    assert type(again) is type(t)
    assert t != type(t)(t.linear, t.shift + 1.0)
    with pytest.raises(AttributeError, match="frozen"):
        t.shift = np.zeros(2)
    with pytest.raises(ValueError, match="read-only"):
        t.linear[0, 0] = 2.0


@given(some.rigids(), some.points(2))
def test_a_rigid_transform_keeps_lengths_and_handedness(t: Rigid, p: FloatArray) -> None:
    close(np.linalg.norm(np.diff(t(p), axis=0), axis=1), np.linalg.norm(np.diff(p, axis=0), axis=1))
    assert np.linalg.det(t.linear) == pytest.approx(1, abs=1e-12)
    assert t.scale == pytest.approx(1, abs=1e-12)


@given(st.floats(-179.9, 179.9), st.floats(0.5, 2))
def test_rotation_and_scale_read_back(angle: float, scale: float) -> None:
    t = Similarity(scale * Rigid.turn(angle).linear, (1.0, 2.0))
    assert t.rotation_deg == pytest.approx(angle, abs=1e-9)
    assert t.scale == pytest.approx(scale, rel=1e-12)


def test_a_turn_is_counter_clockwise_about_its_centre_and_then_shifts() -> None:
    quarter = Rigid.turn(90.0, about=(1.0, 1.0), shift=(10.0, 0.0))
    close(quarter([[2.0, 1.0], [1.0, 1.0]]), np.array([[11.0, 2.0], [11.0, 1.0]]))


def test_ten_thousand_compositions_stay_exactly_rigid() -> None:
    t, step = Rigid.identity(), Rigid.turn(0.0137, shift=(0.01, 0.02))
    for _ in range(10_000):
        t = t @ step
    assert isinstance(t, Rigid)
    assert t.rotation_deg == pytest.approx(137.0, abs=1e-6)


@pytest.mark.parametrize(
    ("kind", "linear", "reason"),
    [
        (Affine, [[1, 2], [2, 4]], "invertible"),
        (Affine, [[0, 0], [0, 0]], "invertible"),
        (Affine, [[np.nan, 0], [0, 1]], "finite"),
        (Similarity, [[1, 0], [0, -1]], "without reflection"),
        (Similarity, [[1, 0.001], [0.001, 1]], "scaled rotation"),
        (Rigid, [[1.001, 0], [0, 1.001]], "scale 1"),
        (Rigid, [[1, 0], [0, -1]], "without reflection"),
    ],
)
def test_a_linear_part_of_the_wrong_kind_is_refused(kind: type[Affine], linear: list[list[float]], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        kind(linear, (0, 0))


def test_shifts_and_matrices_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match="finite"):
        Rigid(np.eye(2), (np.inf, 0))
    for matrix in (np.eye(2), np.diag([1.0, 1.0, 2.0]), [[1, 0, 0], [0, 1, 0], [0.5, 0, 1]]):
        with pytest.raises(ValueError, match="3x3"):
            Affine.from_matrix(matrix)


def test_only_transforms_compose() -> None:
    with pytest.raises(TypeError):
        Rigid.identity() @ "identity"
    assert issubclass(Affine, Transform)
    assert Rigid.identity() != "identity"


@given(models, st.data(), some.spread_points())
def test_a_fit_recovers_what_was_applied(model: Model, data: st.DataObject, p: FloatArray) -> None:
    t = data.draw(some.transforms(model))
    fitted = model.fit(p, t(p))
    assert type(fitted) is model.kind
    close(fitted(p), t(p))


@given(models, some.spread_points(), some.spread_points(), some.rigids(), some.rigids())
def test_a_fit_moves_with_both_frames(model: Model, p: FloatArray, q: FloatArray, a: Rigid, b: Rigid) -> None:
    n = min(len(p), len(q))
    p, q = p[:n], q[:n]
    try:
        fitted = model.fit(p, q)
    except ValueError:
        return
    if model is not Model.AFFINE and turning(p, q) < 1e-3:
        return  # no rotation is much better than any other
    np.testing.assert_allclose(model.fit(a(p), b(q))(a(p)), b(fitted(p)), rtol=0, atol=1e-3)


def turning(p: FloatArray, q: FloatArray) -> float:
    """How well two clouds fix the rotation between them, 0 to 1."""
    p, q = p - p.mean(axis=0), q - q.mean(axis=0)
    dot, cross = np.sum(p * q), np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])
    return float(math.hypot(dot, cross) / max(np.linalg.norm(p) * np.linalg.norm(q), 1e-12))


@given(models, some.spread_points(), st.integers(0, 2**32 - 1))
def test_no_nearby_transform_fits_better(model: Model, p: FloatArray, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = Rigid.turn(20.0)(p) + rng.normal(0, 0.5, p.shape)
    w = rng.uniform(0.1, 2, len(p))
    fitted = model.fit(p, q, w)

    def misfit(t: Affine) -> float:
        return float(w @ ((t(p) - q) ** 2).sum(axis=1))

    centre = np.average(fitted(p), axis=0, weights=w)
    steps: list[Affine] = [Rigid.turn(0.01, about=centre), Rigid(np.eye(2), (0.01, 0)), Rigid(np.eye(2), (0, 0.01))]
    if model is not Model.RIGID:
        steps.append(Similarity(1.0001 * np.eye(2), (0, 0)).about(-centre))
    if model is Model.AFFINE:
        steps.append(Affine([[1.0001, 0], [0, 1]], (0, 0)).about(-centre))
    for step in steps:
        assert misfit(fitted) <= misfit(step @ fitted) + 1e-9
        assert misfit(fitted) <= misfit(step.inverse() @ fitted) + 1e-9


@given(models, some.spread_points(4))
def test_weights_count_trees_and_a_weight_of_zero_counts_none(model: Model, p: FloatArray) -> None:
    q = Rigid.turn(-8.0, shift=(3.0, 4.0))(p)
    q[-1] += (30.0, -20.0)
    without = model.fit(p[:-1], q[:-1])
    close(model.fit(p, q, np.append(np.ones(len(p) - 1), 0.0))(p), without(p))
    twice = model.fit(np.vstack([p, p[:2]]), np.vstack([q, q[:2]]))
    weighted = model.fit(p, q, np.append([2.0, 2.0], np.ones(len(p) - 2)))
    close(weighted(p), twice(p))


def test_a_fit_of_mirrored_points_is_no_reflection() -> None:
    p = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 1.0]])
    mirrored = p * [1, -1]
    assert np.linalg.det(Model.RIGID.fit(p, mirrored).linear) > 0
    assert np.linalg.det(Model.SIMILARITY.fit(p, mirrored).linear) > 0
    assert np.linalg.det(Model.AFFINE.fit(p, mirrored).linear) < 0


@pytest.mark.parametrize("model", Model)
def test_full_utm_coordinates_cost_no_precision(model: Model) -> None:
    rng = np.random.default_rng(0)
    p = rng.uniform((5e5, 6.25e6), (5.003e5, 6.2503e6), (200, 2))
    t = Rigid.turn(0.7, about=p.mean(axis=0), shift=(3.0, -2.0))
    np.testing.assert_allclose(model.fit(p, t(p))(p), t(p), rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    ("model", "p", "reason"),
    [
        (Model.RIGID, [[1, 1], [1, 1]], "determine"),
        (Model.RIGID, [[1, 1]], "determine"),
        (Model.SIMILARITY, [[1, 1]] * 5, "determine"),
        (Model.AFFINE, [[0, 0], [1, 1], [2, 2], [5, 5]], "determine"),
        (Model.AFFINE, [[0, 0], [1, 1]], "determine"),
    ],
)
def test_points_that_fix_nothing_are_refused(model: Model, p: list[list[float]], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        model.fit(p, p)


def test_fits_without_weight_or_rotation_are_refused() -> None:
    p = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    with pytest.raises(ValueError, match="positive weight"):
        Model.RIGID.fit(p, p, np.zeros(3))
    with pytest.raises(ValueError, match="positive weight"):
        Model.RIGID.fit(np.empty((0, 2)), np.empty((0, 2)))
    with pytest.raises(ValueError, match="rotation"):
        Model.RIGID.fit(p, np.ones((3, 2)))


@pytest.mark.parametrize(("model", "count"), [(Model.RIGID, 3), (Model.SIMILARITY, 4), (Model.AFFINE, 6)])
def test_parameters(model: Model, count: int) -> None:
    assert model.parameters == count
