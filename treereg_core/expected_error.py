"""The true error to expect of a fit, from its own residuals; the residual itself is never an accuracy."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import gammaincinv

from treereg_core.features import FeatureSet
from treereg_core.judgement import ExpectedError
from treereg_core.method import Registration
from treereg_core.transform import FloatArray, Model

# Residuals above this share of the tree spacing bring wrong pairs, and the variance grows at this rate.
SURELY_PAIRED = 0.15
MISPAIRED = 3.3


def fit_covariance(
    registration: Registration, reference: FeatureSet, source: FeatureSet, model: Model
) -> tuple[FloatArray, FloatArray]:
    """Covariance of the fitted parameters, (p, p), and the mean square they move a source tree by, (p, p).

    The expected square error over the trees is the trace of their product. The covariance is the sandwich of White
    1980, doi:10.2307/1912934, with the pairs of one source tree taken together, so that outliers and uneven noise count
    as they are. A weight below the largest is read as the probability that the pair is one, which tells less than a
    certain pair where it gives way to the residual (Louis 1982, doi:10.1111/j.2517-6161.1982.tb01203.x). Where the
    residuals are no longer small against the tree spacing, wrong pairs add to the error; by how much is calibrated on
    simulated orchards. Parameters are taken about the pairs' centroid.

    Raises `ValueError` when the pairs do not determine the model.
    """
    at_reference = reference.positions(registration.pairs[:, 0])
    at_source = source.positions(registration.pairs[:, 1])
    moved = registration.transform(source.xy)
    weight = registration.weights
    if len(weight) == 0 or not weight.sum() > 0:
        raise ValueError("a fit without pairs has no covariance")
    centre = weight @ moved[at_source] / weight.sum()
    residual = reference.xy[at_reference] - moved[at_source]
    square = (residual**2).sum(axis=1)
    variance = max(float(weight @ square / (2 * weight.sum())), 1e-12)
    known = weight * (1 - (1 - weight / weight.max()) * square / (2 * variance))
    effective = float(weight.sum() ** 2 / (weight**2).sum())
    if effective <= model.parameters / 2 or known.sum() <= 0:
        raise ValueError("the pairs do not determine the transform")
    jacobian = _jacobian(moved[at_source] - centre, model)
    hessian = np.einsum("k,kap,kaq->pq", known, jacobian, jacobian)
    pull = np.einsum("k,kap,ka->kp", weight, jacobian, residual)
    tree = np.column_stack([np.bincount(at_source, column, len(source)) for column in pull.T])
    try:
        inverse = np.linalg.inv(hessian)
    except np.linalg.LinAlgError:
        raise ValueError("the pairs do not determine the transform") from None
    wrong_pairs = 1 + MISPAIRED * max(0.0, math.sqrt(variance) / reference.spacing - SURELY_PAIRED)
    inflation = wrong_pairs * effective / (effective - model.parameters / 2)
    over_trees = _jacobian(moved - centre, model)
    return (
        inflation * inverse @ (tree.T @ tree) @ inverse,
        np.einsum("kap,kaq->pq", over_trees, over_trees) / len(moved),
    )


def expected_error(covariance: FloatArray, spread: FloatArray, bias: float = 0.0) -> ExpectedError:
    """Expected RMS error over the trees and its central 95 % interval.

    A quadratic form in normal variables, by the gamma distribution of the same mean and variance (Satterthwaite 1946,
    doi:10.2307/3002019). `bias` is a known displacement in metres (RMS) that comes on top.
    """
    product = covariance @ spread
    mean, square = float(np.trace(product)), float(np.trace(product @ product))
    if not mean > 0:  # exact copies
        return ExpectedError(bias, (bias, bias))
    shape = mean**2 / (2 * square)
    low, high = (float(np.sqrt(gammaincinv(shape, q) * mean / shape + bias**2)) for q in (0.025, 0.975))
    return ExpectedError(float(np.sqrt(mean + bias**2)), (low, high))


def _jacobian(points: FloatArray, model: Model) -> FloatArray:
    """How points (n, 2) move with each parameter of the model, (n, 2, p)."""
    x, y = points.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    columns = [[one, zero], [zero, one]]
    if model is Model.AFFINE:
        columns += [[x, zero], [y, zero], [zero, x], [zero, y]]
    else:
        columns += [[-y, x]]
    if model is Model.SIMILARITY:
        columns += [[x, y]]
    return np.array(columns).transpose(2, 1, 0)
