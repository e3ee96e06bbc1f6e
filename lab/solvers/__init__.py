"""The filters: exact Kalman, and particle filters that all run through one loop.

``SOLVERS`` names the particle solvers; ``resolve`` turns what a person types into one, a student's own included.
"""

from lab.solvers.elimination import SmoothedMap, smooth_map
from lab.solvers.exact import Smoothed, kalman, smoother
from lab.solvers.particle import guided, particle_steps, rbpf, sir, sis
from lab.solvers.proposals import Cloud, prior
from lab.solvers.protocol import Proposal, Solver, check_filtered
from lab.solvers.registry import SOLVERS, resolve

__all__ = [
    "SOLVERS",
    "Cloud",
    "Proposal",
    "Smoothed",
    "SmoothedMap",
    "Solver",
    "check_filtered",
    "guided",
    "kalman",
    "particle_steps",
    "prior",
    "rbpf",
    "resolve",
    "sir",
    "sis",
    "smooth_map",
    "smoother",
]
