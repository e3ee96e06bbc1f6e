"""The estimation problem: a linear Gaussian model and what the sensor saw.

Question answered: what may a filter know?  State x = (r, m_1..m_M), n = 2 + 2M, in metres:

    x_k = F x_{k-1} + B + w_k,  w_k ~ N(0, Q),   x_0 ~ N(m0, P0),   z_k = H_k x_k + v_k,  v_k ~ N(0, R_k)

`Problem` is all that a real robot would have, `Experiment` adds what only a simulator knows; a solver is given the
first, so it cannot peek at the truth.  Time comes first in every array; the shapes of MATLAB end in `lab.records`.
Source: question 2 of the handout.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from data_simulation import Simulation
from lab import records
from lab.validation import Array, InputError, check_covariance, real_array

# Of a landmark's prior deviation, or of 1 m where that is wider. The handout's 1e-10 m is there for MATLAB's chol
# alone, while under a diffuse prior real motion, too, is a small part of the deviation.
NEGLIGIBLE_NOISE = 1e-8


@dataclass(frozen=True, eq=False)
class LinearGaussianModel:
    """The prior and the dynamics; arrays are checked, copied and read-only.

    Attributes
    ----------
    F : (n, n) array
        Transition matrix.
    B : (n,) array
        Constant input [m]: (I - F_R) c for the robot, 0 for landmarks.
    Q : (n, n) array
        Process noise covariance [m^2], possibly singular.
    m0 : (n,) array
        Prior mean [m].
    P0 : (n, n) array
        Prior covariance [m^2], possibly singular.

    Raises
    ------
    InputError
        A field has the wrong shape, is not finite, or is no covariance; the message names it.
    """

    F: Array
    B: Array
    Q: Array
    m0: Array
    P0: Array

    def __post_init__(self) -> None:
        """Check every field, the prior mean first because it fixes n."""
        m0 = real_array("m0", self.m0, (-1,))
        n = len(m0)
        if n < 4 or n % 2:
            raise InputError(f"m0 must have 2 + 2M components with M >= 1 landmarks, not {n}.")
        fields = {"m0": m0, "B": real_array("B", self.B, (n,))}
        fields |= {name: real_array(name, getattr(self, name), (n, n)) for name in ("F", "Q", "P0")}
        check_covariance("Q", fields["Q"])
        check_covariance("P0", fields["P0"])
        for name, array in fields.items():
            object.__setattr__(self, name, array)

    @cached_property
    def noise_cov(self) -> Array:
        """Q (n, n) as every solver uses it: negligible landmark noise counts as none.

        Negligible is a deviation below 1e-8 of the prior deviation, and below 1e-8 m.
        """
        variances, priors = np.diag(self.Q), np.diag(self.P0)
        negligible = np.sqrt(variances) < NEGLIGIBLE_NOISE * np.minimum(np.sqrt(priors), 1)
        negligible[:2] = False
        cov = self.Q.copy()
        cov[negligible, :] = cov[:, negligible] = 0
        cov.flags.writeable = False
        return cov

    @cached_property
    def moving(self) -> Any:
        """Indices (d,) of the components that a step can change; the others stay as they are."""
        still = (np.eye(len(self.m0)) == self.F).all(axis=1) & (self.B == 0) & (np.diag(self.noise_cov) == 0)
        return np.flatnonzero(~still)


@dataclass(frozen=True, eq=False)
class Problem:
    """A model and its measurements, NaN where nothing is seen; arrays are checked, copied and read-only.

    Attributes
    ----------
    model : LinearGaussianModel
    z : (N, 2M) array
        Measured vectors from the robot to each landmark [m]; row 0 is NaN, because there is no z_0.
    H : (N, 2M, n) array
        Measurement matrices; rows of unseen components are NaN.
    R : (N, 2M, 2M) array
        Measurement noise covariances [m^2]; rows and columns of unseen components are NaN.

    Raises
    ------
    InputError
        A shape is wrong, z_0 is there, or H or R has no usable value where z has one; the message says which and when.
    """

    model: LinearGaussianModel
    z: Array
    H: Array
    R: Array

    def __post_init__(self) -> None:
        """Check the arrays against the model and blank H and R where z is NaN."""
        n = len(self.model.m0)
        z = real_array("z", self.z, (-1, n - 2), finite=False)
        if not len(z):
            raise InputError("z must have at least one instant.")
        H = real_array("H", self.H, (len(z), n - 2, n), finite=False).copy()
        R = real_array("R", self.R, (len(z), n - 2, n - 2), finite=False).copy()
        unseen = np.isnan(z)
        if not unseen[0].all():
            raise InputError("z must be NaN at k = 0: the first measurement is taken at k = 1.")
        H[unseen] = np.nan
        R[unseen] = np.nan
        R.swapaxes(1, 2)[unseen] = np.nan
        for name, array in (("z", z), ("H", H), ("R", R)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        for k in range(len(z)):
            _, H_seen, R_seen = self.seen(k)
            if np.isnan(H_seen).any() or np.isnan(R_seen).any():
                name = "H" if np.isnan(H_seen).any() else "R"
                raise InputError(f"{name} at k = {k} is NaN where z has a value.")
            check_covariance(f"R at k = {k}", R_seen)

    @property
    def n_instants(self) -> int:
        """N, the number of instants, k = 0..N-1."""
        return len(self.z)

    @property
    def n_landmarks(self) -> int:
        """M, the number of landmarks."""
        return int(self.z.shape[1]) // 2

    def seen(self, k: int) -> tuple[Array, Array, Array]:
        """Return what was seen at instant k, without the NaN rows (and, for R, columns).

        Returns
        -------
        z : (p,) array
        H : (p, n) array
        R : (p, p) array
            p may be 0.
        """
        rows = np.flatnonzero(~np.isnan(self.z[k]))
        return self.z[k, rows], self.H[k, rows], self.R[k][np.ix_(rows, rows)]

    def with_landmark_noise(self, std: float) -> Self:
        """Return the problem whose MODEL lets every landmark move a little at each step.

        Independent noise of this deviation is added to Q for both coordinates of every landmark, so that the exact
        filter and the particle filters answer the same question.

        Parameters
        ----------
        std : float
            Standard deviation of the jitter per step [m].

        Raises
        ------
        InputError
            `std` is negative or not finite.

        Notes
        -----
        Source: questions 2b and 3 of the handout.
        """
        variance = float(real_array("The landmark noise", std, ())) ** 2
        if std < 0:
            raise InputError(f"The landmark noise must not be negative, but is {std}.")
        Q = self.model.Q + np.diag(np.r_[0, 0, np.full(len(self.model.m0) - 2, variance)])
        return replace(self, model=replace(self.model, Q=Q))


def require_problem(value: Any) -> Problem:
    """Return `value` when it is a Problem.

    Raises
    ------
    InputError
        It is something else; an Experiment is told where its problem is.
    """
    if not isinstance(value, Problem):
        hint = "; give experiment.problem, which does not know the truth" if isinstance(value, Experiment) else ""
        raise InputError(f"A solver filters a lab.problem.Problem, not {type(value).__name__}{hint}.")
    return value


@dataclass(frozen=True, eq=False)
class Experiment:
    """A problem together with what only a simulator knows.

    Attributes
    ----------
    problem : Problem
    truth : (N, n) array or None
        The true states [m]; a real robot has none.
    centre : (2,) array
        The point around which the robot turns [m].

    Raises
    ------
    InputError
        A shape is wrong or a value is not finite.
    """

    problem: Problem
    truth: Array | None
    centre: Array

    def __post_init__(self) -> None:
        """Check truth and centre against the problem."""
        object.__setattr__(self, "centre", real_array("centre", self.centre, (2,)))
        if self.truth is not None:
            shape = (self.problem.n_instants, len(self.problem.model.m0))
            object.__setattr__(self, "truth", real_array("truth", self.truth, shape))

    @classmethod
    def from_simulation(cls, simulation: Simulation) -> Self:
        """Return a simulation's experiment; this is where the handout's shapes become time first."""
        return cls._of(records.from_handout(simulation._asdict()))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a .mat file of the original lab (either edition) or our own .npz.

        Raises
        ------
        InputError
            The file is missing, not of these kinds, lacks a variable, or holds one that cannot be used; the message
            starts with the file's name.
        """
        try:
            return cls._of(records.read(path))
        except InputError as error:
            raise error if str(path) in str(error) else InputError(f"{path}: {error}") from None

    def save(self, path: str | Path) -> None:
        """Write an .npz, or a .mat with the handout's names that MATLAB and Octave read.

        T, Hfull and Rv are not in the .mat, since an experiment knows only what was seen; no filter uses them.

        Raises
        ------
        InputError
            The ending is neither, or the file cannot be written.
        """
        model = self.problem.model
        fields: dict[str, Any] = {name: getattr(model, name) for name in ("F", "B", "Q", "m0", "P0")}
        fields |= {name: getattr(self.problem, name) for name in ("z", "H", "R")}
        records.write(path, {**fields, "truth": self.truth, "centre": self.centre})

    @classmethod
    def _of(cls, fields: dict[str, Any]) -> Self:
        model = LinearGaussianModel(*(fields[name] for name in ("F", "B", "Q", "m0", "P0")))
        return cls(Problem(model, fields["z"], fields["H"], fields["R"]), fields["truth"], fields["centre"])
