"""Solà's symbols: r = [x, y, a] robot, u control, n its noise; the value first, then R_r = dr'/dr and R_n = dr'/dn.

Question answered: where is the robot after a control, and how does that depend on where it was and on the noise?

    u = [dx, da]      a step forward, then a turn (the guide's listing)
    u = [dx, dy, da]  the increment of a pose (the guide's appendix)

Position by `from_frame`, angle by sum and wrap; the noise is added to the control and has its components.
Source: J. Solà (2014), function ``move`` and appendix A.
"""

import numpy as np

from lab.ekfslam.frames import from_frame, wrap
from lab.validation import Array, InputError


def move(r: Array, u: Array, n: Array | None = None) -> tuple[Array, Array, Array]:
    """Return the pose after a control.

    Parameters
    ----------
    r : (3,) array
        Pose [m, m, rad].
    u : (2,) or (3,) array
        Control [m, rad] or [m, m, rad].
    n : array, optional
        Noise on the control, of its shape; none by default.

    Returns
    -------
    r : (3,) array
        Heading wrapped.
    R_r : (3, 3) array
    R_n : (3, 2) or (3, 3) array

    Raises
    ------
    InputError
        The control has neither two nor three components.

    Source: J. Solà (2014), section 2 and appendix A.
    """
    size = len(u)
    if size not in (2, 3):
        raise InputError(f"A control has 2 components (forward, turn) or 3 (forward, left, turn), not {size}.")
    if n is not None:
        u = u + n
    step = u[:2] if size == 3 else np.array([u[0], 0.0])
    position, P_r, P_step = from_frame(r, step)
    R_r, R_n = np.eye(3), np.zeros((3, size))
    R_r[:2] = P_r
    R_n[:2, :-1] = P_step[:, : size - 1]
    R_n[2, -1] = 1
    return np.array([position[0], position[1], wrap(r[2] + u[-1])]), R_r, R_n
