"""Optimisers on membranes in closed form: how many evaluations each takes, and what it does where a trial has no state.

    uv run python tests/benchmarks/optimisers.py
    uv run --with nlopt python tests/benchmarks/optimisers.py      NLopt's MMA and CCSA too

Seconds. The thickness of a membrane in n rings is free; its rise is to be large, with limits on stretch, margin to the limit
point and mass. Past the limit point there is no state: an evaluation fails. The table in `softmodels.design.optimise` is from
here.
"""

from __future__ import annotations

import warnings

import numpy as np
from scipy.optimize import NonlinearConstraint, minimize

from softmodels.design.optimise import search
from softmodels.design.problem import Scaled

MOST = 100
"""Evaluations after which a method is stopped."""


class NoStateError(Exception):
    """The pressure is above the limit."""


class Membrane:
    """Values and gradients by scaled thicknesses; each evaluation is counted, none is made twice.

    Args:
        n: Rings.
        margin, pressure, mass, stretch: Limits and load, in numbers of size one.
    """

    def __init__(self, n, margin, pressure, mass, stretch):
        generator = np.random.default_rng(n)
        self.weights = generator.uniform(0.5, 1.5, n)
        self.weights /= self.weights.sum()
        self.effects = generator.uniform(0.7, 1.4, n)
        self.limits = margin, pressure, mass, stretch
        self.known, self.best, self.least = {}, np.nan, np.inf

    def values(self, x):
        margin, pressure, mass, stretch = self.limits
        h = 0.5 + 2.5 * x
        limit = 7.2 / np.sqrt((self.weights / h**2).sum())
        if pressure > limit:
            raise NoStateError
        rise = 8 * (pressure * (self.weights * self.effects / h).sum()) ** (1 / 3) * (1 + 0.15 * (pressure / limit) ** 4)
        most = 1 + 0.005 * rise**2 * (1 + 0.5 * (self.weights * (h - h.mean()) ** 2).sum())
        return np.array([-rise / 10, most / stretch - 1, 1 - limit / pressure / margin, (self.weights * h).sum() / mass - 1])

    def __call__(self, x):
        key = np.asarray(x).tobytes()
        if key not in self.known:
            if len(self.known) >= MOST:
                raise StopIteration
            self.known[key] = self._evaluated(np.array(x))
        return self.known[key]

    def _evaluated(self, x):
        try:
            values, slopes = self.values(x), np.empty((4, len(x)))
        except NoStateError:
            return None
        for k, step in enumerate(1e-6 * np.eye(len(x))):
            try:
                slopes[:, k] = (self.values(x + step) - self.values(x - step)) / 2e-6
            except NoStateError:
                slopes[:, k] = (self.values(x + np.abs(step)) - values) / 1e-6
        worst = values[1:].max()
        self.least = min(self.least, worst)
        if worst <= 1e-4:
            self.best = np.fmin(self.best, values[0])
        return values, slopes


def elastic(membrane, start):
    def evaluate(x):
        found = membrane(x)
        return found and Scaled(found[0][0], found[1][0], found[0][1:] + 2e-4, found[1][1:])

    search(evaluate, start)


def slsqp(membrane, start):
    base = [membrane(start)]

    def at(x):
        return membrane(x) or base[0]

    def slope(x):
        base[0] = at(x)
        return base[0][1][0]

    limits = {"type": "ineq", "fun": lambda x: -at(x)[0][1:], "jac": lambda x: -at(x)[1][1:]}
    minimize(lambda x: at(x)[0][0], start, jac=slope, method="SLSQP", bounds=[(0, 1)] * len(start), constraints=limits,
             options={"maxiter": 60, "ftol": 1e-4})  # fmt: skip


def trust_constr(membrane, start):
    base = membrane(start)

    def at(x):
        return membrane(x) or (np.full(4, 10.0), base[1])

    limits = NonlinearConstraint(lambda x: at(x)[0][1:], -np.inf, 0, jac=lambda x: at(x)[1][1:])
    minimize(lambda x: at(x)[0][0], start, jac=lambda x: at(x)[1][0], method="trust-constr", bounds=[(0, 1)] * len(start),
             constraints=limits, options={"gtol": 1e-4, "xtol": 1e-4, "maxiter": MOST})  # fmt: skip


def of_nlopt(name):
    import nlopt

    def run(membrane, start):
        method = nlopt.opt(getattr(nlopt, name), len(start))
        method.set_lower_bounds(np.zeros(len(start)))
        method.set_upper_bounds(np.ones(len(start)))

        def value(x, slope):
            found = membrane(x)
            if found is not None and slope.size:
                slope[:] = found[1][0]
            return np.inf if found is None else found[0][0]

        def limits(result, x, slopes):
            found = membrane(x)
            result[:] = np.inf if found is None else found[0][1:]
            if found is not None and slopes.size:
                slopes[:] = found[1][1:]

        method.set_min_objective(value)
        method.add_inequality_mconstraint(limits, np.full(3, 1e-4))
        method.set_ftol_rel(1e-4)
        method.set_xtol_rel(1e-4)
        method.optimize(start)

    return run


PROBLEMS = {
    "limits inactive at the start": ((1.3, 9.0, 2.6, 2.4), 0.75),
    "trial points without a state": ((1.03, 9.0, 2.2, 4.0), 0.6),
    "limits broken at the start": ((1.5, 6.0, 2.2, 1.7), 0.35),
    "limits that exclude each other": ((1.6, 9.0, 1.6, 1.6), 0.75),
}
METHODS = {"SLSQP, elastic": elastic, "SLSQP": slsqp, "trust-constr": trust_constr}
try:
    METHODS |= {"MMA": of_nlopt("LD_MMA"), "CCSA": of_nlopt("LD_CCSAQ")}
except ImportError:
    print("nlopt is not installed, so MMA and CCSA are left out")


def main():
    warnings.simplefilter("ignore")
    print(f"{'problem':32s} {'method':16s} " + " ".join(f"{f'n = {n}':>28s}" for n in (3, 8, 20)))
    for problem, (limits, start) in PROBLEMS.items():
        for name, method in METHODS.items():
            cells = []
            for n in (3, 8, 20):
                membrane = Membrane(n, *limits)
                try:
                    method(membrane, np.full(n, start))
                    end = ""
                except Exception as error:  # each library has its own ways to give up
                    end = "" if isinstance(error, StopIteration | RuntimeError) else f" {type(error).__name__}"
                best = f"best {membrane.best:.4f}" if np.isfinite(membrane.best) else f"least {membrane.least:+.4f}"
                cells.append(f"{len(membrane.known):3d} ({best}){end}")
            print(f"{problem:32s} {name:16s} " + " ".join(f"{cell:>28s}" for cell in cells))


if __name__ == "__main__":
    main()
