#!/usr/bin/env python3
"""Writes lasso.json: windows of samples and an independent solver's estimates.

The solver is scikit-learn's coordinate-descent Lasso on all 2^n unknowns; V of Theorem 1 and the Haar matrix are built
here from their definitions, not with Bolo's code. Needs python3-numpy and python3-sklearn.

usage: generate.py > lasso.json
"""

import json
import math
import sys
import warnings

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import Lasso


def haar(size):
    """Orthonormal Haar matrix, rows are basis functions (recursive Kronecker definition)."""
    if size == 1:
        return np.ones((1, 1))
    coarse = np.kron(haar(size // 2), [1.0, 1.0])
    fine = np.kron(np.eye(size // 2), [1.0, -1.0])
    return np.vstack([coarse, fine]) / math.sqrt(2.0)


def response(t, bins, tau):
    """V of Theorem 1: row j is y(t[j+1]) - y(t[0]) exp(-(t[j+1] - t[0]) / tau) for a unit input in each bin."""
    edges = np.linspace(t[0], t[-1], bins + 1)
    v = np.zeros((len(t) - 1, bins))
    for j, end in enumerate(t[1:]):
        for k in range(bins):
            a, b = edges[k], min(edges[k + 1], end)
            if b > a + 1e-12:
                v[j, k] = math.exp(-(end - b) / tau) - math.exp(-(end - a) / tau)
    return v


def last_bin(y, received, period, tau, levels, lam):
    """The published value without look-ahead, K. Requires that the first slot was received."""
    slots = len(y)
    bins = 2**levels
    t = np.arange(slots) * period
    v = response(t, bins, tau)
    mean = y[received].mean()
    z = y - mean
    data = z[1:] - z[0] * np.exp(-(t[1:] - t[0]) / tau)
    rows = received[1:]
    a = (v @ haar(bins).T)[rows]
    n = a.shape[0]
    # scikit-learn minimises 1 / (2 n) ||.||^2 + alpha ||.||_1
    lasso = Lasso(alpha=lam / n, fit_intercept=False, tol=1e-13, max_iter=5_000_000)
    lasso.fit(a, data[rows])
    residual = data[rows] - a @ lasso.coef_
    violation = max(0.0, np.abs(a.T @ residual).max() - lam)
    assert violation < 1e-6 * max(lam, 1e-3), violation
    return mean + (haar(bins).T @ lasso.coef_)[-1]


def windows(rng, slots, ratio):
    """Samples of a pixel, K, rounded to 10 mK: scenes, noise and defects after thermal inertia."""
    before = 40
    n = slots + before
    decay = math.exp(-ratio)

    def blurred(x, noise):
        y = np.empty(n)
        state = x[0]
        for i in range(n):
            state = decay * state + (1 - decay) * x[i]
            y[i] = state
        return y[before:] + rng.normal(0, noise, slots)

    street = 295 + np.cumsum(np.where(rng.random(n) < 0.4, rng.normal(0, 2.0, n), 0.0))
    step = np.full(n, 300.0)
    step[before + rng.integers(2, slots) :] += rng.uniform(-30, 30)
    pulse = np.full(n, 300.0)
    pulse[before + rng.integers(0, slots)] += 300.0
    yield "street", blurred(street, 0.03)
    yield "step", blurred(step, 0.03)
    yield "pulse", blurred(pulse, 0.03)
    yield "noise", 300 + rng.normal(0, 20, slots)


def cases():
    rng = np.random.default_rng(20200712)
    for period, tau, slots, levels, repeats in [
        (0.005, 0.011, 17, 7, 12),  # the paper's camera
        (1 / 30, 0.010, 17, 7, 1),  # outside the exact reduction to one unknown per frame
        (0.005, 0.011, 9, 6, 1),
        (0.01, 0.011, 33, 7, 1),
    ]:
        for repeat in range(repeats):
            for name, y in windows(rng, slots, period / tau):
                y = np.clip(np.round(y, 2), 0, 655.35)
                for lam in (0.5, 0.05, 0.005):
                    received = np.ones(slots, bool)
                    if repeat >= 8:
                        received[rng.integers(1, slots - 1, 3)] = False
                    yield {
                        "name": name,
                        "period_s": period,
                        "tau_s": tau,
                        "levels": levels,
                        "half_square_lambda": lam,
                        "received": [int(r) for r in received],
                        "y_k": [round(float(v), 2) for v in y],
                        "last_bin_k": last_bin(y, received, period, tau, levels, lam),
                    }


def main():
    warnings.simplefilter("error", ConvergenceWarning)
    lines = ",\n".join(json.dumps(case) for case in cases())
    sys.stdout.write('{"source": "scikit-learn Lasso on all 2^levels unknowns", "cases": [\n' + lines + "\n]}\n")


if __name__ == "__main__":
    main()
